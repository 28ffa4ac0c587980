/* What a method is to do, and what it must know of a camera: options checked and completed, constants; its objects and
 * memory. */
#include "classic/classic_steps.h"

#include <math.h>
#include <stdlib.h>

#include "core/base.h"
#include "model/model.h"

static hada_status check_options(const hada_classic_options *o, hada_error *err)
{
    if (o->method < HADA_METHOD_WIENER || o->method > HADA_METHOD_ADMM || o->prior < HADA_PRIOR_AUTO ||
        o->prior > HADA_PRIOR_HAAR || o->support < HADA_SUPPORT_AUTO || o->support > HADA_SUPPORT_GRID)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "method, prior or support is none that there is");
    if (o->iterations < 1 || !(o->stop >= 0.0 && o->stop < 1.0) || !(o->seconds >= 0.0) || !isfinite(o->seconds))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "iterations is %d, stop %g and seconds %g: iterations are 1 or more, stop is from 0 to below 1, "
            "and seconds are finite and not negative",
            o->iterations, o->stop, o->seconds);
    if (!(o->weight >= 0.0 || o->weight == HADA_AUTO) || !isfinite(o->weight) ||
        !(o->lambda > 0.0 && isfinite(o->lambda)) || !(o->step > 0.0 && o->step < 2.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the weight is 0 or more (HADA_AUTO: found), lambda above 0 and the step between 0 and 2");
    if (o->inner < 1 || o->inner > 1000 || o->levels < 1 || o->levels > 8)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "inner iterations are from 1 to 1000, levels of wavelets 1 to 8");
    if (!(o->mu1 > 0.0 && isfinite(o->mu1)) || !(o->mu2 > 0.0 && isfinite(o->mu2)) ||
        !(o->mu3 > 0.0 && isfinite(o->mu3)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "mu1, mu2 and mu3 of ADMM must be above 0");
    const int wavelets = o->prior == HADA_PRIOR_WAVELET || o->prior == HADA_PRIOR_HAAR;
    if ((wavelets && o->method != HADA_METHOD_FISTA) || (o->prior == HADA_PRIOR_TV && o->method == HADA_METHOD_WIENER))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "this method has no such prior: Richardson-Lucy and ADMM take total variation, FISTA also "
                         "wavelets, a Wiener filter none");
    return HADA_OK;
}

/* The weights of priors that were best or near it on simulated frames with 1 % noise: docs/explanation/mathematics.md.
 */
#define WEIGHT_LUCY_OR_WAVELET 5e-3
#define WEIGHT_OTHERS          3e-3

static double usual_weight(const hada_classic_options *o)
{
    if (o->prior == HADA_PRIOR_NONE)
        return 0.0;
    return o->method == HADA_METHOD_RL || o->prior == HADA_PRIOR_WAVELET ? WEIGHT_LUCY_OR_WAVELET : WEIGHT_OTHERS;
}

hada_status hada_classic_shape_of(const hada_model_info *info, int depths, const hada_classic_options *options,
                                  hada_classic_shape *shape, hada_error *err)
{
    hada_classic_options *o = &shape->options;
    HADA_TRY(check_options(options, err));
    if (!info->has_otf)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model %s holds no transfer functions, which this method needs: make the model again "
                         "with fit, from pairs or from PSFs",
                         info->name);
    if (options->method != HADA_METHOD_RL && options->method != HADA_METHOD_FISTA)
        HADA_TRY(hada_model_check_single(info, "a Wiener filter or ADMM", err));
    *o = *options;
    shape->components = info->components > 1 ? info->components : 1;
    shape->place = hada_refine_shape_of(info, depths, 1);
    o->iterations = o->method == HADA_METHOD_WIENER ? 1 : o->iterations;
    if (o->prior == HADA_PRIOR_AUTO)
        o->prior = o->method == HADA_METHOD_ADMM ? HADA_PRIOR_TV : HADA_PRIOR_NONE;
    shape->choose = o->weight < 0.0 && o->prior == HADA_PRIOR_TV && !(o->seconds > 0.0) &&
                    (o->method == HADA_METHOD_FISTA || o->method == HADA_METHOD_ADMM);
    if (o->weight < 0.0)
        o->weight = usual_weight(o);
    if (o->weight <= 0.0)
        o->prior = HADA_PRIOR_NONE;
    if (o->support == HADA_SUPPORT_AUTO)
        o->support = o->method == HADA_METHOD_ADMM ? HADA_SUPPORT_GRID : HADA_SUPPORT_WINDOW;
    shape->support = o->support == HADA_SUPPORT_GRID ? (hada_rectangle){0, 0, info->grid_rows, info->grid_cols}
                                                     : shape->place.window;
    shape->grid_rows = info->grid_rows;
    shape->grid_cols = info->grid_cols;
    shape->reach = (hada_rectangle){0};
    shape->sieve = shape->haze = 0;
    return HADA_OK;
}

/* The largest sum over depths of |H|^2 of a channel; *mean takes the sum over depths of the mean |H|^2. */
static double largest_square(const hada_model *model, const int *depths, int count, int channel, double *mean)
{
    const hada_model_info *info = &model->info;
    const size_t cols = (size_t)info->grid_cols / 2 + 1, plane = hada_model_plane(model);
    double largest = 0.0, sum = 0.0;
    for (size_t f = 0; f < plane; f++) {
        const size_t kx = f % cols;
        double square = 0.0;
        for (int i = 0; i < count; i++) {
            const size_t image = (size_t)depths[i] * (size_t)info->channels + (size_t)channel;
            const float *h = model->otf + 2 * (image * plane + f);
            square += (double)h[0] * h[0] + (double)h[1] * h[1];
        }
        largest = fmax(largest, square);
        sum += (kx == 0 || 2 * kx == (size_t)info->grid_cols ? 1.0 : 2.0) * square;
    }
    *mean = sum / ((double)info->grid_rows * info->grid_cols);
    return largest;
}

/* With components, the frame that planes make is [H_1 ... H_K] of (w_1 x ... w_K x), and the square of its norm at most
 * max_f sum s_k |H_k|^2 times max_p sum w_k^2 / s_k, for any s_k above 0: near the least with these. */
static hada_status bound_varying(const hada_model *model, const int *depths, int count, int channel, double *largest,
                                 hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), pixels = (size_t)info->window_rows * (size_t)info->window_cols;
    const int terms = count * info->components;
    double *share = NULL, square = 0.0;
    const float **h = NULL, **w = NULL;
    hada_status status = HADA_OK;
    *largest = 0.0;
    HADA_TRY_OR_DONE(HADA_NEW(share, (size_t)terms, "a plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(h, (size_t)terms, "a plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(w, (size_t)terms, "a plan", err));
    for (int i = 0; i < terms; i++) {
        const size_t term =
            (size_t)depths[i / info->components] * (size_t)info->components + (size_t)(i % info->components);
        double most_h = 0.0, most_w = 0.0;
        h[i] = model->component_otf + (term * (size_t)info->channels + (size_t)channel) * plane * 2;
        w[i] = model->component_weights + term * pixels;
        for (size_t f = 0; f < plane; f++)
            most_h = fmax(most_h, (double)h[i][2 * f] * h[i][2 * f] + (double)h[i][2 * f + 1] * h[i][2 * f + 1]);
        for (size_t p = 0; p < pixels; p++)
            most_w = fmax(most_w, (double)w[i][p] * w[i][p]);
        share[i] = most_h > 0.0 && most_w > 0.0 ? sqrt(most_w / most_h) : 1.0;
    }
    for (size_t f = 0; f < plane; f++) {
        double sum = 0.0;
        for (int i = 0; i < terms; i++)
            sum += share[i] * ((double)h[i][2 * f] * h[i][2 * f] + (double)h[i][2 * f + 1] * h[i][2 * f + 1]);
        square = fmax(square, sum);
    }
    for (int first = 0; first < terms; first += info->components) /* other depths have other planes */
        for (size_t p = 0; p < pixels; p++) {
            double sum = 0.0;
            for (int i = first; i < first + info->components; i++)
                sum += (double)w[i][p] * w[i][p] / share[i];
            *largest = fmax(*largest, sum * square);
        }
done:
    HADA_FREE(share, h, w);
    return status;
}

hada_status hada_classic_camera_of(hada_classic_camera *camera, const hada_model *model, const int *depths, int count,
                                   hada_error *err)
{
    const int channels = model->info.channels;
    HADA_TRY(HADA_NEW(camera->largest, (size_t)channels, "a plan", err));
    camera->gain = hada_model_gain(model);
    camera->mean_square = 0.0;
    for (int c = 0; c < channels; c++) {
        double mean;
        camera->largest[c] = largest_square(model, depths, count, c, &mean);
        camera->mean_square += mean / channels / count;
    }
    for (int c = 0; c < channels && model->info.components > 1; c++)
        HADA_TRY(bound_varying(model, depths, count, c, &camera->largest[c], err));
    for (int c = 0; c < channels; c++)
        if (!(camera->largest[c] > 0.0))
            return hada_fail(err, HADA_ERROR_MODEL, "the model's transfer functions are 0 in channel %d", c + 1);
    return HADA_OK;
}

void hada_classic_camera_free(hada_classic_camera *camera)
{
    free(camera->largest);
    camera->largest = NULL;
}

enum { MOST_SUMS = 4, BAND = 4096 /* pixels of a band of rows, about */ };

static hada_classic_image image_of(const hada_rectangle *rect)
{
    hada_classic_image image = {.rows = rect->rows, .cols = rect->cols, .pitch = (int)hada_classic_pitch(rect->cols)};
    image.pixels = (size_t)image.rows * (size_t)image.pitch;
    image.band = image.pitch < BAND ? BAND / image.pitch : 1;
    return image;
}

static hada_status make_transforms(hada_fft_pair *pair, const hada_classic *classic, const hada_rectangle *rect,
                                   int images, hada_error *err)
{
    const hada_classic_image image = image_of(rect);
    const int batch = hada_least(images, HADA_CLASSIC_BATCH);
    hada_fft_desc desc =
        hada_fft_of(HADA_FFT_FORWARD, classic->shape.grid_rows, classic->shape.grid_cols, batch, *rect);
    desc.real_pitch = (size_t)image.pitch;
    desc.real_distance = image.pixels;
    return hada_fft_pair_create(pair, classic->slot, desc, err);
}

/* Whether the method looks at the frame's pixels in each iteration. */
static int has_frame(const hada_classic_shape *shape)
{
    return shape->place.boundary == HADA_BOUNDARY_PADDED || shape->options.method == HADA_METHOD_RL;
}

int hada_classic_weighs(const hada_classic_shape *shape)
{
    return has_frame(shape) && shape->options.method != HADA_METHOD_WIENER;
}

/* Whether its transforms are taken together with what lies between them. */
static int fuses(const hada_context *context, const hada_classic_shape *shape)
{
    const hada_method method = shape->options.method;
    return has_frame(shape) && (method == HADA_METHOD_RL || method == HADA_METHOD_FISTA) &&
           hada_fft_fuses(context, shape->grid_rows, shape->grid_cols,
                          shape->place.max_planes * shape->components > 1 ? 2 : 1);
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

/* Sums that a launch leaves, at most. */
static size_t partials(const hada_classic_shape *shape, const hada_spectrum_layout *layout,
                       const hada_classic_image *plane, const hada_classic_image *frame)
{
    const size_t channels = (size_t)shape->place.channels, images = channels * (size_t)shape->place.max_planes;
    size_t most = channels * hada_divide_up(layout->count, HADA_CLASSIC_SLICE);
    most = larger(most, channels * hada_divide_up(frame->pixels, HADA_CLASSIC_SLICE));
    most = larger(most, images * MOST_SUMS * hada_divide_up(plane->pixels, HADA_CLASSIC_SLICE));
    most = larger(most, images * MOST_SUMS * hada_divide_up((size_t)plane->rows, HADA_CLASSIC_ROWS));
    return larger(most, images * MOST_SUMS * hada_divide_up((size_t)plane->rows, (size_t)plane->band));
}

/* Bytes of every buffer; 0: the method has none. */
static void sizes_of(const hada_context *context, const hada_classic_shape *shape, size_t *bytes)
{
    const hada_rectangle plane_at = hada_classic_plane_rect(shape), frame_at = hada_classic_frame_rect(shape);
    const hada_classic_image plane = image_of(&plane_at), frame = image_of(&frame_at);
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    const hada_classic_options *o = &shape->options;
    const hada_rectangle *window = &shape->place.window;
    const int rl = o->method == HADA_METHOD_RL, fista = o->method == HADA_METHOD_FISTA,
              admm = o->method == HADA_METHOD_ADMM, tv = o->prior == HADA_PRIOR_TV,
              wavelet = o->prior == HADA_PRIOR_WAVELET || o->prior == HADA_PRIOR_HAAR, has = has_frame(shape);
    const size_t channels = (size_t)shape->place.channels, images = channels * (size_t)shape->place.max_planes;
    const size_t components = (size_t)shape->components, planes = images * plane.pixels * sizeof(float),
                 frames = channels * frame.pixels * sizeof(float);
    const size_t spectrum = layout.count * 2 * sizeof(float);
    /* fused passes keep half spectra of the images' rows alone */
    const size_t row = (size_t)layout.blocks * (size_t)layout.block * 2 * sizeof(float);
    const size_t plane_spectrum = fuses(context, shape) ? (size_t)plane.rows * row : spectrum;
    const size_t frame_spectrum = fuses(context, shape) ? (size_t)frame.rows * row : spectrum;
    const size_t list[HADA_CLASSIC_PARTS] = {
        [HADA_CLASSIC_WINDOW] = images * (size_t)window->rows * (size_t)window->cols * sizeof(float),
        [HADA_CLASSIC_LIST] = (size_t)shape->place.max_planes * components * sizeof(cl_int),
        [HADA_CLASSIC_PARTIAL] = partials(shape, &layout, &plane, &frame) * sizeof(float),
        [HADA_CLASSIC_SPECTRA] = images * components * plane_spectrum,
        [HADA_CLASSIC_COMPONENTS] = components > 1 ? components * planes : 0,
        [HADA_CLASSIC_PROJECTION] = channels * frame_spectrum,
        [HADA_CLASSIC_PRIMAL] = planes,
        [HADA_CLASSIC_FRAME] = has ? frames : 0,
        [HADA_CLASSIC_WEIGHTS] = hada_classic_weighs(shape) ? frames : 0,
        [HADA_CLASSIC_PREDICTION] = has ? frames : 0,
        [HADA_CLASSIC_PREVIOUS] = rl || admm ? planes : 0,
        [HADA_CLASSIC_EXTRAPOLATED] = rl || fista ? planes : 0,
        [HADA_CLASSIC_GRADIENT] = fista ? planes : 0,
        [HADA_CLASSIC_NORM] = rl ? planes : 0,
        [HADA_CLASSIC_DIRECTION] = rl ? planes : 0,
        [HADA_CLASSIC_BLURRED] = rl && shape->sieve ? planes : 0,
        [HADA_CLASSIC_PROXIMAL] = fista && tv ? planes : 0,
        [HADA_CLASSIC_TV_DUAL] = (fista || admm) && tv ? 2 * planes : 0,
        [HADA_CLASSIC_TV_DUAL_NEXT] = (fista || admm) && tv ? 2 * planes : 0,
        [HADA_CLASSIC_PYRAMID] = wavelet ? (size_t)o->levels * planes : 0,
        [HADA_CLASSIC_PLANE_DUAL] = admm ? planes : 0,
        [HADA_CLASSIC_DATA_DUAL] = admm && has ? frames : 0,
        [HADA_CLASSIC_DATA_SPLIT] = admm && has ? channels * spectrum : 0,
        [HADA_CLASSIC_TABLE] =
            (fista ? channels : (size_t)layout.rows + (size_t)layout.blocks * (size_t)layout.block) * sizeof(float)};
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        bytes[i] = list[i];
    if (rl)
        bytes[HADA_CLASSIC_TABLE] = shape->sieve ? (HADA_CLASSIC_REACH + 1) * sizeof(float) : 0;
}

static const char what[] = "the images of a classic method";

/* Everything that a method keeps, on the host and on the device. */
static hada_status allocate(hada_classic *classic, hada_error *err)
{
    hada_slot *slot = classic->slot;
    const hada_classic_shape *shape = &classic->shape;
    const hada_rectangle plane = hada_classic_plane_rect(shape), frame = hada_classic_frame_rect(shape);
    const int channels = shape->place.channels, images = shape->place.max_planes * shape->components * channels;
    HADA_TRY(hada_allocated(
        classic->sums = hada_alloc(classic->bytes[HADA_CLASSIC_PARTIAL] / sizeof(float), sizeof(float), what, err)));
    HADA_TRY(hada_allocated(classic->table = hada_alloc(classic->bytes[HADA_CLASSIC_TABLE] + 1, 1, what, err)));
    if (classic->fuses)
        HADA_TRY(hada_fft_fused_make(&classic->fused, slot, shape->grid_rows, shape->grid_cols, err));
    else
        HADA_TRY(make_transforms(&classic->fft, classic, &plane, images, err));
    if (classic->has_frame && !classic->fuses)
        HADA_TRY(make_transforms(&classic->frame_fft, classic, &frame, channels, err));
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        if (classic->bytes[i])
            HADA_TRY(hada_buffer_take(&classic->part[i], slot, i == HADA_CLASSIC_WINDOW ? HADA_RESULT : HADA_OWN_STEPS,
                                      classic->bytes[i], what, err));
    return HADA_OK;
}

hada_status hada_classic_create(hada_classic **out, hada_slot *slot, const hada_classic_shape *shape, hada_error *err)
{
    const hada_rectangle plane = hada_classic_plane_rect(shape), frame = hada_classic_frame_rect(shape);
    hada_classic *classic = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(classic, 1, what, err));
    classic->slot = slot;
    classic->shape = *shape;
    classic->layout = hada_fft_layout(slot->context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    classic->plane = image_of(&plane);
    classic->frame = image_of(&frame);
    /* vectors need whole ones of eight frequencies in a row of the layout */
    classic->spectrum_program = HADA_PROGRAM_VARIANT(CLASSIC_SPECTRUM, slot->context, classic->layout.block % 8 == 0);
    classic->group = (size_t)hada_macros_of_classic_spectrum(classic->spectrum_program)->refine_group;
    classic->has_frame = has_frame(shape);
    classic->fuses = fuses(slot->context, shape);
    sizes_of(slot->context, shape, classic->bytes);
    HADA_TRY_OR_DONE(allocate(classic, err));
    if (classic->fuses)
        HADA_TRY_OR_DONE(hada_classic_check(classic, err));
    *out = classic;
done:
    if (status)
        hada_classic_destroy(&classic);
    return status;
}

void hada_classic_destroy(hada_classic **pointer)
{
    hada_classic *classic = hada_taken(pointer);
    if (!classic)
        return;
    hada_slot_finish(classic->slot, NULL);
    hada_fft_pair_destroy(&classic->fft);
    hada_fft_pair_destroy(&classic->frame_fft);
    hada_fft_fused_free(&classic->fused);
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        hada_buffer_destroy(&classic->part[i]);
    HADA_FREE(classic->sums, classic->table, classic);
}

cl_mem hada_classic_planes(const hada_classic *classic)
{
    return classic->part[HADA_CLASSIC_WINDOW].mem;
}
