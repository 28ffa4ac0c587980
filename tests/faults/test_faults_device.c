/* Devices that lack what others have: every time a message that says what to do, never a crash. */
#include "fault.h"
#include "fault_job.h"
#include "model/model.h"
#include "runtime/program.h"
#include "testing.h"

static int begin(void **state)
{
    static fault_job job;
    fault_job_begin(&job);
    *state = &job;
    return 0;
}

static int end(void **state)
{
    fault_pretend = (fault_device){0};
    fault_job_end(*state);
    return 0;
}

static hada_status open_context(hada_context **context, const char *binaries, const char *cache, hada_error *err)
{
    DEFAULTS(hada_context_options, options);
    options.binaries = binaries;
    options.cache = cache;
    return hada_context_create(context, &options, err);
}

static void reconstruct_one(const fault_job *job, hada_context *context)
{
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_plan_options, options);
    ASSERT_OK(hada_plan_create(&plan, context, job->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &job->frame[0][0], &result, err));
}

TEST(nothing_installed)
{
    for (int k = 0; k < 2; k++) {
        hada_context *context;
        hada_device_list *list;
        hada_error error = {0};
        fault_pretend = (fault_device){.no_platform = !k, .no_device = k};
        assert_int_equal(hada_device_list_create(&list, &error), HADA_ERROR_NO_DEVICE);
        assert_null(list);
        assert_non_null(strstr(error.message, "pocl-opencl-icd"));
        assert_int_equal(open_context(&context, NULL, "off", &error), HADA_ERROR_NO_DEVICE);
        assert_null(context);
    }
    fault_pretend = (fault_device){0};
}

TEST(without_a_compiler_only_binaries_serve)
{
    fault_job *job = *state;
    char folder[256];
    hada_context *context;
    hada_error error = {0};
    /* a disk cache that has seen the job is a folder of binaries as well */
    snprintf(folder, sizeof folder, "%s/kernels", job->folder);
    ASSERT_OK(open_context(&context, NULL, folder, err));
    reconstruct_one(job, context);
    hada_context_destroy(&context);
    fault_pretend = (fault_device){.no_compiler = 1};
    assert_int_equal(open_context(&context, NULL, "off", &error), HADA_ERROR_BUILD);
    assert_null(context);
    assert_non_null(strstr(error.message, "cannot compile"));
    assert_non_null(strstr(error.message, "--save-binaries"));
    ASSERT_OK(open_context(&context, folder, "off", err));
    assert_int_equal(hada_context_device(context)->has_compiler, 0);
    reconstruct_one(job, context);
    assert_int_equal(context->programs->compiled, 0);
    assert_true(context->programs->loaded > 0);
    /* nor does clFFT compile behind our back, whatever a tuning file says */
    fault_job offline = *job;
    offline.context = context;
    assert_int_equal(fault_stage_clfft(&offline, &error), HADA_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "at run time"));
    hada_context_destroy(&context);
    fault_pretend = (fault_device){0};
}

TEST(tiny_pieces_of_memory_are_refused_with_sizes)
{
    fault_job *job = *state;
    hada_context *context;
    hada_plan *plan;
    hada_error error = {0};
    DEFAULTS(hada_plan_options, options);
    fault_pretend = (fault_device){.max_allocation_bytes = 2048};
    ASSERT_OK(open_context(&context, NULL, "off", err));
    assert_int_equal(hada_plan_create(&plan, context, job->model, &options, &error), HADA_ERROR_DEVICE_MEMORY);
    assert_null(plan);
    assert_non_null(strstr(error.message, "in one piece"));
    assert_int_equal(hada_context_bytes(context), 0);
    hada_context_destroy(&context);
    /* too little even for the self-test */
    fault_pretend = (fault_device){.max_allocation_bytes = 16};
    assert_int_equal(open_context(&context, NULL, "off", &error), HADA_ERROR_DEVICE_MEMORY);
    assert_null(context);
    assert_non_null(strstr(error.message, "the self-test"));
    fault_pretend = (fault_device){0};
}

/* A fitter whose end tries refinement on the pairs. */
static void make_fitter(hada_fitter **fitter, hada_dataset **pairs, const fault_job *job, hada_context *context)
{
    static const int counts[JOB_DEPTHS] = {JOB_PAIRS, JOB_PAIRS};
    hada_fit_options options = fault_fit_options();
    options.outside = 1.0;
    ASSERT_OK(hada_fitter_create(fitter, context, &options, err));
    ASSERT_OK(
        hada_dataset_from_images(pairs, JOB_DEPTHS, options.distances_mm, counts, job->frame[0], job->scene[0], err));
    ASSERT_OK(hada_fitter_add(*fitter, *pairs, err));
}

static int untried;

static void hear(void *user, hada_log_level level, const char *message)
{
    (void)user;
    untried += level == HADA_LOG_WARNING && strstr(message, "no memory to try refinement") != NULL;
}

static size_t filter_bytes(const hada_model *model)
{
    const hada_model_info *info = &model->info;
    return 2 * sizeof(float) * (size_t)(info->depths * info->channels) * (size_t)info->grid_rows *
           (size_t)(info->grid_cols / 2 + 1);
}

/* Where the trial is short of memory the model is there all the same, and that is said; a device that is lost is an
 * error wherever it is lost. */
TEST(a_fit_goes_on_without_its_trial_for_want_of_memory_alone)
{
    static const cl_int codes[] = {CL_MEM_OBJECT_ALLOCATION_FAILURE, CL_DEVICE_NOT_AVAILABLE};
    static const hada_status statuses[] = {HADA_ERROR_DEVICE_MEMORY, HADA_ERROR_DEVICE};
    SCOPED(hada_context) * context;
    hada_fitter *fitter;
    hada_dataset *pairs;
    hada_model *tried, *model;
    DEFAULTS(hada_context_options, options);
    options.log = hear;
    ASSERT_OK(hada_context_create(&context, &options, err));
    make_fitter(&fitter, &pairs, *state, context);
    ASSERT_OK(hada_fitter_finish(fitter, pairs, &tried, err));
    assert_int_equal(untried, 0);
    for (int kind = 0; kind < 2; kind++) {
        int gone_on = 0, failed = 0, reached = 1;
        for (long n = 1; reached; n += n < 20 ? 3 : n / 3) {
            hada_error error = {0};
            untried = 0;
            fault_lose(&(fault_device_loss){context->cl, n, 1, codes[kind]});
            const hada_status status = hada_fitter_finish(fitter, pairs, &model, &error);
            fault_lose(NULL);
            failed += status != HADA_OK;
            gone_on += untried;
            if (status)
                assert_int_equal(status, statuses[kind]);
            reached = status || untried;
            if (!status)
                assert_memory_equal(model->filter, tried->filter, filter_bytes(model));
            hada_model_destroy(&model);
        }
        assert_true(failed && !gone_on == (codes[kind] == CL_DEVICE_NOT_AVAILABLE));
    }
    hada_model_destroy(&tried);
    hada_fitter_destroy(&fitter);
    hada_dataset_destroy(&pairs);
    assert_int_equal(hada_context_bytes(context), 0);
}

FIXTURE(begin, end)
