/* Training on a small camera: a model of random kernels, pairs, and what training minimises in double precision. */
#ifndef HADA_TESTS_TRAIN_FIXTURE_H
#define HADA_TESTS_TRAIN_FIXTURE_H

#include "net_fixture.h"

#include "model/model.h"
#include "netlist/net_list.h"
#include "ref/ref_fft.h"
#include "ref/ref_loss.h"
#include "ref/ref_net.h"
#include "ref/ref_train.h"
#include "train/replica.h"

enum { TRAIN_DEPTHS = 2, TRAIN_PAIRS = 3 };

static inline void train_fill(float *out, size_t count, double shift, double scale, uint64_t stream)
{
    hada_random random;
    hada_random_seed(&random, 11, stream);
    for (size_t i = 0; i < count; i++)
        out[i] = (float)(shift + scale * hada_random_normal(&random));
}

/* Filters of random kernels around a delta; split: real parts alone are even, and so are imaginary ones. */
static inline hada_model *train_model(int channels, int rows, int cols, int window_rows, int window_cols, int padded,
                                      int split)
{
    static const double distances[TRAIN_DEPTHS] = {100.0, 200.0};
    hada_model_info info = {.depths = TRAIN_DEPTHS,
                            .channels = channels,
                            .form = split ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX,
                            .boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR,
                            .distances_mm = distances};
    hada_model *model;
    ASSERT_OK(hada_model_set_sizes(&info, rows, cols, window_rows, window_cols, err));
    ASSERT_OK(hada_model_create(&model, &info, 0, err));
    const size_t pixels = (size_t)info.grid_rows * (size_t)info.grid_cols, plane = 2 * hada_model_plane(model);
    SCOPED_MEMORY double *kernel = calloc(pixels, sizeof *kernel), *spectrum = calloc(plane, sizeof *spectrum);
    hada_random random;
    hada_random_seed(&random, 3, 0);
    for (size_t image = 0; image < (size_t)(TRAIN_DEPTHS * channels); image++) {
        float *filter = model->filter + image * plane;
        for (size_t i = 0; i < pixels; i++)
            kernel[i] = (i ? 0.0 : 0.8) + 0.4 * hada_random_normal(&random) / sqrt((double)pixels);
        ASSERT_OK(hada_ref_fft_forward(kernel, info.grid_rows, info.grid_cols, spectrum, err));
        for (size_t i = 0; i < plane; i += 2) {
            filter[i] = (float)spectrum[i];
            filter[i + 1] = (float)(split ? 0.5 * spectrum[i] : spectrum[i + 1]);
        }
    }
    return model;
}

/* Pairs of random images: frames (or planes of the window's size) and scenes. */
typedef struct train_pairs {
    hada_image input[TRAIN_PAIRS], scene[TRAIN_PAIRS];
    hada_sample samples[TRAIN_PAIRS];
} train_pairs;

static inline void train_pairs_make(train_pairs *pairs, const hada_model_info *info, int frames)
{
    static const int depths[TRAIN_PAIRS] = {1, 0, 1};
    for (int i = 0; i < TRAIN_PAIRS; i++) {
        hada_image *input = &pairs->input[i], *scene = &pairs->scene[i];
        ASSERT_OK(hada_image_create(input, info->channels, frames ? info->raw_rows : info->window_rows,
                                    frames ? info->raw_cols : info->window_cols, err));
        ASSERT_OK(hada_image_create(scene, info->channels, info->window_rows, info->window_cols, err));
        train_fill(input->data, hada_image_count(input), 0.4, 0.3, 20 + (uint64_t)i);
        train_fill(scene->data, hada_image_count(scene), 0.5, 0.3, 40 + (uint64_t)i);
        pairs->samples[i] = (hada_sample){depths[i], input, scene, 0, 0.0};
    }
}

static inline void train_pairs_free(train_pairs *pairs)
{
    destroy_images(pairs->input, TRAIN_PAIRS);
    destroy_images(pairs->scene, TRAIN_PAIRS);
}

static inline hada_train_options train_options(hada_stage stage)
{
    return (hada_train_options){.size = sizeof(hada_train_options),
                                .stage = stage,
                                .seed = 5,
                                .mse = 1.5,
                                .perceptual = 0.1,
                                .adversarial = 0.02,
                                .variation = 1e-3};
}

static inline hada_ref_grid train_grid(const hada_model_info *info)
{
    hada_geometry g;
    ASSERT_OK(hada_geometry_of(info, &g, err));
    return (hada_ref_grid){.rows = info->grid_rows,
                           .cols = info->grid_cols,
                           .raw_row = g.raw_row,
                           .raw_col = g.raw_col,
                           .raw_rows = info->raw_rows,
                           .raw_cols = info->raw_cols,
                           .window_row = g.window_row,
                           .window_col = g.window_col,
                           .window_rows = info->window_rows,
                           .window_cols = info->window_cols};
}

/* What a step looks at, in double precision. Filters: [depth], each as a group has them; values of the nets. */
typedef struct train_case {
    const hada_model_info *info;
    const hada_train_options *options;
    const hada_sample *samples;
    int count;
    const hada_net *net, *discriminator, *vgg;
    double *filters[TRAIN_DEPTHS], *values, *discriminator_values;
} train_case;

static inline void train_case_free(train_case *c)
{
    for (int z = 0; z < TRAIN_DEPTHS; z++)
        free(c->filters[z]);
    HADA_FREE(c->values, c->discriminator_values);
}

/* The linear plane of a sample. */
static inline void train_plane(const train_case *c, const hada_sample *sample, double *plane)
{
    const hada_ref_grid grid = train_grid(c->info);
    const size_t spectrum = 2 * hada_model_info_plane(c->info), frame = (size_t)grid.raw_rows * (size_t)grid.raw_cols;
    const size_t window = (size_t)grid.window_rows * (size_t)grid.window_cols;
    SCOPED_MEMORY double *b = calloc(spectrum, sizeof *b);
    for (size_t k = 0; k < (size_t)c->info->channels; k++) {
        ASSERT_OK(hada_ref_grid_forward(&grid, sample->input->data + k * frame, grid.raw_row, grid.raw_col,
                                        grid.raw_rows, grid.raw_cols, b, err));
        ASSERT_OK(hada_ref_train_plane(&grid, b, c->filters[sample->depth] + k * spectrum,
                                       c->info->form == HADA_FORM_SPLIT, plane + k * window, err));
    }
}

static inline double *train_run(const hada_net *net, const double *values, int images, int rows, int cols,
                                const double *x, size_t out)
{
    double *y = calloc(out, sizeof *y);
    ASSERT_OK(hada_ref_net_forward(net, values, 1, images, rows, cols, x, y, err));
    return y;
}

/* What the net gives for the samples at the window's size. */
static inline double *train_output(const train_case *c)
{
    const hada_model_info *info = c->info;
    const int filters = c->options->stage == HADA_STAGE_FILTERS;
    const int rows = info->window_rows, cols = info->window_cols;
    const int net_rows = c->options->net_rows ? c->options->net_rows : rows;
    const int net_cols = c->options->net_cols ? c->options->net_cols : cols;
    const hada_ref_shape window = {c->count, info->channels, rows, cols};
    const hada_ref_shape small = {c->count, info->channels, net_rows, net_cols};
    const size_t plane = hada_ref_values(&window) / (size_t)c->count;
    double *x = calloc(hada_ref_values(&window), sizeof *x);
    for (int i = 0; i < c->count; i++) {
        double *to = x + (size_t)i * plane;
        if (filters)
            train_plane(c, &c->samples[i], to);
        for (size_t k = 0; k < plane; k++) {
            if (!filters)
                to[k] = c->samples[i].input->data[k];
            else if (c->net && to[k] < 0)
                to[k] = 0;
        }
    }
    if (!c->net)
        return x;
    double *in = calloc(hada_ref_values(&small), sizeof *in), *out = calloc(hada_ref_values(&window), sizeof *out);
    hada_ref_resize(&window, net_rows, net_cols, 2, 0, x, in);
    SCOPED_MEMORY double *y = train_run(c->net, c->values, c->count, net_rows, net_cols, in, hada_ref_values(&small));
    hada_ref_resize(&small, rows, cols, 2, 0, y, out);
    HADA_FREE(x, in);
    return out;
}

static inline double *train_scenes(const train_case *c)
{
    const size_t plane = hada_image_count(c->samples[0].scene);
    double *scenes = calloc(plane * (size_t)c->count, sizeof *scenes);
    for (size_t i = 0; i < (size_t)c->count; i++)
        for (size_t k = 0; k < plane; k++)
            scenes[i * plane + k] = c->samples[i].scene->data[k];
    return scenes;
}

/* Three channels for the perceptual loss. */
static inline double *train_features(const train_case *c, const double *images, size_t *count)
{
    const int rows = c->info->window_rows, cols = c->info->window_cols;
    const size_t pixels = (size_t)rows * (size_t)cols, channels = (size_t)c->info->channels;
    hada_size sizes[64];
    SCOPED_MEMORY double *colours = calloc(3 * pixels * (size_t)c->count, sizeof *colours);
    for (size_t i = 0; i < (size_t)c->count; i++)
        for (size_t k = 0; k < 3 * pixels; k++)
            colours[i * 3 * pixels + k] = images[i * channels * pixels + (channels == 1 ? k % pixels : k)];
    ASSERT_OK(hada_net_sizes(c->vgg, rows, cols, sizes, err));
    const hada_size last = sizes[c->vgg->count - 1];
    *count =
        (size_t)c->count * (size_t)c->vgg->layers[c->vgg->count - 1].channels * (size_t)last.rows * (size_t)last.cols;
    SCOPED_MEMORY double *values = doubles(c->vgg->values, c->vgg->floats);
    double *features = train_run(c->vgg, values, c->count, rows, cols, colours, *count);
    return features;
}

/* Cross-entropy of the discriminator's logits: one an image, or one a patch. */
static inline double train_logits(const train_case *c, const double *images, double label, double weight)
{
    const int rows = c->info->window_rows, cols = c->info->window_cols;
    hada_size sizes[64];
    ASSERT_OK(hada_net_sizes(c->discriminator, rows, cols, sizes, err));
    const hada_size last = sizes[c->discriminator->count - 1];
    const size_t count = (size_t)c->count * (size_t)last.rows * (size_t)last.cols;
    SCOPED_MEMORY double *labels = calloc(count, sizeof *labels);
    for (size_t i = 0; i < count; i++)
        labels[i] = label;
    const size_t plane = (size_t)c->info->channels * (size_t)rows * (size_t)cols;
    const int paired = c->discriminator->layers[0].channels == 2 * c->info->channels;
    double *pairs = calloc(2 * plane * (size_t)c->count, sizeof *pairs), *at = pairs;
    for (size_t i = 0; paired && i < (size_t)c->count; i++) { /* the plane first */
        for (size_t k = 0; k < plane; k++)
            *at++ = c->samples[i].input->data[k];
        memcpy(at, images + i * plane, plane * sizeof *at);
        at += plane;
    }
    SCOPED_MEMORY double *logits =
        train_run(c->discriminator, c->discriminator_values, c->count, rows, cols, paired ? pairs : images, count);
    const double loss = hada_ref_logits(count, weight, logits, labels, NULL);
    free(pairs);
    return loss;
}

/* The terms, with the mean over the samples. */
static inline hada_terms train_terms(const train_case *c)
{
    const hada_train_options *o = c->options;
    const hada_ref_shape shape = {c->count, c->info->channels, c->info->window_rows, c->info->window_cols};
    const size_t values = hada_ref_values(&shape);
    SCOPED_MEMORY double *x = train_output(c), *t = train_scenes(c);
    hada_terms terms = {.mse = hada_ref_mse(values, o->mse, x, t, NULL)};
    if (c->net)
        terms.variation = hada_ref_variation(&shape, o->variation_squared, o->variation, x, NULL);
    if (c->vgg) {
        size_t count;
        SCOPED_MEMORY double *a = train_features(c, x, &count), *b = train_features(c, t, &count);
        terms.perceptual = hada_ref_mse(count, o->perceptual, a, b, NULL);
    }
    if (c->discriminator) {
        terms.adversarial = train_logits(c, x, 1.0, o->adversarial);
        terms.discriminator = train_logits(c, t, 1.0, 1.0) + train_logits(c, x, 0.0, 1.0);
    }
    return terms;
}

static inline double train_sum(const hada_terms *terms)
{
    return terms->mse + terms->variation + terms->perceptual + terms->adversarial;
}

/* Holds a gradient against the central difference of the terms along random directions: `values` are parameters of the
 * case. */
static inline void train_difference(const train_case *c, double *values, const float *gradient, size_t count,
                                    int discriminator)
{
    double size = 0.0, *direction = calloc(count, sizeof *direction);
    for (size_t i = 0; i < count; i++)
        size += (double)gradient[i] * gradient[i];
    size = sqrt(size);
    assert_true(size > 0.0);
    for (uint64_t d = 0; d < 3; d++) {
        const double step = 1e-6;
        double along = 0.0, loss[2];
        hada_random random;
        hada_random_seed(&random, 77, d);
        for (size_t i = 0; i < count; i++) {
            direction[i] = hada_random_normal(&random);
            along += direction[i] * (double)gradient[i];
        }
        for (int side = 0; side < 2; side++) {
            for (size_t i = 0; i < count; i++)
                values[i] += (side ? -2.0 : 1.0) * step * direction[i];
            const hada_terms terms = train_terms(c);
            loss[side] = discriminator ? terms.discriminator : train_sum(&terms);
        }
        for (size_t i = 0; i < count; i++)
            values[i] += step * direction[i];
        const double error = fabs((loss[0] - loss[1]) / (2.0 * step) - along) / size;
        if (error > 2e-4)
            fail_msg("direction %d: %.9g by differences, %.9g along the gradient, of norm %g", (int)d,
                     (loss[0] - loss[1]) / (2.0 * step), along, size);
    }
    free(direction);
}

static inline float *train_read(hada_replica *replica, int group, hada_content content)
{
    float *out = calloc(hada_parameters_floats(hada_replica_parameters(replica), group, content) + 1, sizeof *out);
    ASSERT_OK(hada_parameters_read(hada_replica_parameters(replica), group, content, out, err));
    return out;
}

/* An replica that holds what it stated. */
static inline hada_replica *train_replica(const net_device *device, const hada_replica_desc *desc)
{
    hada_replica *replica;
    size_t bytes;
    const uint64_t before = hada_context_bytes(device->context);
    ASSERT_OK(hada_replica_bytes(device->context, desc, &bytes, err));
    ASSERT_OK(hada_replica_create(&replica, device->slot, desc, err));
    assert_int_equal(hada_context_bytes(device->context) - before, bytes);
    return replica;
}

#endif
