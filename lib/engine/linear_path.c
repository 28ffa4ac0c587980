/* The linear path: every depth's filter on the frame's spectrum, in batches; frequencies and bits of filters that a
 * frame does not need, and whether their bound was kept. The focus takes the planes near to far, so that its bits do
 * not depend on who computed them. */
#include "engine/stages.h"
#include "filter/hadamard.h"

/* Two runs that add up other frequencies round differently, each by at most this (relative L2, see
 * docs/explanation/speed-and-accuracy.md). */
static const double transform_rounding = 3e-7;

/* The planes' norm is known only afterwards; the choice of a band takes it for this share of what the filters put on
 * the grid. Light that spread evenly over the grid would leave the window the root of its share of the area; scenes
 * fill the window, and their norm was above the root of that root, times this, in all frames tried
 * (docs/explanation/speed-and-accuracy.md). */
static const double norm_margin = 0.7;

static double expected_share(const hada_model_info *info)
{
    const double area = (double)info->window_rows * info->window_cols / ((double)info->grid_rows * info->grid_cols);
    return norm_margin * sqrt(sqrt(area));
}

/* What lies outside the caller's band does not count: the dense run leaves it out as well. */
static void leave_out(const hada_tiles *tiles, int channels, int band_rows, int band_cols, float *energy)
{
    const size_t count = hada_tiles_count(tiles), groups = (size_t)tiles->groups;
    for (size_t t = 0; t < count; t++) {
        const int above = t / groups ? tiles->row_last[t / groups - 1] + 1 : 0,
                  left = (int)(t % groups) * HADA_TILE_COLS;
        for (int c = 0; c < channels && (above > band_rows || left > band_cols); c++)
            energy[(size_t)c * count + t] = 0.0f;
    }
}

/* The smallest band whose change, together with those of half filters and of rounding, stays within max_error of the
 * expected planes. */
static void choose_band(const hada_setup *setup, const float *energy, hada_frame_skip *skip)
{
    const hada_config *config = &setup->config;
    const hada_gains *gains = setup->gains;
    const double light = sqrt(hada_gains_light(gains, energy)), rounding = 2.0 * transform_rounding * light,
                 half = config->half_by_error ? sqrt(gains->halved) * light : 0.0;
    const double most = expected_share(hada_model_get_info(setup->model)) * light * setup->options.max_error /
                        (1.0 + setup->options.max_error);
    double dropped[HADA_BANDS];
    int band = HADA_BANDS - 1;
    hada_gains_dropped(gains, energy, dropped);
    while (setup->options.skip & HADA_SKIP_FREQUENCIES && band > 0 && half + rounding + sqrt(dropped[band - 1]) <= most)
        band--;
    skip->limited = band < HADA_BANDS - 1;
    skip->change = half + sqrt(dropped[band]) + (skip->limited || config->half_by_error ? rounding : 0.0);
    if (!skip->limited)
        return;
    const int rows = gains->tiles.row_last[band], cols = gains->tiles.col_last[band];
    const int banded = config->band_rows || config->band_cols;
    skip->band_rows = banded ? hada_least(rows, config->band_rows) : rows;
    skip->band_cols = banded ? hada_least(cols, config->band_cols) : cols;
}

hada_status hada_skip_frequencies(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const hada_config *config = &setup->config;
    const hada_gains *gains = setup->gains;
    hada_frame_skip *skip = &frame->skip;
    float *energy = NULL;
    hada_status status = HADA_OK;
    skip->change = skip->band_change = 0.0;
    skip->exact = skip->limited = 0;
    skip->band_rows = config->band_rows;
    skip->band_cols = config->band_cols;
    if (!gains)
        return HADA_OK;
    const hada_buffer *measured = &pipeline->meter->energy;
    HADA_TRY_OR_DONE(hada_allocated(energy = hada_alloc_raw(measured->bytes, 1, "the energy of spectra", err)));
    HADA_TRY_OR_DONE(
        hada_meter_run(pipeline->meter, pipeline->stage->spectrum.mem, pipeline->constants->gains.mem, err));
    HADA_TRY_OR_DONE(hada_buffer_read(measured, pipeline->slot, 0, energy, measured->bytes, err));
    if (config->band_rows || config->band_cols) {
        skip->band_change = sqrt(hada_gains_outside(gains, energy, config->band_rows, config->band_cols));
        leave_out(&gains->tiles, gains->channels, config->band_rows, config->band_cols, energy);
    }
    if (config->bounded)
        choose_band(setup, energy, skip);
done:
    free(energy);
    return status;
}

/* Whether planes must come from filters in single precision, which the bank does not hold. */
static int needs_single(const hada_frame *frame)
{
    return frame->skip.exact && frame->setup->config.half_by_error;
}

/* As hada_hadamard_run(), with these. */
static hada_status run_single(hada_pipeline *pipeline, int first, int count, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const size_t plane = hada_plane_values(hada_model_get_info(setup->model));
    hada_bank *bank = NULL;
    hada_status status = HADA_OK;
    for (int i = 0; i < count; i++) {
        HADA_TRY_OR_DONE(hada_bank_create(&bank, pipeline->slot, setup->model, &pipeline->stage->layout,
                                          &setup->depths[first + i], 1, HADA_BANK_FILTERS, 0, err));
        HADA_TRY_OR_DONE(hada_hadamard_run(pipeline->stage, bank, 0, 1, pipeline->planes.mem, (size_t)i * plane, err));
        HADA_TRY_OR_DONE(hada_slot_finish(pipeline->slot, err));
        hada_bank_destroy(&bank);
    }
done:
    hada_bank_destroy(&bank);
    return status;
}

/* The root of the sum of squares of all planes that count. */
static double norm_of(const hada_result *result)
{
    double sum = 0.0;
    for (int z = 0; z < result->depths; z++) {
        const size_t count = result->memory->occupied[z] ? hada_image_count(&result->planes[z]) : 0;
        const float *values = result->planes[z].data;
        for (size_t i = 0; i < count; i++)
            sum += (double)values[i] * values[i];
    }
    return sqrt(sum);
}

/* A change of the stack by at most `change`, relative to what the stack would be without it, which is at least its norm
 * - change: L2 over all pixels. Infinite where nothing is known. */
static double relative(double change, double norm)
{
    return change == 0.0 ? 0.0 : change < norm ? change / (norm - change) : INFINITY;
}

/* After the planes came home: whether max_error was kept. Where not, the bounded kinds are off from now on and the
 * planes must be computed again. */
static int was_kept(hada_frame *frame)
{
    const hada_config *config = &frame->setup->config;
    hada_frame_skip *skip = &frame->skip;
    hada_skip_report *report = &frame->result->memory->skipped;
    const double most = frame->setup->options.max_error;
    const double norm = skip->change + skip->band_change + most > 0.0 ? norm_of(frame->result) : 0.0;
    const int kept = !(relative(skip->change, norm) > most);
    report->bound = relative(skip->change + skip->band_change, norm);
    if (config->enhance && report->bound > 0.0)
        report->bound = INFINITY; /* the net may make anything of it */
    if (!kept) {
        skip->exact = 1;
        skip->limited = 0;
        skip->change = 0.0;
        skip->band_rows = config->band_rows;
        skip->band_cols = config->band_cols;
    }
    return kept;
}

void hada_skip_fill_report(hada_frame *frame)
{
    const hada_config *config = &frame->setup->config;
    const hada_frame_skip *skip = &frame->skip;
    hada_skip_report *report = &frame->result->memory->skipped;
    const int banded = skip->band_rows || skip->band_cols;
    const int left_out = atomic_load(&frame->tiles_left_out), tiles = left_out + atomic_load(&frame->tiles);
    report->depths = config->depths - frame->result->memory->report.occupied_count;
    report->tiles = tiles ? (double)left_out / tiles : 0.0;
    report->channels = skip->channels;
    report->recomputed = skip->exact;
    report->frequencies =
        banded ? hada_tiles_share_outside(&frame->setup->gains->tiles, skip->band_rows, skip->band_cols) : 0.0;
    report->kinds =
        (config->pruned ? HADA_SKIP_PRUNE : 0u) | (report->depths && !config->full_grid ? HADA_SKIP_DEPTHS : 0u) |
        (skip->limited ? HADA_SKIP_FREQUENCIES : 0u) | (config->half_by_error && !skip->exact ? HADA_SKIP_HALF : 0u) |
        (skip->channels ? HADA_SKIP_CHANNELS : 0u) | (left_out ? HADA_SKIP_TILES : 0u);
    frame->result->memory->report.enhanced = atomic_load(&frame->enhanced);
    for (int c = 0; c < frame->exposure.pixels.channels; c++)
        if (skip->spectra[c] != c)
            report->kinds |= HADA_SKIP_CHANNELS;
}

/* Planes of depths first ... first + count - 1 into pipeline->planes; light is not negative. */
static hada_status compute(hada_pipeline *pipeline, const hada_frame *frame, int first, int count, hada_error *err)
{
    const size_t plane = hada_plane_values(hada_model_get_info(pipeline->setup->model));
    const cl_mem planes = pipeline->planes.mem;
    hada_slot_stage(pipeline->slot, "linear");
    hada_pipeline_apply_skip(pipeline, frame);
    if (!needs_single(frame))
        return hada_maker_filter(&pipeline->maker, first, count, planes, err);
    HADA_TRY(run_single(pipeline, first, count, err));
    return hada_image_clip(pipeline->slot, planes, plane * (size_t)count, err);
}

static hada_status read_planes(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "download");
    return hada_pipeline_read_planes(pipeline, frame, &pipeline->planes, 0, first, count, err);
}

/* Planes that another pipeline left in the result come into pipeline->planes. */
static hada_status write_planes(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    const size_t bytes = hada_plane_values(hada_model_get_info(pipeline->setup->model)) * sizeof(float);
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_buffer_write(&pipeline->planes, pipeline->slot, (size_t)i * bytes,
                                   frame->result->planes[first + i].data, bytes, err));
    return HADA_OK;
}

static hada_status push(hada_pipeline *pipeline, hada_frame *frame, int first, int count, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "focus");
    hada_status status = hada_focus_push(pipeline->focus, first, count, pipeline->planes.mem, 0, err);
    return status ? status : hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_focus, err);
}

/* A batch that was taken, into the result; *next moves on where the focus could take it at once. */
static hada_status own_batch(hada_pipeline *pipeline, hada_frame *frame, int first, int count, int *next,
                             hada_error *err)
{
    hada_report *report = &frame->result->memory->report;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(compute(pipeline, frame, first, count, err));
    HADA_TRY_OR_DONE(hada_pipeline_lap(pipeline, frame, &report->seconds_linear, err));
    HADA_TRY_OR_DONE(hada_pipeline_enhance(pipeline, frame, pipeline->planes.mem, count, 0, err));
    HADA_TRY_OR_DONE(hada_pipeline_lap(pipeline, frame, &report->seconds_enhance, err));
    if (first == *next) {
        *next += count;
        HADA_TRY_OR_DONE(push(pipeline, frame, first, count, err));
    }
    HADA_TRY_OR_DONE(read_planes(pipeline, frame, first, count, err));
done:
    frame->batches->put(frame, first, count, !status);
    return status ? status : hada_pipeline_lap(pipeline, frame, &report->seconds_download, err);
}

static hada_status others_batch(hada_pipeline *pipeline, hada_frame *frame, int count, int *next, hada_error *err)
{
    const int first = *next;
    count = count < pipeline->batch ? count : pipeline->batch;
    *next += count;
    HADA_TRY(hada_slot_finish(pipeline->slot, err)); /* they may be this pipeline's own, still on their way */
    HADA_TRY(write_planes(pipeline, frame, first, count, err));
    return push(pipeline, frame, first, count, err);
}

static hada_status all_batches(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const unsigned char *occupied = frame->result->memory->occupied;
    for (int next = 0; next < pipeline->setup->config.depths;) {
        int first, count;
        if (!occupied[next])
            next++;
        else if ((count = frame->batches->arrived(frame, next, 0)))
            HADA_TRY(others_batch(pipeline, frame, count, &next, err));
        else if ((count = frame->batches->take(frame, pipeline->batch, &first)))
            HADA_TRY(own_batch(pipeline, frame, first, count, &next, err));
        else
            frame->batches->arrived(frame, next, 1);
    }
    return HADA_OK;
}

static hada_status all_planes(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const unsigned char *occupied = frame->result->memory->occupied;
    hada_status status = HADA_OK;
    HADA_TRY(hada_focus_begin(pipeline->focus, occupied, err));
    frame->batches->open(frame, occupied);
    status = all_batches(pipeline, frame, err);
    frame->batches->close(frame);
    return status;
}

hada_status hada_pipeline_linear(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    hada_result *result = frame->result;
    hada_report *report = &result->memory->report;
    for (int z = 0; z < result->depths; z++) {
        result->memory->occupied[z] = pipeline->setup->listed[z];
        report->occupied_count += report->occupied[z];
    }
    HADA_TRY(hada_pipeline_dark_planes(pipeline, frame, err)); /* the user knows that nothing is there */
    do {
        HADA_TRY(all_planes(pipeline, frame, err));
        if (pipeline->setup->config.measured) /* their norm is asked for */
            HADA_TRY(hada_slot_finish(pipeline->slot, err));
    } while (!was_kept(frame));
    return hada_pipeline_pictures(pipeline, frame, 0.0, err);
}

hada_status hada_pipeline_linear_batch(hada_pipeline *pipeline, hada_frame *frame, int first, int count,
                                       hada_error *err)
{
    HADA_TRY(compute(pipeline, frame, first, count, err));
    HADA_TRY(hada_pipeline_enhance(pipeline, frame, pipeline->planes.mem, count, 0, err));
    HADA_TRY(read_planes(pipeline, frame, first, count, err));
    return hada_slot_finish(pipeline->slot, err);
}
