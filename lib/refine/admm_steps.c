#include "refine/admm_steps.h"

#include <math.h>

hada_status hada_refine_prepare(hada_refiner *refiner, hada_error *err)
{
    /* vectors need whole ones of eight frequencies in a row of the layout */
    refiner->program = refiner->slot->context->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_REFINE_GROUPS
                       : refiner->layout.block % 8                        ? HADA_PROGRAM_REFINE_SCALAR
                                                                          : HADA_PROGRAM_REFINE_DEFAULT;
    refiner->group = (size_t)hada_macros_of_refine(refiner->program)->refine_group;
    return hada_prepare_refine(refiner->slot, refiner->program, err);
}

static size_t slices_of(size_t count)
{
    return hada_divide_up(count, HADA_REFINE_SLICE);
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

static hada_refine_problem problem_of(const run *r)
{
    return (hada_refine_problem){.otf_offset = r->data->otf_offset,
                                 .frame_offset = r->data->spectrum_offset,
                                 .spectrum = hada_spectrum_shape_of(&r->refiner->layout),
                                 .depths = r->depths,
                                 .channels = (unsigned)r->refiner->shape.channels};
}

/* Sums over slices go to the place `place`, one for each step. */
static hada_refine_sums sums_at(const run *r, int place)
{
    return (hada_refine_sums){HADA_REFINE_SLICE, (unsigned)(r->refiner->partials * (size_t)place)};
}

static hada_range slices_range(const run *r, size_t count, int rows, int planes)
{
    return hada_range_groups(slices_of(count), r->refiner->group, (size_t)rows, (size_t)planes);
}

/* Linear step `step` of a run. The sums go to the place `place`. */
static hada_status solve(const run *r, const hada_refine_rule *rule, int start, int step, int place, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const int has_prior = data->prior && !(rule->tv > 0.0);
    const hada_refine_step now = {.rho = (float)rho_at(rule, step),
                                  .keep = step ? (float)(rho_at(rule, step - 1) / rho_at(rule, step)) : 1.0f,
                                  .relaxation = start == HADA_REFINE_ON ? (float)rule->relaxation : 1.0f,
                                  .start = start,
                                  .padded = r->padded,
                                  .has_prior = has_prior};
    const hada_range range = slices_range(r, refiner->layout.count, refiner->shape.channels, r->sets);
    cost_solve(r, start, has_prior);
    /* what a step does not use is some other buffer */
    return hada_launch_refine_solve(
        refiner->slot, refiner->program, &range, err, .otf = data->otf, .list = refiner->list.mem,
        .frame = data->spectrum, .split_a = r->padded ? refiner->split_a.mem : refiner->now_w.mem,
        .split_e = r->padded ? refiner->split_e.mem : refiner->now_u.mem,
        .prior = has_prior ? data->prior : data->spectrum, .now_u = refiner->now_u.mem, .now_w = refiner->now_w.mem,
        .partial = refiner->partial.mem, .problem = problem_of(r), .now = now, .sums = sums_at(r, place));
}

static hada_status explain(const run *r, int has_rest, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_range range = slices_range(r, refiner->layout.count, refiner->shape.channels, r->sets);
    cost_explain(r, has_rest);
    return hada_launch_refine_explain(refiner->slot, refiner->program, &range, err, .otf = r->data->otf,
                                      .list = refiner->list.mem, .frame = r->data->spectrum,
                                      .now_u = refiner->now_u.mem,
                                      .rest = has_rest ? refiner->rest.mem : refiner->now_w.mem, .has_rest = has_rest,
                                      .partial = refiner->partial.mem, .problem = problem_of(r), .sums = sums_at(r, 0));
}

static hada_status score(const run *r, int band_rows, int band_cols, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const hada_spectrum_layout *layout = &refiner->layout;
    const hada_refine_band band = {(unsigned)band_rows, (unsigned)band_cols, data->prior != NULL, data->doubt != NULL};
    const hada_range range = slices_range(r, layout->count, r->sets, 1);
    cost_score(r, fmin(1.0, (double)band_rows / layout->rows) * fmin(1.0, (double)band_cols / layout->cols),
               band.has_prior, band.has_doubt);
    return hada_launch_refine_score(
        refiner->slot, refiner->program, &range, err, .otf = data->otf, .list = refiner->list.mem,
        .frame = data->spectrum, .now_u = refiner->now_u.mem, .prior = band.has_prior ? data->prior : data->spectrum,
        .doubt = band.has_doubt ? data->doubt : data->spectrum, .partial = refiner->partial.mem,
        .problem = problem_of(r), .band = band, .sums = sums_at(r, 0));
}

/* dual = factor * (dual - frame), or factor * dual, with its energy. */
static hada_status meet_frame(const run *r, cl_mem dual, int use_frame, double factor, int step, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const int channels = refiner->shape.channels;
    const hada_range range = slices_range(r, refiner->frame_area, r->sets * channels, 1);
    const double frame = (double)channels * (double)refiner->frame_area, all = r->sets * frame;
    hada_slot_cost(refiner->slot, 8.0 * all + (use_frame ? 4.0 * frame : 0), (use_frame ? 4.0 : 3.0) * all);
    return hada_launch_refine_frame(refiner->slot, refiner->program, &range, err, .a = dual,
                                    .frame = use_frame ? r->data->frame : refiner->planes.mem,
                                    .frame_offset = r->data->frame_offset, .use_frame = use_frame,
                                    .channels = (cl_uint)channels, .pixels = (cl_uint)refiner->frame_area,
                                    .scale = (float)factor, .partial = refiner->partial.mem, .sums = sums_at(r, step));
}

static hada_status be_positive(const run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t floats = (size_t)(r->sets * r->depths * refiner->shape.channels) * refiner->window_area;
    const size_t group = HADA_REFINE_PAD / 8;
    const hada_range range = hada_range_of(hada_divide_up(floats, HADA_REFINE_PAD) * group,
                                           refiner->slot->context->info.max_work_group < group ? 1 : group, 1, 1);
    hada_slot_cost(refiner->slot, 8.0 * (double)floats, (double)floats);
    return hada_launch_refine_prox(refiner->slot, refiner->program, &range, err, .w = refiner->planes.mem);
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
static void add_up(const run *r, int step, int parts, size_t slices, double factor, double *energy)
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

static hada_status collect(const run *r, int parts, size_t slices, double factor, double *energy, hada_error *err)
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
    const size_t frame_slices = slices_of(refiner->frame_area), slices = slices_of(layout->count);
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
