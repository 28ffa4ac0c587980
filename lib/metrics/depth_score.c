#include <hadalens/metrics.h>
#include <math.h>

#include "core/callers.h"
#include "core/error.h"

double hada_depth_index(const double *distances_mm, int count, double distance_mm)
{
    if (!distances_mm)
        return 0.0;
    if (count < 2)
        return 0.0;
    int i = 0;
    while (i < count - 2 && distance_mm > distances_mm[i + 1])
        i++;
    const double a = 1.0 / distances_mm[i], b = 1.0 / distances_mm[i + 1];
    return i + (a - 1.0 / distance_mm) / (a - b);
}

double hada_depth_distance(const double *distances_mm, int count, double index)
{
    if (!distances_mm)
        return 0.0;
    if (count < 2)
        return distances_mm[0];
    int i = (int)floor(index);
    i = i < 0 ? 0 : i > count - 2 ? count - 2 : i;
    const double t = index - i;
    return 1.0 / ((1.0 - t) / distances_mm[i] + t / distances_mm[i + 1]);
}

hada_status hada_metric_depth(const hada_image *map, const hada_image *truth, const double *distances_mm, int count,
                              double tolerance, const unsigned char *mask, hada_depth_score *out, hada_error *err)
{
    HADA_NEED(map && truth && (distances_mm || !count), err);
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
