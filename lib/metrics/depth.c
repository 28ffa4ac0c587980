/* Distance maps: errors, fractional depth indices, and where maps are hard: at jumps, beyond the camera's depths, and
 * where they do not trust themselves. */
#include <hadalens/metrics.h>

#include "core/callers.h"
#include "core/numbers.h"

double hada_depth_index(const double *distances_mm, int count, double distance_mm)
{
    if (!distances_mm)
        return 0.0;
    if (count < 2)
        return 0.0;
    int i = 0; /* the first step that does not end before it: lists may be long, and maps ask for every pixel */
    for (int last = count - 2; i < last;) {
        const int middle = i + (last - i) / 2;
        if (distance_mm > distances_mm[middle + 1])
            i = middle + 1;
        else
            last = middle;
    }
    const double a = 1.0 / distances_mm[i], b = 1.0 / distances_mm[i + 1];
    return i + (a - 1.0 / distance_mm) / (a - b);
}

double hada_depth_distance(const double *distances_mm, int count, double index)
{
    if (!distances_mm)
        return 0.0;
    if (count < 2)
        return distances_mm[0];
    const int i = hada_within((int)floor(index), count - 1);
    const double t = index - i;
    return 1.0 / ((1.0 - t) / distances_mm[i] + t / distances_mm[i + 1]);
}

hada_status hada_metric_depth(const hada_image *map, const hada_image *truth, const double *distances_mm, int count,
                              double tolerance, const unsigned char *mask, hada_depth_score *out, hada_error *err)
{
    HADA_NEED(distances_mm || !count, err);
    HADA_NEED_IMAGE(map, NULL, err);
    HADA_NEED_IMAGE(truth, NULL, err);
    HADA_TRY(hada_distances_check(distances_mm, count, err));
    hada_status status = HADA_REPORT_CHECK(out, hada_depth_score, err);
    if (status || !out)
        return status ? status : hada_fail(err, HADA_ERROR_ARGUMENT, "hada_metric_depth: out is needed");
    if (map->channels != 1 || truth->channels != 1 || map->rows != truth->rows || map->cols != truth->cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "distance maps of %d channels, %d x %d and %d channels, %d x %d cannot be compared",
                         map->channels, map->rows, map->cols, truth->channels, truth->rows, truth->cols);
    if (distances_mm && count < 2)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a list of %d distances has no depth step; give two or more", count);
    if (!(tolerance >= 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a tolerance of %g is not possible", tolerance);
    long long pixels = 0, covered = 0, within = 0;
    double error = 0.0, steps = 0.0;
    const size_t all = hada_image_count(map);
    for (size_t i = 0; i < all; i++) {
        const double t = truth->data[i], m = map->data[i];
        if ((mask && !mask[i]) || isnan(t))
            continue;
        pixels++;
        if (isnan(m))
            continue;
        covered++;
        const double off = fabs(m - t);
        double distance = off;
        if (distances_mm) {
            distance = fabs(hada_depth_index(distances_mm, count, m) - hada_depth_index(distances_mm, count, t));
            steps += distance;
        }
        error += off;
        within += distance <= tolerance;
    }
    if (!pixels)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "no pixel of the mask has a true distance");
    const hada_depth_score own = {.coverage = (double)covered / (double)pixels,
                                  .within = covered ? (double)within / (double)covered : 0.0,
                                  .mean_error_mm = covered ? error / (double)covered : NAN,
                                  .mean_steps = covered && distances_mm ? steps / (double)covered : NAN,
                                  .pixels = pixels};
    HADA_REPORT_GIVE(out, &own);
    return HADA_OK;
}

/* As fractional indices; NaN stays. */
static hada_status indices_of(double **out, const hada_image *map, const double *distances_mm, int count,
                              hada_error *err)
{
    HADA_TRY(HADA_NEW(*out, hada_image_count(map), "depth indices", err));
    for (size_t i = 0; i < hada_image_count(map); i++)
        (*out)[i] = isnan(map->data[i]) ? (double)NAN : hada_depth_index(distances_mm, count, (double)map->data[i]);
    return HADA_OK;
}

/* Marks the pixels within `reach` of the line between two neighbours, (row, col) and the next one to the right or
 * below.
 */
static void mark(const hada_image *map, unsigned char *parts, int row, int col, int down, int reach)
{
    const int top = row - reach + 1, left = col - reach + 1;
    for (int r = down ? top : row - reach; r <= row + reach; r++)
        for (int c = down ? col - reach : left; c <= col + reach; c++)
            if (r >= 0 && c >= 0 && r < map->rows && c < map->cols &&
                parts[(size_t)r * (size_t)map->cols + (size_t)c] == HADA_DEPTH_AWAY)
                parts[(size_t)r * (size_t)map->cols + (size_t)c] = HADA_DEPTH_JUMP;
}

static void mark_jumps(const hada_image *map, const double *index, double jump, int reach, unsigned char *parts)
{
    for (int r = 0; r < map->rows; r++)
        for (int c = 0; c < map->cols; c++) {
            const size_t i = (size_t)r * (size_t)map->cols + (size_t)c;
            if (c + 1 < map->cols && fabs(index[i] - index[i + 1]) > jump)
                mark(map, parts, r, c, 0, reach);
            if (r + 1 < map->rows && fabs(index[i] - index[i + (size_t)map->cols]) > jump)
                mark(map, parts, r, c, 1, reach);
        }
}

hada_status hada_metric_depth_parts(const hada_image *truth, const double *distances_mm, int count, double jump_steps,
                                    int reach_pixels, unsigned char *parts, hada_error *err)
{
    HADA_NEED(distances_mm && parts, err);
    HADA_NEED_IMAGE(truth, NULL, err);
    HADA_TRY(hada_distances_check(distances_mm, count, err));
    const double jump = jump_steps == HADA_AUTO ? 0.5 : jump_steps;
    const int reach = reach_pixels == HADA_AUTO ? 3 : reach_pixels;
    double *index = NULL;
    hada_status status = HADA_OK;
    if (truth->channels != 1 || !distances_mm || count < 2)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_metric_depth_parts: a map of one channel and a list of two distances or more are needed");
    if (!(jump > 0.0) || reach < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "jumps of %g steps, %d pixels about, are not possible", jump, reach);
    HADA_TRY_OR_DONE(indices_of(&index, truth, distances_mm, count, err));
    for (size_t i = 0; i < hada_image_count(truth); i++)
        parts[i] = isnan(index[i])                             ? HADA_DEPTH_NONE
                   : index[i] < -0.5 || index[i] > count - 0.5 ? HADA_DEPTH_OUTSIDE
                                                               : HADA_DEPTH_AWAY;
    mark_jumps(truth, index, jump, reach, parts);
done:
    free(index);
    return status;
}

typedef struct claim {
    double confidence, error;
} claim;

static int more_confident(const void *a, const void *b)
{
    const double one = ((const claim *)a)->confidence, two = ((const claim *)b)->confidence;
    return (one < two) - (one > two);
}

/* Pixels of the same confidence in any order: each of them stands for their mean. */
static void level(claim *claims, size_t count)
{
    for (size_t i = 0; i < count;) {
        size_t end = i;
        double sum = 0.0;
        for (; end < count && claims[end].confidence == claims[i].confidence; end++)
            sum += claims[end].error;
        for (const double mean = sum / (double)(end - i); i < end; i++)
            claims[i].error = mean;
    }
}

hada_status hada_metric_depth_confidence(const hada_image *map, const hada_image *truth, const hada_image *confidence,
                                         const double *distances_mm, int count, const unsigned char *mask,
                                         hada_confidence_score *out, hada_error *err)
{
    HADA_NEED(distances_mm || !count, err);
    HADA_NEED_IMAGE(map, NULL, err);
    HADA_NEED_IMAGE(truth, NULL, err);
    HADA_NEED_IMAGE(confidence, NULL, err);
    HADA_TRY(hada_distances_check(distances_mm, count, err));
    claim *claims = NULL;
    size_t known = 0;
    double sum = 0.0, half = 0.0, area = 0.0;
    hada_status status = HADA_REPORT_CHECK(out, hada_confidence_score, err);
    if (status || !out)
        return status ? status : hada_fail(err, HADA_ERROR_ARGUMENT, "hada_metric_depth_confidence: out is needed");
    const hada_image *all[] = {map, truth, confidence};
    for (int k = 0; k < 3; k++)
        if (all[k]->channels != 1 || all[k]->rows != map->rows || all[k]->cols != map->cols)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "a map, its truth and its confidence must be of one size, and of one "
                             "channel");
    if (distances_mm && count < 2)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a list of %d distances has no depth step; give two or more", count);
    HADA_TRY_OR_DONE(HADA_NEW(claims, hada_image_count(map), "the pixels of a map", err));
    for (size_t i = 0; i < hada_image_count(map); i++) {
        const double m = (double)map->data[i], t = (double)truth->data[i], c = (double)confidence->data[i];
        if ((mask && !mask[i]) || isnan(m) || isnan(t) || isnan(c))
            continue;
        const double error =
            distances_mm ? hada_depth_index(distances_mm, count, m) - hada_depth_index(distances_mm, count, t) : m - t;
        claims[known++] = (claim){c, fabs(error)};
    }
    qsort(claims, known, sizeof *claims, more_confident);
    level(claims, known);
    for (size_t i = 0; i < known; i++) {
        sum += claims[i].error;
        area += sum / (double)(i + 1);
        if (i + 1 == (known + 1) / 2)
            half = sum / (double)(i + 1);
    }
    const hada_confidence_score own = {.pixels = (long long)known,
                                       .half_error = known ? half : (double)NAN,
                                       .risk = known ? area / (double)known : (double)NAN};
    HADA_REPORT_GIVE(out, &own);
done:
    free(claims);
    return status;
}

hada_status hada_metric_depth_nearer(hada_image *truth, const hada_image *second, const hada_image *map,
                                     const double *distances_mm, int count, hada_error *err)
{
    HADA_NEED(distances_mm || !count, err);
    HADA_NEED_IMAGE(truth, NULL, err);
    HADA_NEED_IMAGE(second, NULL, err);
    HADA_NEED_IMAGE(map, NULL, err);
    HADA_TRY(hada_distances_check(distances_mm, count, err));
    if (truth->channels != 1 || truth->rows != second->rows || truth->cols != second->cols || second->channels != 1 ||
        map->channels != 1 || truth->rows != map->rows || truth->cols != map->cols)
        return hada_fail(err, HADA_ERROR_SIZE, "two true maps and a result must be of one size, and of one channel");
    for (size_t i = 0; i < hada_image_count(truth); i++) {
        double at[] = {(double)truth->data[i], (double)second->data[i], (double)map->data[i]};
        for (int k = 0; k < 3 && count >= 2; k++)
            at[k] = isnan(at[k]) ? at[k] : hada_depth_index(distances_mm, count, at[k]);
        if (isnan(at[0]) || fabs(at[1] - at[2]) < fabs(at[0] - at[2])) /* never where a number is missing */
            truth->data[i] = second->data[i];
    }
    return HADA_OK;
}
