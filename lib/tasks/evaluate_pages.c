/* The pages of a result and of its truth, and the region that counts. */
#include <hadalens/response.h>
#include <hadalens/scene.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "image/pixels.h"
#include "io/folder.h"
#include "io/tiff_meta.h"
#include "tasks/evaluate.h"

hada_status hada_region_read(hada_region *region, const hada_evaluate_task *task, hada_error *err)
{
    *region = (hada_region){task->window_rows, task->window_cols, task->window_row, task->window_col, {0}};
    return task->mask ? hada_named(hada_tiff_load(task->mask, 0, &region->mask, err), task->mask, err) : HADA_OK;
}

void hada_region_free(hada_region *region)
{
    hada_image_destroy(&region->mask);
}

hada_status hada_region_cut(const hada_region *region, hada_image *image, hada_error *err)
{
    hada_image part;
    if (!region->rows)
        return HADA_OK;
    const int row = region->row < 0 ? (image->rows - region->rows) / 2 : region->row;
    const int col = region->col < 0 ? (image->cols - region->cols) / 2 : region->col;
    if (row < 0 || col < 0 || region->rows > image->rows - row || region->cols > image->cols - col)
        return hada_fail(err, HADA_ERROR_SIZE, "the window %dx%d at row %d, column %d does not lie within %dx%d",
                         region->rows, region->cols, row, col, image->rows, image->cols);
    HADA_TRY(hada_image_crop(&part, image, row, col, region->rows, region->cols, err));
    hada_image_destroy(image);
    *image = part;
    return HADA_OK;
}

/* Pixels that are not 0 in some channel; returns whether there are any. */
static int mark(unsigned char *mask, const hada_image *image)
{
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    int any = 0;
    for (int c = 0; c < image->channels; c++)
        for (size_t i = 0; i < pixels; i++) {
            const float value = image->data[(size_t)c * pixels + i];
            any |= mask[i] |= !isnan(value) && value != 0.0f;
        }
    return any;
}

/* The mask for an image of this size, cut to the window as well: a value per pixel, freed with free(); NULL where there
 * is no mask. */
static hada_status region_mask(const hada_region *region, int rows, int cols, unsigned char **mask, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_image part = {0};
    *mask = NULL;
    if (!region->mask.data)
        return HADA_OK;
    if (region->mask.rows != rows || region->mask.cols != cols)
        return hada_fail(err, HADA_ERROR_SIZE, "the mask is %dx%d, but the images to compare are %dx%d",
                         region->mask.rows, region->mask.cols, rows, cols);
    HADA_TRY_OR_DONE(hada_image_crop(&part, &region->mask, 0, 0, rows, cols, err));
    HADA_TRY_OR_DONE(hada_region_cut(region, &part, err));
    HADA_TRY_OR_DONE(HADA_NEW(*mask, (size_t)part.rows * (size_t)part.cols, "a mask", err));
    if (!mark(*mask, &part))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_SIZE, "the mask leaves no pixel to compare: all of it is 0%s",
                                   region->rows ? " within the window" : ""));
done:
    hada_image_destroy(&part);
    if (status) {
        free(*mask);
        *mask = NULL;
    }
    return status;
}

/* Distances that are the same but for the rounding of a file's text. */
#define SAME_DISTANCE 1e-3

int hada_stem_ends(const char *name, size_t length, const char *end)
{
    const size_t tail = strlen(end);
    return length >= tail && !memcmp(name + length - tail, end, tail);
}

size_t hada_stem_of(const char *path)
{
    const char *name = hada_name_of(path);
    return (size_t)(name - path) + hada_name_stem(name);
}

void hada_compared_close(hada_compared *open)
{
    hada_tiff_close(&open->result);
    hada_tiff_close(&open->truth);
    free(open->page);
}

static int rises(const double *values, int count)
{
    for (int i = 1; i < count; i++)
        if (!(values[i] > values[i - 1]))
            return 0;
    return 1;
}

/* Slices by their distances, near to far, when the numbers of pages differ. */
static hada_status match_slices(hada_compared *open, hada_error *err)
{
    const hada_tiff_info *result = hada_tiff_get_info(open->result), *truth = hada_tiff_get_info(open->truth);
    const double *have = result->distances_mm, *want = truth->distances_mm;
    int found = 0;
    if (result->distances == result->frames && truth->distances == truth->frames && rises(have, result->frames) &&
        rises(want, truth->frames))
        for (int t = 0, r = 0; t < truth->frames; t++) {
            const double off = SAME_DISTANCE * want[t];
            while (r < result->frames && have[r] <= want[t] - off)
                r++;
            if (r < result->frames && have[r] < want[t] + off) {
                open->page[t] = r;
                found++;
            }
        }
    if (!found)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "%s has %d %s and %s has %d, and their distances do not tell which belong together",
                         open->result_path, result->frames, result->frames == 1 ? "image" : "images", open->truth_path,
                         truth->frames);
    return HADA_OK;
}

/* By how much a truth of whole frames is larger than a result of binned ones; 1 where it is none. */
static int times_larger(const hada_tiff_info *truth, const hada_tiff_info *result)
{
    const int times = truth->rows / result->rows;
    return times > 1 && truth->rows - times * result->rows < times && truth->cols >= times * result->cols &&
                   truth->cols - times * result->cols < times
               ? times
               : 1;
}

hada_status hada_compared_open(hada_compared *open, const char *result, const char *truth, hada_error *err)
{
    *open = (hada_compared){.result_path = result, .truth_path = truth};
    HADA_TRY(hada_named(hada_tiff_open(&open->result, result, err), result, err));
    HADA_TRY(hada_named(hada_tiff_open(&open->truth, truth, err), truth, err));
    open->count = hada_tiff_get_info(open->truth)->frames;
    HADA_TRY(HADA_NEW(open->page, (size_t)open->count, "a list of pages", err));
    open->times = times_larger(hada_tiff_get_info(open->truth), hada_tiff_get_info(open->result));
    const int equal = hada_tiff_get_info(open->result)->frames == open->count;
    for (int t = 0; t < open->count; t++)
        open->page[t] = equal ? t : -1;
    if (!equal)
        HADA_TRY(match_slices(open, err));
    return HADA_OK;
}

static hada_status not_said(const char *path, hada_error *err)
{
    return hada_fail(
        err, HADA_ERROR_ARGUMENT,
        "options.encoding: %s does not say how its values stand for light, so that they cannot be brought to "
        "another encoding (options.truth_encoding says it of a truth)",
        path);
}

hada_status hada_compared_encode(hada_compared *open, double truth, double both, hada_error *err)
{
    const double said = hada_tiff_get_info(open->truth)->encoding;
    const hada_tiff_info *result = hada_tiff_get_info(open->result);
    if ((truth != HADA_AUTO && !hada_response_is_known(truth)) || (both != HADA_AUTO && !hada_response_is_known(both)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.encoding and truth_encoding: %g is no response",
                         truth != HADA_AUTO && !hada_response_is_known(truth) ? truth : both);
    open->result_encoding = result->encoding;
    open->truth_encoding = truth != HADA_AUTO ? truth
                           : said != 0.0      ? said
                                              : hada_text_response(result->description, "scene_response");
    if (both != HADA_AUTO && open->result_encoding == 0.0)
        return not_said(open->result_path, err);
    if (both != HADA_AUTO && open->truth_encoding == 0.0)
        return not_said(open->truth_path, err);
    if (open->result_encoding != 0.0)
        open->encoding = both != HADA_AUTO ? both : open->truth_encoding;
    return HADA_OK;
}

/* An image of a file in the encoding of the comparison. */
static void encode(hada_image *image, double from, double to)
{
    if (image->data && from != 0.0 && to != 0.0)
        hada_response_convert(image->data, hada_image_count(image), from, to);
}

void hada_compared_page_free(hada_compared_page *one)
{
    hada_image_destroy(&one->result);
    hada_image_destroy(&one->truth);
    free(one->mask);
    one->mask = NULL;
}

/* What the result has for page t of the truth. */
static hada_status read_result(hada_compared_page *one, const hada_compared *open, int t, hada_error *err)
{
    hada_image *result = &one->result;
    const hada_image *truth = &one->truth;
    HADA_TRY(hada_named(hada_tiff_read(open->result, open->page[t], result, err), open->result_path, err));
    if (result->channels != truth->channels || result->rows != truth->rows || result->cols != truth->cols)
        return hada_fail(err, HADA_ERROR_SIZE, "%s is %dx%d with %d %s, but %s is %dx%d with %d", open->result_path,
                         result->rows, result->cols, result->channels, result->channels == 1 ? "channel" : "channels",
                         open->truth_path, truth->rows, truth->cols, truth->channels);
    return HADA_OK;
}

hada_status hada_compared_thin(hada_image *image, int times, hada_error *err)
{
    hada_image thin;
    if (times < 2 || image->rows < times || image->cols < times)
        return HADA_OK;
    HADA_TRY(hada_image_create(&thin, image->channels, image->rows / times, image->cols / times, err));
    float *to = thin.data;
    for (int c = 0; c < thin.channels; c++)
        for (int row = 0; row < thin.rows; row++)
            for (int col = 0; col < thin.cols; col++)
                *to++ = image->data[((size_t)c * (size_t)image->rows + (size_t)(row * times + times / 2)) *
                                        (size_t)image->cols +
                                    (size_t)(col * times + times / 2)];
    hada_image_destroy(image);
    *image = thin;
    return HADA_OK;
}

/* Means of light. */
static hada_status bin(hada_image *image, int times, double encoding, hada_error *err)
{
    if (times < 2)
        return HADA_OK;
    encode(image, encoding, HADA_RESPONSE_LINEAR);
    HADA_TRY(hada_image_bin(image, times, HADA_MOSAIC_NONE, 0, err));
    encode(image, HADA_RESPONSE_LINEAR, encoding);
    return HADA_OK;
}

hada_status hada_compared_read(hada_compared_page *one, const hada_compared *open, int t, int map,
                               const hada_region *region, hada_error *err)
{
    hada_image *truth = &one->truth;
    hada_status status = HADA_OK;
    int reading_truth = 1;
    *one = (hada_compared_page){0};
    HADA_TRY(hada_monitor_check(open->monitor, err)); /* files may have many pages */
    HADA_TRY_OR_DONE(hada_tiff_read(open->truth, t, truth, err));
    HADA_TRY_OR_DONE(map ? hada_compared_thin(truth, open->times, err)
                         : bin(truth, open->times, open->truth_encoding, err));
    HADA_TRY_OR_DONE(region_mask(region, truth->rows, truth->cols, &one->mask, err));
    reading_truth = 0;
    if (open->page[t] >= 0) {
        HADA_TRY_OR_DONE(read_result(one, open, t, err));
        HADA_TRY_OR_DONE(hada_region_cut(region, &one->result, err));
    }
    HADA_TRY_OR_DONE(hada_region_cut(region, truth, err));
    encode(&one->result, open->result_encoding, open->encoding);
    encode(truth, open->truth_encoding, open->encoding);
done:
    if (status && reading_truth)
        hada_error_prefix_path(err, open->truth_path);
    return status;
}

int hada_compared_counts(const hada_compared_page *one, size_t i)
{
    return !one->mask || one->mask[i % ((size_t)one->truth.rows * (size_t)one->truth.cols)];
}
