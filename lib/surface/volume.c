/* A volume: its memory, the parts of a step, each one call, and runs. */
#include "surface/volume.h"

#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "launch/refine.h"
#include "launch/surface_volume.h"
#include "refine/proximal.h"

static const char what[] = "a surface";

/* Buffers that transfer functions are spread over, at most, where the device has not so much memory in one piece. */
enum { PIECES = 16 };

struct hada_volume {
    hada_slot *slot;
    hada_volume_shape shape;
    hada_spectrum_layout layout;
    hada_program_surface_volume program;
    hada_program_refine refine;
    size_t group;
    hada_variation variation;
    hada_shrinkage shrinkage;
    int batch; /* planes at once */
    int piece; /* planes whose transfer functions are in one buffer */
    size_t window_area, frame_area;
    hada_fft_pair fft, frame_fft;            /* of the window's planes; padded: of the frame */
    hada_buffer otf[PIECES];                 /* conjugate, `piece` planes in each but the last */
    hada_buffer weight, spectra, sum, frame; /* weights; spectra of a batch; of what the planes make; in the frame */
    hada_buffer mask;                        /* weights of the frame's pixels, as they are of a residual */
    hada_buffer planes;                      /* free planes; textures: those of a batch */
    hada_buffer at, gradient, start;         /* the extrapolated point, the gradient there, where a run began */
    hada_buffer duals[2], partial;
    float *host_partial; /* of a look or more: see looks_of() */
    double floor;        /* that the weights were made with; 0: not yet */
    cl_mem frame_spectrum, frame_pixels, weights;
    size_t spectrum_offset, pixels_offset;
};

/* 1 where the sensor crops. */
static int is_padded(const hada_volume_shape *shape)
{
    return shape->boundary == HADA_BOUNDARY_PADDED;
}

/* Energies, that of the frame beside, which are read together. A device that shares the host's memory is waited for at
 * little cost; another idles meanwhile, and a run that has gone astray, which is seen later then, is rare. */
enum { LOOKS = 8 };
static int looks_of(const hada_context *context)
{
    return context->info.unified_memory ? 1 : LOOKS;
}

enum { BATCH = 48 }; /* images that one transform call takes */

/* On GPUs, which small images leave idle: as many as this many bytes of spectra hold. */
#define GROUPS_BYTES ((size_t)64 << 20)

/* How many of `bytes` a buffer of the device holds; one at least, which the buffer's making refuses where it must. */
static int in_one_buffer(const hada_context *context, size_t bytes)
{
    const uint64_t most = context->info.max_allocation_bytes / bytes;
    return most < 1 ? 1 : most > INT_MAX ? INT_MAX : (int)most;
}

static int batch_of(const hada_context *context, const hada_volume_shape *shape)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->rows, shape->cols, HADA_FFT_AUTO);
    const size_t plane = (size_t)shape->channels * layout.count * 2 * sizeof(float);
    const int few = BATCH / shape->channels > 1 ? BATCH / shape->channels : 1, held = (int)(GROUPS_BYTES / plane);
    const int most = context->shape == HADA_SHAPE_GROUPS && held > few ? held : few;
    const int batch = shape->planes < most ? shape->planes : most, possible = in_one_buffer(context, plane);
    return possible < batch ? possible : batch;
}

/* Planes whose transfer functions share a buffer: evenly spread over the fewest. */
static int piece_of(const hada_context *context, const hada_volume_shape *shape)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->rows, shape->cols, HADA_FFT_AUTO);
    const int most = in_one_buffer(context, (size_t)shape->channels * layout.count * 2 * sizeof(float));
    int pieces = (shape->planes + most - 1) / most;
    pieces = pieces > PIECES ? PIECES : pieces;
    return (shape->planes + pieces - 1) / pieces;
}

enum { ROWS = PIECES + 12 };

static hada_status make_transforms(hada_volume *v, hada_error *err)
{
    const hada_volume_shape *shape = &v->shape;
    const hada_fft_desc planes =
        hada_fft_of(HADA_FFT_FORWARD, shape->rows, shape->cols, v->batch * shape->channels, shape->window);
    const hada_fft_desc frame = hada_fft_of(HADA_FFT_FORWARD, shape->rows, shape->cols, shape->channels, shape->frame);
    HADA_TRY(hada_fft_pair_create(&v->fft, v->slot, planes, err));
    return is_padded(shape) ? hada_fft_pair_create(&v->frame_fft, v->slot, frame, err) : HADA_OK;
}

/* Sums of the energies that are read together, and of the frame's. */
static size_t sums_of(const hada_context *context, const hada_volume_shape *shape, const hada_spectrum_layout *layout)
{
    const size_t frame = is_padded(shape) ? hada_rect_area(&shape->frame) : 0;
    const size_t slices = hada_divide_up(frame > layout->count ? frame : layout->count, HADA_VOLUME_SLICE);
    return (1 + (size_t)looks_of(context)) * slices * (size_t)shape->channels;
}

static void list_buffers(const hada_context *context, const hada_volume_shape *shape, hada_buffer_row *rows)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->rows, shape->cols, HADA_FFT_AUTO);
    const size_t window = hada_rect_area(&shape->window), channels = (size_t)shape->channels,
                 planes = (size_t)shape->planes;
    const size_t unknown = shape->free ? planes : 1, spectrum = channels * layout.count * 2 * sizeof(float);
    const size_t values = (unknown * channels * window + HADA_VARIATION_ROOM) * sizeof(float);
    const size_t batch = ((size_t)batch_of(context, shape) * channels * window + HADA_VARIATION_ROOM) * sizeof(float);
    const size_t duals = sizeof(float) * hada_variation_floats(context, shape->channels, shape->window.rows,
                                                               shape->window.cols, (int)unknown);
    const size_t piece = (size_t)piece_of(context, shape);
    const hada_buffer_row list[ROWS - PIECES] = {
        {offsetof(hada_volume, weight), spectrum / 2, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, spectra), (size_t)batch_of(context, shape) * spectrum, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, sum), spectrum, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, frame), is_padded(shape) ? channels * hada_rect_area(&shape->frame) * sizeof(float) : 0,
         what, HADA_OWN_STEPS},
        {offsetof(hada_volume, mask),
         is_padded(shape) && shape->weighs ? channels * hada_rect_area(&shape->frame) * sizeof(float) : 0, what,
         HADA_OWN_STEPS},
        {offsetof(hada_volume, planes), shape->free ? values : batch, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, at), values, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, gradient), values, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, start), values, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, duals[0]), duals, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, duals[1]), duals, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, partial), sums_of(context, shape, &layout) * sizeof(float), what, HADA_OWN_STEPS}};
    for (size_t i = 0, left = planes, here; i < PIECES; i++, left -= here) {
        here = left < piece ? left : piece;
        rows[i] = (hada_buffer_row){offsetof(hada_volume, otf) + i * sizeof(hada_buffer), here * spectrum, what,
                                    HADA_OWN_STEPS};
    }
    memcpy(rows + PIECES, list, sizeof list);
}

static hada_status prepare(hada_volume *v, hada_error *err)
{
    const hada_volume_shape *s = &v->shape;
    const int vectors = v->layout.block % 8 == 0;
    v->program = HADA_PROGRAM_VARIANT(SURFACE_VOLUME, v->slot->context, vectors);
    v->refine = HADA_PROGRAM_VARIANT(REFINE, v->slot->context, vectors);
    v->group = (size_t)hada_macros_of_surface_volume(v->program)->refine_group;
    HADA_TRY(hada_prepare_surface_volume(v->slot, v->program, err));
    HADA_TRY(hada_prepare_refine(v->slot, v->refine, err));
    HADA_TRY(hada_variation_prepare(&v->variation, v->slot, s->channels, s->window.rows, s->window.cols, err));
    if (!s->free)
        HADA_TRY(hada_shrinkage_prepare(&v->shrinkage, v->slot, s->channels, s->window.rows, s->window.cols, err));
    return HADA_OK;
}

hada_status hada_volume_create(hada_volume **out, hada_slot *slot, const hada_volume_shape *shape, hada_error *err)
{
    hada_volume *v = NULL;
    hada_buffer_row rows[ROWS];
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(v, 1, what, err));
    v->slot = slot;
    v->shape = *shape;
    v->layout = hada_fft_layout(slot->context, shape->rows, shape->cols, HADA_FFT_AUTO);
    v->batch = batch_of(slot->context, shape);
    v->piece = piece_of(slot->context, shape);
    v->window_area = hada_rect_area(&shape->window);
    v->frame_area = hada_rect_area(&shape->frame);
    HADA_TRY_OR_DONE(make_transforms(v, err));
    list_buffers(slot->context, shape, rows);
    HADA_TRY_OR_DONE(hada_buffer_rows_take(v, slot, rows, ROWS, err));
    for (int i = 0; i < ROWS; i++) /* what lies behind the last value is read and multiplied by 0 */
        if (rows[i].bytes)
            HADA_TRY_OR_DONE(hada_buffer_clear(hada_buffer_of(v, &rows[i]), slot, 0, rows[i].bytes, err));
    HADA_TRY_OR_DONE(HADA_NEW(v->host_partial, sums_of(slot->context, shape, &v->layout), what, err));
    HADA_TRY_OR_DONE(prepare(v, err));
    *out = v;
done:
    if (status)
        hada_volume_destroy(&v);
    return status;
}

void hada_volume_destroy(hada_volume **pointer)
{
    hada_volume *v = hada_taken(pointer);
    hada_buffer_row rows[ROWS];
    if (!v)
        return;
    hada_slot_finish(v->slot, NULL);
    hada_fft_pair_destroy(&v->fft);
    hada_fft_pair_destroy(&v->frame_fft);
    list_buffers(v->slot->context, &v->shape, rows);
    hada_buffer_rows_destroy(v, rows, ROWS);
    HADA_FREE(v->host_partial, v);
}

cl_mem hada_volume_planes(const hada_volume *volume)
{
    return volume->planes.mem;
}

void hada_volume_set_frame(hada_volume *v, cl_mem spectrum, size_t spectrum_offset, cl_mem pixels, size_t pixels_offset,
                           cl_mem weights)
{
    v->weights = v->mask.mem ? weights : NULL;
    v->frame_spectrum = spectrum;
    v->spectrum_offset = spectrum_offset;
    v->frame_pixels = pixels;
    v->pixels_offset = pixels_offset;
}

/* The unknown of a run: free planes, or a texture that makes some of them. */
typedef struct unknown {
    int texture;
    int first, last; /* planes that take part */
    cl_mem depth;    /* of a texture */
    cl_mem values;   /* the planes, or the texture: u */
    cl_mem allowed;  /* or NULL */
    size_t count;    /* of values */
} unknown;

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

hada_status hada_volume_set_camera(hada_volume *v, int plane, cl_mem otf, size_t from, hada_error *err)
{
    const size_t values = (size_t)v->shape.channels * v->layout.count, offset = (size_t)(plane % v->piece) * values;
    const hada_range range = slices(v, values, 1, 1);
    v->floor = 0;
    HADA_TRY(hada_buffer_copy(v->slot, otf, from * 2 * sizeof(float), otf_of(v, plane), offset * 2 * sizeof(float),
                              values * 2 * sizeof(float), err));
    hada_slot_cost(v->slot, 8.0 * (double)values, (double)values);
    return hada_launch_volume_conjugate(v->slot, v->program, &range, err, .otf = otf_of(v, plane),
                                        .offset = (cl_ulong)offset, .count = (cl_ulong)values);
}

/* The weights of the residual, over all planes of the camera. */
static hada_status weigh(hada_volume *v, double floor, hada_error *err)
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
static hada_status explain(hada_volume *v, const unknown *u, int first, int planes, int add, hada_error *err)
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
    HADA_TRY(hada_fft_forward(v->fft.forward, planes * v->shape.channels, u->texture ? v->planes.mem : v->at.mem,
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

/* Sums that an energy takes. */
static size_t energy_sums(const hada_volume *v)
{
    const size_t values = is_padded(&v->shape) ? v->frame_area : v->layout.count;
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
                                        .sums = {HADA_VOLUME_SLICE, (unsigned)((size_t)look * energy_sums(v))}};
    HADA_TRY(hada_fft_inverse(v->frame_fft.inverse, channels, v->sum.mem, 0, v->frame.mem, 0, NULL, err));
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
                                       .first = (cl_uint)((size_t)look * energy_sums(v)));
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
    if (!is_padded(&v->shape))
        return residual_circular(v, 1, look, err);
    HADA_TRY(residual_padded(v, look, err));
    HADA_TRY(mask(v, 1, err));
    HADA_TRY(hada_fft_forward(v->frame_fft.forward, channels, v->frame.mem, 0, v->sum.mem, 0, err));
    HADA_TRY(weigh_sum(v, err));
    HADA_TRY(hada_fft_inverse(v->frame_fft.inverse, channels, v->sum.mem, 0, v->frame.mem, 0, NULL, err));
    HADA_TRY(mask(v, 0, err));
    return hada_fft_forward(v->frame_fft.forward, channels, v->frame.mem, 0, v->sum.mem, 0, err);
}

/* The gradient from the weighted residual's spectrum, for a batch of planes. */
static hada_status correlate(hada_volume *v, const unknown *u, int first, int planes, int add, hada_error *err)
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
    HADA_TRY(hada_fft_inverse(v->fft.inverse, planes * channels, v->sum.mem, 0,
                              u->texture ? v->planes.mem : v->gradient.mem,
                              u->texture ? 0 : (size_t)(first * channels) * v->window_area, &filter, err));
    if (u->texture) {
        hada_slot_cost(v->slot, (4.0 * planes + 8.0) * pixels, 6.0 * planes * pixels);
        HADA_TRY(hada_launch_volume_gather(v->slot, v->program, &range, err, .depth = u->depth, .planes = v->planes.mem,
                                           .texture = v->gradient.mem, .splat = splat));
    }
    return HADA_OK;
}

/* The gradient at the extrapolated point; the residual's energy at place `look`, 1 to looks_of(). */
static hada_status differentiate(hada_volume *v, const unknown *u, int look, hada_error *err)
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
static hada_status smooth(hada_volume *v, const unknown *u, const hada_volume_rule *rule, double theta, int step,
                          hada_error *err)
{
    const cl_mem duals[2] = {v->duals[0].mem, v->duals[1].mem};
    const hada_shrinkage_weights weights = {theta, fmax(rule->colour, 1.0), rule->shrink_tv, rule->shrink};
    if (u->texture && rule->shrink > 0 && step >= rule->steps - HADA_SHRINKAGE_STEPS)
        return hada_shrinkage_after_variation(&v->shrinkage, &v->variation, v->slot, v->gradient.mem, duals, &weights,
                                              !step, err);
    return hada_variation_step(&v->variation, v->slot, v->gradient.mem, duals, u->texture ? 1 : v->shape.planes, theta,
                               weights.colour, !step, err);
}

/* The proximal step number `step` of a run, of length 1 / bound from the extrapolated point, and the next such point.
 */
static hada_status take_step(hada_volume *v, const unknown *u, const hada_volume_rule *rule, double bound,
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

/* The energy of the frame itself, what nothing explains, at place 0. */
static hada_status frame_energy(hada_volume *v, hada_error *err)
{
    HADA_TRY(hada_buffer_clear(&v->sum, v->slot, 0, v->sum.bytes, err));
    return is_padded(&v->shape) ? residual_padded(v, 0, err) : residual_circular(v, 0, 0, err);
}

/* The first `count` energies, within the frame. */
static hada_status fetch_energies(hada_volume *v, int count, double *energy, hada_error *err)
{
    const size_t each = energy_sums(v);
    HADA_TRY(hada_buffer_read(&v->partial, v->slot, 0, v->host_partial, (size_t)count * each * sizeof(float), err));
    for (size_t k = 0; k < (size_t)count; k++) {
        double sum = 0;
        for (size_t i = k * each; i < (k + 1) * each; i++)
            sum += v->host_partial[i];
        energy[k] = is_padded(&v->shape) ? sum : sum / ((double)v->layout.rows * v->layout.cols);
    }
    return HADA_OK;
}

enum { CHECK_EVERY = 5 }; /* steps from one look at the energy to the next */

/* A run has gone astray, its steps being too long, where the residual's energy is above this many times the smallest so
 * far and this part of the frame's, or above the frame's own. */
#define ASTRAY      4.0
#define ASTRAY_PART 1e-3

/* Whether one of `count` energies, after that of the frame, says that the run has gone astray: *energy is the first
 * such one, else the last; *least: of the run so far. */
static int is_astray(const double *energies, int count, double *least, double *energy)
{
    const double whole = energies[0];
    int astray = 0;
    *least = fmin(*least, whole);
    for (int i = 1; i <= count && !astray; i++) {
        *energy = energies[i];
        astray = !(*energy <= whole) || *energy > ASTRAY * *least + ASTRAY_PART * whole;
        *least = fmin(*least, *energy);
    }
    return astray;
}

/* From `start` on with steps of length 1 / bound. astray: they were too long, and the values are worth nothing. */
static hada_status descend(hada_volume *v, const unknown *u, const hada_volume_rule *rule, double bound, double *energy,
                           int *astray, hada_error *err)
{
    const int most = looks_of(v->slot->context);
    double t = 1, least = INFINITY, energies[1 + LOOKS];
    int looks = 0;
    *astray = 0;
    HADA_TRY(hada_buffer_copy(v->slot, v->start.mem, 0, v->at.mem, 0, u->count * sizeof(float), err));
    HADA_TRY(hada_buffer_copy(v->slot, v->start.mem, 0, u->values, 0, u->count * sizeof(float), err));
    for (int k = 0; k < rule->steps && !*astray; k++) {
        const double next = (1 + sqrt(1 + 4 * t * t)) / 2;
        const int last = k == rule->steps - 1;
        HADA_TRY(differentiate(v, u, 1 + looks, err));
        looks += last || k % CHECK_EVERY == CHECK_EVERY - 1;
        if (last || looks == most) {
            HADA_TRY(fetch_energies(v, 1 + looks, energies, err));
            *astray = is_astray(energies, looks, &least, energy);
            looks = 0;
        }
        HADA_TRY(take_step(v, u, rule, bound, (t - 1) / next, k, err));
        t = next;
    }
    return HADA_OK;
}

static hada_status run(hada_volume *v, const unknown *u, const hada_volume_rule *rule, double *energy, hada_error *err)
{
    double left = 0, bound = rule->bound;
    int astray = 1;
    HADA_TRY(weigh(v, rule->floor, err));
    HADA_TRY(hada_buffer_copy(v->slot, u->values, 0, v->start.mem, 0, u->count * sizeof(float), err));
    HADA_TRY(frame_energy(v, err));
    /* no curvature is above the number of planes, so this ends */
    for (; astray && bound < 4.0 * v->shape.planes + 4.0 * rule->bound; bound *= 2)
        HADA_TRY(descend(v, u, rule, bound, &left, &astray, err));
    if (energy)
        *energy = left;
    return HADA_OK;
}

hada_status hada_volume_solve(hada_volume *v, const hada_volume_rule *rule, const hada_volume_band *band,
                              double *energy, hada_error *err)
{
    const unknown u = {.first = band ? band->first : 0,
                       .last = band ? band->last : v->shape.planes - 1,
                       .values = v->planes.mem,
                       .allowed = band ? band->allowed : NULL,
                       .count = (size_t)v->shape.planes * (size_t)v->shape.channels * v->window_area};
    /* no step writes the gradient of dark planes */
    if (u.first > 0 || u.last < v->shape.planes - 1)
        HADA_TRY(hada_buffer_clear(&v->gradient, v->slot, 0, v->gradient.bytes, err));
    return run(v, &u, rule, energy, err);
}

hada_status hada_volume_texture(hada_volume *v, const hada_volume_rule *rule, cl_mem depth, int first, int last,
                                cl_mem texture, double *energy, hada_error *err)
{
    const unknown u = {.texture = 1,
                       .first = first,
                       .last = last,
                       .depth = depth,
                       .values = texture,
                       .count = (size_t)v->shape.channels * v->window_area};
    return run(v, &u, rule, energy, err);
}
