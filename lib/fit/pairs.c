/* The first pass: pairs into sums. */
#include <math.h>
#include <string.h>

#include "core/alloc.h"
#include "image/dark.h"
#include "fit/fitter.h"

hada_status hada_fitter_check_pair(const hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                   hada_error *err)
{
    const hada_model_info *info = &fitter->info;
    if (depth < 0 || depth >= info->depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "depth %d is not one of the %d of this fit (from 0)", depth,
                         info->depths);
    if (!raw || !raw->data || !scene || !scene->data)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a pair needs a raw frame and a scene");
    if (raw->channels != info->channels || raw->rows != info->raw_rows || raw->cols != info->raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the raw frame has %d channels, %d x %d; this fit takes %d channels, %d x %d: all raw frames "
                         "of a data set must be of one size",
                         raw->channels, raw->rows, raw->cols, info->channels, info->raw_rows, info->raw_cols);
    const int whole = scene->rows == info->raw_rows && scene->cols == info->raw_cols;
    const int window = scene->rows == info->window_rows && scene->cols == info->window_cols;
    if (scene->channels != info->channels || (!whole && !window))
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the scene has %d channels, %d x %d; this fit takes %d channels and the window %d x %d or the "
                         "raw frame's size",
                         scene->channels, scene->rows, scene->cols, info->channels, info->window_rows,
                         info->window_cols);
    const size_t bad_raw = hada_image_count_not_finite(raw), bad_scene = hada_image_count_not_finite(scene);
    if (bad_raw || bad_scene)
        return hada_fail(err, HADA_ERROR_NOT_FINITE,
                         "the %s of this pair holds %zu NaN or infinite pixels; leave the pair out or repair the file",
                         bad_raw ? "raw frame" : "scene", bad_raw ? bad_raw : bad_scene);
    return HADA_OK;
}

/* Pixels less the dark level, and the sum of their squares: by Parseval's theorem the mean of |spectrum|^2. */
static double take(const float *from, size_t pitch, int rows, int cols, double dark, float *to)
{
    const float level = (float)dark;
    double energy = 0.0;
    for (int row = 0; row < rows; row++) {
        double sum = 0.0;
        for (int col = 0; col < cols; col++) {
            const float value = from[(size_t)row * pitch + (size_t)col] - level;
            *to++ = value;
            sum += (double)value * value;
        }
        energy += sum;
    }
    return energy;
}

void hada_fitter_take(hada_fitter *fitter, const hada_image *raw, const hada_image *scene)
{
    const hada_model_info *info = &fitter->info;
    const size_t raw_area = (size_t)raw->rows * (size_t)raw->cols, area = (size_t)scene->rows * (size_t)scene->cols;
    const size_t window = (size_t)info->window_rows * (size_t)info->window_cols;
    const size_t row0 = (size_t)(scene->rows - info->window_rows) / 2,
                 col0 = (size_t)(scene->cols - info->window_cols) / 2;
    for (int c = 0; c < info->channels; c++) {
        const float *from = raw->data + (size_t)c * raw_area;
        const double dark = info->dark < 0.0 ? hada_dark_estimate(from, raw_area, fitter->room) : info->dark;
        fitter->raw_energy[c] =
            take(from, (size_t)raw->cols, raw->rows, raw->cols, dark, fitter->raw_pixels + (size_t)c * raw_area);
        from = scene->data + (size_t)c * area + row0 * (size_t)scene->cols + col0;
        fitter->scene_energy[c] = take(from, (size_t)scene->cols, info->window_rows, info->window_cols, 0.0,
                                       fitter->scene_pixels + (size_t)c * window);
    }
}

hada_status hada_fitter_transform(hada_fitter *fitter, const float *raw, const float *scene, hada_error *err)
{
    hada_slot *slot = fitter->slot;
    hada_status status = hada_buffer_write(&fitter->raw, slot, 0, raw, fitter->raw.bytes, err);
    if (!status)
        status = hada_fft_forward(fitter->raw_fft, fitter->info.channels, fitter->raw.mem, 0, fitter->b.mem, 0, err);
    if (!status && scene)
        status = hada_buffer_write(&fitter->scene, slot, 0, scene, fitter->scene.bytes, err);
    if (!status && scene)
        status =
            hada_fft_forward(fitter->scene_fft, fitter->info.channels, fitter->scene.mem, 0, fitter->x.mem, 0, err);
    return status;
}

hada_status hada_fitter_stage(hada_fitter *fitter, const hada_image *raw, const hada_image *scene, hada_error *err)
{
    hada_fitter_take(fitter, raw, scene);
    return hada_fitter_transform(fitter, fitter->raw_pixels, fitter->scene_pixels, err);
}

void hada_fitter_forget_scores(hada_fitter *fitter)
{
    const size_t bytes = (size_t)fitter->setting_count * sizeof(double);
    fitter->pooled = 0;
    hada_fitter_drop_kept(fitter);
    hada_fitter_drop_judged(fitter);
    for (int z = 0; z < fitter->info.depths; z++) {
        fitter->depth[z].scored = 0;
        memset(fitter->depth[z].single, 0, bytes);
        memset(fitter->depth[z].twofold, 0, bytes);
    }
}

hada_status hada_fitter_accumulate(hada_fitter *fitter, double sign, hada_error *err)
{
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors;
    const cl_float factor = (cl_float)sign;
    hada_status status = HADA_OK;
    for (int c = 0; !status && c < fitter->info.channels; c++) {
        const cl_ulong offset = (cl_ulong)c * fitter->layout.count;
        hada_arg args[] = {
            HADA_ARG(fitter->x.mem), HADA_ARG(fitter->b.mem), HADA_ARG(offset), HADA_ARG(fitter->sums[c].mem),
            HADA_ARG(stride),        HADA_ARG(factor),        HADA_ARG(vectors)};
        hada_slot_cost(fitter->slot, 128.0 * (1.0 + fitter->sum_count) * (double)vectors,
                       8.0 * (12.0 + 7.0 * fitter->sum_count) * (double)vectors);
        status = hada_fitter_launch(fitter, "fit_sums", "fit_pair", args, HADA_COUNT(args), err);
    }
    return status;
}

/* The sums of a depth with the pair on its way stay within single precision: no frequency has more than points times
 * the mean, and squares of dim frequencies must not vanish. */
static hada_status check_energy(const hada_fitter *fitter, double energy, double sum, const char *what, hada_error *err)
{
    const double points = (double)fitter->info.grid_rows * fitter->info.grid_cols;
    if ((energy > 0.0 && energy < 0x1p-80) || (energy + sum) * points > 0x1p120)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the %s of this pair has values too %s for single precision (root of the sum of squares %.2g); "
            "divide all images of a data set by one number, so that white is about 1",
            what, energy < 1.0 ? "small" : "large", sqrt(energy));
    return HADA_OK;
}

static hada_status check_range(const hada_fitter *fitter, int depth, hada_error *err)
{
    const hada_fitter_depth *to = &fitter->depth[depth];
    hada_status status = HADA_OK;
    for (int c = 0; !status && c < fitter->info.channels; c++) {
        status = check_energy(fitter, fitter->raw_energy[c], to->raw_energy[c], "raw frame", err);
        if (!status)
            status = check_energy(fitter, fitter->scene_energy[c], to->scene_energy[c], "scene", err);
    }
    return status;
}

hada_status hada_fitter_add(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                            hada_error *err)
{
    if (!fitter)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_add: a fitter is needed");
    hada_status status = hada_fitter_check_pair(fitter, depth, raw, scene, err);
    if (!status)
        status = hada_fitter_stage(fitter, raw, scene, err);
    if (!status)
        status = check_range(fitter, depth, err);
    if (!status)
        status = hada_fitter_select(fitter, depth, err);
    if (status)
        return status;
    fitter->changed = 1;
    hada_fitter_forget_scores(fitter);
    status = hada_fitter_accumulate(fitter, 1.0, err);
    hada_fitter_depth *to = &fitter->depth[depth];
    for (int c = 0; !status && c < fitter->info.channels; c++) {
        to->raw_energy[c] += fitter->raw_energy[c];
        to->scene_energy[c] += fitter->scene_energy[c];
    }
    to->pairs += !status;
    return status;
}
