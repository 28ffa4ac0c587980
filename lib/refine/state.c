#include "refine/state.h"

#include "refine/admm_steps.h"

/* Bytes of one place: its planes and one of its spectra. */
static size_t plane_bytes(const hada_refine_shape *shape)
{
    return (size_t)shape->channels * (size_t)shape->window.rows * (size_t)shape->window.cols * sizeof(float);
}

static size_t spectrum_bytes(const hada_spectrum_layout *layout, const hada_refine_shape *shape)
{
    return (size_t)shape->channels * layout->count * 2 * sizeof(float);
}

static size_t dual_bytes(const hada_refine_shape *shape)
{
    return (size_t)shape->channels * (size_t)shape->frame.rows * (size_t)shape->frame.cols * sizeof(float);
}

size_t hada_refine_state_bytes(const hada_context *context, const hada_refine_shape *shape, int depths)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    size_t bytes = (size_t)depths * (plane_bytes(shape) + 2 * spectrum_bytes(&layout, shape));
    if (shape->boundary == HADA_BOUNDARY_PADDED)
        bytes += spectrum_bytes(&layout, shape) + dual_bytes(shape);
    return bytes;
}

hada_status hada_refine_state_create(hada_refine_state *state, const hada_refiner *refiner, int depths, hada_error *err)
{
    static const char what[] = "the depth pursuit's state";
    hada_context *context = refiner->slot->context;
    const size_t places = (size_t)depths, spectrum = spectrum_bytes(&refiner->layout, &refiner->shape);
    *state = (hada_refine_state){0};
    hada_status status = hada_buffer_create(&state->planes, context, places * plane_bytes(&refiner->shape), what, err);
    if (!status)
        status = hada_buffer_create(&state->now_u, context, places * spectrum, what, err);
    if (!status)
        status = hada_buffer_create(&state->now_w, context, places * spectrum, what, err);
    if (!status && refiner->shape.boundary == HADA_BOUNDARY_PADDED)
        status = hada_buffer_create(&state->split_a, context, spectrum, what, err);
    if (!status && refiner->shape.boundary == HADA_BOUNDARY_PADDED)
        status = hada_buffer_create(&state->dual, context, dual_bytes(&refiner->shape), what, err);
    if (status)
        hada_refine_state_destroy(state);
    return status;
}

void hada_refine_state_destroy(hada_refine_state *state)
{
    hada_buffer_destroy(&state->planes);
    hada_buffer_destroy(&state->now_u);
    hada_buffer_destroy(&state->now_w);
    hada_buffer_destroy(&state->split_a);
    hada_buffer_destroy(&state->dual);
}

static hada_status copy(hada_refiner *refiner, const hada_buffer *from, size_t from_at, const hada_buffer *to,
                        size_t to_at, size_t bytes, hada_error *err)
{
    const cl_int code = clEnqueueCopyBuffer(refiner->slot->queue, from->mem, to->mem, from_at, to_at, bytes, 0, NULL,
                                            hada_slot_event(refiner->slot));
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    hada_slot_moved(refiner->slot, "copy", 2.0 * (double)bytes);
    return HADA_OK;
}

hada_status hada_refine_state_save(hada_refine_state *state, hada_refiner *refiner, int set, int depths,
                                   hada_error *err)
{
    const size_t first = (size_t)set * (size_t)depths, places = (size_t)depths, at = (size_t)set;
    const size_t plane = plane_bytes(&refiner->shape), dual = dual_bytes(&refiner->shape);
    const size_t spectrum = spectrum_bytes(&refiner->layout, &refiner->shape);
    hada_status status = copy(refiner, &refiner->planes, first * plane, &state->planes, 0, places * plane, err);
    if (!status)
        status = copy(refiner, &refiner->now_u, first * spectrum, &state->now_u, 0, places * spectrum, err);
    if (!status)
        status = copy(refiner, &refiner->now_w, first * spectrum, &state->now_w, 0, places * spectrum, err);
    if (!status && state->dual.mem)
        status = copy(refiner, &refiner->split_a, at * spectrum, &state->split_a, 0, spectrum, err);
    if (!status && state->dual.mem)
        status = copy(refiner, &refiner->dual, at * dual, &state->dual, 0, dual, err);
    return status;
}

hada_status hada_refine_state_load(const hada_refine_state *state, hada_refiner *refiner, int set, int depths,
                                   int place, int kept, hada_refine_from from, hada_error *err)
{
    const size_t to = (size_t)set * (size_t)depths + (size_t)place, at = (size_t)kept;
    const size_t plane = plane_bytes(&refiner->shape);
    const size_t spectrum = spectrum_bytes(&refiner->layout, &refiner->shape);
    hada_status status;
    if (from == HADA_REFINE_FROM_ZERO) {
        status = hada_buffer_clear(&refiner->planes, refiner->slot, to * plane, plane, err);
        return status ? status : hada_buffer_clear(&refiner->now_w, refiner->slot, to * spectrum, spectrum, err);
    }
    /* W = U + D: with W = U the duals are zero */
    const hada_buffer *w = from == HADA_REFINE_FROM_PLANES ? &state->now_u : &state->now_w;
    status = copy(refiner, &state->planes, at * plane, &refiner->planes, to * plane, plane, err);
    return status ? status : copy(refiner, w, at * spectrum, &refiner->now_w, to * spectrum, spectrum, err);
}

hada_status hada_refine_state_load_split(const hada_refine_state *state, hada_refiner *refiner, int set,
                                         hada_error *err)
{
    const size_t at = (size_t)set, dual = dual_bytes(&refiner->shape);
    const size_t spectrum = spectrum_bytes(&refiner->layout, &refiner->shape);
    if (!state->dual.mem)
        return HADA_OK;
    hada_status status = copy(refiner, &state->split_a, 0, &refiner->split_a, at * spectrum, spectrum, err);
    return status ? status : copy(refiner, &state->dual, 0, &refiner->dual, at * dual, dual, err);
}
