/* A small camera with as many depths as real ones, its frames, and what one lane makes of them: for tests of jobs. */
#ifndef HADA_TESTS_JOB_FIXTURE_H
#define HADA_TESTS_JOB_FIXTURE_H

#include <hadalens/opencl.h>
#include <stdatomic.h>

#include "camera_small.h"

enum { JOB_ROWS = 24, JOB_COLS = 32, JOB_WINDOW = 12, JOB_DEPTHS = 14, JOB_CHANNELS = 3, JOB_FRAMES = 6 };
enum { JOB_LINEAR, JOB_LISTED, JOB_REFINED, JOB_PURSUED, JOB_KINDS };

typedef struct job_fixture {
    hada_context *whole, *part[2]; /* the device, and the same in two parts */
    hada_model *model;
    hada_image frames[JOB_FRAMES];
    hada_plan_options options[JOB_KINDS];
    hada_result expected[JOB_KINDS][JOB_FRAMES];
} job_fixture;

/* Warnings of all contexts. */
static atomic_int job_warnings;
/* Where not NULL: whoever takes a message asks this plan for its queues, as a program may. */
static _Atomic(hada_plan *) job_asked;

static inline void job_log(void *user, hada_log_level level, const char *message)
{
    (void)user;
    hada_plan *plan = atomic_load(&job_asked);
    if (plan)
        hada_plan_queues(plan, NULL, 0);
    job_warnings += level == HADA_LOG_WARNING && *message;
}

/* Queues of a plan that get no further until they are let go, so that what a test does meanwhile it does in the midst
 * of a frame, whoever gets a turn first. */
enum { JOB_HELD = 4 };
typedef struct job_gate {
    int count;
    cl_event open[JOB_HELD];
} job_gate;

/* While no frame runs. */
static inline job_gate job_hold(const hada_plan *plan, int first, int count)
{
    job_gate gate = {.count = count};
    for (int i = 0; i < count; i++) {
        const cl_command_queue queue = hada_plan_cl_queue(plan, first + i);
        cl_context context;
        cl_int code;
        assert_int_equal(clGetCommandQueueInfo(queue, CL_QUEUE_CONTEXT, sizeof context, &context, NULL), CL_SUCCESS);
        gate.open[i] = clCreateUserEvent(context, &code);
        assert_int_equal(code, CL_SUCCESS);
        assert_int_equal(clEnqueueMarkerWithWaitList(queue, 1, &gate.open[i], NULL), CL_SUCCESS);
        assert_int_equal(clFlush(queue), CL_SUCCESS);
    }
    return gate;
}

static inline void job_let_go(const job_gate *gate)
{
    for (int i = 0; i < gate->count; i++) {
        assert_int_equal(clSetUserEventStatus(gate->open[i], CL_COMPLETE), CL_SUCCESS);
        clReleaseEvent(gate->open[i]);
    }
}

static inline int job_same(const hada_result *a, const hada_result *b)
{
    return same_result(a, b) && !memcmp(a->report->occupied, b->report->occupied, (size_t)a->depths) &&
           a->report->refine_steps == b->report->refine_steps;
}

static inline void job_make_frames(job_fixture *f)
{
    hada_image psf[JOB_DEPTHS];
    double distances[JOB_DEPTHS];
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = JOB_WINDOW;
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    for (int z = 0; z < JOB_DEPTHS; z++) {
        distances[z] = 100.0 * (z + 1);
        psf[z] = small_psf(JOB_CHANNELS, JOB_ROWS, JOB_COLS, 12, (uint64_t)z + 1);
    }
    for (int i = 0; i < JOB_FRAMES; i++) {
        SCOPED(hada_image) scene = small_scene(JOB_CHANNELS, JOB_WINDOW, JOB_WINDOW, (uint64_t)i + 1);
        f->frames[i] = small_frame(&psf[3 * i % JOB_DEPTHS], &scene, 0, 0.003, (uint64_t)i + 1);
    }
    ASSERT_OK(hada_model_from_psf(&f->model, f->whole, psf, JOB_DEPTHS, distances, &options, err));
    destroy_images(psf, JOB_DEPTHS);
}

static inline void job_open(job_fixture *f)
{
    DEFAULTS(hada_context_options, options);
    options.log = job_log;
    ASSERT_OK(hada_context_create(&f->whole, &options, err));
    open_parts(f->whole, &options, f->part);
}

static inline int job_setup(void **state)
{
    static const int listed[] = {1, 2, 6, 7, 8, 13};
    static job_fixture f;
    job_open(&f);
    job_make_frames(&f);
    for (int kind = 0; kind < JOB_KINDS; kind++) {
        SCOPED(hada_plan) * plan;
        hada_plan_options_init(&f.options[kind]);
        f.options[kind].refine = kind >= JOB_REFINED ? 4 : 0;
        f.options[kind].refine_tv = HADA_REFINE_TV_FRAME; /* frames come in any order */
        f.options[kind].dark = HADA_DARK_NONE;
        f.options[kind].occupied = kind == JOB_PURSUED  ? HADA_OCCUPIED_AUTO
                                   : kind == JOB_LINEAR ? HADA_OCCUPIED_ALL
                                                        : HADA_OCCUPIED_LIST;
        f.options[kind].occupied_list = f.options[kind].occupied == HADA_OCCUPIED_LIST ? listed : NULL;
        f.options[kind].occupied_count = f.options[kind].occupied_list ? 6 : 0;
        ASSERT_OK(hada_plan_create(&plan, f.whole, f.model, &f.options[kind], err));
        for (int i = 0; i < JOB_FRAMES; i++)
            ASSERT_OK(hada_plan_run(plan, &f.frames[i], &f.expected[kind][i], err));
    }
    *state = &f;
    return 0;
}

static inline int job_teardown(void **state)
{
    job_fixture *f = *state;
    for (int i = 0; i < JOB_FRAMES; i++) {
        hada_image_destroy(&f->frames[i]);
        for (int kind = 0; kind < JOB_KINDS; kind++)
            hada_result_destroy(&f->expected[kind][i]);
    }
    hada_model_destroy(&f->model);
    hada_context *contexts[] = {f->whole, f->part[0], f->part[1]};
    for (int i = 0; i < 3; i++) {
        close_context(&contexts[i]);
    }
    return 0;
}

#endif
