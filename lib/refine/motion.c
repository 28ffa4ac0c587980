/* A scene that moves as a whole, as it does before a camera that moves, moves its planes: what one frame leaves for the
 * next goes there. How far is told by planes that the joint linear filter makes of the frame, and of what the last
 * planes would have made of it. */
#include <math.h>
#include <string.h>

#include "launch/refine_move.h"
#include "refine/admm_steps.h"
#include "refine/shift.h"

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

static hada_program_refine_move program_of(const hada_refiner *refiner)
{
    return hada_program_refine_move_of(refiner->slot);
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

static hada_refine_run run_of(hada_refiner *refiner, const hada_refine_data *data, int depths)
{
    return (hada_refine_run){.refiner = refiner,
                             .data = data,
                             .sets = 1,
                             .depths = depths,
                             .padded = refiner->shape.boundary == HADA_BOUNDARY_PADDED};
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

hada_status hada_refine_shifted(const hada_refiner *refiner, int depths, const hada_refine_motion *motion,
                                cl_mem planes, hada_error *err)
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
    HADA_TRY(hada_refine_shifted(refiner, depths, motion, refiner->planes.mem, err));
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
    return hada_refine_shifted(refiner, depths, motion, refiner->planes.mem, err);
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
    return hada_refine_shifted(refiner, depths, motion, refiner->planes.mem, err);
}
