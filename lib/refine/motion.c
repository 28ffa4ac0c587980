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
    const hada_refine_rect *window = &refiner->shape.window;
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
                                        .b_at = 2 * left_at, .out_at = 2 * at, .count = (cl_uint)numbers);
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

static hada_status move_planes(hada_refiner *refiner, int depths, const double shift[2], hada_error *err)
{
    return move(refiner, refiner->past.planes.mem, refiner->planes.mem, depths * refiner->shape.channels, shift, 0.0f,
                err);
}

hada_status hada_refiner_find_motion(hada_refiner *refiner, const hada_refine_data *data, double gain, int depths,
                                     const int *list, hada_refine_motion_found *found, hada_error *err)
{
    const hada_refine_run r = run_of(refiner, data, depths);
    hada_shift first, rest;
    HADA_TRY(filter(&r, gain, 0, err));
    HADA_TRY(filter(&r, gain, 1, err));
    HADA_TRY(compare(refiner, depths, 1, &first, err));
    *found = (hada_refine_motion_found){{first.by[0], first.by[1]}, 0.0, first.spread, first.most};
    HADA_TRY(move_planes(refiner, depths, found->shift, err));
    if (found->spread > UNLIKE)
        return HADA_OK;
    HADA_TRY(hada_refiner_residual(refiner, data, 1, depths, list, &found->left, err));
    /* what lies at the window's border stays there: planes that moved within the window explain it as well */
    HADA_TRY(filter(&r, gain, 0, err)); /* cells of the frame are still there */
    HADA_TRY(compare(refiner, depths, 0, &rest, err));
    *found = (hada_refine_motion_found){
        {first.by[0] + rest.by[0], first.by[1] + rest.by[1]}, found->left, rest.spread, rest.most};
    return move_planes(refiner, depths, found->shift, err);
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
    HADA_TRY(hada_refine_planes_forward(&r, err));
    HADA_TRY(hada_buffer_copy(refiner->slot, refiner->now_u.mem, 0, refiner->now_w.mem, 0, bytes, err));
    if (!r.padded)
        return HADA_OK;
    HADA_TRY(hada_refine_explain(&r, 1, err));
    HADA_TRY(explained(&r, refiner->residual.mem, 0, refiner->now_w.mem, refiner->split, err));
    HADA_TRY(hada_refine_frame_inverse(&r, &refiner->now_w, refiner->split, &refiner->dual, err));
    return hada_refine_frame_dual(&r, refiner->dual.mem, 1, 1.0, refiner->shape.max_steps + 1, err);
}

hada_status hada_refiner_move(hada_refiner *refiner, const hada_refine_data *data, int depths, const double shift[2],
                              hada_error *err)
{
    const hada_refine_run r = run_of(refiner, data, depths);
    const int images = depths * refiner->shape.channels;
    const size_t bytes = (size_t)images * refiner->window_area * sizeof(float);
    HADA_TRY(move(refiner, refiner->past.tv.mem, refiner->tv[0].mem, 2 * images, shift, -HUGE_VALF, err));
    HADA_TRY(hada_buffer_copy(refiner->slot, refiner->planes.mem, 0, refiner->past.planes.mem, 0, bytes, err));
    HADA_TRY(hada_refiner_begin_from_planes(refiner, data, depths, err));
    /* duals of the planes are what total variation takes off */
    HADA_TRY(hada_variation_before(&refiner->variation, refiner->slot, refiner->planes.mem, refiner->tv[0].mem, depths,
                                   refiner->last_tv / refiner->past.rho, err));
    HADA_TRY(hada_refine_planes_forward(&r, err));
    HADA_TRY(hada_buffer_copy(refiner->slot, refiner->now_u.mem, 0, refiner->now_w.mem, 0,
                              (size_t)images * refiner->layout.count * 2 * sizeof(float), err));
    return hada_buffer_copy(refiner->slot, refiner->past.planes.mem, 0, refiner->planes.mem, 0, bytes, err);
}
