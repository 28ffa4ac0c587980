/* A frame goes on from the one before it: the planes, their duals and those of the split at the frame are kept beside
 * the refiner's own memory, which other frames' depths, the pursuit and what follows refinement use in between. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "launch/refine_move.h"
#include "refine/admm_steps.h"

/* Copies what a run of so many depths has, there or back. */
static hada_status copy(hada_refiner *refiner, int back, hada_error *err)
{
    hada_refine_past *past = &refiner->past;
    const hada_refine_shape *shape = &refiner->shape;
    const size_t images = (size_t)past->depths * (size_t)shape->channels, channels = (size_t)shape->channels;
    const size_t complex_bytes = refiner->layout.count * 2 * sizeof(float);
    const int padded = shape->boundary == HADA_BOUNDARY_PADDED;
    const size_t tv = shape->tv ? hada_variation_floats(refiner->slot->context, shape->channels, shape->window.rows,
                                                        shape->window.cols, past->depths) *
                                      sizeof(float)
                                : 0;
    const struct {
        cl_mem now, then;
        size_t offset, bytes;
    } parts[] = {{refiner->planes.mem, past->planes.mem, 0, images * refiner->window_area * sizeof(float)},
                 {refiner->now_w.mem, past->now_w.mem, 0, images * complex_bytes},
                 {refiner->now_w.mem, past->now_w.mem, refiner->split * 2 * sizeof(float),
                  padded ? channels * complex_bytes : 0},
                 {refiner->dual.mem, past->dual.mem, 0, padded ? channels * refiner->frame_area * sizeof(float) : 0},
                 {refiner->tv[0].mem, past->tv.mem, 0, tv}};
    for (size_t i = 0; i < HADA_COUNT(parts); i++)
        if (parts[i].bytes)
            HADA_TRY(hada_buffer_copy(refiner->slot, back ? parts[i].then : parts[i].now, parts[i].offset,
                                      back ? parts[i].now : parts[i].then, parts[i].offset, parts[i].bytes, err));
    return HADA_OK;
}

/* a -= part b, of `count` floats from their places on. */
static hada_status subtract(const hada_refiner *refiner, cl_mem a, size_t a_at, cl_mem b, size_t b_at, size_t count,
                            double part, hada_error *err)
{
    const hada_range range = hada_range_of(count, 64, 1, 1);
    hada_slot_cost(refiner->slot, 12.0 * (double)count, 2.0 * (double)count);
    return hada_launch_refine_move_rest(refiner->slot, hada_program_refine_move_of(refiner->slot), &range, err, .a = a,
                                        .b = b, .out = a, .a_at = a_at, .b_at = b_at, .out_at = a_at,
                                        .count = (cl_uint)count, .part = (float)part);
}

/* What is kept of the split at the frame becomes that of mu = 1, its dual being in units of 1 / mu. Few steps that go
 * on with another mu would lag beyond the frame. */
static hada_status use_whole_mu(hada_refiner *refiner, hada_error *err)
{
    const hada_refine_past *past = &refiner->past;
    const size_t channels = (size_t)refiner->shape.channels, at = 2 * refiner->split;
    const hada_refine_run r = {.refiner = refiner, .sets = 1, .depths = past->depths};
    const double part = 1.0 - refiner->mu;
    if (part == 0.0)
        return HADA_OK;
    HADA_TRY(hada_refine_frame_forward(&r, err));
    HADA_TRY(subtract(refiner, past->now_w.mem, at, refiner->now_u.mem, at, 2 * channels * refiner->layout.count, part,
                      err));
    return subtract(refiner, past->dual.mem, 0, past->dual.mem, 0, channels * refiner->frame_area, part, err);
}

hada_status hada_refiner_keep(hada_refiner *refiner, int depths, const int *list, hada_error *err)
{
    hada_refine_past *past = &refiner->past;
    if (!refiner->shape.past)
        return HADA_OK;
    past->depths = depths;
    past->rho = refiner->last_rho;
    memmove(past->list, list, (size_t)depths * sizeof *list);
    HADA_TRY(copy(refiner, 0, err));
    return refiner->shape.boundary == HADA_BOUNDARY_PADDED ? use_whole_mu(refiner, err) : HADA_OK;
}

int hada_refiner_remembers(const hada_refiner *refiner, int depths, const int *list)
{
    const hada_refine_past *past = &refiner->past;
    return depths > 0 && past->depths == depths && !memcmp(past->list, list, (size_t)depths * sizeof *list);
}

hada_status hada_refiner_recall(hada_refiner *refiner, hada_error *err)
{
    refiner->last_rho = refiner->past.rho;
    refiner->mu = 1.0;
    return copy(refiner, 1, err);
}

int hada_refiner_knows_light(const hada_refiner *refiner, const hada_refine_data *data)
{
    return refiner->shape.past && !data->weights;
}

/* With A what the planes explain, |b - A|^2 and |A|^2 tell |b - t A|^2. Circular: |b - 2 A|^2 tells |A|^2. */
hada_status hada_refiner_left_if(hada_refiner *refiner, const hada_refine_data *data, int depths, double frame,
                                 double times, double *left, hada_error *err)
{
    const int padded = refiner->shape.boundary == HADA_BOUNDARY_PADDED, channels = refiner->shape.channels;
    hada_refine_data rest = *data;
    const hada_refine_run r = {.refiner = refiner, .data = &rest, .sets = 1, .depths = depths, .padded = padded};
    double found;
    if (padded) { /* the spectrum of the residual is of no use any more */
        HADA_TRY(hada_buffer_copy(refiner->slot, refiner->residual_frame.mem, 0, refiner->residual.mem, 0,
                                  (size_t)channels * refiner->frame_area * sizeof(float), err));
        HADA_TRY(hada_refine_frame_dual(&r, refiner->residual.mem, 1, 0.0, 0, err));
    } else {
        rest.spectrum = refiner->residual.mem;
        rest.spectrum_offset = 0;
        HADA_TRY(hada_refine_explain(&r, 0, err));
    }
    HADA_TRY(hada_refine_energies(&r, channels, refiner->arriving.slices, refiner->arriving.factor, &found, err));
    const double explained = padded ? found : (found - 2.0 * *left + frame) / 2.0;
    *left += (times - 1.0) * (times * explained - frame + *left);
    return HADA_OK;
}

/* Planes and duals are in units of light, but those of total variation. */
hada_status hada_refiner_brighten(hada_refiner *refiner, double times, hada_error *err)
{
    const hada_refine_past *past = &refiner->past;
    const size_t channels = (size_t)refiner->shape.channels, images = (size_t)past->depths * channels;
    const int padded = refiner->shape.boundary == HADA_BOUNDARY_PADDED;
    const struct {
        cl_mem mem;
        size_t first, count;
    } parts[] = {{refiner->planes.mem, 0, images * refiner->window_area},
                 {past->planes.mem, 0, images * refiner->window_area},
                 {past->now_w.mem, 0, 2 * images * refiner->layout.count},
                 {past->now_w.mem, 2 * refiner->split, padded ? 2 * channels * refiner->layout.count : 0},
                 {past->dual.mem, 0, padded ? channels * refiner->frame_area : 0}};
    for (size_t i = 0; i < HADA_COUNT(parts); i++) {
        if (parts[i].count)
            HADA_TRY(subtract(refiner, parts[i].mem, parts[i].first, parts[i].mem, parts[i].first, parts[i].count,
                              1.0 - times, err));
    }
    refiner->last_tv *= times;
    return HADA_OK;
}

/* How far values near their usual size spread, and how far they go at most: mean square over squared mean, and the most
 * over the mean. Values below a tenth of the mean are dark places, and what moves does not count in the mean. */
static void spread_of(const float *values, size_t count, double *spread, double *most)
{
    static const double dark = 0.1, faint = 0.3, beyond = 3.0;
    double least = 0.0, limit = HUGE_VAL, mean = 0.0, lit = 0.0, sum = 0.0, squares = 0.0, largest = 0.0;
    size_t shown = 0;
    for (int pass = 0; pass < 3; pass++) { /* of all, of lit ones, of lit ones that did not move */
        size_t found = 0;
        double here = 0.0;
        for (size_t i = 0; i < count; i++)
            if (values[i] >= least && values[i] <= limit) {
                here += values[i];
                found++;
            }
        mean = found ? here / (double)found : 0.0;
        lit = pass == 1 ? mean : lit;
        least = dark * mean;
        limit = pass == 1 ? beyond * mean : HUGE_VAL;
    }
    for (size_t i = 0; i < count; i++) {
        largest = fmax(largest, values[i]);
        if (values[i] > faint * lit) {
            sum += values[i];
            squares += (double)values[i] * values[i];
            shown++;
        }
    }
    *spread = sum > 0.0 ? squares * (double)shown / (sum * sum) : 1.0;
    *most = mean > 0.0 ? largest / mean : 1.0;
}

static int in_order(const void *a, const void *b)
{
    const float one = *(const float *)a, other = *(const float *)b;
    return (one > other) - (one < other);
}

/* Noise changes all places alike, what moves changes edges. In three channels still scenes had spreads of up to 1.15
 * and most changes of 2.4 times the mean, those of several depths 1.26 and 2.95; planes of scenes that moved by more
 * than a quarter of a pixel, which would lag, more (perf/results/sequences.md). Sums over more channels are more alike.
 * Planes of several depths that moved together differed by 2.9 at most but for three places in a hundred, where the
 * window's border is; those of which one moved otherwise by 3.4 and more. */
hada_status hada_refiner_moved(hada_refiner *refiner, const hada_refine_motion *motion, int strict, int *moved,
                               hada_error *err)
{
    const hada_refine_past *past = &refiner->past;
    const hada_refine_run r = {.refiner = refiner, .sets = 1, .depths = past->depths};
    const size_t channels = (size_t)refiner->shape.channels;
    const size_t each = hada_divide_up(refiner->window_area, HADA_REFINE_PLACE), places = (size_t)past->depths * each;
    const double part = strict ? 2.0 / 3.0 : 1.0;
    const double most_spread = 1.0 + part * (past->depths > 1 ? 1.26 : 0.54) / (double)channels;
    const double most_even = 1.0 + 3.6 / sqrt((double)channels), bordering = 0.97;
    const double most_change = 1.0 + (past->depths > 1 ? 5.2 : 2.4) * sqrt(part / (double)channels);
    float *sums = refiner->host_partial;
    double spread, most;
    /* spectra are made anew by the next run */
    HADA_TRY(motion ? hada_refine_shifted(refiner, past->depths, motion, refiner->now_u.mem, err)
                    : hada_buffer_copy(refiner->slot, past->planes.mem, 0, refiner->now_u.mem, 0,
                                       (size_t)past->depths * channels * refiner->window_area * sizeof(float), err));
    HADA_TRY(hada_refine_since(&r, refiner->now_u.mem, err));
    HADA_TRY(hada_buffer_read(&refiner->partial, refiner->slot, 0, sums, places * channels * sizeof *sums, err));
    for (size_t i = 0; i < places; i++) { /* of all channels, in place: what is read is not before what is written */
        const float *from = sums + i / each * channels * each + i % each;
        float sum = 0.0f;
        for (size_t c = 0; c < channels; c++)
            sum += from[c * each];
        sums[i] = sum;
    }
    if (motion) { /* the border is new */
        qsort(sums, places, sizeof *sums, in_order);
        spread_of(sums, (size_t)(bordering * (double)places), &spread, &most);
        *moved = most > most_even;
        return HADA_OK;
    }
    spread_of(sums, places, &spread, &most);
    *moved = spread > most_spread || most > most_change;
    return HADA_OK;
}
