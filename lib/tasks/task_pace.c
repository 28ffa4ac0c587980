/* Steps of refinement that keep up with a camera: plans with fewer and fewer take the first frames of its files. */
#include <hadalens/task_reconstruct.h>

#include "core/callers.h"
#include "core/clock.h"
#include "dispatch/plan.h"
#include "tasks/frames.h"

/* Frames at most; the first one compiles, and of a sequence it begins from nothing: the others are timed. */
enum { FRAMES = 5 };

typedef struct trial {
    const hada_model *model;
    hada_plan_options options;
    hada_context *const *contexts;
    const char *const *paths;
    int context_count, count;
    double encoding;
    const hada_monitor *monitor;
    float *stacks[FRAMES]; /* of all steps */
    int frames, most;      /* how many; the most steps of any */
} trial;

static size_t values_of(const hada_result *result)
{
    return (size_t)result->depths * hada_image_count(&result->planes[0]);
}

/* Keeps the planes of all steps, or adds their difference from these and their squares. */
static hada_status compare(trial *of, const hada_result *result, int number, double sums[2], hada_error *err)
{
    const size_t values = values_of(result);
    const float *now = result->planes[0].data;
    const int steps = result->report->refine_steps;
    of->most = steps > of->most ? steps : of->most;
    if (number == of->frames) {
        HADA_TRY(HADA_NEW_RAW(of->stacks[number], values, "the planes of the first frames", err));
        memcpy(of->stacks[number], now, values * sizeof *now);
        of->frames++;
    }
    for (size_t i = 0; i < values; i++) {
        const double whole = of->stacks[number][i], other = now[i] - whole;
        sums[0] += other * other;
        sums[1] += whole * whole;
    }
    return HADA_OK;
}

/* The first frames with so many steps: seconds a frame, and the part of the planes that differs. */
static hada_status try_steps(trial *of, int steps, double *seconds, double *change, hada_error *err)
{
    hada_plan *plan = NULL;
    hada_stream stream = {0};
    double began = 0.0, sums[2] = {0.0, 0.0};
    int done = 0;
    hada_status status = HADA_OK;
    of->options.refine = steps;
    HADA_TRY_OR_DONE(hada_plan_create_on(&plan, of->contexts, of->context_count, of->model, &of->options, err));
    HADA_TRY_OR_DONE(hada_stream_begin(&stream, plan, of->model, of->paths, of->count, of->encoding,
                                       hada_files_ahead(plan), of->monitor, err));
    for (hada_streamed *frame; done < FRAMES && (frame = hada_stream_next(&stream)); done++) {
        *err = frame->error;
        HADA_TRY_OR_DONE(frame->status);
        if (!done)
            began = hada_seconds();
        *seconds = hada_seconds() - began;
        HADA_TRY_OR_DONE(compare(of, &frame->result, done, sums, err));
    }
    HADA_TRY_OR_DONE(hada_monitor_check(of->monitor, err));
    if (done < 2)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT, "two frames or more are needed to find steps that keep up with them"));
    *seconds /= done - 1;
    *change = sums[1] > 0.0 ? sqrt(sums[0] / sums[1]) : 0.0;
done:
    hada_stream_end(&stream);
    hada_plan_destroy(&plan);
    return status;
}

/* Between none and all steps, which are too slow, by halves. */
static hada_status search(trial *of, double enough, hada_pace *pace, hada_error *err)
{
    int fewest = 0, most = of->most;
    while (most - fewest > 1) {
        const int steps = (fewest + most) / 2;
        double seconds = 0.0, change = 0.0;
        HADA_TRY(try_steps(of, steps, &seconds, &change, err));
        hada_monitor_tell(of->monitor, HADA_MESSAGE_DETAIL, "%d steps: %.3g s a frame, planes change by %.2g %%", steps,
                          seconds, 100.0 * change);
        if (seconds <= enough)
            fewest = steps;
        else
            most = steps;
        if (seconds <= enough || steps == 1) {
            pace->steps = steps;
            pace->seconds = seconds;
            pace->change = change;
        }
    }
    return HADA_OK;
}

hada_status hada_files_pace(hada_pace *pace, hada_context *const *contexts, int context_count, const hada_model *model,
                            const hada_plan_options *options, const char *const *paths, int count,
                            const hada_files_task *task, double fps, hada_error *err)
{
    hada_files_task files;
    trial of = {.model = model, .contexts = contexts, .paths = paths, .context_count = context_count, .count = count};
    hada_pace own = {0};
    hada_status status = HADA_OK;
    HADA_NEED(pace && contexts && model && paths, err);
    HADA_TRY(HADA_REPORT_CHECK(pace, hada_pace, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&files, task, hada_files_task, err));
    of.encoding = files.frame_encoding;
    of.monitor = files.monitor;
    if (!(fps > 0.0 && fps < INFINITY))
        HADA_TRY(
            hada_fail(err, HADA_ERROR_ARGUMENT, "%g frames a second cannot be kept up with; more than 0 can", fps));
    HADA_TRY(HADA_OPTIONS_TAKE(&of.options, options, hada_plan_options, err));
    own.steps = of.options.refine;
    HADA_TRY_OR_DONE(try_steps(&of, own.steps, &own.seconds, &own.change, err));
    own.seconds_whole = own.seconds;
    if (own.seconds > 1.0 / fps && of.most > 1 && !(of.options.classic && of.options.classic->method))
        HADA_TRY_OR_DONE(search(&of, 1.0 / fps, &own, err));
    HADA_REPORT_GIVE(pace, &own);
done:
    for (int i = 0; i < of.frames; i++)
        free(of.stacks[i]);
    return status;
}
