/* A small simulated camera for tests: point spread functions of random spots, scenes of random pixels, frames by
 * circular or cropped convolution in double precision. */
#ifndef HADA_TESTS_CAMERA_SMALL_H
#define HADA_TESTS_CAMERA_SMALL_H

#include "image/pixels.h"
#include "ref/ref_convolve.h"
#include "testing.h"

/* Spots of random brightness around the axis and a bright one on it, so that no frequency is lost; sum 1. */
static inline hada_image small_psf(int channels, int rows, int cols, int spots, uint64_t seed)
{
    hada_image psf;
    hada_random random;
    const size_t area = (size_t)rows * (size_t)cols;
    ASSERT_OK(hada_image_create(&psf, channels, rows, cols, err));
    for (int c = 0; c < channels; c++) {
        float *to = psf.data + (size_t)c * area;
        double total = 2.0;
        hada_random_seed(&random, seed, (uint64_t)c);
        to[(size_t)(rows / 2) * (size_t)cols + (size_t)(cols / 2)] = 2.0f;
        for (int i = 0; i < spots; i++) {
            const int row = rows / 4 + (int)hada_random_below(&random, (uint32_t)(rows / 2));
            const int col = cols / 4 + (int)hada_random_below(&random, (uint32_t)(cols / 2));
            const double value = hada_random_range(&random, 0.2, 1.0) / spots;
            to[(size_t)row * (size_t)cols + (size_t)col] += (float)value;
            total += value;
        }
        for (size_t i = 0; i < area; i++)
            to[i] = (float)(to[i] / total);
    }
    return psf;
}

/* Means of neighbours, several times, so that there is no detail as fine as a mosaic. The border stays. */
static inline void small_soften(hada_image *image)
{
    for (int pass = 0; pass < 6; pass++) {
        SCOPED(hada_image) before = {0};
        const size_t cols = (size_t)image->cols, step = pass & 1 ? cols : 1;
        ASSERT_OK(hada_image_copy(&before, image, err));
        for (size_t i = cols; i < hada_image_count(image) - cols; i++)
            image->data[i] = 0.5f * before.data[i] + 0.25f * (before.data[i - step] + before.data[i + step]);
    }
}

static inline hada_image small_scene(int channels, int rows, int cols, uint64_t seed)
{
    hada_image scene;
    hada_random random;
    ASSERT_OK(hada_image_create(&scene, channels, rows, cols, err));
    hada_random_seed(&random, seed, 99);
    for (size_t i = 0; i < hada_image_count(&scene); i++)
        scene.data[i] = (float)hada_random_uniform(&random);
    return scene;
}

/* The frame that the camera sees of a scene in the middle of its field. */
static inline hada_image small_frame(const hada_image *psf, const hada_image *scene, int padded, double noise,
                                     uint64_t seed)
{
    hada_image frame;
    hada_random random;
    const int rows = psf->rows, cols = psf->cols, row0 = (rows - scene->rows) / 2, col0 = (cols - scene->cols) / 2;
    const size_t area = (size_t)rows * (size_t)cols;
    SCOPED_MEMORY float *whole = calloc(area, sizeof *whole);
    SCOPED_MEMORY double *seen = calloc(area, sizeof *seen);
    ASSERT_OK(hada_image_create(&frame, psf->channels, rows, cols, err));
    hada_random_seed(&random, seed, 7);
    for (int c = 0; c < psf->channels; c++) {
        const float *from = scene->data + (size_t)c * (size_t)scene->rows * (size_t)scene->cols;
        const float *spread = psf->data + (size_t)c * area;
        memset(seen, 0, area * sizeof *seen);
        for (int row = 0; row < scene->rows; row++)
            memcpy(whole + (size_t)(row0 + row) * (size_t)cols + (size_t)col0, from + (size_t)row * (size_t)scene->cols,
                   (size_t)scene->cols * sizeof *whole);
        if (padded)
            hada_ref_convolve_crop(rows, cols, whole, rows, cols, spread, seen);
        else
            hada_ref_convolve(rows, cols, whole, spread, seen);
        for (size_t i = 0; i < area; i++)
            frame.data[(size_t)c * area + i] = (float)(seen[i] + noise * hada_random_normal(&random));
    }
    return frame;
}

/* Pairs of one depth for hada_dataset_create(). */
typedef struct small_pairs {
    const hada_image *frames, *scenes;
} small_pairs;

static inline hada_status small_read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene,
                                          hada_error *error)
{
    const small_pairs *of = user;
    const hada_image *from[] = {&of->frames[pair], &of->scenes[pair]};
    hada_image *to[] = {raw, scene};
    (void)depth;
    for (int i = 0; i < 2; i++) {
        const hada_status status = hada_image_create(to[i], from[i]->channels, from[i]->rows, from[i]->cols, error);
        if (status)
            return status;
        memcpy(to[i]->data, from[i]->data, hada_image_count(from[i]) * sizeof(float));
    }
    return HADA_OK;
}

#endif
