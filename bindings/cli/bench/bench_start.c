/* From nothing to the first frame, in a process of its own: with caches that are empty, and with what that left. */
#include "bench.h"

#include <errno.h>
#include <fcntl.h>
#include <hadalens/folder.h>
#include <hadalens/tiff.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

enum { STEPS = 5, MOST = 16, COLD = 2, WARM = 5 };
static const char *const step_names[STEPS] = {"whole process", "open", "plan", "first frame", "close"};

/* Where drivers and the library keep what they have compiled. */
static const char *const cache_variables[] = {"POCL_CACHE_DIR",      "CUDA_CACHE_PATH",       "NEO_CACHE_DIR",
                                              "AMD_COMGR_CACHE_DIR", "MESA_SHADER_CACHE_DIR", "XDG_CACHE_HOME"};
/* Goes: the library's own choice of a cache is what is measured. */
static const char own_variable[] = "HADALENS_CACHE=";
enum { VARIABLES = sizeof cache_variables / sizeof *cache_variables };

static hada_status load_frame(hada_image *raw, const char *path, hada_error *err)
{
    const hada_status status = hada_tiff_load(path, 0, raw, err);
    if (status)
        hada_cli_prefix(err, "%s: ", path);
    return status;
}

hada_status hada_bench_first_frame(hada_cli *cli, const char *model_path, const char *frame, int linear,
                                   hada_error *err)
{
    enum { OPEN, MODEL, PLAN, FIRST, SECOND, CLOSE, TIMES };
    static const char *const names[TIMES] = {"open", "model", "plan", "first frame", "second frame", "close"};
    hada_context *context = NULL;
    hada_model *model = NULL;
    hada_plan *plan = NULL;
    hada_plan_options options;
    hada_image raw = {0};
    hada_result result = {0};
    double at[TIMES + 1];
    hada_bench_mode_options(!linear, &options);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(load_frame(&raw, frame, err));
    at[OPEN] = hada_cli_seconds();
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, err));
    at[MODEL] = hada_cli_seconds();
    HADA_TRY_OR_DONE(hada_model_load(&model, model_path, err));
    at[PLAN] = hada_cli_seconds();
    HADA_TRY_OR_DONE(hada_plan_create(&plan, context, model, &options, err));
    at[FIRST] = hada_cli_seconds();
    HADA_TRY_OR_DONE(hada_plan_run(plan, &raw, &result, err));
    at[SECOND] = hada_cli_seconds();
    HADA_TRY_OR_DONE(hada_plan_run(plan, &raw, &result, err));
    at[CLOSE] = hada_cli_seconds();
    hada_plan_destroy(&plan);
    hada_cli_close(cli, &context); /* what was compiled goes into the cache now */
    at[TIMES] = hada_cli_seconds();
    json_t *seconds = json_object();
    for (int i = 0; i < TIMES; i++) {
        json_object_set_new(seconds, names[i], json_real(at[i + 1] - at[i]));
        hada_cli_say(cli, "%-12s %8.3f s", names[i], at[i + 1] - at[i]);
    }
    json_object_set_new(cli->document, "seconds", seconds);
done:
    hada_plan_destroy(&plan);
    hada_cli_close(cli, &context);
    hada_model_destroy(&model);
    hada_image_destroy(&raw);
    hada_result_destroy(&result);
    return status;
}

/* The environment with all caches in one folder; the array alone and its first VARIABLES texts are on the heap. */
static char **environment_with(const char *folder)
{
    size_t count = 0, n = 0;
    while (environ[count])
        count++;
    char **all = hada_cli_memory(count + VARIABLES + 1, sizeof *all);
    for (; n < VARIABLES; n++)
        all[n] = hada_cli_text("%s=%s", cache_variables[n], folder);
    for (size_t i = 0; i < count; i++) {
        int replaced = !strncmp(environ[i], own_variable, strlen(own_variable));
        for (size_t k = 0; k < VARIABLES; k++) {
            const size_t length = strlen(cache_variables[k]);
            replaced |= !strncmp(environ[i], cache_variables[k], length) && environ[i][length] == '=';
        }
        if (!replaced)
            all[n++] = environ[i];
    }
    return all;
}

static hada_status spawn(char *const *words, char *const *environment, const char *output, double *seconds,
                         hada_error *err)
{
    posix_spawn_file_actions_t actions;
    pid_t child;
    int state = 0;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, output, O_WRONLY | O_CREAT | O_TRUNC, 0666);
    const double start = hada_cli_seconds();
    int code = posix_spawn(&child, "/proc/self/exe", &actions, NULL, words, environment);
    posix_spawn_file_actions_destroy(&actions);
    if (code)
        return hada_cli_error(err, HADA_ERROR_STATE, "a process for the cold start could not be made: %s",
                              strerror(code));
    while (waitpid(child, &state, 0) < 0)
        if (errno != EINTR)
            return hada_cli_error(err, HADA_ERROR_STATE, "a process for the cold start was lost: %s", strerror(errno));
    *seconds = hada_cli_seconds() - start;
    HADA_TRY(hada_cli_check_signals(err));
    if (!WIFEXITED(state) || WEXITSTATUS(state))
        HADA_TRY(hada_cli_error(err, HADA_ERROR_DEVICE,
                                "a process that makes one frame failed; its message stands above. The cold start can "
                                "be left out with --no-start"));
    return HADA_OK;
}

static hada_status read_steps(const char *path, double seconds[STEPS], hada_error *err)
{
    json_error_t error;
    json_t *document = json_load_file(path, 0, &error), *part = json_object_get(document, "seconds");
    hada_status status = HADA_OK;
    for (int i = 1; i < STEPS; i++) {
        seconds[i] = json_number_value(json_object_get(part, step_names[i]));
        if (!json_is_number(json_object_get(part, step_names[i])))
            status = hada_cli_error(err, HADA_ERROR_STATE, "a process that makes one frame said nothing of its time");
    }
    json_decref(document);
    return status;
}

static hada_status one_start(hada_bench *bench, const hada_bench_device *device, const char *model, const char *frame,
                             const char *caches, double seconds[STEPS], hada_error *err)
{
    char *output = hada_cli_text("%s/first-frame.json", bench->scratch);
    char **environment = environment_with(caches);
    const char *words[16] = {"hadalens", "bench",    "--first-frame", "-m",     model,
                             frame,      "--device", device->index,   "--json", "--quiet"};
    int count = 10;
    if (device->common.binaries) {
        words[count++] = "--binaries";
        words[count++] = device->common.binaries;
    }
    if (device->common.shape) {
        words[count++] = "--shape";
        words[count++] = device->common.shape;
    }
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(spawn((char *const *)words, environment, output, &seconds[0], err));
    HADA_TRY_OR_DONE(read_steps(output, seconds, err));
done:
    for (int i = 0; i < VARIABLES; i++)
        free(environment[i]);
    free(environment);
    free(output);
    return status;
}

static void add_rows(hada_bench *bench, const hada_bench_device *device, const char *workload, const char *kind,
                     double values[STEPS][MOST], int count)
{
    for (int i = 0; i < STEPS; i++)
        hada_bench_add(bench, device->info.name, workload, HADA_BENCH_START, "s", -1,
                       hada_bench_figure_of(values[i], count), "%s, %s, %s", hada_bench_mode_names[!bench->quick], kind,
                       step_names[i]);
}

static hada_status cold_and_warm(hada_bench *bench, const hada_bench_device *device, const char *workload,
                                 const char *model, const char *frame, hada_error *err)
{
    double values[2][STEPS][MOST];
    int count[2] = {0, 0};
    const int colds = bench->quick ? 1 : COLD;
    hada_status status = HADA_OK;
    char *caches = NULL;
    for (int i = 0; i < colds + WARM; i++) {
        const int warm = i >= colds;
        double seconds[STEPS];
        if (!warm) { /* the warm starts find what the last cold one left */
            if (caches)
                hada_folder_remove(caches);
            free(caches);
            caches = hada_cli_text("%s/caches-%s-%d", bench->scratch, device->index, i);
            HADA_TRY_OR_DONE(hada_folder_ensure(caches, err));
        }
        HADA_TRY_OR_DONE(one_start(bench, device, model, frame, caches, seconds, err));
        for (int s = 0; s < STEPS; s++)
            values[warm][s][count[warm]] = seconds[s];
        count[warm]++;
        hada_cli_progress_step(bench->cli, NULL);
    }
    add_rows(bench, device, workload, "cold", values[0], count[0]);
    add_rows(bench, device, workload, "warm", values[1], count[1]);
done:
    if (caches)
        hada_folder_remove(caches);
    free(caches);
    return status;
}

hada_status hada_bench_start(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                             hada_error *err)
{
    hada_cli_progress progress;
    char *model = hada_cli_text("%s/start.model", bench->scratch),
         *frame = hada_cli_text("%s/start.tif", bench->scratch);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_model_save(workload->model, model, err));
    HADA_TRY_OR_DONE(hada_tiff_save(frame, &workload->raw[0], NULL, err));
    hada_cli_progress_begin(bench->cli, &progress, "cold and warm starts", (bench->quick ? 1 : COLD) + WARM);
    HADA_TRY_OR_DONE(cold_and_warm(bench, device, workload->name, model, frame, err));
done:
    hada_cli_progress_end(bench->cli);
    free(model);
    free(frame);
    return status;
}
