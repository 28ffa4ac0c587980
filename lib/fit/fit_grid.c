#include "fit/fit_grid.h"

#include <hadalens/response.h>

#include "filter/hadamard.h"

/* Work-items of a group: of kernels by groups of eight frequencies, and of those by chunks where the device works in
 * groups (docs/reference/devices.md). */
enum { GROUP = 64 };

/* Kernels write whole vectors of complex numbers, so up to that many bytes beyond the last frequency. */
enum { VECTOR_BYTES = HADA_FIT_VECTOR * 2 * sizeof(float) };

static hada_status copy_distances(hada_fit_grid *grid, const double *distances_mm, hada_error *err)
{
    const size_t depths = (size_t)grid->info.depths;
    HADA_TRY(HADA_NEW(grid->distances, depths, "the distances", err));
    memcpy(grid->distances, distances_mm, depths * sizeof(double));
    grid->info.distances_mm = grid->distances;
    return HADA_OK;
}

hada_status hada_fit_info(hada_model_info *info, const hada_fit_options *options, hada_error *err)
{
    *info = (hada_model_info){.depths = options->depths,
                              .channels = options->channels,
                              .form = options->form,
                              .boundary = options->boundary,
                              .dark = options->dark,
                              .mosaic = options->mosaic,
                              .downsample = options->downsample > 1 ? options->downsample : 1,
                              .sensor_mosaic = options->sensor_mosaic,
                              .distances_mm = options->distances_mm,
                              .scene_response = options->scene_response == HADA_AUTO ? HADA_RESPONSE_LINEAR
                                                                                     : options->scene_response};
    memcpy(info->colour_matrix, options->colour_matrix, sizeof info->colour_matrix);
    if (options->frame_encoding != HADA_AUTO && options->frame_encoding != HADA_RESPONSE_LINEAR)
        info->frame_encoding = options->frame_encoding;
    HADA_TRY(hada_model_set_sizes(info, options->raw_rows, options->raw_cols, options->window_rows,
                                  options->window_cols, err));
    if (options->boundary == HADA_BOUNDARY_PADDED && options->grid_rows && options->grid_cols) {
        info->grid_rows = options->grid_rows;
        info->grid_cols = options->grid_cols;
    }
    return hada_model_info_check(info, err);
}

hada_status hada_fit_grid_create(hada_fit_grid *grid, hada_context *context, const hada_fit_options *options,
                                 hada_error *err)
{
    hada_model_info *info = &grid->info;
    *grid = (hada_fit_grid){0};
    hada_communicator_init(&grid->communicator);
    HADA_TRY(hada_communicator_check(options->communicator, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&grid->communicator, options->communicator, hada_communicator, err));
    HADA_TRY(hada_fit_info(info, options, err));
    info->has_otf = 1;
    HADA_TRY(hada_geometry_of(info, &grid->geometry, err));
    HADA_TRY(copy_distances(grid, options->distances_mm, err));
    HADA_TRY(hada_slot_create(&grid->slot, context, err));
    grid->layout = hada_fft_layout(context, info->grid_rows, info->grid_cols, HADA_FFT_AUTO);
    grid->vectors = hada_divide_up(grid->layout.count, HADA_FIT_VECTOR);
    grid->stride = hada_round_up(grid->vectors, GROUP) * HADA_FIT_VECTOR;
    grid->chunks = hada_divide_up(grid->vectors, HADA_FIT_CHUNK);
    grid->sum_count = hada_fit_is_split(grid) ? HADA_FIT_SUMS_SPLIT : HADA_FIT_SUMS;
    return HADA_OK;
}

void hada_fit_grid_destroy(hada_fit_grid *grid)
{
    hada_slot_destroy(&grid->slot);
    free(grid->distances);
    *grid = (hada_fit_grid){0};
}

size_t hada_fit_raw_floats(const hada_fit_grid *grid)
{
    const hada_model_info *info = &grid->info;
    return (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
}

size_t hada_fit_window_floats(const hada_fit_grid *grid)
{
    const hada_model_info *info = &grid->info;
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
}

size_t hada_fit_spectra_bytes(const hada_fit_grid *grid, size_t images)
{
    return images * grid->layout.count * 2 * sizeof(float) + VECTOR_BYTES;
}

hada_fft_desc hada_fit_transform_desc(const hada_fit_grid *grid, hada_fft_direction direction, int window)
{
    return hada_geometry_transform(&grid->info, &grid->geometry, direction, window, 1);
}

hada_fft_filter hada_fit_product(const hada_fit_grid *grid, cl_mem filters, int first)
{
    return (hada_fft_filter){.product = hada_fit_is_split(grid) ? HADA_FFT_SPLIT : HADA_FFT_COMPLEX,
                             .filter = filters,
                             .spectrum_count = grid->info.channels,
                             .filter_first = first};
}

hada_status hada_fit_read_plane(const hada_fit_grid *grid, const hada_buffer *from, size_t at, float *blocks, float *to,
                                const char *what, hada_error *err)
{
    const size_t plane = hada_model_info_plane(&grid->info), bytes = grid->layout.count * 2 * sizeof(float);
    HADA_TRY(hada_buffer_read(from, grid->slot, at * 2 * sizeof(float), blocks, bytes, err));
    hada_layout_unpack(&grid->layout, blocks, to);
    float sum = 0.0f; /* x - x is 0 for finite x alone */
    for (size_t i = 0; i < 2 * plane; i++)
        sum += to[i] - to[i];
    return sum == 0.0f ? HADA_OK
                       : hada_fail(err, HADA_ERROR_NUMERIC,
                                   "%s came out not finite; the raw frames are nearly dark at some frequencies: give a "
                                   "lambda above 0",
                                   what);
}

hada_fit_image hada_fit_image_of(const hada_fit_grid *grid, size_t n)
{
    return (hada_fit_image){.first = n * grid->layout.count,
                            .count = grid->layout.count,
                            .vectors = grid->vectors,
                            .stride = grid->stride,
                            .chunks = grid->chunks,
                            .partial = n * grid->chunks};
}

hada_range hada_fit_vectors(const hada_fit_grid *grid)
{
    return hada_range_of(grid->vectors, GROUP, 1, 1);
}

hada_range hada_fit_chunks(const hada_fit_grid *grid)
{
    if (grid->slot->context->shape == HADA_SHAPE_LANES)
        return hada_range_of(grid->chunks, 1, 1, 1);
    return hada_range_of(grid->chunks * HADA_FIT_CHUNK, HADA_FIT_GROUP, 1, 1);
}

/* Sums of squares that are added in another order differ by less than this share. */
#define SAME_ENERGY 1e-6

static hada_status make_host_side(hada_fit_pair *pair, hada_error *err)
{
    const hada_fit_grid *grid = pair->grid;
    const size_t channels = (size_t)grid->info.channels, raw = hada_fit_raw_floats(grid);
    HADA_TRY(HADA_NEW_RAW(pair->raw_pixels, raw, "a raw frame", err));
    HADA_TRY(HADA_NEW_RAW(pair->scene_pixels, hada_fit_window_floats(grid), "a scene", err));
    HADA_TRY(HADA_NEW_RAW(pair->raw_weights, raw, "the weights of pixels", err));
    HADA_TRY(HADA_NEW_RAW(pair->scratch, raw / channels, "a raw frame", err));
    HADA_TRY(HADA_NEW(pair->raw_energy, channels, "a fitter", err));
    return HADA_NEW(pair->scene_energy, channels, "a fitter", err);
}

static hada_status make_buffer(hada_fit_pair *pair, hada_buffer *buffer, size_t bytes, const char *what,
                               hada_error *err)
{
    hada_status status = hada_buffer_create(buffer, pair->grid->slot->context, bytes, what, err);
    pair->bytes += buffer->bytes;
    return status;
}

static hada_status make_device_side(hada_fit_pair *pair, hada_error *err)
{
    const hada_fit_grid *grid = pair->grid;
    const hada_fft_desc raw = hada_fit_transform_desc(grid, HADA_FFT_FORWARD, 0);
    const hada_fft_desc scene = hada_fit_transform_desc(grid, HADA_FFT_FORWARD, 1);
    const size_t spectra = hada_fit_spectra_bytes(grid, (size_t)grid->info.channels);
    hada_context *context = grid->slot->context;
    HADA_TRY(hada_fft_create(&pair->raw_fft, grid->slot, &raw, err));
    HADA_TRY(hada_fft_create(&pair->scene_fft, grid->slot, &scene, err));
    pair->bytes = hada_fft_bytes(context, &raw) + hada_fft_bytes(context, &scene);
    HADA_TRY(make_buffer(pair, &pair->raw, hada_fit_raw_floats(grid) * sizeof(float), "a raw frame", err));
    HADA_TRY(make_buffer(pair, &pair->scene, hada_fit_window_floats(grid) * sizeof(float), "a scene", err));
    HADA_TRY(make_buffer(pair, &pair->raw_spectrum, spectra, "a raw frame's spectrum", err));
    return make_buffer(pair, &pair->scene_spectrum, spectra, "a scene's spectrum", err);
}

hada_status hada_fit_pair_create(hada_fit_pair *pair, const hada_fit_grid *grid, hada_error *err)
{
    *pair = (hada_fit_pair){.grid = grid};
    hada_status status = make_host_side(pair, err);
    return status ? status : make_device_side(pair, err);
}

void hada_fit_pair_destroy(hada_fit_pair *pair)
{
    hada_fft_destroy(&pair->raw_fft);
    hada_fft_destroy(&pair->scene_fft);
    HADA_DESTROY_BUFFERS(&pair->raw, &pair->scene, &pair->weights, &pair->raw_spectrum, &pair->scene_spectrum);
    HADA_FREE(pair->raw_pixels, pair->scene_pixels, pair->raw_weights, pair->raw_energy, pair->scene_energy,
              pair->scratch);
    *pair = (hada_fit_pair){0};
}

hada_status hada_fit_pair_check(const hada_fit_grid *grid, int depth, const hada_image *raw, const hada_image *scene,
                                hada_error *err)
{
    const hada_model_info *info = &grid->info;
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
        return hada_fail(
            err, HADA_ERROR_SIZE,
            "the scene has %d channels, %d x %d; this fit takes %d and the window %d x %d or the raw frame's "
            "size%s",
            scene->channels, scene->rows, scene->cols, info->channels, info->window_rows, info->window_cols,
            hada_mosaic_hint(raw->channels, scene->channels));
    const size_t bad_raw = hada_image_count_not_finite(raw), bad_scene = hada_image_count_not_finite(scene);
    if (bad_raw || bad_scene)
        return hada_fail(err, HADA_ERROR_NOT_FINITE,
                         "the %s of this pair holds %zu NaN or infinite pixels; leave the pair out or repair the file",
                         bad_raw ? "raw frame" : "scene", bad_raw ? bad_raw : bad_scene);
    return HADA_OK;
}

/* Pixels less the dark level; returns the sum of their squares. */
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

static double energy_of(const float *values, size_t count)
{
    double energy = 0.0;
    for (size_t i = 0; i < count; i++)
        energy += (double)values[i] * (double)values[i];
    return energy;
}

/* The dark level of a channel's frame, by the pixels that hold it. */
static double dark_of(const hada_model_info *info, int channel, const float *frame, float *room)
{
    size_t count = (size_t)info->raw_rows * (size_t)info->raw_cols;
    if (info->mosaic != HADA_MOSAIC_NONE) {
        count = hada_mosaic_own(info->mosaic, channel, frame, info->raw_rows, info->raw_cols, room);
        frame = room;
    }
    return hada_dark_estimate(frame, count, room);
}

static void weigh(hada_fit_pair *pair, const hada_image *weights)
{
    const hada_model_info *info = &pair->grid->info;
    const int mosaic = info->mosaic != HADA_MOSAIC_NONE;
    const size_t cols = (size_t)info->raw_cols, plane = (size_t)info->raw_rows * cols;
    float *to = pair->raw_weights;
    pair->weighted = mosaic || weights;
    for (size_t k = 0; pair->weighted && k < (size_t)info->channels * plane; k++)
        to[k] = weights ? weights->data[k] : 1.0f;
    if (weights && hada_colours_known(info->colour_matrix))
        hada_colours_weigh(to, info->raw_rows, info->raw_cols, HADA_MOSAIC_NONE);
    for (size_t i = 0; mosaic && i < plane; i++)
        for (int c = 0; c < info->channels; c++)
            if (hada_mosaic_channel(info->mosaic, (int)(i / cols), (int)(i % cols)) != c)
                to[(size_t)c * plane + i] = 0.0f;
}

void hada_fit_pair_take(hada_fit_pair *pair, const hada_image *raw, const hada_image *scene, const hada_image *weights)
{
    const hada_model_info *info = &pair->grid->info;
    const size_t raw_area = (size_t)raw->rows * (size_t)raw->cols, area = (size_t)scene->rows * (size_t)scene->cols;
    const size_t window = (size_t)info->window_rows * (size_t)info->window_cols;
    const size_t row0 = (size_t)(scene->rows - info->window_rows) / 2,
                 col0 = (size_t)(scene->cols - info->window_cols) / 2;
    for (int c = 0; c < info->channels; c++) {
        const float *from = raw->data + (size_t)c * raw_area;
        const double dark = info->dark == HADA_AUTO ? dark_of(info, c, from, pair->scratch) : info->dark;
        pair->raw_energy[c] =
            take(from, (size_t)raw->cols, raw->rows, raw->cols, dark, pair->raw_pixels + (size_t)c * raw_area);
        float *light = pair->scene_pixels + (size_t)c * window;
        from = scene->data + (size_t)c * area + row0 * (size_t)scene->cols + col0;
        pair->scene_energy[c] = take(from, (size_t)scene->cols, info->window_rows, info->window_cols, 0.0, light);
        if (info->scene_response != HADA_RESPONSE_LINEAR) {
            hada_response_convert(light, window, info->scene_response, HADA_RESPONSE_LINEAR);
            pair->scene_energy[c] = energy_of(light, window);
        }
    }
    weigh(pair, weights);
    hada_colours_unmix(pair->raw_pixels, raw_area, info->colour_matrix);
    for (int c = 0; c < info->channels && hada_colours_known(info->colour_matrix); c++)
        pair->raw_energy[c] = energy_of(pair->raw_pixels + (size_t)c * raw_area, raw_area);
}

hada_status hada_fit_pair_transform(hada_fit_pair *pair, const float *raw, const float *scene, hada_error *err)
{
    hada_slot *slot = pair->grid->slot;
    const int channels = pair->grid->info.channels;
    HADA_TRY(hada_buffer_write(&pair->raw, slot, 0, raw, pair->raw.bytes, err));
    HADA_TRY(hada_fft_forward(pair->raw_fft, channels, pair->raw.mem, 0, pair->raw_spectrum.mem, 0, err));
    if (!scene)
        return HADA_OK;
    HADA_TRY(hada_buffer_write(&pair->scene, slot, 0, scene, pair->scene.bytes, err));
    return hada_fft_forward(pair->scene_fft, channels, pair->scene.mem, 0, pair->scene_spectrum.mem, 0, err);
}

hada_status hada_fit_stored_create(hada_fit_stored *stored, const hada_fit_pair *pair, hada_error *err)
{
    hada_context *context = pair->grid->slot->context;
    hada_status status = HADA_OK;
    *stored = (hada_fit_stored){0};
    HADA_TRY_OR_DONE(hada_buffer_create(&stored->raw, context, pair->raw.bytes, "a raw frame", err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&stored->spectrum, context, pair->scene_spectrum.bytes, "a scene's spectrum", err));
done:
    if (status)
        hada_fit_stored_free(stored);
    return status;
}

void hada_fit_stored_free(hada_fit_stored *stored)
{
    HADA_DESTROY_BUFFERS(&stored->raw, &stored->weights, &stored->spectrum);
}

hada_status hada_fit_pair_upload(hada_fit_pair *pair, hada_buffer *raw, hada_buffer *weights,
                                 const hada_buffer *spectrum, hada_error *err)
{
    hada_slot *slot = pair->grid->slot;
    HADA_TRY(hada_buffer_write(raw, slot, 0, pair->raw_pixels, pair->raw.bytes, err));
    if (pair->weighted && !weights->bytes)
        HADA_TRY(hada_buffer_create(weights, slot->context, pair->raw.bytes, "the weights of pixels", err));
    if (pair->weighted)
        HADA_TRY(hada_buffer_write(weights, slot, 0, pair->raw_weights, pair->raw.bytes, err));
    HADA_TRY(hada_buffer_write(&pair->scene, slot, 0, pair->scene_pixels, pair->scene.bytes, err));
    return hada_fft_forward(pair->scene_fft, pair->grid->info.channels, pair->scene.mem, 0, spectrum->mem, 0, err);
}

hada_status hada_fit_pair_filter(hada_fit_pair *pair, hada_fft *inverse, const hada_fft_filter *filter, hada_error *err)
{
    return hada_fft_inverse(inverse, pair->grid->info.channels, pair->raw_spectrum.mem, 0, pair->scene.mem, 0, filter,
                            err);
}

hada_status hada_fit_reader_create(hada_fit_reader *reader, const hada_dataset *pairs, hada_fit_pair *pair,
                                   const hada_monitor *monitor, const char *why, hada_error *err)
{
    *reader = (hada_fit_reader){.pairs = pairs, .pair = pair, .monitor = monitor, .why = why};
    return HADA_NEW(reader->energy, (size_t)pair->grid->info.channels, "a fit", err);
}

void hada_fit_reader_destroy(hada_fit_reader *reader)
{
    if (reader->progress.what)
        hada_progress_end(&reader->progress);
    free(reader->energy);
    *reader = (hada_fit_reader){0};
}

hada_status hada_fit_read(hada_fit_reader *reader, int z, int64_t i, int64_t next, hada_error *err)
{
    hada_fit_pair *to = reader->pair;
    hada_pair pair = {0};
    hada_status status = HADA_OK;
    if (!reader->progress.what)
        reader->progress = hada_progress_begin(reader->monitor, reader->why, 0);
    HADA_TRY(hada_progress_step(&reader->progress, NULL, err));
    HADA_TRY(hada_pair_take(&pair, reader->pairs, z, (int)i, err));
    if (next >= 0 && next < hada_dataset_get_info(reader->pairs)->counts[z])
        hada_pair_expect(reader->pairs, z, (int)next);
    HADA_TRY_OR_DONE(hada_fit_pair_check(to->grid, z, pair.raw, pair.scene, err));
    hada_fit_pair_take(to, pair.raw, pair.scene, pair.weights);
    for (int c = 0; c < to->grid->info.channels; c++)
        reader->energy[c] += to->raw_energy[c];
done:
    if (status)
        hada_pair_name(reader->pairs, z, (int)i, err);
    hada_pair_return(&pair);
    return status;
}

void hada_fit_reader_clear(hada_fit_reader *reader)
{
    for (int c = 0; c < reader->pair->grid->info.channels; c++)
        reader->energy[c] = 0.0;
}

hada_status hada_fit_reader_check(const hada_fit_reader *reader, int z, const double *raw_energy, hada_error *err)
{
    const hada_fit_grid *grid = reader->pair->grid;
    int same = 1;
    for (int c = 0; c < grid->info.channels; c++)
        same &= fabs(reader->energy[c] - raw_energy[c]) <= SAME_ENERGY * raw_energy[c];
    return same ? HADA_OK
                : hada_fail(err, HADA_ERROR_STATE,
                            "the pairs of depth %d (%g mm) are not those in its sums; give hada_fitter_finish() the "
                            "pairs that were added, or none",
                            z, grid->distances[z]);
}
