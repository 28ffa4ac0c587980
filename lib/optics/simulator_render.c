/* Raw frames on a device: b = sum_z PSF_z * x_z + noise. */
#include <limits.h>

#include "launch/optics_accumulate.h"
#include "optics/simulator.h"

#define LOCAL 64 /* items in a work-group, of four complex numbers each */

hada_status hada_optics_accumulate(hada_slot *slot, cl_mem sum, size_t sum_offset, cl_mem otf, int otf_images,
                                   cl_mem scene, int images, size_t count, int add, hada_error *err)
{
    if (count > INT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "spectra of %zu values are too large for one image", count);
    const hada_range range = hada_range_of(hada_divide_up(count, 4), LOCAL, (size_t)images, 1);
    hada_slot_cost(slot, 8.0 * (double)count * (otf_images + (add ? 3.0 : 2.0) * images), 8.0 * (double)count * images);
    return hada_launch_optics_accumulate(slot, HADA_PROGRAM_OPTICS_ACCUMULATE_DEFAULT, &range, err, .sum = sum,
                                         .offset = sum_offset, .otf = otf, .scene = scene, .count = (int)count,
                                         .otf_images = otf_images, .add = add);
}

hada_status hada_simulator_check_image(const hada_simulator *s, const hada_image *image, hada_error *err)
{
    const hada_camera *c = &s->camera;
    const int window = image->rows == c->window_rows && image->cols == c->window_cols,
              field = image->rows == s->field.rows && image->cols == s->field.cols;
    if ((!window && !field) || (image->channels != 1 && image->channels != c->channels))
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a scene of %d channels, %d x %d does not fit the camera's window of %d channels, %d x %d "
                         "(field: %d x %d); crop or resize it",
                         image->channels, image->rows, image->cols, c->channels, c->window_rows, c->window_cols,
                         s->field.rows, s->field.cols);
    if (hada_image_count_not_finite(image))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "a scene holds NaN or infinite values");
    return HADA_OK;
}

hada_status hada_simulator_check_plane(const hada_simulator *s, const hada_plane *plane, hada_error *err)
{
    const hada_status status = hada_simulator_check_depth(s, plane->depth, err);
    return status ? status : hada_simulator_check_image(s, plane->image, err);
}

hada_status hada_simulator_upload(hada_simulator *s, const hada_image *image, int channels, hada_buffer *to,
                                  size_t offset, hada_error *err)
{
    const hada_extent field = s->field;
    const size_t pixels = (size_t)field.rows * (size_t)field.cols, bytes = pixels * sizeof(float);
    const int whole = image->rows == field.rows && image->cols == field.cols;
    float *wide = NULL;
    hada_status status = HADA_OK;
    if (!whole)
        HADA_TRY_OR_DONE(HADA_NEW(wide, pixels, "a scene", err));
    const int row0 = hada_window_origin(field.rows, image->rows), col0 = hada_window_origin(field.cols, image->cols);
    for (int c = 0; c < channels; c++) {
        const float *from =
            image->data + (image->channels == 1 ? 0 : (size_t)c * (size_t)image->rows * (size_t)image->cols);
        for (int r = 0; r < image->rows && !whole; r++)
            memcpy(wide + (size_t)(row0 + r) * (size_t)field.cols + col0, from + (size_t)r * (size_t)image->cols,
                   (size_t)image->cols * sizeof(float));
        HADA_TRY_OR_DONE(hada_buffer_write(to, s->slot, (offset + (size_t)c * pixels) * sizeof(float),
                                           whole ? from : wide, bytes, err));
    }
done:
    free(wide);
    return status;
}

hada_status hada_simulator_add_image(hada_simulator *s, const hada_image *image, const hada_buffer *otf, int add,
                                     hada_error *err)
{
    const int channels = s->camera.channels;
    HADA_TRY(hada_simulator_upload(s, image, channels, &s->scene, 0, err));
    HADA_TRY(hada_fft_forward(s->forward_scene, channels, s->scene.mem, 0, s->spectrum.mem, 0, err));
    return hada_optics_accumulate(s->slot, s->sum.mem, 0, otf->mem, s->psf_images, s->spectrum.mem, channels,
                                  s->layout.count, add, err);
}

static float maximum(const hada_image *image)
{
    float most = 0.0f;
    for (size_t i = 0; i < hada_image_count(image); i++)
        most = image->data[i] > most ? image->data[i] : most;
    return most;
}

hada_status hada_simulator_finish(hada_simulator *s, double noise, uint64_t seed, hada_image *raw, hada_error *err)
{
    const hada_camera *c = &s->camera;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fft_inverse(s->inverse, c->channels, s->sum.mem, 0, s->real.mem, 0, NULL, err));
    HADA_TRY_OR_DONE(hada_image_create(raw, c->channels, c->rows, c->cols, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&s->real, s->slot, 0, raw->data, hada_image_count(raw) * sizeof(float), err));
    if (noise > 0.0)
        hada_image_add_noise(raw, noise * maximum(raw), seed);
done:
    if (status)
        hada_image_destroy(raw);
    return status;
}

static hada_status add_planes(hada_simulator *s, const hada_plane *planes, int count, hada_error *err)
{
    const hada_buffer *otf;
    for (int i = 0; i < count; i++) {
        HADA_TRY(hada_simulator_otf(s, hada_simulator_place(s, planes[i].depth), NULL, &otf, err));
        HADA_TRY(hada_simulator_add_image(s, planes[i].image, otf, i > 0, err));
    }
    return HADA_OK;
}

hada_status hada_simulator_render(hada_simulator *s, const hada_plane *planes, int count, double noise,
                                  uint64_t noise_seed, hada_image *raw, hada_error *err)
{
    HADA_NEED(s && planes && raw, err);
    *raw = (hada_image){0};
    if (count < 1 || !(noise >= 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d planes with noise %g is not possible", count, noise);
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_simulator_check_plane(s, &planes[i], err));
    if (s->varying) {
        HADA_TRY(hada_varying_render(s, planes, count, raw, err));
        if (noise > 0.0)
            hada_image_add_noise(raw, noise * maximum(raw), noise_seed);
        return HADA_OK;
    }
    HADA_TRY(add_planes(s, planes, count, err));
    return hada_simulator_finish(s, noise, noise_seed, raw, err);
}

hada_status hada_simulator_white_exposure(hada_simulator *s, double share, double *exposure, hada_error *err)
{
    HADA_NEED(s && exposure, err);
    hada_image white = {0}, raw = {0};
    float most = 0.0f;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&white, 1, s->camera.window_rows, s->camera.window_cols, err));
    for (size_t i = 0; i < hada_image_count(&white); i++)
        white.data[i] = 1.0f;
    for (int z = 0; z < s->camera.depths; z++) {
        hada_image_destroy(&raw);
        HADA_TRY_OR_DONE(hada_simulator_render(s, &(hada_plane){z, &white}, 1, 0.0, 0, &raw, err));
        most = maximum(&raw) > most ? maximum(&raw) : most;
    }
    if (!(most > 0.0f))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_NUMERIC, "no light of the window reaches the sensor: is its shift too large?"));
    *exposure = share / most;
done:
    hada_image_destroy(&white);
    hada_image_destroy(&raw);
    return status;
}
