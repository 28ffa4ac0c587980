#include "surface/volume_steps.h"

#include <math.h>

int hada_volume_is_padded(const hada_volume_shape *shape)
{
    return shape->boundary == HADA_BOUNDARY_PADDED;
}

/* Work-groups for `count` values of each of rows x planes. */
static hada_range slices(const hada_volume *v, size_t count, size_t rows, size_t planes)
{
    return hada_range_groups(hada_divide_up(count, HADA_VOLUME_SLICE), v->group, rows, planes);
}

static hada_volume_batch batch_at(const hada_volume *v, int first, int planes, int add)
{
    return (hada_volume_batch){.spectrum = hada_spectrum_shape_of(&v->layout),
                               .channels = (unsigned)v->shape.channels,
                               .first = (unsigned)first,
                               .planes = (unsigned)planes,
                               .add = add};
}

/* Planes first ... last, in batches whose transfer functions stand in one buffer: how many the next one has. */
static int batch_from(const hada_volume *v, int first, int last, int most)
{
    const int left = last - first + 1, there = v->piece - first % v->piece;
    const int batch = left < most ? left : most;
    return batch < there ? batch : there;
}

/* The buffer with the transfer functions of a plane. */
static cl_mem otf_of(const hada_volume *v, int plane)
{
    return v->otf[plane / v->piece].mem;
}

static hada_status set_camera(hada_volume *v, int first, int count, cl_mem otf, size_t from, hada_error *err)
{
    const size_t each = (size_t)v->shape.channels * v->layout.count, values = (size_t)count * each;
    const size_t offset = (size_t)(first % v->piece) * each;
    const hada_range range = slices(v, values, 1, 1);
    HADA_TRY(hada_buffer_copy(v->slot, otf, from * 2 * sizeof(float), otf_of(v, first), offset * 2 * sizeof(float),
                              values * 2 * sizeof(float), err));
    hada_slot_cost(v->slot, 8.0 * (double)values, (double)values);
    return hada_launch_volume_conjugate(v->slot, v->program, &range, err, .otf = otf_of(v, first),
                                        .offset = (cl_ulong)offset, .count = (cl_ulong)values);
}

hada_status hada_volume_set_camera(hada_volume *v, int first, int count, cl_mem otf, hada_error *err)
{
    const size_t each = (size_t)v->shape.channels * v->layout.count;
    v->floor = 0;
    for (int done = 0, here; done < count; done += here) {
        here = batch_from(v, first + done, first + count - 1, count);
        HADA_TRY(set_camera(v, first + done, here, otf, (size_t)done * each, err));
    }
    return HADA_OK;
}

hada_status hada_volume_weigh(hada_volume *v, double floor, hada_error *err)
{
    const hada_range range = slices(v, v->layout.count, (size_t)v->shape.channels, 1);
    const double values = (double)v->layout.count * v->shape.channels;
    if (floor == v->floor)
        return HADA_OK;
    v->floor = floor;
    for (int first = 0, here; first < v->shape.planes; first += here) {
        here = batch_from(v, first, v->shape.planes - 1, v->piece);
        const int last = first + here == v->shape.planes;
        hada_slot_cost(v->slot, (8.0 * here + 4.0) * values, 4.0 * here * values);
        /* sums of energies, which are not in use, have room for those of |H(0)|^2 */
        HADA_TRY(hada_launch_volume_weights(v->slot, v->program, &range, err, .otf = otf_of(v, first), .offset = 0,
                                            .weight = v->weight.mem, .still = v->partial.mem,
                                            .batch = batch_at(v, 0, here, first > 0),
                                            .all = last ? (cl_uint)v->shape.planes : 0, .floor = (float)floor));
    }
    return HADA_OK;
}

static hada_volume_splat splat_of(const hada_volume *v, int first, int planes, int add)
{
    return (hada_volume_splat){.area = (unsigned)v->window_area,
                               .channels = (unsigned)v->shape.channels,
                               .first = (unsigned)first,
                               .planes = (unsigned)planes,
                               .add = add};
}

hada_status hada_volume_spread(hada_volume *v, cl_mem depth, cl_mem texture, int planes, cl_mem out, hada_error *err)
{
    const size_t channels = (size_t)v->shape.channels;
    const hada_range range = slices(v, v->window_area, channels, (size_t)planes);
    const hada_volume_splat splat = splat_of(v, 0, planes, 0);
    const double pixels = (double)(v->window_area * channels) * planes;
    hada_slot_cost(v->slot, 4.0 * pixels, 4.0 * pixels);
    return hada_launch_volume_splat(v->slot, v->program, &range, err, .depth = depth, .texture = texture, .planes = out,
                                    .splat = splat);
}

/* The spectrum that a batch of planes makes, added to that of those before. */
static hada_status explain(hada_volume *v, const hada_volume_unknown *u, int first, int planes, int add,
                           hada_error *err)
{
    const size_t channels = (size_t)v->shape.channels;
    const hada_range spread = slices(v, v->window_area, channels, (size_t)planes);
    const hada_range range = slices(v, v->layout.count, channels, 1);
    const hada_volume_splat splat = splat_of(v, first, planes, 0);
    const double pixels = (double)(v->window_area * channels) * planes;
    const double values = (double)(v->layout.count * channels) * planes;
    if (u->texture) {
        hada_slot_cost(v->slot, 4.0 * pixels, 4.0 * pixels);
        HADA_TRY(hada_launch_volume_splat(v->slot, v->program, &spread, err, .depth = u->depth, .texture = v->at.mem,
                                          .planes = v->planes.mem, .splat = splat));
    }
    HADA_TRY(hada_fft_forward(v->forward, planes * v->shape.channels, u->texture ? v->planes.mem : v->at.mem,
                              u->texture ? 0 : (size_t)first * channels * v->window_area, v->spectra.mem, 0, err));
    hada_slot_cost(v->slot, 16.0 * values, 8.0 * values);
    return hada_launch_volume_explain(v->slot, v->program, &range, err, .otf = otf_of(v, first), .offset = 0,
                                      .u = v->spectra.mem, .sum = v->sum.mem,
                                      .batch = batch_at(v, first % v->piece, planes, add));
}

static hada_status weigh_sum(hada_volume *v, hada_error *err)
{
    const hada_range range = slices(v, v->layout.count, (size_t)v->shape.channels, 1);
    const double values = (double)v->layout.count * v->shape.channels;
    hada_slot_cost(v->slot, 20.0 * values, 2.0 * values);
    return hada_launch_volume_weigh(v->slot, v->program, &range, err, .sum = v->sum.mem, .weight = v->weight.mem,
                                    .count = (cl_uint)v->layout.count);
}

int hada_volume_looks(const hada_context *context)
{
    return context->info.unified_memory ? 1 : HADA_VOLUME_LOOKS;
}

/* Sums that an energy takes. */
static size_t sums_of(const hada_volume *v)
{
    const size_t values = hada_volume_is_padded(&v->shape) ? v->frame_area : v->layout.count;
    return hada_divide_up(values, HADA_VOLUME_SLICE) * (size_t)v->shape.channels;
}

/* Padded: what the spectrum of the model leaves of the frame, within it, with sums of its squares. */
static hada_status residual_padded(hada_volume *v, int look, hada_error *err)
{
    const int channels = v->shape.channels;
    const hada_range range = slices(v, v->frame_area, (size_t)channels, 1);
    const hada_refine_frame_step now = {.frame_offset = (cl_ulong)v->pixels_offset,
                                        .channels = (cl_uint)channels,
                                        .pixels = (cl_uint)v->frame_area,
                                        .use_frame = 1,
                                        .has_weights = v->weights != NULL,
                                        .scale = 1.0f,
                                        .sums = {HADA_VOLUME_SLICE, (unsigned)((size_t)look * sums_of(v))}};
    HADA_TRY(hada_fft_inverse(v->frame_inverse, channels, v->sum.mem, 0, v->frame.mem, 0, NULL, err));
    hada_slot_cost(v->slot, 12.0 * channels * (double)v->frame_area, 4.0 * channels * (double)v->frame_area);
    return hada_launch_refine_frame(v->slot, v->refine, &range, err, .a = v->frame.mem, .frame = v->frame_pixels,
                                    .weights = v->weights, .partial = v->partial.mem, .now = now);
}

/* The same where the sensor sees everything: its spectrum, weighted where that is wanted. */
static hada_status residual_circular(hada_volume *v, int weighted, int look, hada_error *err)
{
    const hada_range range = slices(v, v->layout.count, (size_t)v->shape.channels, 1);
    const double values = (double)v->layout.count * v->shape.channels;
    const hada_spectrum_shape shape = hada_spectrum_shape_of(&v->layout);
    hada_slot_cost(v->slot, (weighted ? 28.0 : 24.0) * values, (weighted ? 8.0 : 6.0) * values);
    return hada_launch_volume_residual(v->slot, v->program, &range, err, .sum = v->sum.mem, .frame = v->frame_spectrum,
                                       .frame_offset = (cl_ulong)v->spectrum_offset,
                                       .weight = weighted ? v->weight.mem : v->sum.mem, .has_weight = weighted,
                                       .spectrum = shape, .partial = v->partial.mem,
                                       .first = (cl_uint)((size_t)look * sums_of(v)));
}

/* The weights of pixels on what stands in v->frame: of a residual, or once more, by the same ones. */
static hada_status mask(hada_volume *v, int given, hada_error *err)
{
    const size_t values = v->frame_area * (size_t)v->shape.channels;
    const hada_range range = slices(v, values, 1, 1);
    if (!v->weights)
        return HADA_OK;
    hada_slot_cost(v->slot, 16.0 * (double)values, 2.0 * (double)values);
    return hada_launch_volume_mask(v->slot, v->program, &range, err, .frame = v->frame.mem,
                                   .weights = given ? v->weights : v->mask.mem, .mask = v->mask.mem, .given = given,
                                   .values = (cl_uint)values);
}

/* What the spectrum of the model leaves of the frame, its energy, and its weighted spectrum; where the sensor crops,
 * all of that within it. */
static hada_status leave_residual(hada_volume *v, int look, hada_error *err)
{
    const int channels = v->shape.channels;
    if (!hada_volume_is_padded(&v->shape))
        return residual_circular(v, 1, look, err);
    HADA_TRY(residual_padded(v, look, err));
    HADA_TRY(mask(v, 1, err));
    HADA_TRY(hada_fft_forward(v->frame_forward, channels, v->frame.mem, 0, v->sum.mem, 0, err));
    HADA_TRY(weigh_sum(v, err));
    HADA_TRY(hada_fft_inverse(v->frame_inverse, channels, v->sum.mem, 0, v->frame.mem, 0, NULL, err));
    HADA_TRY(mask(v, 0, err));
    return hada_fft_forward(v->frame_forward, channels, v->frame.mem, 0, v->sum.mem, 0, err);
}

/* The gradient from the weighted residual's spectrum, for a batch of planes. */
static hada_status correlate(hada_volume *v, const hada_volume_unknown *u, int first, int planes, int add,
                             hada_error *err)
{
    const int channels = v->shape.channels;
    const hada_fft_filter filter = {.product = HADA_FFT_COMPLEX,
                                    .filter = otf_of(v, first),
                                    .spectrum_count = channels,
                                    .filter_first = first % v->piece * channels,
                                    .stride = 1};
    const hada_range range = slices(v, v->window_area, (size_t)channels, 1);
    const hada_volume_splat splat = splat_of(v, first, planes, add);
    const double pixels = (double)v->window_area * channels;
    HADA_TRY(hada_fft_inverse(v->inverse, planes * channels, v->sum.mem, 0,
                              u->texture ? v->planes.mem : v->gradient.mem,
                              u->texture ? 0 : (size_t)(first * channels) * v->window_area, &filter, err));
    if (u->texture) {
        hada_slot_cost(v->slot, (4.0 * planes + 8.0) * pixels, 6.0 * planes * pixels);
        HADA_TRY(hada_launch_volume_gather(v->slot, v->program, &range, err, .depth = u->depth, .planes = v->planes.mem,
                                           .texture = v->gradient.mem, .splat = splat));
    }
    return HADA_OK;
}

hada_status hada_volume_differentiate(hada_volume *v, const hada_volume_unknown *u, int look, hada_error *err)
{
    for (int first = u->first, here; first <= u->last; first += here) {
        here = batch_from(v, first, u->last, v->batch);
        HADA_TRY(explain(v, u, first, here, first > u->first, err));
    }
    HADA_TRY(leave_residual(v, look, err));
    for (int first = u->first, here; first <= u->last; first += here) {
        here = batch_from(v, first, u->last, v->batch);
        HADA_TRY(correlate(v, u, first, here, first > u->first, err));
    }
    return HADA_OK;
}

/* The proximal step of total variation on the point that a gradient step found, with shrinkage at the end of a
 * texture's run. */
static hada_status smooth(hada_volume *v, const hada_volume_unknown *u, const hada_volume_rule *rule, double theta,
                          int step, hada_error *err)
{
    const cl_mem duals[2] = {v->duals[0].mem, v->duals[1].mem};
    const hada_shrinkage_weights weights = {theta, fmax(rule->colour, 1.0), rule->shrink_tv, rule->shrink};
    if (u->texture && rule->shrink > 0 && step >= rule->steps - HADA_SHRINKAGE_STEPS)
        return hada_shrinkage_after_variation(&v->shrinkage, &v->variation, v->slot, v->gradient.mem, duals, &weights,
                                              !step, err);
    return hada_variation_step(&v->variation, v->slot, v->gradient.mem, duals, u->texture ? 1 : v->shape.planes, theta,
                               weights.colour, !step, err);
}

hada_status hada_volume_step(hada_volume *v, const hada_volume_unknown *u, const hada_volume_rule *rule, double bound,
                             double momentum, int step, hada_error *err)
{
    const cl_mem allowed = u->allowed ? u->allowed : v->at.mem;
    const hada_range range = slices(v, u->count, 1, 1);
    const double values = (double)u->count, theta = rule->variation > 0 ? rule->variation / bound : 0;
    hada_slot_cost(v->slot, (u->allowed ? 16.0 : 12.0) * values, 3.0 * values);
    HADA_TRY(hada_launch_volume_descend(v->slot, v->program, &range, err, .g = v->gradient.mem, .y = v->at.mem,
                                        .allowed = allowed, .has_allowed = u->allowed != NULL,
                                        .values = (cl_uint)u->count, .length = (float)(1.0 / bound)));
    if (theta > 0)
        HADA_TRY(smooth(v, u, rule, theta, step, err));
    hada_slot_cost(v->slot, (u->allowed ? 20.0 : 16.0) * values, 4.0 * values);
    return hada_launch_volume_advance(v->slot, v->program, &range, err, .point = v->gradient.mem, .u = u->values,
                                      .y = v->at.mem, .allowed = allowed, .has_allowed = u->allowed != NULL,
                                      .values = (cl_uint)u->count, .momentum = (float)momentum);
}

hada_status hada_volume_frame_energy(hada_volume *v, hada_error *err)
{
    HADA_TRY(hada_buffer_clear(&v->sum, v->slot, 0, v->sum.bytes, err));
    return hada_volume_is_padded(&v->shape) ? residual_padded(v, 0, err) : residual_circular(v, 0, 0, err);
}

hada_status hada_volume_fetch_energies(hada_volume *v, int count, double *energy, hada_error *err)
{
    const size_t each = sums_of(v);
    HADA_TRY(hada_buffer_read(&v->partial, v->slot, 0, v->host_partial, (size_t)count * each * sizeof(float), err));
    for (size_t k = 0; k < (size_t)count; k++) {
        double sum = 0;
        for (size_t i = k * each; i < (k + 1) * each; i++)
            sum += v->host_partial[i];
        energy[k] = hada_volume_is_padded(&v->shape) ? sum : sum / ((double)v->layout.rows * v->layout.cols);
    }
    return HADA_OK;
}
