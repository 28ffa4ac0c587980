/* The n-th call for memory, to OpenCL or to a file fails, for n = 1, 2, ...: every time there is a status with a
 * message, or the result is that of an undisturbed run; nothing leaks, and no file is left half-written.
 *
 * At most FAULT_RUNS runs (10 by default, "all" for every n) are spread over the calls of a stage; "chains" and "sites"
 * choose them by their callers (fault_chain.h). To reproduce a
 * failure: FAULT_ONLY=STAGE:KIND:N (or a part of it from the left); FAULT_TRACE=1 names each run before it starts. */
#include <dirent.h>
#include <errno.h>

#include "fault.h"
#include "fault_chain.h"
#include "fault_job.h"
#include "testing.h"

static const char *const kinds[FAULT_KINDS] = {"none", "memory", "opencl", "map", "file"};

static const struct stage {
    const char *name;
    fault_stage run;
    int share; /* of the runs, in percent: stages with a context of their own are slow */
} stages[] = {
    {"context", fault_stage_context, 50},
    {"whole", fault_stage_whole, 8},
    {"binaries", fault_stage_binaries, 15},
    {"simulate", fault_stage_simulate, 100},
    {"occlusion", fault_stage_occlusion, 30},
    {"fit", fault_stage_fit, 100},
    {"psf", fault_stage_psf, 100},
    {"reconstruct", fault_stage_reconstruct, 100},
    {"classic", fault_stage_classic, 60},
    {"jobs", fault_stage_jobs, 50},
    {"net", fault_stage_net, 60},
    {"training step", fault_stage_training_step, 60},
    {"trainer", fault_stage_trainer, 60},
    {"devices", fault_stage_devices, 30},
    {"register", fault_stage_register, 10},
    {"lpips", fault_stage_lpips, 10},
    {"model_file", fault_stage_model_file, 100},
    {"tiff", fault_stage_tiff, 100},
    {"files", fault_stage_files, 100},
    {"preview", fault_stage_preview, 100},
    {"clfft", fault_stage_clfft, 6},
    {"judging", fault_stage_judging, 30},
    {"surface", fault_stage_surface, 30},
    {"optics", fault_stage_optics, 10},
    {"tuning", fault_stage_tuning, 6},
    {"offline", fault_stage_offline, 20},
    {"tasks", fault_stage_tasks, 10},
    {"training", fault_stage_training, 10},
};

/* Deletes what a stage wrote and returns how many files have a name that says "half-written". */
static int sweep(const char *folder)
{
    int half = 0;
    DIR *all = opendir(folder);
    assert_non_null(all);
    for (struct dirent *entry; (entry = readdir(all));) {
        char path[512];
        struct stat info;
        if (!strcmp(entry->d_name, ".") || !strcmp(entry->d_name, ".."))
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        if (!lstat(path, &info) && S_ISDIR(info.st_mode)) {
            half += sweep(path);
            continue;
        }
        const char *dot = strrchr(entry->d_name, '.');
        half += !dot || (strcmp(dot, ".model") && strcmp(dot, ".tif") && strcmp(dot, ".png") && strcmp(dot, ".sums") &&
                         strcmp(dot, ".bin"));
        if (half)
            print_message("left behind: %s\n", path);
        unlink(path);
    }
    closedir(all);
    return half;
}

static int fits(fault_kind kind, hada_status status, const char *message)
{
    if (kind == FAULT_MEMORY) /* where the system's reason is quoted, it may be memory as well */
        return status == HADA_ERROR_MEMORY || status == HADA_ERROR_DEVICE_MEMORY ||
               (status == HADA_ERROR_FILE_WRITE && strstr(message, strerror(ENOMEM)));
    if (kind == FAULT_FILE) /* a binary that cannot be read is one that has to be made */
        return (status >= HADA_ERROR_FILE_OPEN && status <= HADA_ERROR_FILE_WRITE) ||
               (status == HADA_ERROR_BUILD && strstr(message, "that can be read"));
    return status == HADA_ERROR_DEVICE_MEMORY || (status >= HADA_ERROR_NO_DEVICE && status <= HADA_ERROR_SELF_TEST);
}

static const char *struck_name(void)
{
    return fault_struck() ? fault_struck() : "nothing";
}

/* One run with a fault. Returns 1 when it was noticed, 0 when the job went on without harm; counts what is wrong. */
static int run_one(fault_job *job, const struct stage *stage, fault_kind kind, long n, uint64_t expected, int *wrong)
{
    hada_error error = {0};
    const uint64_t before = hada_context_bytes(job->context) + hada_context_bytes(job->part);
    const int wrong_before = *wrong;
    if (getenv("FAULT_TRACE"))
        fprintf(stderr, "FAULT_ONLY=%s:%s:%ld\n", stage->name, kinds[kind], n);
    job->sum = 0;
    fault_arm(kind, n);
    const hada_status status = stage->run(job, &error);
    const long memory = fault_memory_left(), objects = fault_objects_alive();
    fault_disarm();
    *wrong += memory != 0;
    *wrong += objects != 0;
    *wrong += hada_context_bytes(job->context) + hada_context_bytes(job->part) != before;
    *wrong += sweep(job->folder) != 0;
    if (status) {
        *wrong += !fits(kind, status, error.message);
        *wrong += error.status != status;
        *wrong += strlen(error.message) < 10;
    } else {
        *wrong += job->sum != expected;
    }
    if (*wrong != wrong_before)
        print_message("FAULT_ONLY=%s:%s:%ld (%s): %s '%s'; alive: %ld pieces of memory, %ld objects, %llu bytes on the "
                      "device; results %s\n",
                      stage->name, kinds[kind], n, struck_name(), hada_status_name(status), error.message, memory,
                      objects,
                      (unsigned long long)(hada_context_bytes(job->context) + hada_context_bytes(job->part) - before),
                      status || job->sum == expected ? "as they should be" : "wrong");
    return status != HADA_OK;
}

static fault_chains chains;

static long runs_of(const struct stage *stage, long calls)
{
    const char *words = getenv("FAULT_RUNS");
    if (fault_choice_asked())
        return chains.count;
    if (words && !strcmp(words, "all"))
        return calls;
    long runs = (words ? atol(words) : 10) * stage->share / 100;
    return runs < 1 ? 1 : runs > calls ? calls : runs;
}

TEST(every_call_may_fail)
{
    fault_job *job = *state;
    const char *only = getenv("FAULT_ONLY");
    int wrong = 0;
    for (size_t s = 0; s < sizeof stages / sizeof *stages; s++)
        for (fault_kind kind = FAULT_MEMORY; kind < FAULT_KINDS; kind++) {
            const struct stage *stage = &stages[s];
            char name[64];
            long n = 0, noticed = 0, runs, calls = 0;
            uint64_t expected = 0;
            snprintf(name, sizeof name, "%s:%s:", stage->name, kinds[kind]);
            if (only && strncmp(only, name, strlen(name)) && strncmp(only, name, strlen(only)))
                continue;
            for (int warm = 0; warm < 2; warm++) { /* the first run may keep programs for later ones */
                hada_error error = {0};
                job->sum = 0;
                fault_chains_listen(warm && fault_choice_asked() ? &chains : NULL, fault_choice_asked());
                fault_arm(kind, 0);
                if (stage->run(job, &error))
                    fail_msg("%s without faults: %s", stage->name, error.message);
                fault_chains_listen(NULL, FAULT_SPREAD);
                if (warm)
                    assert_true(fault_memory_left() == 0 && fault_objects_alive() == 0);
                calls = fault_disarm();
                expected = job->sum;
                sweep(job->folder);
            }
            const int single = only && strlen(only) > strlen(name);
            runs = single ? 1 : runs_of(stage, calls);
            if (!calls)
                continue;
            for (long r = 0; r < runs; r++) {
                n = single ? atol(only + strlen(name)) : fault_choice_asked() ? chains.first[r] : 1 + r * calls / runs;
                noticed += run_one(job, stage, kind, n, expected, &wrong);
            }
            print_message("%-12s %-7s %5ld calls, %4ld of %4ld faults noticed\n", stage->name, kinds[kind], calls,
                          noticed, runs);
            /* and the context works on */
            hada_error error = {0};
            job->sum = 0;
            if (stage->run(job, &error) || job->sum != expected)
                fail_msg("%s after faults: %s", stage->name, error.message);
            sweep(job->folder);
        }
    assert_int_equal(wrong, 0);
}

static int begin(void **state)
{
    static fault_job job;
    fault_job_begin(&job);
    *state = &job;
    return 0;
}

static int end(void **state)
{
    fault_job_end(*state);
    return 0;
}

FIXTURE_OF_EACH(begin, end)
