/* A frame goes on from the one before it: the planes, their duals and those of the split at the frame are kept beside
 * the refiner's own memory, which other frames' depths, the pursuit and what follows refinement use in between.
 *
 * A scene that moves as a whole, as it does before a camera that moves, moves its planes: what one frame leaves for the
 * next goes there. How far is told by planes that the joint linear filter makes of the frame, and of what the last
 * planes would have made of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "launch/refine_move.h"
#include "refine/admm_steps.h"
#include "refine/shift.h"

static hada_program_refine_move program_of(const hada_refiner *refiner)
{
    return hada_program_refine_move_of(refiner->slot);
}

static hada_refine_run run_of(hada_refiner *refiner, const hada_refine_data *data, int depths)
{
    return (hada_refine_run){.refiner = refiner,
                             .data = data,
                             .sets = 1,
                             .depths = depths,
                             .padded = refiner->shape.boundary == HADA_BOUNDARY_PADDED};
}

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
    return hada_launch_refine_move_rest(refiner->slot, program_of(refiner), &range, err, .a = a, .b = b, .out = a,
                                        .a_at = a_at, .b_at = b_at, .out_at = a_at, .count = (cl_uint)count,
                                        .part = (float)part);
}

/* What is kept of the split at the frame becomes that of mu = 1, its dual being in units of 1 / mu. Few steps that go
 * on with another mu would lag beyond the frame. */
static hada_status use_whole_mu(hada_refiner *refiner, hada_error *err)
{
    const hada_refine_past *past = &refiner->past;
    const size_t channels = (size_t)refiner->shape.channels, at = 2 * refiner->split;
    const hada_refine_run r = run_of(refiner, NULL, past->depths);
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
    const hada_refine_run r = run_of(refiner, &rest, depths);
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

/* The joint linear filter: rho in units of the gain. A larger one reaches farther, and what does not move with the
 * scene, as the window's border, falsified what was found by 8 % at 0.02 and 3 % at 0.005. */
#define COMPARED_RHO 0.005

/* Tiles that are so unlike do not move alike: nothing else is asked. */
#define UNLIKE 3.0

static int scale_of(const hada_refine_shape *shape)
{
    return hada_shift_scale(shape->window.rows, shape->window.cols);
}

int hada_refiner_knows_motion(const hada_refiner *refiner, const hada_refine_data *data)
{
    const hada_refine_shape *shape = &refiner->shape;
    return shape->past && shape->tv && !data->weights && hada_shift_possible(shape->window.rows, shape->window.cols);
}

static size_t group_of(const hada_refiner *refiner)
{
    return (size_t)hada_macros_of_refine_move(program_of(refiner))->move_group;
}

/* `images` images of the window to another place. */
static hada_status move(const hada_refiner *refiner, cl_mem in, cl_mem out, int images, const double shift[2],
                        float least, hada_error *err)
{
    const hada_rectangle *window = &refiner->shape.window;
    const double values = (double)hada_rect_area(window) * images;
    const hada_range range = hada_range_groups(1, group_of(refiner), (size_t)window->rows, (size_t)images);
    hada_refine_move now = {.rows = window->rows, .cols = window->cols, .least = least};
    now.row = hada_shift_weights(shift[0], now.down);
    now.col = hada_shift_weights(shift[1], now.across);
    hada_slot_cost(refiner->slot, 8.0 * values, 84.0 * values);
    return hada_launch_refine_move_images(refiner->slot, program_of(refiner), &range, err, .in = in, .out = out,
                                          .move = now);
}

/* Cells of planes, as number `set` of two. */
static hada_status to_cells(const hada_refiner *refiner, cl_mem planes, int depths, int set, hada_error *err)
{
    const hada_refine_shape *shape = &refiner->shape;
    const int scale = scale_of(shape), rows = shape->window.rows / scale, cols = shape->window.cols / scale;
    const hada_range range = hada_range_groups(1, group_of(refiner), (size_t)rows, (size_t)depths);
    const double values = (double)depths * shape->channels * (double)refiner->window_area;
    hada_slot_cost(refiner->slot, 4.0 * values, values);
    return hada_launch_refine_move_cells(
        refiner->slot, program_of(refiner), &range, err, .planes = planes, .cells = refiner->partial.mem,
        .first = (cl_uint)(refiner->cells + (size_t)(set * depths * rows * cols)), .channels = shape->channels,
        .rows = shape->window.rows, .cols = shape->window.cols, .scale = scale);
}

/* How far the second cells are from the first ones: *shift, in pixels. */
static hada_status compare(hada_refiner *refiner, int depths, int far, hada_shift *shift, hada_error *err)
{
    const hada_refine_shape *shape = &refiner->shape;
    const int scale = scale_of(shape), rows = shape->window.rows / scale, cols = shape->window.cols / scale;
    const size_t each = (size_t)(depths * rows * cols);
    float *cells = refiner->host_partial + refiner->cells;
    *shift = (hada_shift){.by = {0.0, 0.0}};
    HADA_TRY(hada_buffer_read(&refiner->partial, refiner->slot, refiner->cells * sizeof *cells, cells,
                              2 * each * sizeof *cells, err));
    HADA_TRY(hada_shift_find(cells, cells + each, depths, rows, cols, hada_shift_border(scale), far, shift, err));
    for (int k = 0; k < 2; k++)
        shift->by[k] *= scale;
    shift->apart *= scale;
    return HADA_OK;
}

/* out = spectra of the frame less those of what is left of it. */
static hada_status explained(const hada_refine_run *r, cl_mem left, size_t left_at, cl_mem out, size_t at,
                             hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t numbers = 2 * refiner->layout.count * (size_t)refiner->shape.channels;
    const hada_range range = hada_range_of(numbers, 64, 1, 1);
    hada_slot_cost(refiner->slot, 12.0 * (double)numbers, (double)numbers);
    return hada_launch_refine_move_rest(refiner->slot, program_of(refiner), &range, err, .a = r->data->spectrum,
                                        .b = left, .out = out, .a_at = 2 * r->data->spectrum_offset,
                                        .b_at = 2 * left_at, .out_at = 2 * at, .count = (cl_uint)numbers, .part = 1.0f);
}

/* Spectra of what the planes would make of the frame, in the place of what hada_refiner_residual() left. Where a sensor
 * crops it crops that as well. */
static hada_status predict(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const cl_mem residual = refiner->residual.mem;
    if (!r->padded)
        return explained(r, residual, 0, residual, 0, err);
    HADA_TRY(hada_buffer_copy(refiner->slot, refiner->residual_frame.mem, 0, refiner->dual.mem, 0,
                              (size_t)refiner->shape.channels * refiner->frame_area * sizeof(float), err));
    HADA_TRY(hada_refine_frame_forward(r, err));
    return explained(r, refiner->now_u.mem, refiner->split, residual, 0, err);
}

/* Cells of the planes that the joint linear filter makes of the frame, or of what the planes explain of it. */
static hada_status filter(const hada_refine_run *r, double gain, int of_frame, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    hada_refine_data data = *r->data;
    hada_refine_run run = *r;
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    rule.rho = COMPARED_RHO * gain;
    run.data = &data;
    if (!of_frame) {
        HADA_TRY(predict(r, err));
        data.spectrum = refiner->residual.mem;
        data.spectrum_offset = 0;
    }
    HADA_TRY(hada_refine_solve(&run, &rule, HADA_REFINE_COLD, 0, refiner->shape.max_steps + 1, err));
    HADA_TRY(hada_refine_planes_inverse(&run, err));
    return to_cells(refiner, refiner->planes.mem, r->depths, of_frame, err);
}

/* Remembered planes, where they moved to. */
static hada_status shifted(const hada_refiner *refiner, int depths, const hada_refine_motion *motion, cl_mem planes,
                           hada_error *err)
{
    const hada_rectangle *window = &refiner->shape.window;
    const int channels = refiner->shape.channels;
    const cl_mem before = refiner->past.planes.mem;
    const hada_range pixels = hada_range_of((size_t)window->cols, 64, (size_t)window->rows, 1);
    const double values = (double)depths * channels * (double)refiner->window_area;
    HADA_TRY(move(refiner, before, planes, depths * channels, motion->shift, 0.0f, err));
    if (!motion->stays)
        return HADA_OK;
    hada_slot_cost(refiner->slot, 12.0 * values, 60.0 * values);
    return hada_launch_refine_move_share(refiner->slot, program_of(refiner), &pixels, err, .before = before,
                                         .planes = planes, .depths = depths, .channels = channels, .rows = window->rows,
                                         .cols = window->cols);
}

static hada_status try_motion(hada_refiner *refiner, const hada_refine_data *data, int depths, const int *list,
                              hada_refine_motion *motion, hada_error *err)
{
    HADA_TRY(shifted(refiner, depths, motion, refiner->planes.mem, err));
    return hada_refiner_residual(refiner, data, 1, depths, list, &motion->left, err);
}

/* Depths move with their light, or stay where they are. That they move needs a reason, for a shift that is not yet
 * right tells little, and light that stays is seldom wrong by much. */
static hada_status choose(hada_refiner *refiner, const hada_refine_data *data, int depths, const int *list,
                          hada_refine_motion *motion, hada_error *err)
{
    static const double reason = 1.01;
    hada_refine_motion with = *motion, stays = *motion;
    with.stays = 0;
    stays.stays = 1;
    HADA_TRY(try_motion(refiner, data, depths, list, &with, err));
    HADA_TRY(try_motion(refiner, data, depths, list, &stays, err));
    *motion = stays;
    if (reason * with.left > stays.left)
        return HADA_OK;
    *motion = with;
    return try_motion(refiner, data, depths, list, motion, err);
}

/* Adds what is left of a shift. A look finds a part of it: what lies at the window's border stays there, and light of
 * other depths is spread over a plane. The part is told by what the last steps changed. Returns how far it goes. */
static double advance(hada_refine_motion *motion, const double rest[2], double step[2], double before[2])
{
    static const double tells = 0.03, least = 0.2, most = 1.2, farthest = 1.5;
    double largest = 0.0;
    for (int k = 0; k < 2; k++) {
        if (fabs(step[k]) > tells)
            motion->part[k] = fmax(least, fmin((before[k] - rest[k]) / step[k], most));
        before[k] = rest[k];
        step[k] = fmax(-farthest, fmin(rest[k] / motion->part[k], farthest));
        motion->shift[k] += step[k];
        largest = fmax(largest, fabs(step[k]));
    }
    return largest;
}

hada_status hada_refiner_find_motion(hada_refiner *refiner, const hada_refine_data *data, double gain, int depths,
                                     const int *list, hada_refine_motion *motion, hada_error *err)
{
    const double enough = depths > 1 ? 0.03 : 0.1;
    enum { LOOKS = 6 };
    const hada_refine_run r = run_of(refiner, data, depths);
    const int known = motion->part[0] > 0.0;
    double step[2] = {0.0, 0.0}, before[2] = {0.0, 0.0};
    hada_shift rest;
    HADA_TRY(filter(&r, gain, 1, err)); /* what was left of the frame stays */
    if (!known) {
        HADA_TRY(filter(&r, gain, 0, err));
        HADA_TRY(compare(refiner, depths, 1, &rest, err));
        *motion = (hada_refine_motion){.shift = {rest.by[0], rest.by[1]}, .part = {1.0, 1.0}, .spread = rest.spread};
        memcpy(step, rest.by, sizeof step);
        memcpy(before, rest.by, sizeof before);
        if (rest.spread > UNLIKE)
            return HADA_OK;
    }
    for (int look = 0; look < LOOKS; look++) {
        HADA_TRY(known || depths == 1 ? try_motion(refiner, data, depths, list, motion, err)
                                      : choose(refiner, data, depths, list, motion, err));
        HADA_TRY(filter(&r, gain, 0, err)); /* cells of the frame are still there */
        HADA_TRY(compare(refiner, depths, 0, &rest, err));
        motion->spread = rest.spread;
        motion->most = rest.most;
        motion->apart = rest.apart;
        if (depths == 1) /* nearly all is found in each look, and noise says the rest */
            step[0] = step[1] = 0.0;
        motion->rest = advance(motion, rest.by, step, before);
        if ((rest.spread > UNLIKE && (look || !known)) || motion->rest < enough)
            break;
    }
    return shifted(refiner, depths, motion, refiner->planes.mem, err);
}

hada_status hada_refiner_creep(hada_refiner *refiner, int depths, double shift[2], hada_error *err)
{
    hada_shift found;
    HADA_TRY(to_cells(refiner, refiner->past.planes.mem, depths, 0, err));
    HADA_TRY(to_cells(refiner, refiner->planes.mem, depths, 1, err));
    HADA_TRY(compare(refiner, depths, 0, &found, err));
    memcpy(shift, found.by, sizeof found.by);
    return HADA_OK;
}

hada_status hada_refiner_begin_from_planes(hada_refiner *refiner, const hada_refine_data *data, int depths,
                                           hada_error *err)
{
    const hada_refine_run r = run_of(refiner, data, depths);
    const size_t bytes = (size_t)(depths * refiner->shape.channels) * refiner->layout.count * 2 * sizeof(float);
    refiner->last_rho = refiner->past.rho;
    refiner->mu = 1.0;
    HADA_TRY(hada_refine_planes_forward(&r, err));
    HADA_TRY(hada_buffer_copy(refiner->slot, refiner->now_u.mem, 0, refiner->now_w.mem, 0, bytes, err));
    if (!r.padded)
        return HADA_OK;
    HADA_TRY(hada_refine_explain(&r, 1, err));
    HADA_TRY(explained(&r, refiner->residual.mem, 0, refiner->now_w.mem, refiner->split, err));
    HADA_TRY(hada_refine_frame_inverse(&r, &refiner->now_w, refiner->split, &refiner->dual, err));
    return hada_refine_frame_dual(&r, refiner->dual.mem, 1, refiner->mu, refiner->shape.max_steps + 1, err);
}

hada_status hada_refiner_move(hada_refiner *refiner, const hada_refine_data *data, int depths,
                              const hada_refine_motion *motion, hada_error *err)
{
    const hada_refine_run r = run_of(refiner, data, depths);
    const int images = depths * refiner->shape.channels;
    refiner->last_rho = refiner->past.rho;
    HADA_TRY(move(refiner, refiner->past.tv.mem, refiner->tv[0].mem, 2 * images, motion->shift, -HUGE_VALF, err));
    if (r.padded)
        HADA_TRY(hada_refiner_begin_from_planes(refiner, data, depths, err));
    /* duals of the planes are what total variation takes off */
    HADA_TRY(hada_variation_before(&refiner->variation, refiner->slot, refiner->planes.mem, refiner->tv[0].mem, depths,
                                   refiner->last_tv / refiner->past.rho, err));
    HADA_TRY(hada_refine_planes_forward(&r, err));
    HADA_TRY(hada_buffer_copy(refiner->slot, refiner->now_u.mem, 0, refiner->now_w.mem, 0,
                              (size_t)images * refiner->layout.count * 2 * sizeof(float), err));
    return shifted(refiner, depths, motion, refiner->planes.mem, err);
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
    const hada_refine_run r = run_of(refiner, NULL, past->depths);
    const size_t channels = (size_t)refiner->shape.channels;
    const size_t each = hada_divide_up(refiner->window_area, HADA_REFINE_PLACE), places = (size_t)past->depths * each;
    const double part = strict ? 2.0 / 3.0 : 1.0;
    const double most_spread = 1.0 + part * (past->depths > 1 ? 1.26 : 0.54) / (double)channels;
    const double most_even = 1.0 + 3.6 / sqrt((double)channels), bordering = 0.97;
    const double most_change = 1.0 + (past->depths > 1 ? 5.2 : 2.4) * sqrt(part / (double)channels);
    float *sums = refiner->host_partial;
    double spread, most;
    /* spectra are made anew by the next run */
    HADA_TRY(motion ? shifted(refiner, past->depths, motion, refiner->now_u.mem, err)
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
