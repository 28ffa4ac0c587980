/* Models from point spread functions: transfer functions, matched and Wiener filters. */
#include <hadalens/scene.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "core/callers.h"
#include "filter/bank.h"
#include "filter/psf.h"
#include "image/pixels.h"

/* Chosen on simulated frames with 1 % noise (circular) and on a real caustic PSF whose frame is cropped (padded), where
 * the light that left the frame counts as noise: docs/explanation/learning-a-camera.md. */
typedef struct choice {
    double lambda, rho;
    int steps;
} choice;
static const choice for_circular = {0.2, 3e-3, 12}, for_padded = {2.0, 1e-3, 20};

/* The place on a grid of a point that is `from_axis` pixels from the axis, which is at the origin. */
static int on_grid(int from_axis, int turned, int grid)
{
    return (grid + (turned ? -from_axis : from_axis)) % grid;
}

hada_status hada_psf_reach(hada_image *out, const hada_image *psf, const hada_model_info *info, hada_error *err)
{
    const int rows = psf->rows < info->grid_rows ? psf->rows : info->grid_rows;
    const int cols = psf->cols < info->grid_cols ? psf->cols : info->grid_cols;
    return hada_image_crop(out, psf, psf->rows / 2 - rows / 2, psf->cols / 2 - cols / 2, rows, cols, err);
}

/* A copy, cleaned. */
static hada_status take(hada_image *out, const hada_image *psf, const hada_psf_options *options, int depth,
                        hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_copy(out, psf, err));
    if (options->turn & HADA_TURN_TRANSPOSE)
        HADA_TRY_OR_DONE(hada_psf_transpose(out, err));
    HADA_TRY_OR_DONE(hada_psf_clean(out, options, NULL, err));
done:
    if (status)
        hada_error_prefix(err, "depth %d: ", depth);
    return status;
}

/* A channel of a PSF onto the grid, which is as large at least: times `scale`, axis at the origin. Returns the sum of
 * squares, which is the mean of |OTF|^2. */
static double place(const hada_image *psf, const hada_model_info *info, hada_turn turn, int channel, double scale,
                    float *grid)
{
    const float *from = psf->data + (size_t)channel * (size_t)psf->rows * (size_t)psf->cols;
    double square = 0.0;
    memset(grid, 0, (size_t)info->grid_rows * (size_t)info->grid_cols * sizeof *grid);
    for (int row = 0; row < psf->rows; row++) {
        float *to = grid + (size_t)on_grid(row - psf->rows / 2, (turn & HADA_TURN_FLIP) != 0, info->grid_rows) *
                               (size_t)info->grid_cols;
        for (int col = 0; col < psf->cols; col++) {
            const double value = from[(size_t)row * (size_t)psf->cols + (size_t)col];
            to[on_grid(col - psf->cols / 2, (turn & HADA_TURN_MIRROR) != 0, info->grid_cols)] = (float)(value * scale);
            square += value * value;
        }
    }
    return square * (scale * scale);
}

/* A channel at a time: the arrays on grids are what a large PSF costs. */
typedef struct psf_work {
    hada_slot *slot;
    hada_fft *fft;
    hada_buffer real, spectrum;
    float *room;      /* for a channel on the grid, then its spectrum */
    hada_image clean; /* the PSF in hand, as far as the grid reaches */
} psf_work;

static hada_status work_create(psf_work *work, hada_context *context, const hada_model_info *info, hada_error *err)
{
    const size_t area = (size_t)info->grid_rows * (size_t)info->grid_cols;
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, info->grid_rows, info->grid_cols, 1);
    HADA_TRY(hada_slot_create(&work->slot, context, err));
    HADA_TRY(hada_fft_create(&work->fft, work->slot, &desc, err));
    const size_t values = 2 * hada_fft_plan_layout(work->fft)->count;
    HADA_TRY(hada_buffer_create(&work->real, context, area * 4, "a point spread function", err));
    HADA_TRY(hada_buffer_create(&work->spectrum, context, values * 4, "a transfer function", err));
    return HADA_NEW_RAW(work->room, values > area ? values : area, "a point spread function", err);
}

static void work_destroy(psf_work *work)
{
    if (work->slot)
        hada_slot_finish(work->slot, NULL);
    hada_fft_destroy(&work->fft);
    HADA_DESTROY_BUFFERS(&work->real, &work->spectrum);
    free(work->room);
    hada_image_destroy(&work->clean);
    hada_slot_destroy(&work->slot);
}

/* The transfer functions of what the grid holds of an image, times `scale` (0: brightness 1, the mean over channels,
 * which takes the scale's place), and the sums of squares of its channels. */
static hada_status transform(psf_work *work, const hada_model_info *info, const hada_image *psf, hada_turn turn,
                             double *scale, float *otf, double *square, hada_error *err)
{
    const hada_spectrum_layout *layout = hada_fft_plan_layout(work->fft);
    const size_t plane = hada_model_info_plane(info), area = (size_t)info->grid_rows * (size_t)info->grid_cols;
    hada_image_destroy(&work->clean);
    HADA_TRY(hada_psf_reach(&work->clean, psf, info, err));
    if (*scale == 0.0) {
        const double light = hada_psf_light(&work->clean);
        if (!(light > 0.0))
            return hada_fail(err, HADA_ERROR_NUMERIC,
                             "no light of the point spread function is near its middle, where the optical axis is; "
                             "check that it belongs to frames of %d x %d",
                             info->raw_rows, info->raw_cols);
        *scale = psf->channels / light;
    }
    for (int c = 0; c < info->channels; c++) {
        square[c] = place(&work->clean, info, turn, c, *scale, work->room);
        HADA_TRY(hada_buffer_write(&work->real, work->slot, 0, work->room, area * 4, err));
        HADA_TRY(hada_fft_forward(work->fft, 1, work->real.mem, 0, work->spectrum.mem, 0, err));
        HADA_TRY(hada_buffer_read(&work->spectrum, work->slot, 0, work->room, layout->count * 8, err));
        hada_layout_unpack(layout, work->room, otf + (size_t)c * plane * 2);
    }
    return HADA_OK;
}

/* What is made of PSFs: for each depth one image, or `positions` of them. */
typedef struct making {
    const hada_image *psfs;
    const hada_psf_options *options;
    hada_psf_field *fields; /* of each depth; NULL: one image for each */
    double *rows, *cols;    /* [depth][position], as the images stand after they are transposed */
    hada_image *images;     /* of the depth in hand, cleaned and registered */
} making;

static void free_images(making *now)
{
    for (int n = 0; now->images && n < now->options->positions; n++)
        hada_image_destroy(&now->images[n]);
}

static hada_status take_depth(making *now, int depth, hada_error *err)
{
    const int count = now->options->positions;
    const size_t first = (size_t)depth * (size_t)count;
    free_images(now);
    for (int n = 0; n < count; n++)
        HADA_TRY(take(&now->images[n], &now->psfs[first + (size_t)n], now->options, depth, err));
    return hada_psf_register(now->images, now->rows + first, now->cols + first, count, err);
}

/* The least that explain the wanted share of each depth. */
static int components_of(const making *now, int depths)
{
    const hada_psf_options *o = now->options;
    const int most = o->positions < HADA_MOST_COMPONENTS ? o->positions : HADA_MOST_COMPONENTS;
    int components = 1;
    if (o->components > 0)
        return o->components < most ? o->components : most;
    for (int z = 0; z < depths; z++)
        while (components < most && hada_psf_field_lost(&now->fields[z], components) > 1.0 - o->explained)
            components++;
    return components;
}

/* Looks at the PSFs of all depths: how many components they have. */
static hada_status find_components(making *now, hada_model_info *info, hada_error *err)
{
    const hada_psf_options *o = now->options;
    const size_t all = (size_t)info->depths * (size_t)o->positions;
    const int across = (o->turn & HADA_TURN_TRANSPOSE) != 0;
    HADA_TRY(HADA_NEW(now->fields, (size_t)info->depths, "the components of PSFs", err));
    HADA_TRY(HADA_NEW(now->images, (size_t)o->positions, "point spread functions", err));
    HADA_TRY(HADA_NEW(now->rows, all, "positions", err));
    HADA_TRY(HADA_NEW(now->cols, all, "positions", err));
    for (size_t i = 0; i < all; i++) {
        now->rows[i] = across ? o->position_cols[i] : o->position_rows[i];
        now->cols[i] = across ? o->position_rows[i] : o->position_cols[i];
    }
    for (int z = 0; z < info->depths; z++) {
        const size_t first = (size_t)z * (size_t)o->positions;
        HADA_TRY(hada_psf_positions_check(now->rows + first, now->cols + first, o->positions, err));
        HADA_TRY(take_depth(now, z, err));
        HADA_TRY(
            hada_psf_field_of(&now->fields[z], now->images, now->rows + first, now->cols + first, o->positions, err));
    }
    info->components = components_of(now, info->depths);
    info->positions = o->positions;
    for (int z = 0; z < info->depths; z++) {
        info->lost = fmax(info->lost, hada_psf_field_lost(&now->fields[z], info->components));
        info->lost_single = fmax(info->lost_single, now->fields[z].lost_single);
    }
    if (info->components == 1)
        info->lost = info->lost_single;
    return HADA_OK;
}

/* The weights of a depth's components, and how much of each there is. */
static hada_status weigh_depth(const making *now, hada_model *model, int depth, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const int count = info->positions;
    const hada_turn turn = now->options->turn;
    const size_t pixels = (size_t)info->window_rows * (size_t)info->window_cols;
    double *turned = NULL;
    hada_psf_field field = now->fields[depth];
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(turned, 2 * (size_t)count, "positions", err));
    for (int n = 0; n < count; n++) { /* on the frame */
        turned[n] = turn & HADA_TURN_FLIP ? -field.rows[n] : field.rows[n];
        turned[count + n] = turn & HADA_TURN_MIRROR ? -field.cols[n] : field.cols[n];
    }
    field.rows = turned;
    field.cols = turned + count;
    HADA_TRY_OR_DONE(hada_psf_field_weights(
        model->component_weights + (size_t)depth * (size_t)info->components * pixels, &field, info->components,
        info->window_rows, info->window_cols, (info->raw_rows - info->window_rows) / 2 - info->raw_rows / 2,
        (info->raw_cols - info->window_cols) / 2 - info->raw_cols / 2, err));
    memcpy(model->singular_values + (size_t)depth * (size_t)count, field.singular, (size_t)count * sizeof(double));
done:
    free(turned);
    return status;
}

/* Components have the scale of the mean PSF, whose brightness is 1. */
static hada_status transform_field(psf_work *work, making *now, hada_model *model, int depth, double *square,
                                   hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t channels = (size_t)info->channels, values = hada_model_plane(model) * 2;
    double *unused = NULL, scale = 0.0;
    hada_image image = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(unused, channels, "point spread functions", err));
    HADA_TRY_OR_DONE(take_depth(now, depth, err));
    for (int k = -1; k < (info->components > 1 ? info->components : 0); k++) {
        const size_t term = (size_t)depth * (size_t)info->components + (size_t)(k > 0 ? k : 0);
        float *otf =
            k < 0 ? model->otf + (size_t)depth * channels * values : model->component_otf + term * channels * values;
        HADA_TRY_OR_DONE(hada_psf_field_component(&image, &now->fields[depth], now->images, k, err));
        HADA_TRY_OR_DONE(transform(work, info, &image, now->options->turn, &scale, otf, k < 0 ? square : unused, err));
        hada_image_destroy(&image);
    }
    if (info->components > 1)
        HADA_TRY_OR_DONE(weigh_depth(now, model, depth, err));
done:
    hada_image_destroy(&image);
    free(unused);
    return status;
}

static hada_status transform_depth(psf_work *work, making *now, hada_model *model, int depth, double *square,
                                   hada_error *err)
{
    const size_t first = (size_t)depth * (size_t)model->info.channels;
    double scale = 0.0;
    hada_image clean = {0};
    hada_status status = HADA_OK;
    if (now->fields)
        return transform_field(work, now, model, depth, square + first, err);
    HADA_TRY_OR_DONE(take(&clean, &now->psfs[depth], now->options, depth, err));
    status = transform(work, &model->info, &clean, now->options->turn, &scale,
                       model->otf + first * hada_model_plane(model) * 2, square + first, err);
    if (status)
        hada_error_prefix(err, "depth %d: ", depth);
done:
    hada_image_destroy(&clean);
    return status;
}

static hada_status transform_all(hada_model *model, hada_context *context, making *now, double *square, hada_error *err)
{
    psf_work work = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(work_create(&work, context, &model->info, err));
    for (int z = 0; z < model->info.depths; z++)
        HADA_TRY_OR_DONE(transform_depth(&work, now, model, z, square, err));
done:
    work_destroy(&work);
    return status;
}

static void free_making(making *now, int depths)
{
    free_images(now);
    for (int z = 0; now->fields && z < depths; z++)
        hada_psf_field_free(&now->fields[z]);
    HADA_FREE(now->fields, now->images, now->rows, now->cols);
}

/* What the options say of PSFs that vary over the field. */
static hada_status check_field(const hada_psf_options *o, hada_error *err)
{
    if (o->positions < 0 || (o->positions && (!o->position_rows || !o->position_cols)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "PSFs that vary over the field need positions, rows and columns");
    if ((o->components != HADA_AUTO && (o->components < 1 || o->components > HADA_MOST_COMPONENTS)) ||
        !(o->explained > 0.0 && o->explained <= 1.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.components takes 1 to %d, and options.explained a share above 0 and at most 1",
                         HADA_MOST_COMPONENTS);
    if (o->positions && o->boundary != HADA_BOUNDARY_PADDED)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "PSFs that vary over the field are for options.boundary padded, as a sensor crops");
    return HADA_OK;
}

static hada_status check_psfs(const hada_image *psfs, int depths, hada_error *err)
{
    for (int z = 0; z < depths; z++) {
        HADA_TRY(hada_image_check(&psfs[z], NULL, "hada_model_from_psf", "one of psfs", err));
        if (psfs[z].channels != psfs->channels || psfs[z].rows != psfs->rows || psfs[z].cols != psfs->cols)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "point spread functions must be of one size: depth %d has %d channels, %d x %d; depth 0 "
                             "has %d, %d x %d",
                             z, psfs[z].channels, psfs[z].rows, psfs[z].cols, psfs->channels, psfs->rows, psfs->cols);
        const size_t bad = hada_image_count_not_finite(&psfs[z]);
        if (bad)
            return hada_fail(err, HADA_ERROR_NOT_FINITE,
                             "the point spread function of depth %d holds %zu NaN or infinite pixels", z, bad);
    }
    return HADA_OK;
}

hada_status hada_model_from_psf(hada_model **out, hada_context *context, const hada_image *psfs, int depths,
                                const double *distances_mm, const hada_psf_options *callers, hada_error *err)
{
    hada_psf_options own, *options = &own;
    making now = {.psfs = psfs, .options = options};
    hada_status status = HADA_OK;
    double *square = NULL;
    if (!out || !context || !psfs || depths < 1 || !distances_mm)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_model_from_psf: out, a context, point spread functions and distances are needed");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(options, callers, hada_psf_options, err));
    if (options->form != HADA_FORM_MATCHED && options->form != HADA_FORM_WIENER)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "a point spread function gives filters of the forms matched and wiener; for complex or "
                      "split, fit from pairs"));
    if (options->lambda == 0.0 || !hada_model_weight_is_given(options->lambda) ||
        !hada_model_weight_is_given(options->refine_tv) || !hada_model_weight_is_given(options->dark) ||
        !isfinite(options->psf_dark) || !hada_model_weight_is_given(options->psf_gate) ||
        !hada_model_weight_is_given(options->refine_steps) || options->refine_steps > HADA_MODEL_MOST_STEPS ||
        options->psf_taper < 0)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "options.lambda is %g, refine_tv %g, psf_gate %g, dark %g, psf_dark %g, refine_steps "
                      "%d and psf_taper %d: they are finite, lambda above 0, none negative but psf_dark and "
                      "HADA_AUTO, and at most %g, or %d steps",
                      options->lambda, options->refine_tv, options->psf_gate, options->dark, options->psf_dark,
                      options->refine_steps, options->psf_taper, HADA_MODEL_MOST_WEIGHT, HADA_MODEL_MOST_STEPS));
    if ((int)options->turn < HADA_TURN_NONE || options->turn > HADA_TURN_270)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "there is no turn %d (hada_turn)", (int)options->turn));
    HADA_TRY_OR_DONE(check_field(options, err));
    HADA_TRY_OR_DONE(check_psfs(psfs, depths * (options->positions ? options->positions : 1), err));
    const choice *chosen = options->boundary == HADA_BOUNDARY_PADDED ? &for_padded : &for_circular;
    hada_model_info info = {.depths = depths,
                            .channels = psfs->channels,
                            .form = options->form,
                            .boundary = options->boundary,
                            .lambda = options->lambda > 0.0 ? options->lambda : chosen->lambda,
                            .dark = options->dark,
                            .refine_steps = options->refine_steps < 0 ? chosen->steps : options->refine_steps,
                            .refine_rho = chosen->rho,
                            .refine_tv = options->refine_tv,
                            .has_otf = 1,
                            .mosaic = options->downsample > 1 ? HADA_MOSAIC_NONE : options->mosaic,
                            .downsample = options->downsample,
                            .sensor_mosaic = options->downsample > 1 ? options->mosaic : HADA_MOSAIC_NONE,
                            .distances_mm = distances_mm};
    if (info.form == HADA_FORM_MATCHED)
        info.lambda = 0.0;
    memcpy(info.colour_matrix, options->colour_matrix, sizeof info.colour_matrix);
    const int across = (options->turn & HADA_TURN_TRANSPOSE) != 0;
    const int rows = across ? psfs->cols : psfs->rows, cols = across ? psfs->rows : psfs->cols;
    HADA_TRY_OR_DONE(hada_model_set_sizes(&info, options->frame_rows ? options->frame_rows : rows,
                                          options->frame_cols ? options->frame_cols : cols, options->window_rows,
                                          options->window_cols, err));
    if (options->positions)
        HADA_TRY_OR_DONE(find_components(&now, &info, err));
    HADA_TRY_OR_DONE(hada_model_create(out, &info, 0, err));
    const size_t images = (size_t)depths * (size_t)info.channels, plane = hada_model_plane(*out);
    HADA_TRY_OR_DONE(HADA_NEW(square, images, "point spread functions", err));
    HADA_TRY_OR_DONE(transform_all(*out, context, &now, square, err));
    /* the device's memory is given back by now: the filters are as large */
    for (size_t i = 0; i < images; i++)
        hada_model_make_filter((*out)->otf + i * plane * 2, plane, info.form, info.lambda * square[i],
                               (*out)->filter + i * plane * 2);
done:
    free(square);
    free_making(&now, depths);
    if (status)
        hada_model_destroy(out);
    return status;
}
