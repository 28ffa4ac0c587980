/* Volumes: free planes, or a texture on continuous depths, after a few steps, against the reference. */
#include "check_camera.h"
#include "ref/ref_volume.h"
#include "refine/proximal.h"
#include "surface/volume.h"

typedef struct volume_state {
    hada_volume *volume;
    hada_volume_shape shape;
    hada_volume_rule rule;
    check_camera camera;
    hada_buffer allowed, depth, texture, start;
    int is_texture, is_masked;
    size_t area, unknown;
    hada_buffer weights;
    double *mask, *depths, *weigh; /* of the reference */
} volume_state;

static void read_shape(const check_state *state, volume_state *own)
{
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), padded = check_get(state, 'p', 0);
    const int window_rows = check_get(state, 'h', rows / 2), window_cols = check_get(state, 'w', cols / 2);
    own->is_texture = check_get(state, 'x', 0);
    own->is_masked = check_get(state, 'm', 0);
    own->shape =
        (hada_volume_shape){.rows = rows,
                            .cols = cols,
                            .window = {(rows - window_rows) / 2, (cols - window_cols) / 2, window_rows, window_cols},
                            .frame = {rows / 5, cols / 5, rows - 2 * (rows / 5), cols - 2 * (cols / 5)},
                            .boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR,
                            .channels = check_get(state, 'k', 1),
                            .planes = check_get(state, 'd', 2),
                            .free = !own->is_texture,
                            .weighs = padded && check_get(state, 'v', 0)};
    own->rule = (hada_volume_rule){.steps = check_get(state, 'n', 6),
                                   .floor = 0.01,
                                   .variation = 1e-3 * check_get(state, 'y', 0),
                                   .colour = 0.1 * check_get(state, 'z', 10),
                                   .shrink = 0.1 * check_get(state, 's', 0),
                                   .shrink_tv = 0.6,
                                   .bound = own->shape.planes + 0.5};
    own->area = (size_t)window_rows * (size_t)window_cols;
    own->unknown = (size_t)(own->is_texture ? 1 : own->shape.planes) * (size_t)own->shape.channels * own->area;
}

/* Of several planes the first is left out by a mask. */
static int first_plane(const volume_state *own)
{
    return own->shape.planes > 1;
}

/* Where a run starts, which planes a pixel has, or how deep it lies. */
static hada_status make_scene(check_state *state, volume_state *own, double *start, hada_error *err)
{
    const size_t room = own->unknown + HADA_VARIATION_ROOM, channels = (size_t)own->shape.channels;
    float *first = check_room(state, room * sizeof *first), *noise = check_room(state, own->area * sizeof *noise);
    float *mask = check_room(state, room * sizeof *mask);
    own->mask = check_room(state, own->unknown * sizeof *own->mask);
    own->depths = check_room(state, own->area * sizeof *own->depths);
    check_fill_normal(state, 1000, first, own->unknown);
    check_fill_normal(state, 1001, mask, own->unknown);
    check_fill_normal(state, 1002, noise, own->area);
    for (size_t i = 0; i < own->unknown; i++) {
        mask[i] = mask[i] > -0.5f && (int)(i / (own->area * channels)) >= first_plane(own);
        own->mask[i] = mask[i];
        first[i] = first[i] > 0 ? 0.1f * first[i] * (own->is_masked ? mask[i] : 1.0f) : 0.0f;
        start[i] = first[i];
    }
    for (size_t i = 0; i < own->area; i++) {
        const float top = (float)(own->shape.planes - 1), depth = top * (0.5f + 0.3f * noise[i]);
        noise[i] = depth < 0 ? 0 : depth > top ? top : depth;
        own->depths[i] = noise[i];
    }
    HADA_TRY(check_upload(state, &own->start, first, room * sizeof *first, err));
    HADA_TRY(check_upload(state, &own->allowed, mask, own->unknown * sizeof *mask, err));
    HADA_TRY(check_upload(state, &own->depth, noise, own->area * sizeof *noise, err));
    return check_scratch(state, &own->texture, room * sizeof *first, err);
}

static hada_status expect(check_state *state, const volume_state *own, hada_error *err)
{
    const hada_volume_shape *s = &own->shape;
    const hada_ref_volume problem = {.rows = s->rows,
                                     .cols = s->cols,
                                     .window = s->window,
                                     .padded = s->boundary == HADA_BOUNDARY_PADDED,
                                     .frame = s->frame,
                                     .planes = s->planes,
                                     .channels = s->channels,
                                     .otf = own->camera.otfs,
                                     .image = own->camera.image,
                                     .weights = own->weigh,
                                     .allowed = own->is_masked ? own->mask : NULL,
                                     .depth = own->is_texture ? own->depths : NULL,
                                     .floor = own->rule.floor,
                                     .variation = own->rule.variation,
                                     .colour = own->rule.colour,
                                     .bound = own->rule.bound,
                                     .shrink = own->rule.shrink,
                                     .shrink_tv = own->rule.shrink_tv,
                                     .shrink_colour = HADA_SHRINKAGE_COLOUR,
                                     .shrink_steps = own->is_texture && own->rule.shrink > 0 ? HADA_SHRINKAGE_STEPS : 0,
                                     .tv_length = HADA_REFINE_TV_LENGTH,
                                     .tv_steps = HADA_REFINE_TV_STEPS,
                                     .steps = own->rule.steps};
    return hada_ref_volume_run(&problem, state->expected, err);
}

/* The volume, on a device that takes the transfer functions of so many planes in one piece; 0: as it is. */
static hada_status make_volume(check_state *state, volume_state *own, int planes, hada_error *err)
{
    const uint64_t largest = state->slot->context->info.max_allocation_bytes;
    const hada_volume_shape *s = &own->shape;
    const uint64_t plane =
        (uint64_t)s->channels * hada_fft_layout(state->slot->context, s->rows, s->cols, HADA_FFT_AUTO).count * 8;
    if (planes)
        state->slot->context->info.max_allocation_bytes = (uint64_t)planes * plane;
    const hada_status status = hada_volume_create(&own->volume, state->slot, s, err);
    state->slot->context->info.max_allocation_bytes = largest;
    return status;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    volume_state *own = check_own(state, sizeof *own);
    read_shape(state, own);
    const double points = (double)own->shape.rows * own->shape.cols * own->shape.planes * own->shape.channels;
    own->camera = (check_camera){.rows = own->shape.rows,
                                 .cols = own->shape.cols,
                                 .padded = own->shape.boundary == HADA_BOUNDARY_PADDED,
                                 .frame = own->shape.frame,
                                 .functions = (size_t)own->shape.planes * (size_t)own->shape.channels,
                                 .channels = (size_t)own->shape.channels};
    HADA_TRY(check_camera_make(state, &own->camera, err));
    HADA_TRY(make_volume(state, own, check_get(state, 'q', 0), err));
    for (size_t k = 0, each = own->camera.otf.bytes / 8 / (size_t)own->shape.planes; k < (size_t)own->shape.planes; k++)
        HADA_TRY(hada_volume_set_camera(own->volume, (int)k, own->camera.otf.mem, k * each, err));
    if (own->shape.weighs)
        HADA_TRY(check_camera_weights(state, &own->camera, &own->weights, &own->weigh, err));
    hada_volume_set_frame(own->volume, own->camera.spectrum.mem, 0, own->camera.seen.mem, 0, own->weights.mem);
    HADA_TRY(check_output(state, own->unknown, err));
    HADA_TRY(make_scene(state, own, state->expected, err));
    HADA_TRY(expect(state, own, err));
    /* single precision through a transform there and back in every step, on values of about one; nothing amplifies */
    state->tolerance = 1e-5;
    /* per step, plane and frequency: H read twice, U written and read, and each transform reads and writes */
    state->bytes = own->rule.steps * points / 2.0 * (32.0 + 32.0);
    state->flops = own->rule.steps * points / 2.0 * 40.0;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    volume_state *own = state->own;
    const size_t bytes = own->unknown * sizeof(float);
    const cl_mem values = own->is_texture ? own->texture.mem : hada_volume_planes(own->volume);
    const hada_volume_band band = {own->allowed.mem, first_plane(own), own->shape.planes - 1};
    HADA_TRY(hada_buffer_copy(state->slot, own->start.mem, 0, values, 0, bytes, err));
    HADA_TRY(own->is_texture ? hada_volume_texture(own->volume, &own->rule, own->depth.mem, 0, own->shape.planes - 1,
                                                   values, NULL, err)
                             : hada_volume_solve(own->volume, &own->rule, own->is_masked ? &band : NULL, NULL, err));
    return hada_buffer_copy(state->slot, values, 0, state->out.mem, state->out_offset * sizeof(float), bytes, err);
}

static void release(check_state *state)
{
    volume_state *own = state->own;
    hada_volume_destroy(&own->volume);
}

const check_op check_volume = {
    "volume",
    "r rows, c columns, h and w of the window, d planes, k channels, n steps, p1 cropped by "
    "the sensor, y total variation (thousandths), z its weight of colour (tenths), m1 within a mask, x1 a texture, "
    "s shrinkage of its blocks (tenths), q planes whose transfer functions share a buffer, v1 weights of pixels (with p1)",
    prepare, launch, release};
