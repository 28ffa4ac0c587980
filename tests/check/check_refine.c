/* Refinement: planes after a few steps, for several sets side by side, against textbook ADMM. */
#include "check_camera.h"
#include "ref/ref_refine.h"
#include "refine/proximal.h"

enum { MAX_LIST = 64 };

typedef struct refine_state {
    hada_refiner *refiner;
    hada_refine_shape shape;
    hada_refine_data data;
    hada_refine_rule rule, last;
    check_camera camera;
    hada_buffer weights;
    int sets, depths, channels, list[MAX_LIST];
    size_t set_floats;
    double *weigh; /* weights of the pixels of the grid; NULL: none */
} refine_state;

static void read_shape(const check_state *state, refine_state *own)
{
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), padded = check_get(state, 'p', 0);
    const int window_rows = check_get(state, 'h', rows / 2), window_cols = check_get(state, 'w', cols / 2);
    own->sets = check_get(state, 's', 1);
    own->depths = check_get(state, 'd', 2);
    own->channels = check_get(state, 'k', 1);
    own->shape =
        (hada_refine_shape){.grid_rows = rows,
                            .grid_cols = cols,
                            .window = {(rows - window_rows) / 2, (cols - window_cols) / 2, window_rows, window_cols},
                            .frame = {rows / 5, cols / 5, rows - 2 * (rows / 5), cols - 2 * (cols / 5)},
                            .boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR,
                            .channels = own->channels,
                            .max_sets = own->sets,
                            .max_planes = own->sets * own->depths,
                            .max_steps = 40,
                            .tv = check_get(state, 'y', 0) > 0,
                            .ridge = check_get(state, 'x', 0) > 0};
    hada_refine_rule_init(&own->rule);
    own->rule.rho = 1e-2;
    own->rule.tv = 1e-3 * check_get(state, 'y', 0);
    own->rule.tv_colour = 0.1 * check_get(state, 'z', 10);
    if (check_get(state, 'q', 0)) {
        own->rule.first_rho = 1e-3;
        own->rule.growth = 1.5;
        own->rule.first_relaxation = 1.95;
        own->rule.first_steps = 3;
    }
    own->rule.steps = check_get(state, 'n', 6);
    own->last = own->rule;
    const hada_model_info info = {.channels = own->channels};
    const hada_refine_weights weights = {.tv = fmax(own->rule.tv, 1e-3), .ridge = 1.0};
    hada_refine_rule_ridge(&own->last, check_get(state, 'x', 0), &info, &weights, own->depths, 1.0);
    for (int i = 0; i < own->sets * own->depths; i++)
        own->list[i] = (i % own->depths + i / own->depths) % (own->depths + 1);
    own->set_floats = (size_t)own->depths * (size_t)own->channels * (size_t)window_rows * (size_t)window_cols;
}

static hada_status expect(check_state *state, const refine_state *own, hada_error *err)
{
    const hada_refine_shape *s = &own->shape;
    const size_t values = (size_t)s->grid_rows * (size_t)(s->grid_cols / 2 + 1) * 2 * (size_t)own->channels;
    double *otf = check_room(state, (size_t)own->depths * values * sizeof *otf);
    for (int set = 0; set < own->sets; set++) {
        for (int place = 0; place < own->depths; place++)
            memcpy(otf + (size_t)place * values,
                   own->camera.otfs + (size_t)own->list[set * own->depths + place] * values, values * sizeof *otf);
        const hada_ref_refine problem = {.rows = s->grid_rows,
                                         .cols = s->grid_cols,
                                         .window = s->window,
                                         .padded = s->boundary == HADA_BOUNDARY_PADDED,
                                         .frame = s->frame,
                                         .depths = own->depths,
                                         .channels = own->channels,
                                         .tv = own->rule.tv,
                                         .tv_colour = own->rule.tv_colour,
                                         .tv_length = HADA_REFINE_TV_LENGTH,
                                         .tv_steps = HADA_REFINE_TV_STEPS,
                                         .ridge_steps = own->last.steps,
                                         .ridge_rho = own->last.rho,
                                         .ridge_noise = own->last.noise,
                                         .otf = otf,
                                         .image = own->camera.image,
                                         .weights = own->weigh,
                                         .rho = own->rule.rho,
                                         .first_rho = own->rule.first_rho,
                                         .growth = own->rule.growth,
                                         .relaxation = own->rule.relaxation,
                                         .first_relaxation = own->rule.first_relaxation,
                                         .first_steps = own->rule.first_steps,
                                         .mu = own->rule.mu,
                                         .steps = own->rule.steps};
        HADA_TRY(hada_ref_refine_run(&problem, state->expected + (size_t)set * own->set_floats, NULL, NULL, err));
    }
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    refine_state *own = check_own(state, sizeof *own);
    read_shape(state, own);
    if (own->sets * own->depths > MAX_LIST)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d planes", MAX_LIST);
    own->camera = (check_camera){.rows = own->shape.grid_rows,
                                 .cols = own->shape.grid_cols,
                                 .padded = own->shape.boundary == HADA_BOUNDARY_PADDED,
                                 .frame = own->shape.frame,
                                 .functions = ((size_t)own->depths + 1) * (size_t)own->channels,
                                 .channels = (size_t)own->channels};
    HADA_TRY(check_camera_make(state, &own->camera, err));
    if (check_get(state, 'v', 0))
        HADA_TRY(check_camera_weights(state, &own->camera, &own->weights, &own->weigh, err));
    own->data = (hada_refine_data){.spectrum = own->camera.spectrum.mem,
                                   .frame = own->camera.seen.mem,
                                   .weights = own->weights.mem,
                                   .otf = own->camera.otf.mem,
                                   .otf_depths = own->depths + 1};
    HADA_TRY(hada_refiner_create(&own->refiner, state->slot, &own->shape, err));
    HADA_TRY(check_output(state, (size_t)own->sets * own->set_floats, err));
    HADA_TRY(expect(state, own, err));
    const double points = (double)own->shape.grid_rows * own->shape.grid_cols;
    state->tolerance = 1e-5;
    /* per step and plane, in bytes per frequency: H, U and W read, W written, and each transform reads and writes */
    state->bytes = own->rule.steps * own->sets * own->depths * points / 2.0 * (32.0 + 32.0);
    state->flops = own->rule.steps * own->sets * own->depths * points / 2.0 * 60.0;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    refine_state *own = state->own;
    const size_t bytes = own->set_floats * sizeof(float);
    for (int set = 0, n; set < own->sets; set += n) {
        n = own->sets - set;
        if (state->batch_limit && state->batch_limit < n)
            n = state->batch_limit;
        HADA_TRY(hada_refiner_run(own->refiner, &own->data, &own->rule, n, own->depths, own->list + set * own->depths,
                                  NULL, err));
        if (own->last.steps)
            HADA_TRY(hada_refiner_run(own->refiner, &own->data, &own->last, n, own->depths,
                                      own->list + set * own->depths, NULL, err));
        const cl_int code = clEnqueueCopyBuffer(state->slot->queue, hada_refiner_planes(own->refiner), state->out.mem,
                                                0, state->out_offset * sizeof(float) + (size_t)set * bytes,
                                                (size_t)n * bytes, 0, NULL, NULL);
        if (code != CL_SUCCESS)
            HADA_TRY(hada_fail_cl(err, code, "clEnqueueCopyBuffer"));
    }
    return HADA_OK;
}

static void release(check_state *state)
{
    refine_state *own = state->own;
    hada_refiner_destroy(&own->refiner);
}

const check_op check_refine = {
    "refine",
    "r rows, c columns, h and w of the window, d depths in a set, s sets, n steps, p1 "
    "cropped by the sensor, q1 growing rho and falling relaxation, k channels, v1 weights of pixels (with p1), y total variation (thousandths), z its weight of "
    "colour (tenths), x steps with the learned regulariser after them",
    prepare, launch, release};
