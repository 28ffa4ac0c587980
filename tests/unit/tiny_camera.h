/* A small camera for tests: random spots that spread with the depth, scenes in a window, frames by the double-precision
 * reference. */
#ifndef HADA_TESTS_TINY_CAMERA_H
#define HADA_TESTS_TINY_CAMERA_H

#include "filter/bank.h"
#include "ref/ref_fft.h"
#include "refine/admm.h"
#include "testing.h"

enum { TINY_SPOTS = 9 };

typedef struct tiny_camera {
    int rows, cols, depths, channels;
    hada_rectangle frame, window;
    int padded;
    size_t pixels, values, window_area, frame_area;
    double *otf; /* [depth][values] complex, the same for all channels */
} tiny_camera;

static inline double *tiny_zeros(size_t count)
{
    double *zeros = calloc(count, sizeof *zeros);
    return zeros;
}

/* Frame and window share the middle of the grid; padded: the grid is twice the frame. */
static inline tiny_camera tiny_make(int frame_rows, int frame_cols, int window_rows, int window_cols, int depths,
                                    int channels, int padded)
{
    tiny_camera camera = {.rows = frame_rows * (padded ? 2 : 1),
                          .cols = frame_cols * (padded ? 2 : 1),
                          .depths = depths,
                          .channels = channels,
                          .padded = padded};
    hada_random random;
    double y[TINY_SPOTS], x[TINY_SPOTS];
    camera.frame =
        (hada_rectangle){(camera.rows - frame_rows) / 2, (camera.cols - frame_cols) / 2, frame_rows, frame_cols};
    camera.window = (hada_rectangle){camera.frame.row0 + (frame_rows - window_rows) / 2,
                                     camera.frame.col0 + (frame_cols - window_cols) / 2, window_rows, window_cols};
    camera.pixels = (size_t)camera.rows * (size_t)camera.cols;
    camera.values = (size_t)camera.rows * (size_t)(camera.cols / 2 + 1);
    camera.window_area = (size_t)window_rows * (size_t)window_cols;
    camera.frame_area = (size_t)frame_rows * (size_t)frame_cols;
    camera.otf = tiny_zeros((size_t)depths * camera.values * 2);
    hada_random_seed(&random, 7, 0);
    for (int s = 0; s < TINY_SPOTS; s++) {
        y[s] = hada_random_range(&random, -0.3, 0.3) * frame_rows;
        x[s] = hada_random_range(&random, -0.3, 0.3) * frame_cols;
    }
    SCOPED_MEMORY double *psf = tiny_zeros(camera.pixels);
    for (int z = 0; z < depths; z++) {
        const double scale = 1.0 + 0.5 * (depths - 1 - z) / (depths > 1 ? depths - 1 : 1), sigma = 0.7 + 0.1 * z;
        double sum = 0.0;
        memset(psf, 0, camera.pixels * sizeof *psf);
        for (int s = 0; s < TINY_SPOTS; s++)
            for (int i = -4; i <= 4; i++)
                for (int j = -4; j <= 4; j++) {
                    const double py = y[s] * scale, px = x[s] * scale;
                    const int row = (int)lrint(py) + i, col = (int)lrint(px) + j;
                    const double square = (row - py) * (row - py) + (col - px) * (col - px);
                    const int r = (row + 4 * camera.rows) % camera.rows, c = (col + 4 * camera.cols) % camera.cols;
                    psf[(size_t)r * (size_t)camera.cols + (size_t)c] += exp(-square / (2.0 * sigma * sigma));
                }
        for (size_t i = 0; i < camera.pixels; i++)
            sum += psf[i];
        for (size_t i = 0; i < camera.pixels; i++)
            psf[i] /= sum;
        ASSERT_OK(hada_ref_fft_forward(psf, camera.rows, camera.cols, camera.otf + (size_t)z * camera.values * 2, err));
    }
    return camera;
}

static inline void tiny_free(tiny_camera *camera)
{
    free(camera->otf);
    camera->otf = NULL;
}

/* A scene of bright shapes on a dim ground, values 0 to 1, different for each seed. */
static inline void tiny_scene(const tiny_camera *camera, unsigned seed, double *scene)
{
    hada_random random;
    const int rows = camera->window.rows, cols = camera->window.cols;
    hada_random_seed(&random, seed, 1);
    for (size_t i = 0; i < camera->window_area; i++)
        scene[i] = 0.1;
    for (int k = 0; k < 6; k++) {
        const int h = 2 + (int)hada_random_below(&random, (uint32_t)(rows / 3)),
                  w = 2 + (int)hada_random_below(&random, (uint32_t)(cols / 3));
        const int row = (int)hada_random_below(&random, (uint32_t)(rows - h)),
                  col = (int)hada_random_below(&random, (uint32_t)(cols - w));
        const double value = hada_random_range(&random, 0.2, 1.0);
        for (int i = row; i < row + h; i++)
            for (int j = col; j < col + w; j++)
                scene[(size_t)i * (size_t)cols + (size_t)j] = value;
    }
}

/* image[grid] = what the sensor sees of scenes[depth][window], plus noise of `noise` times its maximum; zero outside
 * the frame. */
static inline void tiny_shoot(const tiny_camera *camera, const double *scenes, double noise, unsigned seed,
                              double *image)
{
    const size_t count = camera->values * 2;
    double *grid = tiny_zeros(camera->pixels), *spectrum = tiny_zeros(count), *sum = tiny_zeros(count), top = 0.0;
    hada_random random;
    for (int z = 0; z < camera->depths; z++) {
        const double *h = camera->otf + (size_t)z * count, *scene = scenes + (size_t)z * camera->window_area;
        for (int i = 0; i < camera->window.rows; i++)
            memcpy(grid + (size_t)(camera->window.row0 + i) * (size_t)camera->cols + (size_t)camera->window.col0,
                   scene + (size_t)i * (size_t)camera->window.cols, (size_t)camera->window.cols * sizeof *grid);
        ASSERT_OK(hada_ref_fft_forward(grid, camera->rows, camera->cols, spectrum, err));
        for (size_t f = 0; f < count; f += 2) {
            sum[f] += h[f] * spectrum[f] - h[f + 1] * spectrum[f + 1];
            sum[f + 1] += h[f] * spectrum[f + 1] + h[f + 1] * spectrum[f];
        }
    }
    ASSERT_OK(hada_ref_fft_inverse(sum, camera->rows, camera->cols, grid, err));
    memset(image, 0, camera->pixels * sizeof *image);
    hada_random_seed(&random, seed, 2);
    for (size_t i = 0; i < camera->pixels; i++)
        top = fmax(top, grid[i]);
    for (int i = camera->frame.row0; i < camera->frame.row0 + camera->frame.rows; i++)
        for (int j = camera->frame.col0; j < camera->frame.col0 + camera->frame.cols; j++) {
            const size_t at = (size_t)i * (size_t)camera->cols + (size_t)j;
            image[at] = grid[at] + noise * top * hada_random_normal(&random);
        }
    HADA_FREE(grid, spectrum, sum);
}

/* A camera's data on the device: OTFs, and the frame `image` in every channel, channel c scaled by 1 / (1 + c). */
typedef struct tiny_device {
    hada_context *context;
    hada_slot *slot;
    hada_refine_shape shape;
    hada_spectrum_layout layout;
    hada_buffer otf, prior, image, frame, spectrum;
    hada_refine_data data;
} tiny_device;

static inline void tiny_upload(tiny_device *device, const tiny_camera *camera)
{
    memset(device, 0, sizeof *device);
    ASSERT_OK(hada_context_create(&device->context, NULL, err));
    ASSERT_OK(hada_slot_create(&device->slot, device->context, err));
    device->layout = hada_fft_layout(device->context, camera->rows, camera->cols, HADA_FFT_AUTO);
    const size_t count = device->layout.count;
    float *rows = calloc(camera->values, 2 * sizeof *rows);
    float *packed = calloc(count * (size_t)(camera->depths * camera->channels), 2 * sizeof *packed);
    for (int z = 0; z < camera->depths; z++)
        for (int c = 0; c < camera->channels; c++) {
            for (size_t f = 0; f < 2 * camera->values; f++)
                rows[f] = (float)camera->otf[(size_t)z * camera->values * 2 + f];
            hada_layout_pack(&device->layout, rows, packed + 2 * count * (size_t)(z * camera->channels + c));
        }
    ASSERT_OK(hada_buffer_create_from(&device->otf, device->slot, packed,
                                      count * (size_t)(camera->depths * camera->channels) * 8, "the OTFs", err));
    HADA_FREE(rows, packed);
    ASSERT_OK(hada_buffer_create(&device->image, device->context, camera->pixels * (size_t)camera->channels * 4,
                                 "the image", err));
    ASSERT_OK(hada_buffer_create(&device->frame, device->context, camera->frame_area * (size_t)camera->channels * 4,
                                 "the frame", err));
    ASSERT_OK(
        hada_buffer_create(&device->spectrum, device->context, count * (size_t)camera->channels * 8, "spectra", err));
    device->shape = (hada_refine_shape){
        .grid_rows = camera->rows,
        .grid_cols = camera->cols,
        .frame = camera->frame,
        .window = camera->window,
        .boundary = camera->padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR,
        .channels = camera->channels,
        .max_sets = 4,
        .max_planes = 4 * camera->depths,
        .max_steps = 40,
    };
    device->data = (hada_refine_data){.spectrum = device->spectrum.mem,
                                      .frame = device->frame.mem,
                                      .otf = device->otf.mem,
                                      .otf_depths = camera->depths};
}

/* Puts a frame on the device: images[channel][grid]. */
static inline void tiny_expose_colours(tiny_device *device, const tiny_camera *camera, const double *images)
{
    SCOPED_MEMORY float *whole = calloc(camera->pixels * (size_t)camera->channels, sizeof *whole);
    SCOPED_MEMORY float *part = calloc(camera->frame_area * (size_t)camera->channels, sizeof *part);
    float *to = part;
    for (size_t i = 0; i < camera->pixels * (size_t)camera->channels; i++)
        whole[i] = (float)images[i];
    for (int c = 0; c < camera->channels; c++)
        for (int i = 0; i < camera->frame.rows; i++, to += camera->frame.cols)
            memcpy(to,
                   whole + (size_t)c * camera->pixels + (size_t)(camera->frame.row0 + i) * (size_t)camera->cols +
                       (size_t)camera->frame.col0,
                   (size_t)camera->frame.cols * sizeof *to);
    SCOPED(hada_fft) * plan;
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, camera->rows, camera->cols, camera->channels);
    ASSERT_OK(hada_buffer_write(&device->image, device->slot, 0, whole, device->image.bytes, err));
    ASSERT_OK(hada_buffer_write(&device->frame, device->slot, 0, part, device->frame.bytes, err));
    ASSERT_OK(hada_fft_create(&plan, device->slot, &desc, err));
    ASSERT_OK(hada_fft_forward(plan, camera->channels, device->image.mem, 0, device->spectrum.mem, 0, err));
    ASSERT_OK(hada_slot_finish(device->slot, err));
}

/* One image in every channel, channel c scaled by gain / (1 + c). */
static inline void tiny_expose(tiny_device *device, const tiny_camera *camera, const double *image, double gain)
{
    SCOPED_MEMORY double *images = tiny_zeros(camera->pixels * (size_t)camera->channels);
    for (int c = 0; c < camera->channels; c++)
        for (size_t i = 0; i < camera->pixels; i++)
            images[(size_t)c * camera->pixels + i] = image[i] * gain / (1 + c);
    tiny_expose_colours(device, camera, images);
}

/* The Wiener prior: power of noise of `noise` times the frame's maximum over the mean power of scenes; the same for all
 * channels. */
static inline void tiny_prior(tiny_device *device, const tiny_camera *camera, const double *image, double noise)
{
    const double share = (double)camera->window_area / (double)camera->pixels;
    double *scene = tiny_zeros(camera->window_area), *grid = tiny_zeros(camera->pixels), top = 0.0;
    SCOPED_MEMORY double *spectrum = tiny_zeros(2 * camera->values), *power = tiny_zeros(camera->values);
    SCOPED_MEMORY float *rows = calloc(camera->values, sizeof *rows);
    SCOPED_MEMORY float *packed = calloc(device->layout.count * (size_t)camera->channels, sizeof *packed);
    for (unsigned seed = 50; seed < 58; seed++) {
        tiny_scene(camera, seed, scene);
        for (size_t i = 0; i < camera->window_area; i++)
            grid[(i / (size_t)camera->window.cols + (size_t)camera->window.row0) * (size_t)camera->cols +
                 i % (size_t)camera->window.cols + (size_t)camera->window.col0] = scene[i];
        ASSERT_OK(hada_ref_fft_forward(grid, camera->rows, camera->cols, spectrum, err));
        for (size_t i = 0; i < camera->values; i++)
            power[i] += (spectrum[2 * i] * spectrum[2 * i] + spectrum[2 * i + 1] * spectrum[2 * i + 1]) / 8.0;
    }
    for (size_t i = 0; i < camera->pixels; i++)
        top = fmax(top, image[i]);
    for (size_t i = 0; i < camera->values; i++)
        rows[i] = (float)(share * noise * noise * top * top * (double)camera->pixels / power[i]);
    for (size_t c = 0; c < (size_t)camera->channels; c++)
        hada_layout_pack_real(&device->layout, rows, packed + c * device->layout.count);
    hada_buffer_destroy(&device->prior);
    ASSERT_OK(hada_buffer_create_from(&device->prior, device->slot, packed,
                                      device->layout.count * (size_t)camera->channels * 4, "the prior", err));
    device->data.prior = device->prior.mem;
    HADA_FREE(scene, grid);
}

static inline void tiny_release(tiny_device *device)
{
    hada_buffer *buffers[] = {&device->otf, &device->prior, &device->image, &device->frame, &device->spectrum};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    hada_slot_destroy(&device->slot);
    hada_context_destroy(&device->context);
}

static inline double tiny_psnr(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return -10.0 * log10(sum / (double)count + 1e-20);
}

#endif
