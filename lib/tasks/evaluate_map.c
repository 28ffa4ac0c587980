/* The pages of a result and of its truth, and the region that counts; distance maps against the truth. */
#include "tasks/evaluate.h"

#include <hadalens/response.h>
#include <hadalens/scene.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "image/pixels.h"
#include "io/folder.h"
#include "io/tiff_meta.h"

hada_status hada_region_read(hada_region *region, const hada_evaluate_task *task, hada_error *err)
{
    *region = (hada_region){task->window_rows, task->window_cols, task->window_row, task->window_col, {0}};
    return task->mask ? hada_named(hada_tiff_load(task->mask, 0, &region->mask, err), task->mask, err) : HADA_OK;
}

void hada_region_free(hada_region *region)
{
    hada_image_destroy(&region->mask);
}

/* Cuts an image to the window, in place. */
static hada_status cut(const hada_region *region, hada_image *image, hada_error *err)
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
    HADA_TRY_OR_DONE(cut(region, &part, err));
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

/* The middle pixels of bins of `times` x `times`, in place. */
static hada_status thin_out(hada_image *image, int times, hada_error *err)
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
    HADA_TRY_OR_DONE(map ? thin_out(truth, open->times, err) : bin(truth, open->times, open->truth_encoding, err));
    HADA_TRY_OR_DONE(region_mask(region, truth->rows, truth->cols, &one->mask, err));
    reading_truth = 0;
    if (open->page[t] >= 0) {
        HADA_TRY_OR_DONE(read_result(one, open, t, err));
        HADA_TRY_OR_DONE(cut(region, &one->result, err));
    }
    HADA_TRY_OR_DONE(cut(region, truth, err));
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

/* Distance maps against the truth. */

/* The distances that the NAME_stack.tif beside a NAME_depth.tif (or another tail) states, freed with free(); 0 of them
 * where there is none, or one that cannot be read: then nothing is known. */
static hada_status distances_beside(double **out, int *count, const char *map_path, const char *tail_word,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tiff_reader *reader = NULL;
    hada_error ignored;
    hada_path path;
    const size_t stem = hada_stem_of(map_path), tail = strlen(tail_word);
    int there = 0;
    *out = NULL;
    *count = 0;
    if (!hada_stem_ends(map_path, stem, tail_word))
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%.*s_stack%s", (int)(stem - tail), map_path, map_path + stem));
    HADA_TRY_OR_DONE(hada_path_finds_file(path, &there, err));
    if (!there || hada_tiff_open(&reader, path, &ignored))
        goto done;
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    *count = info->distances;
    HADA_TRY_OR_DONE(HADA_NEW(*out, (size_t)*count + 1, "distances", err));
    for (int z = 0; z < *count; z++)
        (*out)[z] = info->distances_mm[z];
done:
    hada_tiff_close(&reader);
    return status;
}

/* The list that says what a depth step is. */
typedef struct steps {
    const double *distances;
    int count;
    double *own;
} steps;

static hada_status find_steps(steps *out, const hada_compared *open, const hada_evaluate_task *by, const char *tail,
                              hada_error *err)
{
    *out = (steps){by->distances_mm, by->distances, NULL};
    if (out->count)
        return HADA_OK;
    HADA_TRY(distances_beside(&out->own, &out->count, open->truth_path, tail, err));
    if (!out->count) {
        free(out->own);
        HADA_TRY(distances_beside(&out->own, &out->count, open->result_path, tail, err));
    }
    out->distances = out->own;
    return HADA_OK;
}

/* Page t of a file, thinned out and cut to the region; empty where there is no such page. */
static hada_status read_page(hada_image *out, const char *path, int t, int times, const hada_region *region,
                             hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_open(&reader, path, err));
    if (t >= hada_tiff_get_info(reader)->frames)
        goto done;
    HADA_TRY_OR_DONE(hada_tiff_read(reader, t, out, err));
    HADA_TRY_OR_DONE(thin_out(out, times, err));
    HADA_TRY_OR_DONE(cut(region, out, err));
done:
    hada_tiff_close(&reader);
    return status;
}

/* Page t of the image whose name has another tail, cut to the region; empty where there is no such file or page. */
static hada_status read_beside(hada_image *out, const char *path, const char *tail, const char *other, int t, int times,
                               const hada_region *region, hada_error *err)
{
    const size_t stem = hada_stem_of(path), length = strlen(tail);
    hada_path beside;
    int there = 0;
    *out = (hada_image){0};
    if (!hada_stem_ends(path, stem, tail))
        return HADA_OK;
    HADA_TRY(hada_path_write(beside, err, "%.*s%s%s", (int)(stem - length), path, other, path + stem));
    HADA_TRY(hada_path_finds_file(beside, &there, err));
    return there ? hada_named(read_page(out, beside, t, times, region, err), beside, err) : HADA_OK;
}

hada_status hada_evaluate_parts_beside(unsigned char **parts, const hada_compared *open, int t,
                                       const hada_compared_page *one, const hada_evaluate_task *by,
                                       const hada_region *region, hada_error *err)
{
    hada_image map = {0};
    steps list = {0};
    hada_status status = HADA_OK;
    *parts = NULL;
    HADA_TRY_OR_DONE(find_steps(&list, open, by, "_aif", err));
    if (list.count < 2)
        goto done;
    HADA_TRY_OR_DONE(read_beside(&map, open->truth_path, "_aif", "_depth", t, open->times, region, err));
    if (!map.data || map.channels != 1 || map.rows != one->truth.rows || map.cols != one->truth.cols)
        goto done;
    HADA_TRY_OR_DONE(HADA_NEW(*parts, hada_image_count(&map), "parts of a map", err));
    HADA_TRY_OR_DONE(hada_metric_depth_parts(&map, list.distances, list.count, HADA_AUTO, HADA_AUTO, *parts, err));
done:
    free(list.own);
    hada_image_destroy(&map);
    return status;
}

/* Sums over the frames of a sequence, weighted by their pixels. */
typedef struct depth_sums {
    double covered, pixels, within, error, steps;
} depth_sums;

static void add_score(depth_sums *sums, const hada_depth_score *depth, int steps_known)
{
    const double here = depth->coverage * (double)depth->pixels;
    sums->pixels += (double)depth->pixels;
    sums->covered += here;
    if (here > 0) {
        sums->within += depth->within * here;
        sums->error += depth->mean_error_mm * here;
        sums->steps += steps_known ? depth->mean_steps * here : 0;
    }
}

/* What is summed for maps; the first is all but what lies outside. */
enum { ALL, JUMPS, AWAY, PLACES };

typedef struct map_sums {
    depth_sums place[PLACES];
    double outside, unknown, half, risk, claimed;
    const hada_evaluate_task *by;
    steps list;
    int steps_known;
} map_sums;

/* 1 where a pixel counts for a place; returns how many do. `parts` NULL: all with a true distance. */
static size_t choose(const hada_compared_page *one, const unsigned char *parts, int place, unsigned char *chosen)
{
    size_t count = 0;
    for (size_t i = 0; i < hada_image_count(&one->truth); i++) {
        const int part = parts ? parts[i] : isnan(one->truth.data[i]) ? HADA_DEPTH_NONE : HADA_DEPTH_AWAY;
        chosen[i] =
            hada_compared_counts(one, i) && (place == JUMPS  ? part == HADA_DEPTH_JUMP
                                             : place == AWAY ? part == HADA_DEPTH_AWAY
                                                             : part == HADA_DEPTH_JUMP || part == HADA_DEPTH_AWAY);
        count += chosen[i];
    }
    return count;
}

static void add_outside(map_sums *sums, const hada_compared_page *one, const unsigned char *parts)
{
    for (size_t i = 0; i < hada_image_count(&one->truth); i++)
        if (hada_compared_counts(one, i) && parts[i] == HADA_DEPTH_OUTSIDE) {
            sums->outside++;
            sums->unknown += isnan(one->result.data[i]) != 0;
        }
}

static hada_status add_confidence(map_sums *sums, const hada_compared *open, int t, const hada_compared_page *one,
                                  const hada_region *region, const unsigned char *chosen, hada_error *err)
{
    hada_confidence_score score = {.size = sizeof score};
    hada_image confidence = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(read_beside(&confidence, open->result_path, "_depth", "_confidence", t, 1, region, err));
    if (!confidence.data)
        goto done;
    HADA_TRY_OR_DONE(hada_metric_depth_confidence(&one->result, &one->truth, &confidence,
                                                  sums->steps_known ? sums->list.distances : NULL,
                                                  sums->steps_known ? sums->list.count : 0, chosen, &score, err));
    if (score.pixels) {
        sums->half += score.half_error * (double)score.pixels;
        sums->risk += score.risk * (double)score.pixels;
        sums->claimed += (double)score.pixels;
    }
done:
    hada_image_destroy(&confidence);
    return status;
}

static hada_status add_page(map_sums *sums, const hada_compared *open, int t, hada_compared_page *one,
                            const hada_region *region, hada_error *err)
{
    const double *distances = sums->steps_known ? sums->list.distances : NULL;
    const int count = sums->steps_known ? sums->list.count : 0;
    const size_t pixels = hada_image_count(&one->truth);
    unsigned char *parts = NULL, *chosen = NULL;
    hada_image second = {0};
    hada_status status = HADA_OK;
    if (!one->result.data || one->truth.channels != 1)
        return hada_fail(err, HADA_ERROR_SIZE, "%s has no distance map for page %d of %s", open->result_path, t + 1,
                         open->truth_path);
    HADA_TRY_OR_DONE(HADA_NEW(chosen, pixels, "a mask", err));
    if (sums->steps_known) {
        HADA_TRY_OR_DONE(HADA_NEW(parts, pixels, "parts of a map", err));
        HADA_TRY_OR_DONE(hada_metric_depth_parts(&one->truth, distances, count, HADA_AUTO, HADA_AUTO, parts, err));
        add_outside(sums, one, parts);
    }
    HADA_TRY_OR_DONE(read_beside(&second, open->truth_path, "_depth", "_depth2", t, open->times, region, err));
    if (second.data)
        HADA_TRY_OR_DONE(hada_metric_depth_nearer(&one->truth, &second, &one->result, distances, count, err));
    for (int place = PLACES - 1; place >= ALL; place--) { /* so that `chosen` is all in the end */
        hada_depth_score depth = {.size = sizeof depth};
        const size_t here = choose(one, parts, place, chosen);
        if (!here && (place != ALL || sums->outside > 0))
            continue;
        HADA_TRY_OR_DONE(
            hada_metric_depth(&one->result, &one->truth, distances, count, sums->by->tolerance, chosen, &depth, err));
        add_score(&sums->place[place], &depth, sums->steps_known);
    }
    HADA_TRY_OR_DONE(add_confidence(sums, open, t, one, region, chosen, err));
done:
    HADA_FREE(parts, chosen);
    hada_image_destroy(&second);
    return status;
}

static void give(const map_sums *sums, hada_evaluation *score)
{
    const depth_sums *all = &sums->place[ALL], *jumps = &sums->place[JUMPS], *away = &sums->place[AWAY];
    score->depth = (hada_depth_score){.size = sizeof score->depth,
                                      .pixels = (long long)all->pixels,
                                      .coverage = all->covered / all->pixels,
                                      .within = all->within / all->covered,
                                      .mean_error_mm = all->error / all->covered,
                                      .mean_steps = sums->steps_known ? all->steps / all->covered : (double)NAN};
    score->confident_half = sums->half / sums->claimed;
    score->risk = sums->risk / sums->claimed;
    if (!sums->steps_known)
        return;
    score->steps_jumps = jumps->steps / jumps->covered;
    score->within_jumps = jumps->within / jumps->covered;
    score->coverage_jumps = jumps->covered / jumps->pixels;
    score->steps_away = away->steps / away->covered;
    score->within_away = away->within / away->covered;
    score->coverage_away = away->covered / away->pixels;
    score->outside = sums->outside / (sums->outside + all->pixels);
    score->outside_unknown = sums->unknown / sums->outside;
}

hada_status hada_evaluate_maps(hada_evaluation *score, const hada_compared *open, const hada_evaluate_task *by,
                               const hada_region *region, hada_error *err)
{
    hada_status status = HADA_OK;
    map_sums sums = {.by = by};
    hada_compared_page one = {0};
    HADA_TRY_OR_DONE(find_steps(&sums.list, open, by, "_depth", err));
    sums.steps_known = score->steps_known = sums.list.count >= 2;
    for (int t = 0; t < open->count; t++) {
        HADA_TRY_OR_DONE(hada_compared_read(&one, open, t, 1, region, err));
        HADA_TRY_OR_DONE(add_page(&sums, open, t, &one, region, err));
        score->pages++;
        hada_compared_page_free(&one);
    }
    give(&sums, score);
done:
    hada_compared_page_free(&one);
    free(sums.list.own);
    return status;
}
