/* The classic methods: planes after a few iterations against the references, and their proximal steps, frames and
 * transposes with them. */
#include "check_camera.h"
#include "classic/classic.h"
#include "model/model.h"
#include "ref/ref_classic.h"

enum { MAX_DEPTHS = 16 };

typedef struct classic_state {
    hada_classic *classic;
    hada_classic_shape shape;
    hada_refine_data data;
    hada_classic_camera camera;
    hada_classic_job job;
    check_camera seen;
    hada_buffer weights; /* of the frame's values */
    double *weighed;     /* the same on the grid, [channel][row][col]; NULL: none */
    hada_model model;    /* what is needed to make the grid smaller: sizes and transfer functions */
    int depths, channels, list[MAX_DEPTHS];
    size_t pixels, values, floats; /* of the grid, its half spectrum, the window of all planes */
} classic_state;

static hada_status read_shape(const check_state *state, classic_state *own, hada_error *err)
{
    static const double distances[MAX_DEPTHS + 1] = {0};
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), padded = check_get(state, 'p', 0);
    const int high = check_get(state, 'h', rows / 2), wide = check_get(state, 'w', cols / 2);
    own->depths = check_get(state, 'd', 2);
    own->channels = check_get(state, 'b', 2);
    own->pixels = (size_t)rows * (size_t)cols;
    own->values = (size_t)rows * (size_t)(cols / 2 + 1);
    own->floats = (size_t)(own->depths * own->channels * high * wide);
    if (own->depths > MAX_DEPTHS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d depths", MAX_DEPTHS);
    own->model.info = (hada_model_info){.depths = own->depths + 1,
                                        .channels = own->channels,
                                        .raw_rows = padded ? rows - 2 * (rows / 5) : rows,
                                        .raw_cols = padded ? cols - 2 * (cols / 5) : cols,
                                        .grid_rows = rows,
                                        .grid_cols = cols,
                                        .window_rows = high,
                                        .window_cols = wide,
                                        .boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR,
                                        .has_otf = 1,
                                        .distances_mm = distances,
                                        .name = ""};
    DEFAULTS(hada_classic_options, options);
    options.method = (hada_method)check_get(state, 'm', HADA_METHOD_ADMM);
    options.iterations = check_get(state, 'n', 5);
    options.prior = (hada_prior)(check_get(state, 'x', 0) + 1);
    options.weight = 3e-3;
    options.support = check_get(state, 's', 0) ? HADA_SUPPORT_GRID : HADA_SUPPORT_WINDOW;
    options.accelerate = check_get(state, 'a', 1);
    options.levels = check_get(state, 'l', 3);
    options.mu2 = options.mu3 = 0.03;
    for (int i = 0; i < own->depths; i++)
        own->list[i] = (i + 1) % (own->depths + 1);
    HADA_TRY(hada_classic_shape_of(&own->model.info, own->depths, &options, &own->shape, err));
    own->shape.sieve = check_get(state, 't', 0) > 0;
    if (check_get(state, 'k', 0)) /* a camera that wraps around takes the data step of a sensor that crops */
        own->shape.place.boundary = HADA_BOUNDARY_PADDED;
    return HADA_OK;
}

/* Whether a point spread function is not 0 here: within o x q pixels from (y, z) on, round the edges. */
static int within(const check_state *state, const classic_state *own, int row, int col)
{
    const int rows = own->shape.place.grid_rows, cols = own->shape.place.grid_cols;
    return (row + rows - check_get(state, 'y', 0)) % rows < check_get(state, 'o', rows) &&
           (col + cols - check_get(state, 'z', 0)) % cols < check_get(state, 'q', cols);
}

/* Sparse point spread functions of brightness 1, and frames without negative values: image `number`. */
static void fill_image(const check_state *state, size_t number, int is_frame, float *out)
{
    const classic_state *own = state->own;
    const hada_rectangle *frame = &own->shape.place.frame;
    const size_t cols = (size_t)own->shape.place.grid_cols;
    const int cut = is_frame && own->shape.place.boundary == HADA_BOUNDARY_PADDED;
    double sum = 0.0;
    check_fill_normal(state, number, out, own->pixels);
    for (size_t i = 0; i < own->pixels; i++) {
        const int row = (int)(i / cols) - frame->row0, col = (int)(i % cols) - frame->col0;
        const int inside = row >= 0 && row < frame->rows && col >= 0 && col < frame->cols;
        out[i] = is_frame ? (cut && !inside ? 0.0f : fabsf(out[i])) : fmaxf(out[i] - 1.0f, 0.0f);
        if (!is_frame && !within(state, own, (int)(i / cols), (int)(i % cols)))
            out[i] = 0.0f;
        sum += out[i];
    }
    for (size_t i = 0; !is_frame && i < own->pixels; i++)
        out[i] = (float)(out[i] / sum);
}

/* The grid as small as the point spread functions allow, and the transfer functions on it. */
static hada_status make_smaller(check_state *state, classic_state *own, hada_error *err)
{
    hada_context *context = state->slot->context;
    hada_status status = hada_classic_fit_grid(&own->shape, context, &own->model, NULL, own->depths + 1, err);
    if (status || !own->shape.reach.rows)
        return status;
    hada_buffer_destroy(&own->seen.otf);
    return hada_classic_optics(&own->seen.otf, context, &own->shape, &own->model, NULL, own->depths + 1, err);
}

/* Values without weight, saturated ones, and others of all sizes up to 1. */
static hada_status make_weights(check_state *state, classic_state *own, hada_error *err)
{
    const hada_rectangle *frame = &own->shape.place.frame;
    const size_t area = hada_rect_area(frame), cols = (size_t)own->shape.place.grid_cols;
    float *weights = check_room(state, (size_t)own->channels * area * sizeof *weights);
    own->weighed = check_room(state, (size_t)own->channels * own->pixels * sizeof *own->weighed);
    for (size_t i = 0; i < (size_t)own->channels * area; i++) {
        const size_t row = i % area / (size_t)frame->cols, col = i % area % (size_t)frame->cols;
        weights[i] = i % 7 == 3 ? 0.0f : i % 5 == 1 ? -0.9f : 1.0f - 0.1f * (float)(i % 8);
        own->weighed[i / area * own->pixels + ((size_t)frame->row0 + row) * cols + (size_t)frame->col0 + col] =
            weights[i];
    }
    own->data.weights = NULL;
    HADA_TRY(check_upload(state, &own->weights, weights, (size_t)own->channels * area * sizeof *weights, err));
    own->data.weights = own->weights.mem;
    return HADA_OK;
}

static hada_status make_camera(check_state *state, classic_state *own, hada_error *err)
{
    const hada_refine_shape *place = &own->shape.place;
    check_camera *seen = &own->seen;
    *seen = (check_camera){.rows = place->grid_rows,
                           .cols = place->grid_cols,
                           .frame = place->frame,
                           .functions = ((size_t)own->depths + 1) * (size_t)own->channels,
                           .channels = (size_t)own->channels,
                           .fill = fill_image};
    HADA_TRY(check_camera_make(state, seen, err));
    own->camera.largest = check_room(state, seen->channels * sizeof *own->camera.largest);
    own->model.otf = seen->half;
    if (check_get(state, 'o', 0))
        HADA_TRY(make_smaller(state, own, err));
    own->data = (hada_refine_data){
        .spectrum = seen->spectrum.mem, .frame = seen->seen.mem, .otf = seen->otf.mem, .otf_depths = own->depths + 1};
    own->model.otf = NULL;
    return check_get(state, 'k', 0) ? make_weights(state, own, err) : HADA_OK;
}

/* One channel's transfer functions, in the order of the list; its largest sum of squares. */
static void gather(classic_state *own, int channel, double *otf)
{
    for (int s = 0; s < own->depths; s++)
        memcpy(otf + (size_t)s * 2 * own->values,
               own->seen.otfs + (size_t)(own->list[s] * own->channels + channel) * 2 * own->values,
               2 * own->values * sizeof *otf);
    for (size_t f = 0; f < own->values; f++) {
        double square = 0.0;
        for (int s = 0; s < own->depths; s++) {
            const double *h = otf + 2 * ((size_t)s * own->values + f);
            square += h[0] * h[0] + h[1] * h[1];
        }
        own->camera.largest[channel] = fmax(own->camera.largest[channel], square);
    }
}

static hada_ref_classic problem_of(const classic_state *own, int channel, const double *otf)
{
    static const hada_ref_method methods[] = {0, HADA_REF_WIENER, HADA_REF_RL, HADA_REF_FISTA, HADA_REF_ADMM};
    static const hada_ref_prior priors[] = {0, HADA_REF_NONE, HADA_REF_TV, HADA_REF_WAVELET, HADA_REF_HAAR};
    const hada_classic_options *o = &own->shape.options;
    const hada_refine_shape *place = &own->shape.place;
    const hada_rectangle *f = &place->frame, *s = &own->shape.support;
    const int padded = place->boundary == HADA_BOUNDARY_PADDED;
    const double mu1 = padded ? o->mu1 : 1.0;
    return (hada_ref_classic){.method = methods[o->method],
                              .rows = place->grid_rows,
                              .cols = place->grid_cols,
                              .depths = own->depths,
                              .padded = padded,
                              .frame = {f->row0, f->col0, f->rows, f->cols},
                              .support = {s->row0, s->col0, s->rows, s->cols},
                              .otf = otf,
                              .image = own->seen.image + (size_t)channel * own->pixels,
                              .iterations = o->iterations,
                              .prior = priors[o->prior],
                              .weight = o->prior == HADA_PRIOR_NONE ? 0.0 : o->weight,
                              .step = o->step / own->camera.largest[channel],
                              .inner = o->inner,
                              .levels = o->levels,
                              .accelerate = o->accelerate,
                              .sieve = own->job.sieve,
                              .beside = own->job.sieve > 0.0 ? 0.1 : 0.0,
                              .flat = 1.0,
                              .floor = 1e-5,
                              .seen = 1e-3,
                              .mu1 = mu1,
                              .mu2 = o->prior == HADA_PRIOR_TV ? o->mu2 * mu1 : 0.0,
                              .mu3 = o->mu3 * mu1,
                              .lambda = o->lambda,
                              .weights = own->weighed ? own->weighed + (size_t)channel * own->pixels : NULL};
}

static hada_status expect(check_state *state, classic_state *own, hada_error *err)
{
    const hada_rectangle *window = &own->shape.place.window;
    const size_t area = (size_t)window->rows * (size_t)window->cols, cols = (size_t)own->shape.place.grid_cols;
    double *otf = check_room(state, (size_t)own->depths * 2 * own->values * sizeof *otf);
    double *planes = check_room(state, (size_t)own->depths * own->pixels * sizeof *planes);
    for (int c = 0; c < own->channels; c++) {
        gather(own, c, otf);
        const hada_ref_classic problem = problem_of(own, c, otf);
        HADA_TRY(hada_ref_classic_run(&problem, planes, NULL, err));
        for (size_t z = 0; z < (size_t)own->depths; z++)
            for (size_t i = 0; i < area; i++) {
                const size_t row = (size_t)window->row0 + i / (size_t)window->cols;
                const size_t col = (size_t)window->col0 + i % (size_t)window->cols;
                state->expected[(z * (size_t)own->channels + (size_t)c) * area + i] =
                    fmax(0.0, planes[z * own->pixels + row * cols + col]);
            }
    }
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    classic_state *own = check_own(state, sizeof *own);
    own->camera.gain = own->camera.mean_square = 1.0;
    HADA_TRY(read_shape(state, own, err));
    HADA_TRY(make_camera(state, own, err));
    HADA_TRY(hada_classic_create(&own->classic, state->slot, &own->shape, err));
    HADA_TRY(check_output(state, own->floats, err));
    own->job = (hada_classic_job){.data = &own->data,
                                  .camera = &own->camera,
                                  .depths = own->depths,
                                  .list = own->list,
                                  .brightness = 1.0,
                                  .weight = own->shape.options.weight,
                                  .sieve = check_get(state, 't', 0) / 10.0};
    HADA_TRY(expect(state, own, err));
    state->tolerance = 3e-6;
    /* per iteration: four transforms that read and write, and about three passes over planes and spectra */
    const double all = (double)own->shape.options.iterations * own->depths * own->channels * (double)own->pixels;
    state->bytes = all * 64.0;
    state->flops = all * 60.0;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    classic_state *own = state->own;
    hada_classic_result result;
    HADA_TRY(hada_classic_run(own->classic, &own->job, &result, err));
    const cl_int code =
        clEnqueueCopyBuffer(state->slot->queue, hada_classic_planes(own->classic), state->out.mem, 0,
                            state->out_offset * sizeof(float), own->floats * sizeof(float), 0, NULL, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
}

static void release(check_state *state)
{
    classic_state *own = state->own;
    hada_classic_destroy(&own->classic);
}

const check_op check_classic = {"classic",
                                "m1 Wiener, m2 Richardson-Lucy (a1 accelerated), m3 FISTA, m4 ADMM; x0 no prior, x1 "
                                "TV, x2 and x3 wavelets (l levels); r rows, c columns, h and w of the window, d "
                                "depths, b channels, n iterations, p1 cropped by the sensor, s1 planes on the grid; "
                                "o and q rows and columns of point spread functions from (y, z) on, on the grid that "
                                "they allow; k1 values of the frame have weights; t tenths of a pixel of "
                                "Richardson-Lucy's Gaussians",
                                prepare, launch, release};
