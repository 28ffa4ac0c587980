#include "fit/look.h"

#include <hadalens/pixels.h>
#include <hadalens/response.h>
#include <hadalens/scene.h>

#include "image/correct.h"
#include "image/statistics.h"

/* Pairs of a depth from which on two are held out, and iterations: fewer than for a model, as only a few settings are
 * compared (docs/explanation/learning-a-camera.md). */
enum { MANY_PAIRS = 4, PASSES = 9, WEIGHTED_PASSES = 27 };
/* The same where they are centred, which takes the worth of one away; fewer lose too much. */
enum { CENTRED_PAIRS = 4, MANY_CENTRED = 6 };
/* Differences of this share of the noise's energy say nothing, for it is not known so well. */
#define LEAST_OF_NOISE 0.02
#define WHY            "looks at pairs, for boundary, response and dark level"

/* So that the two edges of a window can still be distinguished. */
static const double overhangs[HADA_OVERHANGS] = {0.0, 0.25, 0.5, 0.75, 1.0};

static hada_image channel_of(const hada_image *image, int channel)
{
    const size_t area = (size_t)image->rows * (size_t)image->cols;
    return (hada_image){1, image->rows, image->cols, image->data + (size_t)channel * area};
}

static int channel_number(const hada_look *at)
{
    return at->channel ? at->channel - 1 : at->options->channels / 2;
}

/* A copy of the centre of a pair's image, linear, and its share of the mean, which is created. */
static hada_status copy_linear(const hada_image *from, int rows, int cols, double response, double share,
                               hada_image *copy, hada_image *mean, hada_error *err)
{
    HADA_TRY(hada_image_crop(copy, from, (from->rows - rows) / 2, (from->cols - cols) / 2, rows, cols, err));
    hada_response_convert(copy->data, hada_image_count(copy), response, HADA_RESPONSE_LINEAR);
    if (!mean->data)
        HADA_TRY(hada_image_create(mean, 1, rows, cols, err));
    for (size_t k = 0; k < hada_image_count(copy); k++)
        mean->data[k] += (float)(share * copy->data[k]);
    return HADA_OK;
}

/* Pixels that pair number i does not know, the mean does not know either. */
static hada_status know(hada_look *at, int i, hada_error *err)
{
    const hada_image *weights = &at->weights[i];
    if (!weights->data)
        return HADA_OK;
    if (!at->known.data)
        HADA_TRY(hada_image_copy(&at->known, weights, err));
    for (size_t k = 0; k < hada_image_count(weights); k++)
        at->known.data[k] = weights->data[k] == 1.0f && at->known.data[k] == 1.0f ? 1.0f : 0.0f;
    return HADA_OK;
}

static hada_status centre(hada_look *at, int learned, hada_error *err)
{
    const hada_fit_options *of = at->options;
    const double *distance = &of->distances_mm[at->depth];
    const int one = 1;
    hada_image *raw = &at->own_raw[HADA_LOOK_MOST], *scene = &at->own_scene[HADA_LOOK_MOST];
    for (int i = 0; i < at->count; i++) {
        const double share = i < learned ? 1.0 / learned : 0.0;
        HADA_TRY(copy_linear(&at->raw[i], of->raw_rows, of->raw_cols, HADA_RESPONSE_LINEAR, share, &at->own_raw[i], raw,
                             err));
        HADA_TRY(copy_linear(&at->scene[i], of->window_rows, of->window_cols, of->scene_response, share,
                             &at->own_scene[i], scene, err));
        HADA_TRY(know(at, i, err));
    }
    for (int i = 0; i < at->count; i++) {
        at->raw[i] = at->own_raw[i];
        at->scene[i] = at->own_scene[i];
        at->weights[i] = at->known;
        for (size_t k = 0; k < hada_image_count(raw); k++)
            at->raw[i].data[k] -= raw->data[k];
        for (size_t k = 0; k < hada_image_count(scene); k++)
            at->scene[i].data[k] -= scene->data[k];
    }
    return hada_dataset_from_weighted(&at->mean, 1, distance, &one, raw, scene, &at->known, err);
}

static hada_status check(const hada_look *at, const hada_pair *pair, int channel, hada_error *err)
{
    const hada_fit_options *of = at->options;
    if (pair->raw->channels <= channel || pair->scene->channels <= channel)
        return hada_fail(err, HADA_ERROR_SIZE, "raw frames and scenes of a data set must have the same channels");
    if (pair->raw->rows != of->raw_rows || pair->raw->cols != of->raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the raw frame has %d x %d pixels, the first one of the data set %d x %d: they must have one "
                         "size",
                         pair->raw->rows, pair->raw->cols, of->raw_rows, of->raw_cols);
    return HADA_OK;
}

hada_status hada_look_take(hada_look *at, const hada_dataset *pairs, hada_error *err)
{
    const double *distance = &at->options->distances_mm[at->depth];
    const int all = hada_dataset_get_info(pairs)->counts[at->depth], channel = channel_number(at);
    at->held = at->group ? 0 : all >= (at->centred ? MANY_CENTRED : MANY_PAIRS) ? HADA_LOOK_HELD : 1;
    const int count = at->group ? at->group : hada_least(all, HADA_LOOK_LEARNED + at->held), learned = count - at->held;
    hada_status status;
    for (; at->count < count; at->count++) {
        const int number = at->group ? at->first + at->count : (int)(((long)at->count * all / count + at->first) % all);
        hada_pair *pair = &at->pair[at->count];
        HADA_TRY(hada_pair_take(pair, pairs, at->depth, number, err));
        status = check(at, pair, channel, err);
        if (status) {
            hada_pair_return(pair);
            hada_pair_name(pairs, at->depth, number, err);
            return status;
        }
        at->raw[at->count] = channel_of(pair->raw, channel);
        at->scene[at->count] = channel_of(pair->scene, channel);
        at->weights[at->count] = pair->weights ? channel_of(pair->weights, channel) : (hada_image){0};
    }
    if (at->centred)
        HADA_TRY(centre(at, learned, err));
    HADA_TRY(hada_dataset_from_weighted(&at->learned, 1, distance, &learned, at->raw, at->scene, at->weights, err));
    return at->group ? HADA_OK
                     : hada_dataset_from_weighted(&at->held_out, 1, distance, &at->held, at->raw + learned,
                                                  at->scene + learned, at->weights + learned, err);
}

void hada_look_return(hada_look *at)
{
    hada_dataset_destroy(&at->learned);
    hada_dataset_destroy(&at->held_out);
    hada_dataset_destroy(&at->mean);
    hada_image_destroy(&at->known);
    for (int i = 0; i <= HADA_LOOK_MOST; i++) {
        hada_image_destroy(&at->own_raw[i]);
        hada_image_destroy(&at->own_scene[i]);
    }
    while (at->count)
        hada_pair_return(&at->pair[--at->count]);
}

int hada_look_is_lit(const hada_fit_options *options, const hada_dataset *pairs)
{
    return options->find_dark && hada_dataset_get_info(pairs)->dark_frame;
}

void hada_look_ignore_light(hada_look *at, const hada_dataset *pairs, int depth)
{
    const int lit = hada_look_is_lit(at->options, pairs),
              many = hada_dataset_get_info(pairs)->counts[depth] >= CENTRED_PAIRS;
    at->centred = lit && many;
    at->smooth = at->smooth || (lit && !many);
}

hada_status hada_look_explain(const hada_look *at, int rows, int cols, const hada_dataset *others, double *left,
                              double *light, float *rest, hada_error *err)
{
    hada_fit_options options = *at->options;
    hada_fitter *fitter = NULL;
    hada_fit_reader from = {0}, held = {0};
    int weighted = 0;
    hada_status status = HADA_OK;
    options.depths = options.channels = 1;
    options.mosaic = options.sensor_mosaic = HADA_MOSAIC_NONE; /* of that channel */
    memset(options.colour_matrix, 0, sizeof options.colour_matrix);
    options.distances_mm = at->options->distances_mm + at->depth;
    options.boundary =
        rows == options.raw_rows && cols == options.raw_cols ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
    options.form = HADA_FORM_COMPLEX;
    options.grid_rows = rows;
    options.grid_cols = cols;
    options.refine_steps = 0;
    if (at->centred) {
        options.scene_response = HADA_RESPONSE_LINEAR;
        options.dark = 0.0;
    }
    options.communicator = NULL;
    options.sums = NULL;
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, at->context, &options, err));
    for (int i = 0; i < at->count - at->held; i++) {
        HADA_TRY_OR_DONE(hada_fitter_add_pair(fitter, 0, &at->raw[i], &at->scene[i], err));
        weighted |= at->weights[i].data != NULL;
    }
    HADA_TRY_OR_DONE(hada_fit_reader_create(&from, at->learned, &fitter->pair, options.monitor, WHY, err));
    HADA_TRY_OR_DONE(hada_fit_reader_create(&held, others, &fitter->pair, NULL, WHY, err));
    hada_slot_watch(fitter->grid.slot, options.monitor);
    HADA_TRY_OR_DONE(hada_fit_transfers_left(&fitter->sums, &from, weighted ? WEIGHTED_PASSES : PASSES, at->coarse,
                                             &held, left, light, rest, err));
done:
    hada_fit_reader_destroy(&from);
    hada_fit_reader_destroy(&held);
    hada_fitter_destroy(&fitter);
    return status;
}

hada_status hada_look_predict(const hada_look *at, float *made, hada_image *frame, double *dark, hada_error *err)
{
    const size_t area = (size_t)at->options->raw_rows * (size_t)at->options->raw_cols;
    double left[HADA_LOOK_MOST];
    float *room = NULL;
    int rows, cols;
    hada_status status = HADA_OK;
    hada_look_whole(at->options, &rows, &cols);
    HADA_TRY_OR_DONE(HADA_NEW_RAW(room, area, "frames", err));
    HADA_TRY_OR_DONE(hada_look_explain(at, rows, cols, at->learned, left, NULL, made, err));
    for (int i = 0; i < at->count - at->held; i++) {
        frame[i] = channel_of(at->pair[i].raw, channel_number(at));
        dark[i] = at->centred                      ? 0.0
                  : at->options->dark == HADA_AUTO ? hada_dark_estimate(frame[i].data, area, room)
                                                   : at->options->dark;
        for (size_t k = 0; k < area; k++)
            made[(size_t)i * area + k] += frame[i].data[k] - (float)dark[i];
    }
    if (at->centred) { /* the mean frame, which was taken off, is in them: it becomes what transfer functions make */
        HADA_TRY_OR_DONE(hada_look_explain(at, rows, cols, at->mean, left, NULL, room, err));
        for (size_t k = 0; k < area * (size_t)(at->count - at->held); k++)
            made[k] += room[k % area];
    }
done:
    free(room);
    return status;
}

/* The noise's energy in a channel of a frame. Of a mosaic: where colours were filled in by means of neighbours, it is a
 * half or a quarter of what it is at the channel's own pixels, which are rows x cols / 2 or half as many. */
static hada_status noise_energy(const hada_look *at, const hada_image *frame, double *energy, hada_error *err)
{
    const int channel = channel_number(at), green = channel == 1;
    const hada_mosaic mosaic = at->options->mosaic;
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    hada_image own = {0};
    double share = 1.0;
    hada_pixels_of_image(&pixels, frame);
    if (mosaic != HADA_MOSAIC_NONE) {
        HADA_TRY(hada_image_create(&own, 1, frame->rows, frame->cols, err));
        own.cols = frame->cols / 2;
        own.rows = (int)hada_mosaic_own(mosaic, channel, frame->data, frame->rows, frame->cols, own.data) / own.cols;
        hada_pixels_of_image(&pixels, &own);
        share = green ? 5.0 / 8.0 : 9.0 / 16.0;
    }
    const double noise = hada_noise_estimate(&pixels, HADA_MOSAIC_NONE);
    *energy = share * noise * noise * (double)frame->rows * (double)frame->cols;
    hada_image_destroy(&own);
    return HADA_OK;
}

/* What is left of held-out frames but for smooth surfaces and noise: what other light cannot explain. */
static hada_status left_sharp(const hada_look *at, int rows, int cols, double *left, hada_error *err)
{
    const size_t area = (size_t)at->options->raw_rows * (size_t)at->options->raw_cols;
    double each[HADA_LOOK_HELD], noise, surface[HADA_SMOOTH_TERMS];
    float *rest = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(rest, (size_t)at->held * area, "frames", err));
    HADA_TRY_OR_DONE(hada_look_explain(at, rows, cols, at->held_out, each, NULL, rest, err));
    *left = 0.0;
    for (int k = 0; k < at->held; k++) {
        HADA_TRY_OR_DONE(noise_energy(at, &at->raw[at->count - at->held + k], &noise, err));
        *left +=
            fmax(LEAST_OF_NOISE * noise, each[k] - noise -
                                             hada_smooth_nearest(rest + (size_t)k * area, NULL, at->options->raw_rows,
                                                                 at->options->raw_cols, surface));
    }
done:
    free(rest);
    return status;
}

hada_status hada_look_left(const hada_look *at, int rows, int cols, double *left, hada_error *err)
{
    double each[HADA_LOOK_HELD];
    if (at->smooth)
        return left_sharp(at, rows, cols, left, err);
    HADA_TRY(hada_look_explain(at, rows, cols, at->held_out, each, NULL, NULL, err));
    *left = 0.0;
    for (int k = 0; k < at->held; k++)
        *left += each[k];
    return HADA_OK;
}

int hada_look_side(int raw, int window, int k)
{
    const int over = (int)(overhangs[k] * (window - 1));
    return over ? hada_fft_good_size(raw + over) : raw;
}

void hada_look_whole(const hada_fit_options *options, int *rows, int *cols)
{
    const int k = options->boundary == HADA_BOUNDARY_CIRCULAR ? 0 : HADA_OVERHANGS - 1;
    *rows = hada_look_side(options->raw_rows, options->window_rows, k);
    *cols = hada_look_side(options->raw_cols, options->window_cols, k);
}

int hada_look_depth(const hada_fit_options *options, const hada_dataset *pairs)
{
    int z = 0;
    while (z < options->depths && hada_dataset_get_info(pairs)->counts[z] < HADA_LOOK_LEAST)
        z++;
    return z;
}
