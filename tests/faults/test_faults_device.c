/* Devices that lack what others have: every time a message that says what to do, never a crash. */
#include <stdlib.h>
#include <string.h>

#include "fault.h"
#include "fault_job.h"
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
    hada_context_options options;
    hada_context_options_init(&options);
    options.binaries = binaries;
    options.cache = cache;
    return hada_context_create(context, &options, err);
}

static void reconstruct_one(const fault_job *job, hada_context *context)
{
    hada_plan *plan;
    hada_plan_options options;
    hada_result result = {0};
    hada_plan_options_init(&options);
    ASSERT_OK(hada_plan_create(&plan, context, job->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &job->frame[0][0], &result, err));
    hada_result_destroy(&result);
    hada_plan_destroy(&plan);
}

static void nothing_installed(void **state)
{
    (void)state;
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

static void without_a_compiler_only_binaries_serve(void **state)
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
    assert_int_equal(hada_context_programs_compiled(context), 0);
    assert_true(hada_context_programs_loaded(context) > 0);
    /* nor does clFFT compile behind our back, whatever a tuning file says */
    fault_job offline = *job;
    offline.context = context;
    assert_int_equal(fault_stage_clfft(&offline, &error), HADA_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "at run time"));
    hada_context_destroy(&context);
    fault_pretend = (fault_device){0};
}

static void tiny_pieces_of_memory_are_refused_with_sizes(void **state)
{
    fault_job *job = *state;
    hada_context *context;
    hada_plan *plan;
    hada_plan_options options;
    hada_error error = {0};
    hada_plan_options_init(&options);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_installed),
        cmocka_unit_test(without_a_compiler_only_binaries_serve),
        cmocka_unit_test(tiny_pieces_of_memory_are_refused_with_sizes),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
