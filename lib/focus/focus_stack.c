/* A stack on the host, focused plane by plane. */
#include <math.h>

#include "core/callers.h"
#include "focus/focus.h"

static hada_status check_planes(const hada_image *planes, int depths, hada_error *err)
{
    if (depths < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a stack of %d depths cannot be focused", depths);
    for (int i = 0; i < depths; i++) {
        if (!planes[i].data || planes[i].channels != planes[0].channels || planes[i].rows != planes[0].rows ||
            planes[i].cols != planes[0].cols)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "plane %d of %d channels, %d x %d differs from the first of %d channels, %d x %d", i + 1,
                             planes[i].channels, planes[i].rows, planes[i].cols, planes[0].channels, planes[0].rows,
                             planes[0].cols);
        if (hada_image_count_not_finite(&planes[i]))
            return hada_fail(err, HADA_ERROR_NOT_FINITE, "plane %d holds NaN or infinite values", i + 1);
    }
    return HADA_OK;
}

/* Pushes the planes through one device buffer; the results come behind each other in `results`. */
static hada_status focus_planes(hada_focus *focus, hada_slot *slot, hada_buffer *plane, hada_buffer *results,
                                const hada_image *planes, int depths, const unsigned char *competing,
                                hada_focus_report *report, hada_error *err)
{
    const size_t count = hada_image_count(&planes[0]);
    HADA_TRY(hada_focus_begin(focus, competing, err));
    for (int i = 0; i < depths; i++) {
        if (competing && !competing[i])
            continue;
        HADA_TRY(hada_buffer_write(plane, slot, 0, planes[i].data, count * sizeof(float), err));
        HADA_TRY(hada_focus_push(focus, i, 1, plane->mem, 0, err));
    }
    return hada_focus_finish(focus, 0.0, results->mem, 0, results->mem, count, report, err);
}

static hada_status read_results(const hada_buffer *results, hada_slot *slot, const hada_image *like,
                                hada_image *all_in_focus, hada_image *distance_map, hada_error *err)
{
    const size_t count = hada_image_count(like) * sizeof(float);
    HADA_TRY(hada_image_create(all_in_focus, like->channels, like->rows, like->cols, err));
    HADA_TRY(hada_image_create(distance_map, 1, like->rows, like->cols, err));
    HADA_TRY(hada_buffer_read(results, slot, 0, all_in_focus->data, count, err));
    return hada_buffer_read(results, slot, count, distance_map->data, hada_image_count(distance_map) * sizeof(float),
                            err);
}

/* The share of pixels that have a distance. */
static double coverage_of(const hada_image *distance_map)
{
    size_t covered = 0;
    for (size_t i = 0; i < hada_image_count(distance_map); i++)
        covered += !isnan(distance_map->data[i]);
    return (double)covered / (double)hada_image_count(distance_map);
}

hada_status hada_focus_stack(hada_context *context, const hada_image *planes, const double *distances_mm, int depths,
                             const unsigned char *competing, const hada_focus_options *options,
                             hada_image *all_in_focus, hada_image *distance_map, hada_focus_report *report,
                             hada_error *err)
{
    HADA_NEED(context && planes && all_in_focus && distance_map, err);
    hada_slot *slot = NULL;
    hada_focus *focus = NULL;
    hada_buffer plane = {0}, results = {0};
    hada_focus_report found = {0};
    hada_status status = HADA_OK;
    *all_in_focus = *distance_map = (hada_image){0};
    HADA_TRY_OR_DONE(check_planes(planes, depths, err));
    HADA_TRY_OR_DONE(HADA_REPORT_CHECK(report, hada_focus_report, err));
    hada_focus_desc desc = {.channels = planes[0].channels,
                            .rows = planes[0].rows,
                            .cols = planes[0].cols,
                            .depths = depths,
                            .distances_mm = distances_mm};
    hada_focus_options_init(&desc.options, 0);
    HADA_TRY_OR_DONE(hada_sized_take(&desc.options, sizeof desc.options, options, "hada_focus_options", err));
    const size_t bytes = hada_image_count(&planes[0]) * sizeof(float),
                 map = (size_t)desc.rows * (size_t)desc.cols * sizeof(float);
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(hada_focus_create(&focus, slot, &desc, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&plane, context, bytes, "a plane", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&results, context, bytes + map, "the focused image", err));
    HADA_TRY_OR_DONE(focus_planes(focus, slot, &plane, &results, planes, depths, competing, &found, err));
    HADA_TRY_OR_DONE(read_results(&results, slot, &planes[0], all_in_focus, distance_map, err));
    if (report) {
        found.coverage = coverage_of(distance_map);
        HADA_REPORT_GIVE(report, &found);
    }
done:
    if (status) {
        hada_image_destroy(all_in_focus);
        hada_image_destroy(distance_map);
    }
    hada_focus_destroy(&focus);
    if (slot)
        hada_slot_finish(slot, NULL);
    HADA_DESTROY_BUFFERS(&plane, &results);
    hada_slot_destroy(&slot);
    return status;
}
