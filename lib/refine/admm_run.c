/* Runs of a refiner: steps until a rule stops them, and what planes leave unexplained. */
#include "refine/admm_steps.h"

#include <math.h>
#include <string.h>

#include "launch/filter_hold_out.h"

/* Least traffic and operations, for profiles: a transfer function that several sets share is read once. */
static double frequencies(const hada_refine_run *r)
{
    return (double)r->refiner->layout.rows * (r->refiner->layout.cols / 2 + 1.0) * r->refiner->shape.channels;
}

static double otfs_read(const hada_refine_run *r)
{
    const int all = r->sets * r->depths;
    return all < r->data->otf_depths ? all : r->data->otf_depths;
}

static void cost_solve(const hada_refine_run *r, int start, int has_prior)
{
    const double all = (double)r->sets * r->depths, kept = start == HADA_REFINE_COLD       ? 8
                                                           : start == HADA_REFINE_CONTINUE ? 24
                                                                                           : 16;
    const double data = r->padded ? (start == HADA_REFINE_CONTINUE ? 24.0 * r->sets : 8.0 * r->sets + 8.0) : 8.0;
    hada_slot_cost(r->refiner->slot, frequencies(r) * (8.0 * otfs_read(r) + kept * all + data + (has_prior ? 4 : 0)),
                   frequencies(r) * ((start == HADA_REFINE_COLD ? 20.0 : 44.0) * all + 16.0 * r->sets));
}

static void cost_explain(const hada_refine_run *r, int has_residual)
{
    const double all = (double)r->sets * r->depths;
    hada_slot_cost(r->refiner->slot,
                   frequencies(r) * (8.0 * otfs_read(r) + 8.0 * all + 8.0 + (has_residual ? 8.0 * r->sets : 0)),
                   frequencies(r) * (8.0 * all + 4.0 * r->sets));
}

/* share: of the frequencies that are looked at */
static void cost_score(const hada_refine_run *r, double share, int has_prior, int has_variance)
{
    const double all = (double)r->sets * r->depths, values = share * frequencies(r);
    hada_slot_cost(r->refiner->slot,
                   values * ((has_variance ? 12.0 : 8.0) * otfs_read(r) + 8.0 * all + 8.0 + (has_prior ? 4 : 0)),
                   values * ((has_variance ? 14.0 : 12.0) * all + 6.0 * r->sets));
}

static hada_range slices_range(const hada_refine_run *r, size_t count, int rows, int planes)
{
    return hada_range_groups(hada_refine_slices(count), r->refiner->group, (size_t)rows, (size_t)planes);
}

hada_status hada_refine_solve(const hada_refine_run *r, const hada_refine_rule *rule, int start, int step, int place,
                              hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const hada_refine_step now = hada_refine_step_of(r, rule, start, step, place);
    const hada_range range = slices_range(r, refiner->layout.count, refiner->shape.channels, r->sets);
    cost_solve(r, start, now.has_prior);
    return hada_launch_refine_solve(refiner->slot, refiner->program, &range, err, .otf = data->otf,
                                    .list = refiner->list.ints, .frame = data->spectrum, .prior = data->prior,
                                    .now_u = refiner->now_u.mem, .now_w = refiner->now_w.mem,
                                    .partial = refiner->partial.mem, .now = now);
}

hada_status hada_refine_explain(const hada_refine_run *r, int has_residual, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_range range = slices_range(r, refiner->layout.count, refiner->shape.channels, r->sets);
    cost_explain(r, has_residual);
    return hada_launch_refine_explain(
        refiner->slot, refiner->program, &range, err, .otf = r->data->otf, .list = refiner->list.ints,
        .frame = r->data->spectrum, .now_u = refiner->now_u.mem,
        .residual = has_residual ? refiner->residual.mem : NULL, .has_residual = has_residual,
        .partial = refiner->partial.mem, .problem = hada_refine_problem_of(r, 0));
}

/* What hada_refiner_score() is made of, to `place`. */
static hada_status score(const hada_refine_run *r, const hada_refine_band *band, int place, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_refine_data *data = r->data;
    const hada_spectrum_layout *layout = &refiner->layout;
    const hada_range range = slices_range(r, layout->count, r->sets, 1);
    cost_score(r, fmin(1.0, (double)band->rows / layout->rows) * fmin(1.0, (double)band->cols / layout->cols),
               band->has_prior, band->has_variance);
    return hada_launch_refine_score(refiner->slot, refiner->program, &range, err, .otf = data->otf,
                                    .list = refiner->list.ints, .frame = data->spectrum, .now_u = refiner->now_u.mem,
                                    .prior = data->prior, .variance = data->variance, .partial = refiner->partial.mem,
                                    .problem = hada_refine_problem_of(r, place), .band = *band);
}

/* The launch of the data step on `planes` images of `pixels` pixels each. */
static hada_status frame_step(const hada_refine_run *r, cl_mem a, cl_mem frame, cl_mem weights, size_t planes,
                              const hada_refine_frame_step *now, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const hada_range range =
        hada_range_groups(hada_divide_up(now->pixels, now->sums.slice), r->refiner->group, planes, 1);
    const double all = (double)planes * now->pixels, read = (double)now->channels * now->pixels;
    hada_slot_cost(refiner->slot, 8.0 * all + (now->use_frame ? 4.0 : 0.0) * read + (weights ? 4.0 : 0.0) * read,
                   (now->use_frame ? 4.0 : 3.0) * all);
    return hada_launch_refine_frame(refiner->slot, refiner->program, &range, err, .a = a, .frame = frame,
                                    .weights = weights, .partial = refiner->partial.mem, .now = *now);
}

/* The step on the dual, or the same of a residual b - sum H U, for its energy. */
hada_status hada_refine_frame_dual(const hada_refine_run *r, cl_mem dual, int use_frame, double mu, int step,
                                   hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const int channels = refiner->shape.channels;
    const cl_mem weights = r->data->weights;
    const hada_refine_frame_step now = {.frame_offset = r->data->frame_offset,
                                        .channels = (cl_uint)channels,
                                        .pixels = (cl_uint)refiner->frame_area,
                                        .use_frame = use_frame,
                                        .has_weights = weights != NULL,
                                        /* a residual is b - a */
                                        .scale = !weights    ? (float)(1.0 / (1.0 + mu))
                                                 : use_frame ? 1.0f
                                                             : -1.0f,
                                        .mu = (float)mu,
                                        .sums = hada_refine_sums_at(r, step)};
    return frame_step(r, dual, use_frame ? r->data->frame : NULL, weights, (size_t)(r->sets * channels), &now, err);
}

/* The proximal step of non-negativity on the planes. */
static hada_status nonnegative(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t floats = (size_t)(r->sets * r->depths * refiner->shape.channels) * refiner->window_area;
    const size_t group = HADA_REFINE_PAD / 8;
    const hada_range range = hada_range_of(hada_divide_up(floats, HADA_REFINE_PAD) * group,
                                           refiner->slot->context->info.max_work_group < group ? 1 : group, 1, 1);
    hada_slot_cost(refiner->slot, 8.0 * (double)floats, (double)floats);
    return hada_launch_refine_prox(refiner->slot, refiner->program, &range, err, .w = refiner->planes.mem);
}

/* Partial sums in order and in double. */
static double add(const float *values, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += values[i];
    return sum;
}

/* Of the planes of a run's one set. */
static size_t planes_bytes(const hada_refine_run *r)
{
    return (size_t)(r->depths * r->refiner->shape.channels) * r->refiner->window_area * sizeof(float);
}

static hada_status keep(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return hada_buffer_copy(refiner->slot, refiner->planes.mem, 0, refiner->kept.mem, 0, planes_bytes(r), err);
}

/* The planes as they are now are set aside, and come back; where more than one look is read at once. */
static hada_status set_aside(const hada_refine_run *r, hada_error *err)
{
    const size_t bytes = planes_bytes(r);
    return hada_buffer_copy(r->refiner->slot, r->refiner->planes.mem, 0, r->refiner->kept.mem, bytes, bytes, err);
}

static hada_status take_back(const hada_refine_run *r, hada_error *err)
{
    const size_t bytes = planes_bytes(r);
    return hada_buffer_copy(r->refiner->slot, r->refiner->kept.mem, bytes, r->refiner->planes.mem, 0, bytes, err);
}

/* before = before - planes, or before as it is, with its energies. */
static hada_status energy_before(const hada_refine_run *r, cl_mem before, int use_planes, hada_refine_sums sums,
                                 hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const int images = r->depths * refiner->shape.channels;
    const hada_refine_frame_step now = {.channels = (cl_uint)images,
                                        .pixels = (cl_uint)refiner->window_area,
                                        .use_frame = use_planes,
                                        .scale = 1.0f,
                                        .sums = sums};
    return frame_step(r, before, refiner->planes.mem, NULL, (size_t)images, &now, err);
}

/* Where sums of changes stand behind those of all steps, and how many each look has of either kind. */
static size_t changes_at(const hada_refine_run *r, size_t *count)
{
    *count = (size_t)(r->depths * r->refiner->shape.channels) * hada_refine_slices(r->refiner->window_area);
    return r->refiner->partials * ((size_t)r->refiner->shape.max_steps + 2);
}

hada_status hada_refine_since(const hada_refine_run *r, cl_mem before, hada_error *err)
{
    return energy_before(r, before, 1, (hada_refine_sums){HADA_REFINE_PLACE, 0}, err);
}

/* Measures what has changed since planes were kept, and keeps them anew, as the look number `look` of those that are
 * read together. */
static hada_status change_at(const hada_refine_run *r, size_t look, hada_error *err)
{
    size_t count;
    const size_t first = changes_at(r, &count) + look * 2 * count;
    const cl_mem kept = r->refiner->kept.mem;
    HADA_TRY(energy_before(r, kept, 1, (hada_refine_sums){HADA_REFINE_SLICE, (unsigned)first}, err));
    HADA_TRY(keep(r, err));
    return energy_before(r, kept, 0, (hada_refine_sums){HADA_REFINE_SLICE, (unsigned)(first + count)}, err);
}

/* By what part of themselves (root of energies) the planes changed at each look. */
static hada_status read_changes(const hada_refine_run *r, size_t looks, double *change, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    size_t count;
    const size_t first = changes_at(r, &count);
    const float *sums = refiner->host_partial + first;
    HADA_TRY(hada_buffer_read(&refiner->partial, refiner->slot, first * sizeof(float), refiner->host_partial + first,
                              looks * 2 * count * sizeof(float), err));
    for (size_t i = 0; i < looks; i++, sums += 2 * count) {
        const double planes = add(sums + count, count);
        change[i] = planes > 0.0 ? sqrt(add(sums, count) / planes) : 0.0;
    }
    return HADA_OK;
}

/* All planes, or the channels of all frames; their spectra stand from `offset` on. */
static hada_status transform(const hada_refine_run *r, hada_fft *plan, int each, cl_mem real,
                             const hada_buffer *spectra, size_t offset, hada_error *err)
{
    const int images = r->sets * each * r->refiner->shape.channels;
    r->refiner->transforms += (size_t)images;
    return hada_fft_all(plan, images, real, spectra->mem, offset, err);
}

hada_status hada_refine_planes_forward(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(r, refiner->fft.forward, r->depths, refiner->planes.mem, &refiner->now_u, 0, err);
}

hada_status hada_refine_planes_inverse(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(r, refiner->fft.inverse, r->depths, refiner->planes.mem, &refiner->now_w, 0, err);
}

hada_status hada_refine_frame_forward(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return transform(r, refiner->frame_fft.forward, 1, refiner->dual.mem, &refiner->now_u, refiner->split, err);
}

hada_status hada_refine_frame_inverse(const hada_refine_run *r, const hada_buffer *spectrum, size_t at,
                                      const hada_buffer *frame, hada_error *err)
{
    return transform(r, r->refiner->frame_fft.inverse, 1, frame->mem, spectrum, at, err);
}

/* Brings the sums of `count` places to the host, at once or once the slot was waited for. */
static hada_status fetch(const hada_refine_run *r, int step, int count, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t first = refiner->partials * (size_t)step, floats = refiner->partials * (size_t)count;
    const hada_status status = hada_buffer_read(&refiner->partial, refiner->slot, first * sizeof(float),
                                                refiner->host_partial + first, floats * sizeof(float), err);
    refiner->list_busy &= status != HADA_OK;
    return status;
}

static hada_status fetch_later(const hada_refine_run *r, int step, int count, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t first = refiner->partials * (size_t)step, floats = refiner->partials * (size_t)count;
    return hada_buffer_read_later(&refiner->partial, refiner->slot, first * sizeof(float),
                                  refiner->host_partial + first, floats * sizeof(float), err);
}

/* Adds a place's sums up, those of `parts` images a set, in order and in double. */
static void add_up(const hada_refine_run *r, int step, int parts, size_t slices, double factor, double *energy)
{
    const size_t each = (size_t)parts * slices;
    const float *partial = r->refiner->host_partial + r->refiner->partials * (size_t)step;
    for (int set = 0; set < r->sets; set++)
        energy[set] = add(partial + (size_t)set * each, each) * factor;
}

hada_status hada_refine_energies(const hada_refine_run *r, int parts, size_t slices, double factor, double *energy,
                                 hada_error *err)
{
    HADA_TRY(fetch(r, 0, 1, err));
    add_up(r, 0, parts, slices, factor, energy);
    return HADA_OK;
}

/* What settles is looked at every so many steps, first after so many. */
enum { KEEP_EVERY = 4, KEEP_FIRST = 8 };

static hada_status check_run(const hada_refine_run *r, const int *list, hada_error *err)
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

/* The depths of a run. Its planes are asked about with the same ones, and then they stand there already; before a run
 * others may have used the memory. */
static hada_status put_list(hada_refiner *refiner, const int *list, int count, int again, hada_error *err)
{
    const size_t bytes = (size_t)count * sizeof *list;
    if (again && count == refiner->host_count && !memcmp(list, refiner->host_list, bytes))
        return HADA_OK;
    if (refiner->list_busy)
        HADA_TRY(hada_slot_finish(refiner->slot, err));
    refiner->host_count = 0;
    memcpy(refiner->host_list, list, bytes);
    refiner->list_busy = 1;
    HADA_TRY(hada_buffer_write_later(&refiner->list, refiner->slot, 0, refiner->host_list, bytes, err));
    refiner->host_count = count;
    return HADA_OK;
}

static hada_status begin(hada_refine_run *r, hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                         const int *list, int again, hada_error *err)
{
    *r = (hada_refine_run){.refiner = refiner,
                           .data = data,
                           .sets = sets,
                           .depths = depths,
                           .padded = refiner->shape.boundary == HADA_BOUNDARY_PADDED,
                           .fused = hada_refine_fused_takes(refiner, depths)};
    HADA_TRY(check_run(r, list, err));
    return put_list(refiner, list, sets * depths, again, err);
}

static hada_status check_rule(const hada_refiner *refiner, const hada_refine_rule *rule, hada_error *err)
{
    if (rule->steps < 1 || rule->steps > refiner->shape.max_steps || !(rule->rho > 0.0) ||
        !(rule->relaxation > 0.0 && rule->relaxation < 2.0) || !(rule->mu > 0.0) || !(rule->growth >= 1.0) ||
        !hada_refine_colour_known(rule->tv_colour) || !(rule->noise >= 0.0) || rule->before < 0 ||
        (rule->first_steps > 0 && !(rule->first_relaxation > 0.0 && rule->first_relaxation < 2.0)))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "refinement: steps 1 to %d, rho and mu above 0, relaxation between 0 and 2, growth and the "
                         "weight of colour from 1 on, noise from 0 on are possible (got %d, %g, %g, %g, %g, %g, %g)",
                         refiner->shape.max_steps, rule->steps, rule->rho, rule->mu, rule->relaxation, rule->growth,
                         rule->tv_colour, rule->noise);
    if (rule->tv > 0.0 && (!refiner->shape.tv || (rule->noise > 0.0 && !refiner->shape.ridge)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "refinement: this refiner was made without %s",
                         refiner->shape.tv ? "the learned regulariser" : "total variation");
    if (rule->settle > 0.0 && !refiner->shape.settle)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "refinement: this refiner was made without telling whether planes have settled");
    return HADA_OK;
}

double hada_refiner_energy(const hada_refiner *refiner, int set, int step)
{
    return refiner->energy[(size_t)step * (size_t)refiner->shape.max_sets + (size_t)set];
}

/* One change may pass zero on its way: ADMM's residual swings, so two in a row are asked for. */
static int converged(const hada_refiner *refiner, int sets, int step, double stop)
{
    for (int set = 0; set < sets; set++) {
        const double now = sqrt(hada_refiner_energy(refiner, set, step));
        const double before = sqrt(hada_refiner_energy(refiner, set, step - 1));
        if (fabs(before - now) > stop * now)
            return 0;
    }
    return 1;
}

/* The proximal step on the planes. */
static hada_status constrain(const hada_refine_run *r, const hada_refine_rule *rule, int step, int fresh,
                             hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const cl_mem duals[2] = {refiner->tv[0].mem, refiner->tv[1].mem};
    const int planes = r->sets * r->depths;
    if (!(rule->tv > 0.0))
        return nonnegative(r, err);
    if (rule->noise > 0.0) /* total variation's duals are in the first buffer, and the second is free */
        return hada_ridge_apply(&refiner->ridge, refiner->slot, refiner->planes.mem, duals[1], planes, rule->noise,
                                err);
    return hada_variation_step(&refiner->variation, refiner->slot, refiner->planes.mem, duals, planes,
                               rule->tv / hada_refine_rho_at(rule, step), rule->tv_colour, fresh, err);
}

/* Where the sums of a linear step go. Padded: the energies wanted are those within the frame, but of the frame itself;
 * the last place takes the others. Those of steps that follow a run are not wanted. */
static int place_of(const hada_refine_run *r, const hada_refine_rule *rule, int step)
{
    return (r->padded && step) || rule->noise > 0.0 ? r->refiner->shape.max_steps + 1 : step;
}

/* Step number `step` in passes along columns and along rows. Where the step before was one as well, without total
 * variation, the planes' half spectra stand there. */
static hada_status iterate_fused(const hada_refine_run *r, const hada_refine_rule *rule, int step, hada_error *err)
{
    const int start = step ? HADA_REFINE_CONTINUE : (int)rule->start, tv = rule->tv > 0.0;
    const int asked = rule->scored && hada_refine_fused_scores(r->refiner, r->depths);
    const int forward = HADA_REFINE_TO_SPECTRA, last = step + 1 == rule->steps;
    const int planes = HADA_REFINE_TO_PIXELS | (tv ? 0 : HADA_REFINE_CLIP | (!last || asked ? forward : 0));
    const int frame = r->padded ? HADA_REFINE_TO_PIXELS | (last ? 0 : forward) : 0;
    const int goes_on = r->padded && start == HADA_REFINE_CONTINUE && !step;
    if (start != HADA_REFINE_COLD && (tv || !step))
        HADA_TRY(hada_refine_fused_rows(r, forward, goes_on ? forward : 0, r->refiner->mu, 0, err));
    HADA_TRY(hada_refine_fused_columns(r, rule, start, step, place_of(r, rule, step), err));
    HADA_TRY(hada_refine_fused_rows(r, planes, frame, r->refiner->mu, step + 1, err));
    if (tv)
        HADA_TRY(constrain(r, rule, step, start != HADA_REFINE_CONTINUE, err));
    r->refiner->half_there = planes & forward;
    return HADA_OK;
}

/* Step number `step`: the linear step, then the proximal steps on planes and frame. */
static hada_status iterate(const hada_refine_run *r, const hada_refine_rule *rule, int step, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const int start = step ? HADA_REFINE_CONTINUE : (int)rule->start;
    if (start != HADA_REFINE_COLD)
        HADA_TRY(hada_refine_planes_forward(r, err));
    if (r->padded && start == HADA_REFINE_CONTINUE)
        HADA_TRY(hada_refine_frame_forward(r, err));
    HADA_TRY(hada_refine_solve(r, rule, start, step, place_of(r, rule, step), err));
    HADA_TRY(hada_refine_planes_inverse(r, err));
    HADA_TRY(constrain(r, rule, step, start != HADA_REFINE_CONTINUE, err));
    if (r->padded) {
        HADA_TRY(hada_refine_frame_inverse(r, &refiner->now_w, refiner->split, &refiner->dual, err));
        HADA_TRY(hada_refine_frame_dual(r, refiner->dual.mem, 1, refiner->mu, step + 1, err));
    }
    return HADA_OK;
}

/* Slices that a linear step adds up. */
static size_t step_slices(const hada_refine_run *r)
{
    return r->fused ? hada_refine_fused_slices(r) : hada_refine_slices(r->refiner->layout.count);
}

/* The same within a cropped frame. */
static size_t frame_slices(const hada_refine_run *r)
{
    const hada_refiner *refiner = r->refiner;
    return r->fused ? hada_refine_fused_frame_slices(refiner->slot->context, &refiner->shape)
                    : hada_refine_slices(refiner->frame_area);
}

/* The energies of steps first ... end - 1: see hada_refiner_energy() for what they mean. */
static hada_status read_energies(const hada_refine_run *r, int first, int end, hada_error *err)
{
    const hada_refiner *refiner = r->refiner;
    const size_t width = (size_t)refiner->shape.max_sets;
    HADA_TRY(fetch(r, first, end - first, err));
    for (int step = first; step < end; step++) {
        const int in_frame = r->padded && step;
        add_up(r, step, refiner->shape.channels, in_frame ? frame_slices(r) : step_slices(r),
               in_frame ? refiner->mu * refiner->mu : hada_refine_per_pixel(refiner),
               refiner->energy + (size_t)step * width);
    }
    return HADA_OK;
}

/* Whether the planes have settled after *count steps. Planes seldom have at the first look: where a look leaves the
 * device idle, the first two are read together, and if they had, the planes of the first come back, and *count; not
 * where steps that follow need the split at the frame as well. */
static hada_status look(const hada_refine_run *r, const hada_refine_rule *rule, int *count, int *settled,
                        hada_error *err)
{
    enum { FIRST = KEEP_FIRST + KEEP_EVERY, SECOND = FIRST + KEEP_EVERY };
    const int now = *count, both = !(rule->ridge && r->padded) && hada_refine_looks(r->refiner->slot->context) > 1 &&
                                   SECOND < rule->steps;
    const size_t place = both && now == SECOND;
    double change[2];
    *settled = 0;
    if (now < KEEP_FIRST || now % KEEP_EVERY)
        return HADA_OK;
    HADA_TRY(now == KEEP_FIRST ? keep(r, err) : change_at(r, place, err));
    if (both && now == FIRST)
        HADA_TRY(set_aside(r, err));
    if (now == KEEP_FIRST || (both && now == FIRST))
        return HADA_OK;
    HADA_TRY(read_changes(r, place + 1, change, err));
    *settled = change[place] < rule->settle;
    if (place && change[0] < rule->settle) {
        HADA_TRY(take_back(r, err));
        *count = FIRST;
        *settled = 1;
    }
    return HADA_OK;
}

hada_status hada_refiner_run(hada_refiner *refiner, const hada_refine_data *data, const hada_refine_rule *rule,
                             int sets, int depths, const int *list, int *steps, hada_error *err)
{
    hada_refine_run r;
    int count = 0, read = 0;
    hada_status status = HADA_OK;
    refiner->half_there = 0;
    HADA_TRY_OR_DONE(begin(&r, refiner, data, sets, depths, list, 0, err));
    HADA_TRY_OR_DONE(check_rule(refiner, rule, err));
    if (rule->start != HADA_REFINE_CONTINUE)
        refiner->mu = rule->mu;
    for (int end = rule->steps; count < end;) {
        HADA_TRY_OR_DONE(r.fused ? iterate_fused(&r, rule, count, err) : iterate(&r, rule, count, err));
        count++;
        if (rule->settle > 0.0 && count < end) {
            int settled;
            HADA_TRY_OR_DONE(look(&r, rule, &count, &settled, err));
            end = settled ? count : end;
        }
        if (count < end ? !(rule->stop > 0.0) || count < rule->least : rule->quiet)
            continue;
        const int known = r.padded ? count + 1 : count;
        HADA_TRY_OR_DONE(read_energies(&r, read, known, err));
        read = known;
        if (rule->stop > 0.0 && count >= rule->least && read >= 4 && converged(refiner, sets, read - 1, rule->stop) &&
            converged(refiner, sets, read - 2, rule->stop))
            end = count;
    }
    refiner->last_rho = hada_refine_rho_at(rule, count - 1);
    refiner->last_tv = rule->tv;
    if (!(rule->noise > 0.0))
        refiner->arriving.linear_slices = !r.padded && count > 1 ? step_slices(&r) : 0;
done:
    if (steps)
        *steps = count;
    return status;
}

/* The spectra of what the planes leave and sums over these, to the first place. */
static hada_status explain_spectra(hada_refine_run *r, hada_refiner *refiner, const hada_refine_data *data, int sets,
                                   int depths, const int *list, hada_error *err)
{
    refiner->half_there = 0;
    HADA_TRY(begin(r, refiner, data, sets, depths, list, 1, err));
    HADA_TRY(hada_refine_planes_forward(r, err));
    return hada_refine_explain(r, refiner->residual.mem != NULL, err);
}

hada_status hada_refiner_residual_spectra(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                          const int *list, cl_mem *spectra, hada_error *err)
{
    hada_refine_run r;
    *spectra = refiner->residual.mem;
    return explain_spectra(&r, refiner, data, sets, depths, list, err);
}

hada_status hada_refiner_residual_values(hada_refiner *refiner, const hada_refine_data *data, int depths,
                                         const int *list, float *values, hada_error *err)
{
    const size_t bytes = refiner->frame_area * (size_t)refiner->shape.channels * sizeof *values;
    hada_refine_run r;
    HADA_TRY(explain_spectra(&r, refiner, data, 1, depths, list, err));
    HADA_TRY(hada_refine_frame_inverse(&r, &refiner->residual, 0, &refiner->residual_frame, err));
    HADA_TRY(hada_buffer_read(&refiner->residual_frame, refiner->slot, 0, values, bytes, err));
    refiner->list_busy = 0;
    return HADA_OK;
}

void hada_refiner_waited(hada_refiner *refiner)
{
    refiner->list_busy = 0;
}

/* The means of blocks off errors of values that have weights. */
static hada_status level_blocks(const hada_refiner *refiner, const hada_refine_data *data, hada_error *err)
{
    const int rows = refiner->shape.channels * refiner->shape.frame.rows, cols = refiner->shape.frame.cols;
    const hada_range range = hada_range_of(hada_divide_up((size_t)cols, (size_t)data->level), 8,
                                           hada_divide_up((size_t)rows, (size_t)data->level), 1);
    hada_slot_cost(refiner->slot, 4.0 * rows * cols, 0.0);
    return hada_launch_filter_level_blocks(refiner->slot, HADA_PROGRAM_FILTER_HOLD_OUT_DEFAULT, &range, err,
                                           .side = data->level, .rows = rows, .cols = cols, .held = data->weights,
                                           .values = refiner->residual_frame.mem);
}

/* Sums of what the planes leave, to the first place; refiner->arriving says of how many slices. */
static hada_status explain(hada_refine_run *r, hada_refiner *refiner, const hada_refine_data *data, int sets,
                           int depths, const int *list, hada_error *err)
{
    hada_refine_arriving *arriving = &refiner->arriving;
    HADA_TRY(explain_spectra(r, refiner, data, sets, depths, list, err));
    if (r->padded) {
        HADA_TRY(hada_refine_frame_inverse(r, &refiner->residual, 0, &refiner->residual_frame, err));
        if (data->level)
            HADA_TRY(level_blocks(refiner, data, err));
        HADA_TRY(hada_refine_frame_dual(r, refiner->residual_frame.mem, 0, data->score_mu, 0, err));
    }
    arriving->sets = sets;
    arriving->slices = hada_refine_slices(r->padded ? refiner->frame_area : refiner->layout.count);
    arriving->factor = r->padded ? 1.0 : hada_refine_per_pixel(refiner);
    return HADA_OK;
}

hada_status hada_refiner_residual(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                  const int *list, double *energy, hada_error *err)
{
    const hada_refine_arriving *arriving = &refiner->arriving;
    hada_refine_run r;
    HADA_TRY(explain(&r, refiner, data, sets, depths, list, err));
    return hada_refine_energies(&r, refiner->shape.channels, arriving->slices, arriving->factor, energy, err);
}

hada_status hada_refiner_residual_later(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                        const int *list, hada_error *err)
{
    hada_refine_run r;
    HADA_TRY(explain(&r, refiner, data, sets, depths, list, err));
    return fetch_later(&r, 0, refiner->arriving.linear_slices ? 2 : 1, err);
}

void hada_refiner_residual_arrived(hada_refiner *refiner, double *energy)
{
    const hada_refine_arriving *arriving = &refiner->arriving;
    const hada_refine_run r = {.refiner = refiner, .sets = arriving->sets};
    const int channels = refiner->shape.channels;
    add_up(&r, 0, channels, arriving->slices, arriving->factor, energy);
    if (arriving->linear_slices)
        add_up(&r, 1, channels, arriving->linear_slices, arriving->factor, refiner->energy + refiner->shape.max_sets);
    refiner->list_busy = 0;
}

hada_status hada_refiner_score(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                               const int *list, int band_rows, int band_cols, double *energy, double *frame,
                               hada_error *err)
{
    hada_refine_run r = {.refiner = refiner, .data = data, .sets = 1};
    const hada_refine_run whole = r;
    const hada_refine_band band = {(unsigned)band_rows, (unsigned)band_cols, data->prior != NULL,
                                   data->variance != NULL};
    const int fused = depths && hada_refine_fused_scores(refiner, depths);
    size_t slices = hada_refine_slices(refiner->layout.count);
    if (depths)
        HADA_TRY(begin(&r, refiner, data, sets, depths, list, 1, err));
    if (fused && !refiner->half_there)
        HADA_TRY(hada_refine_fused_rows(&r, HADA_REFINE_TO_SPECTRA, 0, 1.0, 0, err));
    if (depths && !fused)
        HADA_TRY(hada_refine_planes_forward(&r, err));
    HADA_TRY(fused ? hada_refine_fused_score(&r, &band, &slices, err) : score(&r, &band, 0, err));
    refiner->half_there = 0;
    if (frame)
        HADA_TRY(score(&whole, &band, 1, err));
    HADA_TRY(fetch(&r, 0, frame ? 2 : 1, err));
    add_up(&r, 0, 1, slices, hada_refine_per_pixel(refiner), energy);
    if (frame)
        add_up(&whole, 1, 1, hada_refine_slices(refiner->layout.count), hada_refine_per_pixel(refiner), frame);
    return HADA_OK;
}
