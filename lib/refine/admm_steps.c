#include "refine/admm_steps.h"

#include <math.h>

#include "runtime/kernel.h"

hada_status hada_refine_kernels(hada_refiner *refiner, hada_error *err)
{
    hada_slot *slot = refiner->slot;
    /* vectors need whole ones of eight frequencies in a row of the layout */
    const char *options = slot->context->shape == HADA_SHAPE_GROUPS ? "-DREFINE_WIDTH=1 -DREFINE_GROUP=64"
                          : refiner->layout.block % 8               ? "-DREFINE_WIDTH=1"
                                                                    : "";
    refiner->group = slot->context->shape == HADA_SHAPE_GROUPS ? HADA_REFINE_GROUP : 1;
    hada_status status = hada_slot_kernel(slot, "refine", "refine_solve", options, &refiner->solve, err);
    if (!status)
        status = hada_slot_kernel(slot, "refine", "refine_explain", options, &refiner->explain, err);
    if (!status)
        status = hada_slot_kernel(slot, "refine", "refine_score", options, &refiner->score, err);
    if (!status)
        status = hada_slot_kernel(slot, "refine", "refine_frame", options, &refiner->frame, err);
    if (!status)
        status = hada_slot_kernel(slot, "refine", "refine_prox", options, &refiner->prox, err);
    return status;
}

static cl_uint slices_of(size_t count)
{
    return (cl_uint)((count + HADA_REFINE_SLICE - 1) / HADA_REFINE_SLICE);
}

/* One run's constants. */
typedef struct run {
    hada_refiner *refiner;
    const hada_refine_data *data;
    int sets, depths;
    int padded;
} run;

/* Least traffic and operations, for profiles: a transfer function that several sets share is read once. */
static double frequencies(const run *r)
{
    return (double)r->refiner->layout.rows * (r->refiner->layout.cols / 2 + 1.0) * r->refiner->shape.channels;
}

static double otfs_read(const run *r)
{
    const int all = r->sets * r->depths;
    return all < r->data->otf_depths ? all : r->data->otf_depths;
}

static void cost_solve(const run *r, int start, int has_prior)
{
    const double all = (double)r->sets * r->depths, kept = start == HADA_REFINE_COLD ? 8
                                                           : start == HADA_REFINE_ON ? 24
                                                                                     : 16;
    const double data = r->padded ? (start == HADA_REFINE_ON ? 24.0 * r->sets : 8.0 * r->sets + 8.0) : 8.0;
    hada_slot_cost(r->refiner->slot, frequencies(r) * (8.0 * otfs_read(r) + kept * all + data + (has_prior ? 4 : 0)),
                   frequencies(r) * ((start == HADA_REFINE_COLD ? 20.0 : 44.0) * all + 16.0 * r->sets));
}

static void cost_explain(const run *r, int has_rest)
{
    const double all = (double)r->sets * r->depths;
    hada_slot_cost(r->refiner->slot,
                   frequencies(r) * (8.0 * otfs_read(r) + 8.0 * all + 8.0 + (has_rest ? 8.0 * r->sets : 0)),
                   frequencies(r) * (8.0 * all + 4.0 * r->sets));
}

/* share: of the frequencies that are looked at */
static void cost_score(const run *r, double share, int has_prior, int has_doubt)
{
    const double all = (double)r->sets * r->depths, values = share * frequencies(r);
    hada_slot_cost(r->refiner->slot,
                   values * ((has_doubt ? 12.0 : 8.0) * otfs_read(r) + 8.0 * all + 8.0 + (has_prior ? 4 : 0)),
                   values * ((has_doubt ? 14.0 : 12.0) * all + 6.0 * r->sets));
}

static double rho_at(const hada_refine_rule *rule, int step)
{
    return rule->first_rho > 0.0 ? fmin(rule->rho, rule->first_rho * pow(rule->growth, step)) : rule->rho;
}

/* Linear step `step` of a run. The sums go to the place `sums`. */
static hada_status solve(const run *r, const hada_refine_rule *rule, int start, int step, int sums, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const hada_spectrum_layout *layout = &refiner->layout;
    cl_ulong otf_offset = data->otf_offset, data_offset = data->spectrum_offset;
    cl_int depths = r->depths, padded = r->padded, has_prior = data->prior && !(rule->tv > 0.0), first = start;
    cl_mem split_a = padded ? refiner->split_a.mem : refiner->now_w.mem;
    cl_mem split_e = padded ? refiner->split_e.mem : refiner->now_u.mem;
    cl_mem prior = has_prior ? data->prior : data->spectrum;
    cl_float rho = (float)rho_at(rule, step), keep = step ? (float)(rho_at(rule, step - 1) / rho_at(rule, step)) : 1.0f;
    cl_float over = start == HADA_REFINE_ON ? (float)rule->relaxation : 1.0f;
    cl_uint count = (cl_uint)layout->count, slice = HADA_REFINE_SLICE, rows = (cl_uint)layout->rows;
    cl_uint block = (cl_uint)layout->block, cols = (cl_uint)layout->cols;
    cl_uint partial_first = (cl_uint)(refiner->partials * (size_t)sums);
    hada_arg args[] = {HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(refiner->list.mem),
                       HADA_ARG(depths),
                       HADA_ARG(data->spectrum),
                       HADA_ARG(data_offset),
                       HADA_ARG(split_a),
                       HADA_ARG(split_e),
                       HADA_ARG(padded),
                       HADA_ARG(prior),
                       HADA_ARG(has_prior),
                       HADA_ARG(refiner->now_u.mem),
                       HADA_ARG(refiner->now_w.mem),
                       HADA_ARG(rho),
                       HADA_ARG(keep),
                       HADA_ARG(over),
                       HADA_ARG(first),
                       HADA_ARG(count),
                       HADA_ARG(slice),
                       HADA_ARG(rows),
                       HADA_ARG(block),
                       HADA_ARG(cols),
                       HADA_ARG(refiner->partial.mem),
                       HADA_ARG(partial_first)};
    const size_t local[3] = {(size_t)refiner->group, 1, 1};
    const size_t global[3] = {slices_of(count) * local[0], (size_t)refiner->shape.channels, (size_t)r->sets};
    cost_solve(r, start, has_prior);
    return hada_slot_launch(refiner->slot, refiner->solve, "refine_solve", 3, global, local, args, HADA_COUNT(args),
                            err);
}

static hada_status explain(const run *r, int has_rest, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const hada_spectrum_layout *layout = &refiner->layout;
    cl_ulong otf_offset = data->otf_offset, data_offset = data->spectrum_offset;
    cl_int depths = r->depths, rest_kept = has_rest;
    cl_mem rest = has_rest ? refiner->rest.mem : refiner->now_w.mem;
    cl_uint count = (cl_uint)layout->count, slice = HADA_REFINE_SLICE, rows = (cl_uint)layout->rows;
    cl_uint block = (cl_uint)layout->block, cols = (cl_uint)layout->cols;
    hada_arg args[] = {HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(refiner->list.mem),
                       HADA_ARG(depths),
                       HADA_ARG(data->spectrum),
                       HADA_ARG(data_offset),
                       HADA_ARG(refiner->now_u.mem),
                       HADA_ARG(rest),
                       HADA_ARG(rest_kept),
                       HADA_ARG(count),
                       HADA_ARG(slice),
                       HADA_ARG(rows),
                       HADA_ARG(block),
                       HADA_ARG(cols),
                       HADA_ARG(refiner->partial.mem)};
    const size_t local[3] = {(size_t)refiner->group, 1, 1};
    const size_t global[3] = {slices_of(count) * local[0], (size_t)refiner->shape.channels, (size_t)r->sets};
    cost_explain(r, has_rest);
    return hada_slot_launch(refiner->slot, refiner->explain, "refine_explain", 3, global, local, args, HADA_COUNT(args),
                            err);
}

static hada_status score(const run *r, int band_rows, int band_cols, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const hada_spectrum_layout *layout = &refiner->layout;
    cl_ulong otf_offset = data->otf_offset, data_offset = data->spectrum_offset;
    cl_int depths = r->depths, has_prior = data->prior != NULL, has_doubt = data->doubt != NULL;
    cl_mem prior = has_prior ? data->prior : data->spectrum, doubt = has_doubt ? data->doubt : data->spectrum;
    cl_uint channels = (cl_uint)refiner->shape.channels, count = (cl_uint)layout->count, slice = HADA_REFINE_SLICE;
    cl_uint rows = (cl_uint)layout->rows, block = (cl_uint)layout->block, cols = (cl_uint)layout->cols;
    cl_uint high = (cl_uint)band_rows, wide = (cl_uint)band_cols;
    hada_arg args[] = {HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(refiner->list.mem),
                       HADA_ARG(depths),
                       HADA_ARG(data->spectrum),
                       HADA_ARG(data_offset),
                       HADA_ARG(refiner->now_u.mem),
                       HADA_ARG(prior),
                       HADA_ARG(has_prior),
                       HADA_ARG(doubt),
                       HADA_ARG(has_doubt),
                       HADA_ARG(channels),
                       HADA_ARG(count),
                       HADA_ARG(slice),
                       HADA_ARG(rows),
                       HADA_ARG(block),
                       HADA_ARG(cols),
                       HADA_ARG(high),
                       HADA_ARG(wide),
                       HADA_ARG(refiner->partial.mem)};
    const size_t local[2] = {(size_t)refiner->group, 1};
    const size_t global[2] = {slices_of(count) * local[0], (size_t)r->sets};
    cost_score(r, fmin(1.0, (double)band_rows / layout->rows) * fmin(1.0, (double)band_cols / layout->cols), has_prior,
               has_doubt);
    return hada_slot_launch(refiner->slot, refiner->score, "refine_score", 2, global, local, args, HADA_COUNT(args),
                            err);
}

/* dual = factor * (dual - frame), or factor * dual, with its energy. */
static hada_status meet_frame(const run *r, cl_mem dual, int use_frame, double factor, int step, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    cl_mem frame = use_frame ? r->data->frame : refiner->planes.mem;
    cl_ulong frame_offset = r->data->frame_offset;
    cl_int used = use_frame;
    cl_uint channels = (cl_uint)refiner->shape.channels, pixels = (cl_uint)refiner->frame_area;
    cl_uint slice = HADA_REFINE_SLICE, partial_first = (cl_uint)(refiner->partials * (size_t)step);
    cl_float scale = (float)factor;
    hada_arg args[] = {HADA_ARG(dual),         HADA_ARG(frame),    HADA_ARG(frame_offset),
                       HADA_ARG(used),         HADA_ARG(channels), HADA_ARG(pixels),
                       HADA_ARG(slice),        HADA_ARG(scale),    HADA_ARG(refiner->partial.mem),
                       HADA_ARG(partial_first)};
    const size_t local[2] = {(size_t)refiner->group, 1};
    const size_t global[2] = {slices_of(pixels) * local[0], (size_t)(r->sets * refiner->shape.channels)};
    const double all = (double)r->sets * channels * pixels;
    hada_slot_cost(refiner->slot, 8.0 * all + (use_frame ? 4.0 * channels * pixels : 0), (use_frame ? 4.0 : 3.0) * all);
    return hada_slot_launch(refiner->slot, refiner->frame, "refine_frame", 2, global, local, args, HADA_COUNT(args),
                            err);
}

static hada_status be_positive(const run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t floats = (size_t)(r->sets * r->depths * refiner->shape.channels) * refiner->window_area;
    const size_t group = HADA_REFINE_PAD / 8;
    const size_t local = refiner->slot->context->info.max_work_group < group ? 1 : group;
    const size_t global = (floats + HADA_REFINE_PAD - 1) / HADA_REFINE_PAD * group;
    hada_arg args[] = {HADA_ARG(refiner->planes.mem)};
    hada_slot_cost(refiner->slot, 8.0 * (double)floats, (double)floats);
    return hada_slot_launch(refiner->slot, refiner->prox, "refine_prox", 1, &global, &local, args, 1, err);
}

/* Transforms `images` images in calls of the plan's batch. */
static hada_status transform(hada_refiner *refiner, hada_fft *plan, int forward, int images, cl_mem real,
                             size_t distance, cl_mem spectrum, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int done = 0; !status && done < images; done += HADA_REFINE_BATCH) {
        const int batch = images - done < HADA_REFINE_BATCH ? images - done : HADA_REFINE_BATCH;
        const size_t at = (size_t)done * refiner->layout.count, real_at = (size_t)done * distance;
        status = forward ? hada_fft_forward(plan, batch, real, real_at, spectrum, at, err)
                         : hada_fft_inverse(plan, batch, spectrum, at, real, real_at, NULL, err);
    }
    refiner->transforms += (size_t)images;
    return status;
}

static hada_status planes_forward(const run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(refiner, refiner->forward, 1, r->sets * r->depths * refiner->shape.channels, refiner->planes.mem,
                     refiner->window_area, refiner->now_u.mem, err);
}

static hada_status planes_inverse(const run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(refiner, refiner->inverse, 0, r->sets * r->depths * refiner->shape.channels, refiner->planes.mem,
                     refiner->window_area, refiner->now_w.mem, err);
}

static hada_status frame_forward(const run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(refiner, refiner->frame_forward, 1, r->sets * refiner->shape.channels, refiner->dual.mem,
                     refiner->frame_area, refiner->split_e.mem, err);
}

static hada_status frame_inverse(const run *r, const hada_buffer *spectrum, const hada_buffer *frame, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(refiner, refiner->frame_inverse, 0, r->sets * refiner->shape.channels, frame->mem,
                     refiner->frame_area, spectrum->mem, err);
}

/* Parseval: from energies of spectra to energies of images. */
static double per_pixel(const hada_refiner *refiner)
{
    return 1.0 / ((double)refiner->layout.rows * refiner->layout.cols);
}

/* Brings the partial sums of `count` steps to the host. */
static hada_status fetch(const run *r, int step, int count, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t first = refiner->partials * (size_t)step, floats = refiner->partials * (size_t)count;
    return hada_buffer_read(&refiner->partial, refiner->slot, first * sizeof(float), refiner->host_partial + first,
                            floats * sizeof(float), err);
}

/* Adds a step's partial sums, those of `parts` images a set, up, in order and in double. */
static void add_up(const run *r, int step, int parts, cl_uint slices, double factor, double *energy)
{
    const size_t each = (size_t)parts * slices;
    const float *partial = r->refiner->host_partial + r->refiner->partials * (size_t)step;
    for (int set = 0; set < r->sets; set++) {
        double sum = 0.0;
        for (size_t i = 0; i < each; i++)
            sum += partial[(size_t)set * each + i];
        energy[set] = sum * factor;
    }
}

static hada_status collect(const run *r, int parts, cl_uint slices, double factor, double *energy, hada_error *err)
{
    hada_status status = fetch(r, 0, 1, err);
    if (!status)
        add_up(r, 0, parts, slices, factor, energy);
    return status;
}

static hada_status check_run(const run *r, const int *list, hada_error *err)
{
    const hada_refine_shape *shape = &r->refiner->shape;
    if (r->sets < 1 || r->sets > shape->max_sets || r->depths < 1 || r->sets * r->depths > shape->max_planes)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "refinement: %d sets of %d depths asked for; this refiner takes %d sets and %d planes",
                         r->sets, r->depths, shape->max_sets, shape->max_planes);
    for (int i = 0; i < r->sets * r->depths; i++)
        if (list[i] < 0 || list[i] >= r->data->otf_depths)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "refinement: depth %d asked for; the model has %d", list[i],
                             r->data->otf_depths);
    if (r->padded && !r->data->frame)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "refinement: the padded boundary needs the frame's pixels");
    return HADA_OK;
}

static hada_status begin(run *r, hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                         const int *list, hada_error *err)
{
    *r = (run){refiner, data, sets, depths, refiner->shape.boundary == HADA_BOUNDARY_PADDED};
    hada_status status = check_run(r, list, err);
    if (!status)
        status =
            hada_buffer_write(&refiner->list, refiner->slot, 0, list, (size_t)(sets * depths) * sizeof(cl_int), err);
    return status;
}

/* One change may pass zero on its way: ADMM's residual swings, so two in a row are asked for. */
static int settled(const hada_refiner *refiner, int sets, int step, double stop)
{
    for (int set = 0; set < sets; set++) {
        const double now = sqrt(hada_refiner_energy(refiner, set, step));
        const double before = sqrt(hada_refiner_energy(refiner, set, step - 1));
        if (fabs(before - now) > stop * now)
            return 0;
    }
    return 1;
}

hada_status hada_refiner_run(hada_refiner *refiner, const hada_refine_data *data, const hada_refine_rule *rule,
                             int sets, int depths, const int *list, int *steps, hada_error *err)
{
    run r;
    const hada_spectrum_layout *layout = &refiner->layout;
    const size_t width = (size_t)refiner->shape.max_sets;
    hada_status status = begin(&r, refiner, data, sets, depths, list, err);
    if (!status && (rule->steps < 1 || rule->steps > refiner->shape.max_steps || !(rule->rho > 0.0) ||
                    !(rule->relaxation > 0.0 && rule->relaxation < 2.0) || !(rule->mu > 0.0) || !(rule->growth >= 1.0)))
        status = hada_fail(err, HADA_ERROR_ARGUMENT,
                           "refinement: steps 1 to %d, rho and mu above 0, relaxation between 0 and 2, growth from 1 "
                           "on are possible (got %d, %g, %g, %g, %g)",
                           refiner->shape.max_steps, rule->steps, rule->rho, rule->mu, rule->relaxation, rule->growth);
    if (!status && rule->tv > 0.0 && !refiner->shape.tv)
        status = hada_fail(err, HADA_ERROR_ARGUMENT, "refinement: this refiner was made without total variation");
    /* what a step's energies mean: see hada_refiner_energy() */
    const cl_uint frame_slices = slices_of(refiner->frame_area), slices = slices_of(layout->count);
    const double frame_factor = rule->mu * rule->mu;
    int done = 0, read = 0;
    for (int step = 0; !status && step < rule->steps; step++) {
        const int start = step ? HADA_REFINE_ON : (int)rule->start;
        if (start != HADA_REFINE_COLD)
            status = planes_forward(&r, err);
        if (!status && r.padded && start == HADA_REFINE_ON)
            status = frame_forward(&r, err);
        /* padded: the frame's sums are wanted, of this one only the first; the last place takes the others */
        if (!status)
            status = solve(&r, rule, start, step, r.padded && step ? refiner->shape.max_steps + 1 : step, err);
        if (!status)
            status = planes_inverse(&r, err);
        if (!status)
            status = rule->tv > 0.0 ? hada_refine_tv_step(refiner, sets * depths, rule->tv / rho_at(rule, step),
                                                          start != HADA_REFINE_ON, err)
                                    : be_positive(&r, err);
        if (!status && r.padded)
            status = frame_inverse(&r, &refiner->split_a, &refiner->dual, err);
        if (!status && r.padded)
            status = meet_frame(&r, refiner->dual.mem, 1, 1.0 / (1.0 + rule->mu), step + 1, err);
        done = step + 1;
        const int last = done == rule->steps;
        const int known = r.padded ? done + 1 : done;
        if (!status && (last || rule->stop > 0.0)) {
            status = fetch(&r, read, known - read, err);
            for (; !status && read < known; read++)
                add_up(&r, read, refiner->shape.channels, r.padded && read ? frame_slices : slices,
                       r.padded && read ? frame_factor : per_pixel(refiner), refiner->energy + (size_t)read * width);
        }
        if (!status && rule->stop > 0.0 && read >= 4 && settled(refiner, sets, read - 1, rule->stop) &&
            settled(refiner, sets, read - 2, rule->stop))
            break;
    }
    if (steps)
        *steps = done;
    return status;
}

hada_status hada_refiner_residual(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                  const int *list, double *energy, hada_error *err)
{
    run r;
    hada_status status = begin(&r, refiner, data, sets, depths, list, err);
    if (!status)
        status = planes_forward(&r, err);
    if (!status)
        status = explain(&r, r.padded, err);
    if (status)
        return status;
    if (!r.padded)
        return collect(&r, refiner->shape.channels, slices_of(refiner->layout.count), per_pixel(refiner), energy, err);
    status = frame_inverse(&r, &refiner->rest, &refiner->rest_frame, err);
    if (!status)
        status = meet_frame(&r, refiner->rest_frame.mem, 0, 1.0, 0, err);
    if (!status)
        status = collect(&r, refiner->shape.channels, slices_of(refiner->frame_area), 1.0, energy, err);
    return status;
}

hada_status hada_refiner_score(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                               const int *list, int band_rows, int band_cols, double *energy, hada_error *err)
{
    run r = {refiner, data, 1, 0, 0};
    hada_status status = depths ? begin(&r, refiner, data, sets, depths, list, err) : HADA_OK;
    if (!status && depths)
        status = planes_forward(&r, err);
    if (!status)
        status = score(&r, band_rows, band_cols, err);
    if (!status)
        status = collect(&r, 1, slices_of(refiner->layout.count), per_pixel(refiner), energy, err);
    return status;
}
