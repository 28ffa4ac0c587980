#include "fault_job.h"

#include <fcntl.h>
#include <xxhash.h>

#include "fft/fft.h"
#include "testing.h"

static const double distances[JOB_DEPTHS] = {100.0, 300.0};

void fault_add(fault_job *job, const void *data, size_t bytes)
{
    job->sum = XXH3_64bits_withSeed(data, bytes, job->sum);
}

void fault_add_image(fault_job *job, const hada_image *image)
{
    fault_add(job, image->data, hada_image_count(image) * sizeof *image->data);
}

/* The true functions: reading what was written is not part of the stage. */
int __real_open(const char *path, int flags, ...);
ssize_t __real_read(int fd, void *data, size_t bytes);
int __real_close(int fd);

static void add_file(fault_job *job, const char *path)
{
    unsigned char bytes[4096];
    const int fd = __real_open(path, O_RDONLY);
    assert_true(fd >= 0);
    for (ssize_t got; (got = __real_read(fd, bytes, sizeof bytes)) > 0;)
        fault_add(job, bytes, (size_t)got);
    __real_close(fd);
}

static void path_in(const fault_job *job, char *out, const char *name)
{
    snprintf(out, 256, "%s/%s", job->folder, name);
}

hada_status fault_camera_make(hada_camera *camera, hada_error *err)
{
    hada_camera_init(camera);
    camera->lenses = 7;
    camera->channels = 1;
    HADA_TRY(hada_camera_set_depths(camera, distances[0], distances[1], JOB_DEPTHS, err));
    return hada_camera_resize(camera, JOB_ROWS, JOB_COLS, JOB_WINDOW, JOB_WINDOW, err);
}

static hada_status copy(hada_image *out, const hada_image *image, hada_error *err)
{
    HADA_TRY(hada_image_create(out, 1, image->rows, image->cols, err));
    memcpy(out->data, image->data, hada_image_count(image) * sizeof *image->data);
    return HADA_OK;
}

static hada_status simulate(fault_job *job, hada_context *context,
                            hada_status (*take)(fault_job *, int, int, const hada_image *, const hada_image *,
                                                hada_error *),
                            hada_error *err)
{
    hada_camera camera;
    SCOPED(hada_simulator) *simulator = NULL;
    hada_status status = fault_camera_make(&camera, err);
    if (!status)
        status = hada_simulator_create(&simulator, context, &camera, NULL, err);
    for (int k = 0; !status && k < JOB_DEPTHS * JOB_PAIRS; k++) {
        SCOPED(hada_image) scene = {0}, raw = {0};
        status = hada_scene_procedural(&scene, (uint64_t)k + 1, 1, JOB_WINDOW, JOB_WINDOW, err);
        const hada_plane plane = {k / JOB_PAIRS, &scene};
        if (!status)
            status = hada_simulator_render(simulator, &plane, 1, 0.01, (uint64_t)k, &raw, err);
        if (!status)
            status = take(job, k / JOB_PAIRS, k % JOB_PAIRS, &scene, &raw, err);
    }
    return status;
}

static hada_status keep(fault_job *job, int z, int i, const hada_image *scene, const hada_image *raw, hada_error *err)
{
    HADA_TRY(copy(&job->scene[z][i], scene, err));
    return copy(&job->frame[z][i], raw, err);
}

static hada_status only_look(fault_job *job, int z, int i, const hada_image *scene, const hada_image *raw,
                             hada_error *err)
{
    (void)z;
    (void)i;
    (void)scene;
    (void)err;
    fault_add_image(job, raw);
    return HADA_OK;
}

hada_status fault_stage_simulate(fault_job *job, hada_error *err)
{
    return simulate(job, job->context, only_look, err);
}

hada_fit_options fault_fit_options(void)
{
    return helpers_fit(JOB_DEPTHS, 1, distances, JOB_ROWS, JOB_COLS, JOB_WINDOW);
}

static hada_status fit(fault_job *job, hada_context *context, hada_model **model, const char *sums, hada_error *err)
{
    static const int counts[JOB_DEPTHS] = {JOB_PAIRS, JOB_PAIRS}, scored[JOB_DEPTHS] = {1, 1};
    hada_fit_options options = fault_fit_options();
    hada_image firsts[2][JOB_DEPTHS];
    hada_fitter *fitter = NULL;
    hada_dataset *pairs = NULL, *first = NULL;
    hada_status status = HADA_OK;
    options.refine_steps = 4;
    options.refine_tv = 0.003;
    for (int z = 0; z < JOB_DEPTHS; z++) {
        firsts[0][z] = job->frame[z][0];
        firsts[1][z] = job->scene[z][0];
    }
    HADA_TRY_OR_DONE(
        hada_dataset_from_images(&pairs, JOB_DEPTHS, distances, counts, job->frame[0], job->scene[0], err));
    HADA_TRY_OR_DONE(hada_dataset_from_images(&first, JOB_DEPTHS, distances, scored, firsts[0], firsts[1], err));
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, context, &options, err));
    HADA_TRY_OR_DONE(hada_fitter_add(fitter, pairs, err));
    if (sums) {
        HADA_TRY_OR_DONE(hada_fitter_save_sums(fitter, sums, err));
        HADA_TRY_OR_DONE(hada_fitter_load_sums(fitter, sums, err));
    }
    HADA_TRY_OR_DONE(hada_fitter_finish(fitter, first, model, err));
    for (const hada_fit_filter_score *const *row = hada_fitter_get_info(fitter)->scores->filters; *row; row++)
        fault_add(job, *row, sizeof **row);
done:
    hada_fitter_destroy(&fitter);
    hada_dataset_destroy(&pairs);
    hada_dataset_destroy(&first);
    return status;
}

hada_status fault_stage_fit(fault_job *job, hada_error *err)
{
    SCOPED(hada_model) *model = NULL;
    char sums[256];
    path_in(job, sums, "new.sums");
    return fit(job, job->context, &model, sums, err);
}

hada_status fault_stage_psf(fault_job *job, hada_error *err)
{
    hada_camera camera;
    hada_image psf[JOB_DEPTHS] = {{0}};
    hada_model *model = NULL, *half = NULL, *matched = NULL;
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = JOB_WINDOW;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(fault_camera_make(&camera, err));
    for (int z = 0; z < JOB_DEPTHS; z++)
        HADA_TRY_OR_DONE(hada_camera_psf(&camera, distances[z], 0, 0, &psf[z], err));
    HADA_TRY_OR_DONE(hada_model_from_psf(&model, job->context, psf, JOB_DEPTHS, distances, &options, err));
    HADA_TRY_OR_DONE(hada_model_with_form(&matched, model, HADA_FORM_MATCHED, 0.0, err));
    HADA_TRY_OR_DONE(hada_model_to_half(&half, model, err));
    fault_add(job, &hada_model_get_info(half)->bytes, sizeof(uint64_t));
done:
    hada_model_destroy(&half);
    hada_model_destroy(&matched);
    hada_model_destroy(&model);
    for (int z = 0; z < JOB_DEPTHS; z++)
        hada_image_destroy(&psf[z]);
    return status;
}

static hada_status reconstruct(fault_job *job, hada_context *context, const hada_model *model, int steps,
                               hada_result *result, hada_error *err)
{
    hada_plan *plan = NULL;
    DEFAULTS(hada_plan_options, options);
    options.refine = steps;
    hada_status status = hada_plan_create(&plan, context, model, &options, err);
    for (int i = 0; !status && i < JOB_PAIRS; i++)
        status = hada_plan_run(plan, &job->frame[1][i], result, err);
    hada_plan_destroy(&plan);
    for (int z = 0; !status && z < result->depths; z++)
        fault_add_image(job, &result->planes[z]);
    if (!status)
        fault_add_image(job, &result->all_in_focus);
    return status;
}

hada_status fault_stage_reconstruct(fault_job *job, hada_error *err)
{
    SCOPED(hada_result) result = {0};
    return reconstruct(job, job->context, job->model, 3, &result, err);
}

/* A context on a part of the device (where it has parts) beside the job's own. */
static hada_status open_part(const fault_job *job, hada_context **context, hada_error *err)
{
    const hada_device_info *device = hada_context_device(job->context);
    DEFAULTS(hada_context_options, options);
    options.cache = job->cache;
    options.skip_self_test = 1;
    options.part = options.parts = device->max_sub_devices >= 2 && device->compute_units >= 2 ? 2 : 0;
    return hada_context_create(context, &options, err);
}

static hada_status run_jobs(fault_job *job, hada_plan *plan, hada_error *err)
{
    enum { FRAMES = JOB_PAIRS * JOB_DEPTHS };
    hada_result results[FRAMES] = {{0}};
    hada_job *jobs[FRAMES] = {NULL};
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < FRAMES; i++)
        status = hada_job_submit(&jobs[i], plan, &job->frame[i % JOB_DEPTHS][i / JOB_DEPTHS], &results[i], err);
    for (int i = 0; i < FRAMES; i++) {
        if (!status && jobs[i])
            status = hada_job_wait(jobs[i], err);
        hada_job_destroy(&jobs[i]);
        if (!status)
            fault_add_image(job, &results[i].all_in_focus);
        hada_result_destroy(&results[i]);
    }
    return status;
}

hada_status fault_stage_jobs(fault_job *job, hada_error *err)
{
    hada_context *contexts[2] = {job->context, NULL};
    hada_plan *plan = NULL;
    DEFAULTS(hada_plan_options, options);
    options.refine = 0;
    options.queues = 2;
    options.batch = 1; /* none that is smaller, whose programs would be new and kept */
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(open_part(job, &contexts[1], err));
    HADA_TRY_OR_DONE(hada_plan_create_on(&plan, contexts, 2, job->model, &options, err));
    HADA_TRY_OR_DONE(run_jobs(job, plan, err));
done:
    hada_plan_destroy(&plan);
    hada_context_destroy(&contexts[1]);
    return status;
}

hada_status fault_stage_model_file(fault_job *job, hada_error *err)
{
    char path[256];
    SCOPED(hada_model) *model = NULL;
    path_in(job, path, "new.model");
    HADA_TRY(hada_model_save(job->model, path, err));
    HADA_TRY(hada_model_load(&model, path, err));
    fault_add(job, &hada_model_get_info(model)->refine_rho, sizeof(double));
    return HADA_OK;
}

static hada_status write_stack(const fault_job *job, const char *path, hada_tiff_layout layout, hada_error *err)
{
    hada_tiff_writer *writer = NULL;
    DEFAULTS(hada_tiff_write_options, options);
    options.layout = layout;
    options.slices = JOB_DEPTHS;
    options.times = 1;
    options.distances_mm = distances;
    options.compress = layout == HADA_TIFF_PAGES;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_create(&writer, path, 1, JOB_ROWS, JOB_COLS, &options, err));
    for (int z = 0; z < JOB_DEPTHS; z++)
        HADA_TRY_OR_DONE(hada_tiff_write(writer, &job->frame[z][0], err));
    HADA_TRY_OR_DONE(hada_tiff_finish(&writer, err));
done:
    hada_tiff_abandon(&writer);
    return status;
}

hada_status fault_stage_tiff(fault_job *job, hada_error *err)
{
    static const char *const names[] = {"new.tif", "new_pages.tif"};
    hada_status status = HADA_OK;
    for (int k = 0; !status && k < 2; k++) {
        char path[256];
        hada_image image = {0};
        path_in(job, path, names[k]);
        status = write_stack(job, path, k ? HADA_TIFF_PAGES : HADA_TIFF_HYPERSTACK, err);
        for (int z = 0; !status && z < JOB_DEPTHS; z++) {
            status = hada_tiff_load(path, z, &image, err);
            if (!status)
                fault_add_image(job, &image);
            hada_image_destroy(&image);
        }
    }
    return status;
}

hada_status fault_stage_preview(fault_job *job, hada_error *err)
{
    char path[256];
    hada_preview preview = {.size = sizeof preview, .gamma = HADA_AUTO, .title = "faults"};
    preview.raw = &job->frame[1][0];
    preview.all_in_focus = &job->result.all_in_focus;
    preview.planes = job->result.planes;
    preview.depths = job->result.depths;
    preview.distances_mm = job->result.distances_mm;
    preview.distance_map = &job->result.distance_map;
    path_in(job, path, "new.png");
    HADA_TRY(hada_preview_save(path, &preview, err));
    add_file(job, path);
    return HADA_OK;
}

/* One transform forward and back. */
hada_status fault_stage_clfft(fault_job *job, hada_error *err)
{
    SCOPED(hada_slot) *slot = NULL;
    hada_fft *plan = NULL;
    hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, 16, 12, 2);
    hada_status status = hada_slot_create(&slot, job->context, err);
    desc.backend = HADA_FFT_CLFFT;
    for (int k = 0; !status && k < 2; k++) {
        desc.direction = k ? HADA_FFT_INVERSE : HADA_FFT_FORWARD;
        status = hada_fft_create(&plan, slot, &desc, err);
        hada_fft_destroy(&plan);
    }
    return status;
}

static hada_status open_context(const fault_job *job, hada_context **context, const char *cache, hada_error *err)
{
    (void)job;
    DEFAULTS(hada_context_options, options);
    options.cache = cache;
    return hada_context_create(context, &options, err);
}

hada_status fault_stage_context(fault_job *job, hada_error *err)
{
    SCOPED(hada_context) *context = NULL;
    hada_device_list *list;
    hada_status status = hada_device_list_create(&list, err);
    hada_device_list_destroy(&list);
    if (!status)
        status = open_context(job, &context, job->cache, err);
    return status;
}

hada_status fault_stage_binaries(fault_job *job, hada_error *err)
{
    char folder[256];
    path_in(job, folder, "binaries");
    return hada_programs_save(job->context, folder, NULL, err);
}

hada_status fault_stage_whole(fault_job *job, hada_error *err)
{
    hada_context *context = NULL;
    hada_model *model = NULL;
    hada_result result = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(open_context(job, &context, "off", err));
    HADA_TRY_OR_DONE(fit(job, context, &model, NULL, err));
    HADA_TRY_OR_DONE(reconstruct(job, context, model, 3, &result, err));
done:
    hada_result_destroy(&result);
    hada_model_destroy(&model);
    if (context)
        assert_int_equal(hada_context_bytes(context), 0);
    hada_context_destroy(&context);
    return status;
}

void fault_job_begin(fault_job *job)
{
    *job = (fault_job){.folder = "/tmp/hadalens-faults-XXXXXX"};
    assert_non_null(mkdtemp(job->folder));
    path_in(job, job->cache, "cache");
    snprintf(job->offline, sizeof job->offline, "%s.offline", job->folder); /* beside what stages are judged by */
    snprintf(job->set, sizeof job->set, "%s.set", job->folder);
    ASSERT_OK(open_context(job, &job->context, "off", err));
    ASSERT_OK(open_part(job, &job->part, err));
    ASSERT_OK(simulate(job, job->context, keep, err));
    ASSERT_OK(fit(job, job->context, &job->model, NULL, err));
    /* whichever queue does which job, its programs have been made */
    ASSERT_OK(reconstruct(job, job->context, job->model, 0, &job->result, err));
    ASSERT_OK(reconstruct(job, job->context, job->model, 3, &job->result, err));
}

void fault_job_end(fault_job *job)
{
    char command[600];
    hada_result_destroy(&job->result);
    hada_model_destroy(&job->model);
    for (int k = 0; k < JOB_DEPTHS * JOB_PAIRS; k++) {
        hada_image_destroy(&job->scene[k / JOB_PAIRS][k % JOB_PAIRS]);
        hada_image_destroy(&job->frame[k / JOB_PAIRS][k % JOB_PAIRS]);
    }
    assert_int_equal(hada_context_bytes(job->context), 0);
    hada_context_destroy(&job->context);
    hada_context_destroy(&job->part);
    snprintf(command, sizeof command, "rm -rf '%s' '%s' '%s'", job->folder, job->offline, job->set);
    assert_int_equal(system(command), 0);
}
