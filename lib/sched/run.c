/* One frame through a plan. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "core/alloc.h"
#include "filter/dark.h"
#include "program/kernel.h"
#include "sched/frame.h"
#include "sched/plan.h"
#include "sched/result.h"

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Waits for the stage and adds its time to *total. */
static hada_status stop_watch(hada_plan *plan, double *start, double *total, hada_error *err)
{
    hada_status status = hada_slot_finish(plan->slot, err);
    const double now = seconds();
    *total += now - *start;
    *start = now;
    return status;
}

/* *bad: the number of NaN and infinite pixels, above 0 only where the plan repairs them. */
static hada_status check_frame(const hada_plan *plan, const hada_image *raw, size_t *bad, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    if (raw->channels != info->channels || raw->rows != info->raw_rows || raw->cols != info->raw_cols)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the frame has %d channel(s) of %d x %d pixels; the model %s is for %d channel(s) of %d x %d: use "
            "the model of this camera, or make one with fit",
            raw->channels, raw->rows, raw->cols, info->name, info->channels, info->raw_rows, info->raw_cols);
    *bad = hada_image_count_not_finite(raw);
    if (*bad && !plan->options.repair_not_finite)
        return hada_fail(
            err, HADA_ERROR_NOT_FINITE,
            "%zu pixel(s) of the frame are NaN or infinite; repair them from their neighbours with --repair, "
            "or mend the file",
            *bad);
    return HADA_OK;
}

static double energy_above(const hada_image *frame, const double *levels, const hada_image *dark)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    double sum = 0;
    for (int channel = 0; channel < frame->channels; channel++)
        for (size_t i = (size_t)channel * pixels; i < (size_t)(channel + 1) * pixels; i++) {
            const double value = frame->data[i] - levels[channel] - (dark->data ? dark->data[i] : 0.0f);
            sum += value * value;
        }
    return sum;
}

/* Fills plan->levels; the report takes their mean. */
static hada_status find_levels(hada_plan *plan, const hada_image *frame, hada_report *report, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    const hada_dark dark = plan->options.dark;
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    const double level = dark == HADA_DARK_MODEL   ? info->dark
                         : dark == HADA_DARK_LEVEL ? plan->options.dark_level
                                                   : 0.0;
    /* a model asks for the level of each frame by a dark level below zero */
    const int each = dark == HADA_DARK_AUTO || (dark == HADA_DARK_MODEL && info->dark < 0);
    void *room = NULL;
    hada_status status = each ? hada_alloc_raw(&room, pixels, sizeof(float), "the dark level", err) : HADA_OK;
    for (int channel = 0; !status && channel < frame->channels; channel++) {
        plan->levels[channel] = each ? hada_dark_estimate(frame->data + (size_t)channel * pixels, pixels, room) : level;
        report->dark += plan->levels[channel] / frame->channels;
    }
    free(room);
    return status;
}

static hada_status upload(hada_plan *plan, const hada_image *raw, size_t bad, double *energy, hada_report *report,
                          hada_error *err)
{
    hada_image repaired = {0};
    const hada_image *frame = raw;
    hada_status status = HADA_OK;
    if (bad) {
        status = hada_image_create(&repaired, raw->channels, raw->rows, raw->cols, err);
        if (!status) {
            memcpy(repaired.data, raw->data, hada_image_count(raw) * sizeof(float));
            status = hada_frame_repair(&repaired, &report->repaired_pixels, err);
        }
        frame = &repaired;
    }
    if (!status)
        status = find_levels(plan, frame, report, err);
    if (!status)
        status = hada_hadamard_frame(plan->stage, frame->data, plan->levels, err);
    if (!status && plan->shape.refined)
        *energy = energy_above(frame, plan->levels, &plan->dark_frame);
    hada_image_destroy(&repaired);
    return status;
}

static hada_status clip(hada_plan *plan, size_t count, hada_error *err)
{
    cl_kernel kernel;
    const size_t local = 64, global = (count + 8 * local - 1) / (8 * local) * local;
    const cl_ulong offset = 0, values = count;
    hada_status status = hada_slot_kernel(plan->slot, "sched_clip", "sched_clip", "", &kernel, err);
    hada_arg args[] = {HADA_ARG(plan->planes.mem), HADA_ARG(offset), HADA_ARG(values)};
    if (!status)
        status = hada_slot_launch(plan->slot, kernel, "sched_clip", 1, &global, &local, args, HADA_COUNT(args), err);
    return status;
}

static hada_status linear(hada_plan *plan, hada_result *result, double *watch, hada_error *err)
{
    hada_report *report = &result->report;
    const size_t plane = hada_plan_plane(plan);
    hada_status status = hada_hadamard_run(plan->stage, plan->bank, 0, plan->shape.depths, plan->planes.mem, 0, err);
    if (!status)
        status = clip(plan, plane * (size_t)plan->shape.depths, err);
    if (!status)
        status = stop_watch(plan, watch, &report->seconds_linear, err);
    memcpy(report->occupied, plan->listed, (size_t)plan->shape.depths);
    if (!status)
        status = hada_focus_begin(plan->focus, report->occupied, err);
    if (!status)
        status = hada_focus_push(plan->focus, 0, plan->shape.depths, plan->planes.mem, 0, err);
    if (!status)
        status = hada_focus_finish(plan->focus, plan->pictures.mem, 0, plan->pictures.mem, plane, NULL, err);
    if (!status)
        status = stop_watch(plan, watch, &report->seconds_focus, err);
    for (int z = 0; z < plan->shape.depths; z++) {
        if (!report->occupied[z]) /* the user knows that nothing is there */
            memset(result->planes[z].data, 0, plane * sizeof(float));
        else if (!status)
            status = hada_buffer_read(&plan->planes, plan->slot, (size_t)z * plane * sizeof(float),
                                      result->planes[z].data, plane * sizeof(float), err);
        report->occupied_count += report->occupied[z];
    }
    return status;
}

static hada_status refine(hada_plan *plan, int count, double energy, hada_result *result, double *watch,
                          hada_error *err)
{
    hada_report *report = &result->report;
    const hada_model_info *info = hada_model_get_info(plan->model);
    hada_refine_rule rule;
    size_t first;
    int together;
    hada_refine_data data = {.spectrum = plan->stage->spectrum.mem,
                             .frame = plan->stage->raw.mem,
                             .otf = hada_bank_otf(plan->bank, 0, &first, &together),
                             .otf_depths = plan->shape.depths,
                             .prior = plan->prior.mem};
    data.otf_offset = first * plan->bank->layout.count;
    hada_refine_rule_init(&rule);
    const double gain = hada_model_gain(plan->model);
    rule.steps = plan->shape.steps;
    rule.rho = info->refine_rho * gain;
    rule.stop = plan->options.refine < 0 ? HADA_REFINE_STOP : 0;
    hada_status status =
        hada_refiner_run(plan->refiner, &data, &rule, 1, count, plan->occupied, &report->refine_steps, err);
    double left = 0;
    if (!status)
        status = hada_refiner_residual(plan->refiner, &data, 1, count, plan->occupied, &left, err);
    if (!status && energy > 0) {
        report->residual = sqrt(left / energy);
        /* the first step is the joint linear filter; what it left is met in the second */
        if (info->boundary == HADA_BOUNDARY_CIRCULAR && report->refine_steps > 1)
            report->residual_linear = sqrt(hada_refiner_energy(plan->refiner, 0, 1) / energy);
    }
    if (!status)
        status = stop_watch(plan, watch, &report->seconds_refine, err);
    return status;
}

/* Focus over the refined planes, which stand in the order of plan->occupied, and their way home. */
static hada_status refined_pictures(hada_plan *plan, int count, hada_result *result, double *watch, hada_error *err)
{
    const size_t plane = hada_plan_plane(plan);
    cl_mem planes = hada_refiner_planes(plan->refiner);
    hada_status status = hada_focus_begin(plan->focus, result->report.occupied, err);
    for (int place = 0; !status && place < count; place++)
        status = hada_focus_push(plan->focus, plan->occupied[place], 1, planes, (size_t)place * plane, err);
    if (!status)
        status = hada_focus_finish(plan->focus, plan->pictures.mem, 0, plan->pictures.mem, plane, NULL, err);
    if (!status)
        status = stop_watch(plan, watch, &result->report.seconds_focus, err);
    for (int place = 0; !status && place < count; place++) {
        cl_int code =
            clEnqueueReadBuffer(plan->slot->queue, planes, CL_TRUE, (size_t)place * plane * sizeof(float),
                                plane * sizeof(float), result->planes[plan->occupied[place]].data, 0, NULL, NULL);
        if (code != CL_SUCCESS)
            status = hada_fail_cl(err, code, "clEnqueueReadBuffer");
    }
    return status;
}

/* A frame that no depth explains: everything dark, no distance anywhere. */
static void nothing_there(hada_result *result)
{
    memset(result->all_in_focus.data, 0, hada_image_count(&result->all_in_focus) * sizeof(float));
    for (size_t i = 0; i < hada_image_count(&result->distance_map); i++)
        result->distance_map.data[i] = NAN;
}

static hada_status refined(hada_plan *plan, double energy, hada_result *result, double *watch, hada_error *err)
{
    hada_report *report = &result->report;
    int count = 0;
    hada_status status = HADA_OK;
    if (plan->shape.pursuit) {
        status = hada_plan_find_occupied(plan, &count, err);
        if (!status)
            status = stop_watch(plan, watch, &report->seconds_pursuit, err);
    } else {
        for (int z = 0; z < plan->shape.depths; z++)
            if (plan->listed[z])
                plan->occupied[count++] = z;
    }
    for (int z = 0; z < plan->shape.depths; z++)
        memset(result->planes[z].data, 0, hada_plan_plane(plan) * sizeof(float));
    memset(report->occupied, 0, (size_t)plan->shape.depths);
    for (int i = 0; i < count; i++)
        report->occupied[plan->occupied[i]] = 1;
    report->occupied_count = count;
    if (status)
        return status;
    if (!count) {
        nothing_there(result);
        return HADA_OK;
    }
    status = refine(plan, count, energy, result, watch, err);
    return status ? status : refined_pictures(plan, count, result, watch, err);
}

static void apply_gamma(hada_image *image, double gamma)
{
    const size_t count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        image->data[i] = powf(fmaxf(image->data[i], 0.0f), (float)gamma);
}

static hada_status run(hada_plan *plan, const hada_image *raw, size_t bad, hada_result *result, hada_error *err)
{
    hada_report *report = &result->report;
    const size_t plane = hada_plan_plane(plan);
    double start = seconds(), watch = start, energy = 0;
    hada_status status = upload(plan, raw, bad, &energy, report, err);
    if (!status)
        status = stop_watch(plan, &watch, &report->seconds_upload, err);
    if (!status)
        status = plan->shape.refined ? refined(plan, energy, result, &watch, err) : linear(plan, result, &watch, err);
    if (!status && report->occupied_count) {
        status =
            hada_buffer_read(&plan->pictures, plan->slot, 0, result->all_in_focus.data, plane * sizeof(float), err);
        if (!status)
            status = hada_buffer_read(&plan->pictures, plan->slot, plane * sizeof(float), result->distance_map.data,
                                      hada_image_count(&result->distance_map) * sizeof(float), err);
    }
    if (!status && plan->options.gamma != 1.0) {
        for (int z = 0; z < result->depths; z++)
            apply_gamma(&result->planes[z], plan->options.gamma);
        apply_gamma(&result->all_in_focus, plan->options.gamma);
    }
    if (!status)
        status = stop_watch(plan, &watch, &report->seconds_download, err);
    report->seconds_total = seconds() - start;
    return status;
}

hada_status hada_plan_run(hada_plan *plan, const hada_image *raw, hada_result *result, hada_error *err)
{
    if (!plan || !raw || !raw->data || !result)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_run: a plan, a frame and a result are needed");
    size_t bad = 0;
    hada_status status = check_frame(plan, raw, &bad, err);
    if (!status)
        status = hada_result_fit(result, hada_model_get_info(plan->model), plan->shape.depths, err);
    if (status)
        return status;
    unsigned char *occupied = result->report.occupied;
    result->report = (hada_report){.occupied = occupied, .residual_linear = NAN, .residual = NAN};
    memcpy(result->distances_mm, plan->distances, (size_t)plan->shape.depths * sizeof(double));
    status = run(plan, raw, bad, result, err);
    if (status) {
        hada_slot_finish(plan->slot, NULL); /* the plan is ready for the next frame */
        hada_result_destroy(result);
    }
    return status;
}
