/* Raw frames on a device: b = sum_z PSF_z * x_z + noise. */
#include <hadalens/scene.h>
#include <hadalens/simulate.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "fft/fft.h"
#include "optics/accumulate.h"

struct hada_simulator {
    hada_camera camera;
    hada_image *psf; /* given ones, one a depth; NULL: from geometry */
    int psf_images;  /* channels of each PSF */
    int rows, cols;  /* of the transform: the sensor, or larger where light is cropped */

    hada_slot *slot;
    hada_fft *forward_psf, *forward_scene, *inverse;
    hada_spectrum_layout layout;
    hada_buffer real;     /* a PSF on the transform's grid, or the frame */
    hada_buffer scene;    /* a plane, channels x window */
    hada_buffer spectrum; /* of a plane */
    hada_buffer sum;      /* of the frame */
    hada_buffer *otf;     /* per depth, empty until first used */
};

static size_t max_size(size_t a, size_t b)
{
    return a > b ? a : b;
}

static hada_status make_plans(hada_simulator *s, hada_error *err)
{
    const hada_camera *c = &s->camera;
    const int images = c->channels > s->psf_images ? c->channels : s->psf_images;
    const hada_fft_desc psf = {.direction = HADA_FFT_FORWARD,
                               .rows = s->rows,
                               .cols = s->cols,
                               .batch = 1,
                               .real_rows = s->rows,
                               .real_cols = s->cols,
                               .real_pitch = (size_t)s->cols,
                               .real_distance = (size_t)s->rows * (size_t)s->cols};
    /* the sensor's first pixel is the transform's first pixel */
    const hada_fft_desc scene = {.direction = HADA_FFT_FORWARD,
                                 .rows = s->rows,
                                 .cols = s->cols,
                                 .batch = c->channels,
                                 .row0 = hada_window_origin(c->rows, c->window_rows),
                                 .col0 = hada_window_origin(c->cols, c->window_cols),
                                 .real_rows = c->window_rows,
                                 .real_cols = c->window_cols,
                                 .real_pitch = (size_t)c->window_cols,
                                 .real_distance = (size_t)c->window_rows * (size_t)c->window_cols};
    const hada_fft_desc frame = {.direction = HADA_FFT_INVERSE,
                                 .rows = s->rows,
                                 .cols = s->cols,
                                 .batch = c->channels,
                                 .real_rows = c->rows,
                                 .real_cols = c->cols,
                                 .real_pitch = (size_t)c->cols,
                                 .real_distance = (size_t)c->rows * (size_t)c->cols};
    hada_status status;
    if ((status = hada_fft_create(&s->forward_psf, s->slot, &psf, err)) ||
        (status = hada_fft_create(&s->forward_scene, s->slot, &scene, err)) ||
        (status = hada_fft_create(&s->inverse, s->slot, &frame, err)))
        return status;
    s->layout = *hada_fft_plan_layout(s->forward_psf);
    const size_t spectrum = s->layout.count * 2 * sizeof(float) * (size_t)images,
                 real = max_size(psf.real_distance, frame.real_distance * (size_t)c->channels) * sizeof(float);
    hada_context *context = s->slot->context;
    if ((status = hada_buffer_create(&s->real, context, real, "a simulated frame", err)) ||
        (status = hada_buffer_create(&s->scene, context, scene.real_distance * (size_t)c->channels * sizeof(float),
                                     "a scene", err)) ||
        (status = hada_buffer_create(&s->spectrum, context, spectrum, "the spectrum of a scene", err)))
        return status;
    return hada_buffer_create(&s->sum, context, spectrum, "the spectrum of a simulated frame", err);
}

static hada_status check_psf(const hada_camera *camera, const hada_image *psf, hada_error *err)
{
    for (int i = 0; i < camera->depths; i++) {
        if (psf[i].rows != camera->rows || psf[i].cols != camera->cols || psf[i].channels != psf[0].channels ||
            (psf[i].channels != 1 && psf[i].channels != camera->channels))
            return hada_fail(err, HADA_ERROR_SIZE,
                             "PSF %d of %d channels, %d x %d does not fit a camera "
                             "of %d channels, %d x %d",
                             i + 1, psf[i].channels, psf[i].rows, psf[i].cols, camera->channels, camera->rows,
                             camera->cols);
        if (hada_image_count_not_finite(&psf[i]))
            return hada_fail(err, HADA_ERROR_NOT_FINITE, "PSF %d holds NaN or infinite values", i + 1);
    }
    return HADA_OK;
}

static hada_status keep_psf(hada_simulator *s, const hada_image *psf, hada_error *err)
{
    void *memory;
    hada_status status = hada_alloc(&memory, (size_t)s->camera.depths, sizeof(hada_image), "the PSFs", err);
    if (status)
        return status;
    s->psf = memory;
    for (int i = 0; i < s->camera.depths; i++) {
        if ((status = hada_image_create(&s->psf[i], psf[i].channels, psf[i].rows, psf[i].cols, err)))
            return status;
        memcpy(s->psf[i].data, psf[i].data, hada_image_count(&psf[i]) * sizeof(float));
    }
    s->psf_images = psf[0].channels;
    return HADA_OK;
}

static hada_status create(hada_simulator **out, hada_context *context, const hada_camera *camera, const hada_image *psf,
                          hada_error *err)
{
    *out = NULL;
    hada_status status = hada_camera_check(camera, err);
    if (status || (psf && (status = check_psf(camera, psf, err))))
        return status;
    void *memory;
    if ((status = hada_alloc(&memory, 1, sizeof(hada_simulator), "a simulator", err)))
        return status;
    hada_simulator *s = memory;
    s->camera = *camera;
    s->psf_images = 1;
    s->rows = camera->rows;
    s->cols = camera->cols;
    if (camera->boundary == HADA_BOUNDARY_PADDED) {
        s->rows = hada_fft_good_size(camera->rows + camera->window_rows);
        s->cols = hada_fft_good_size(camera->cols + camera->window_cols);
    }
    if ((psf && (status = keep_psf(s, psf, err))) ||
        (status = hada_alloc(&memory, (size_t)camera->depths, sizeof(hada_buffer), "the transfer functions", err)))
        goto done;
    s->otf = memory;
    if (!(status = hada_slot_create(&s->slot, context, err)))
        status = make_plans(s, err);
done:
    if (status)
        hada_simulator_destroy(&s);
    *out = s;
    return status;
}

hada_status hada_simulator_create(hada_simulator **out, hada_context *context, const hada_camera *camera,
                                  hada_error *err)
{
    return create(out, context, camera, NULL, err);
}

hada_status hada_simulator_create_psf(hada_simulator **out, hada_context *context, const hada_camera *camera,
                                      const hada_image *psf, hada_error *err)
{
    return create(out, context, camera, psf, err);
}

void hada_simulator_destroy(hada_simulator **simulator)
{
    hada_simulator *s = simulator ? *simulator : NULL;
    if (!s)
        return;
    *simulator = NULL;
    if (s->slot)
        hada_slot_finish(s->slot, NULL);
    hada_fft_destroy(&s->forward_psf);
    hada_fft_destroy(&s->forward_scene);
    hada_fft_destroy(&s->inverse);
    hada_buffer_destroy(&s->real);
    hada_buffer_destroy(&s->scene);
    hada_buffer_destroy(&s->spectrum);
    hada_buffer_destroy(&s->sum);
    for (int i = 0; i < s->camera.depths; i++) {
        if (s->otf)
            hada_buffer_destroy(&s->otf[i]);
        if (s->psf)
            hada_image_destroy(&s->psf[i]);
    }
    free(s->otf);
    free(s->psf);
    hada_slot_destroy(&s->slot);
    free(s);
}

const hada_camera *hada_simulator_camera(const hada_simulator *simulator)
{
    return &simulator->camera;
}

static hada_status check_depth(const hada_simulator *s, int depth, hada_error *err)
{
    if (depth < 0 || depth >= s->camera.depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "depth %d is not among the camera's %d depths (0 to %d)", depth,
                         s->camera.depths, s->camera.depths - 1);
    return HADA_OK;
}

hada_status hada_simulator_psf(const hada_simulator *simulator, int depth, hada_image *psf, hada_error *err)
{
    *psf = (hada_image){0};
    hada_status status = check_depth(simulator, depth, err);
    if (status)
        return status;
    if (!simulator->psf)
        return hada_camera_psf(&simulator->camera, simulator->camera.distances_mm[depth], psf, err);
    const hada_image *given = &simulator->psf[depth];
    return hada_image_crop(psf, given, 0, 0, given->rows, given->cols, err);
}

/* A PSF on the transform's grid with the axis moved from the middle to pixel
 * (0, 0). */
static hada_status upload_psf(hada_simulator *s, const hada_image *psf, int channel, hada_error *err)
{
    void *memory;
    hada_status status = hada_alloc(&memory, (size_t)s->rows * (size_t)s->cols, sizeof(float), "a PSF", err);
    if (status)
        return status;
    float *turned = memory;
    for (int r = 0; r < psf->rows; r++) {
        const int to_row = (r - psf->rows / 2 + s->rows) % s->rows;
        const float *from = psf->data + ((size_t)channel * (size_t)psf->rows + (size_t)r) * (size_t)psf->cols;
        for (int c = 0; c < psf->cols; c++)
            turned[(size_t)to_row * (size_t)s->cols + (size_t)((c - psf->cols / 2 + s->cols) % s->cols)] = from[c];
    }
    status = hada_buffer_write(&s->real, s->slot, 0, turned, (size_t)s->rows * (size_t)s->cols * sizeof(float), err);
    free(turned);
    return status;
}

static hada_status make_otf(hada_simulator *s, int depth, hada_error *err)
{
    hada_image made = {0};
    const hada_image *psf = s->psf ? &s->psf[depth] : &made;
    hada_buffer *otf = &s->otf[depth];
    hada_status status = HADA_OK;
    if (!s->psf)
        status = hada_camera_psf_sized(&s->camera, s->camera.distances_mm[depth], s->rows, s->cols, &made, err);
    if (!status)
        status = hada_buffer_create(otf, s->slot->context, s->layout.count * 2 * sizeof(float) * (size_t)s->psf_images,
                                    "a transfer function", err);
    for (int c = 0; c < s->psf_images && !status; c++)
        if (!(status = upload_psf(s, psf, c, err)))
            status = hada_fft_forward(s->forward_psf, 1, s->real.mem, 0, otf->mem, (size_t)c * s->layout.count, err);
    hada_image_destroy(&made);
    if (!status)
        status = hada_slot_finish(s->slot, err);
    if (status)
        hada_buffer_destroy(otf);
    return status;
}

static hada_status check_plane(const hada_simulator *s, const hada_plane *plane, hada_error *err)
{
    const hada_camera *c = &s->camera;
    const hada_image *image = plane->image;
    hada_status status = check_depth(s, plane->depth, err);
    if (status)
        return status;
    if (image->rows != c->window_rows || image->cols != c->window_cols ||
        (image->channels != 1 && image->channels != c->channels))
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a scene of %d channels, %d x %d does not fit the "
                         "camera's window of %d channels, %d x %d; "
                         "crop or resize it",
                         image->channels, image->rows, image->cols, c->channels, c->window_rows, c->window_cols);
    if (hada_image_count_not_finite(image))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "a scene holds NaN or infinite values");
    return HADA_OK;
}

/* Adds a plane's part to the frame's spectrum. */
static hada_status add_plane(hada_simulator *s, const hada_plane *plane, int add, hada_error *err)
{
    const int channels = s->camera.channels;
    const size_t bytes = (size_t)s->camera.window_rows * (size_t)s->camera.window_cols * sizeof(float);
    hada_status status = HADA_OK;
    if (!s->otf[plane->depth].mem && (status = make_otf(s, plane->depth, err)))
        return status;
    for (int c = 0; c < channels && !status; c++) {
        const size_t from = plane->image->channels == 1 ? 0 : (size_t)c * bytes / sizeof(float);
        status = hada_buffer_write(&s->scene, s->slot, (size_t)c * bytes, plane->image->data + from, bytes, err);
    }
    if (status || (status = hada_fft_forward(s->forward_scene, channels, s->scene.mem, 0, s->spectrum.mem, 0, err)))
        return status;
    return hada_optics_accumulate(s->slot, s->sum.mem, 0, s->otf[plane->depth].mem, s->psf_images, s->spectrum.mem,
                                  channels, s->layout.count, add, err);
}

hada_status hada_simulator_render(hada_simulator *s, const hada_plane *planes, int count, double noise,
                                  uint64_t noise_seed, hada_image *raw, hada_error *err)
{
    *raw = (hada_image){0};
    if (count < 1 || !(noise >= 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d planes with noise %g is not possible", count, noise);
    hada_status status = HADA_OK;
    for (int i = 0; i < count && !status; i++)
        status = check_plane(s, &planes[i], err);
    for (int i = 0; i < count && !status; i++)
        status = add_plane(s, &planes[i], i > 0, err);
    if (status)
        return status;
    const hada_camera *c = &s->camera;
    if ((status = hada_fft_inverse(s->inverse, c->channels, s->sum.mem, 0, s->real.mem, 0, NULL, err)) ||
        (status = hada_image_create(raw, c->channels, c->rows, c->cols, err)))
        return status;
    if ((status = hada_buffer_read(&s->real, s->slot, 0, raw->data, hada_image_count(raw) * sizeof(float), err))) {
        hada_image_destroy(raw);
        return status;
    }
    float most = 0.0f;
    for (size_t i = 0; i < hada_image_count(raw); i++)
        most = raw->data[i] > most ? raw->data[i] : most;
    if (noise > 0.0)
        hada_image_add_noise(raw, noise * most, noise_seed);
    return HADA_OK;
}
