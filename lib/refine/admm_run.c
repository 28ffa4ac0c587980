/* Runs of a refiner: steps until a rule stops them, and what planes leave unexplained. */
#include <math.h>
#include <string.h>

#include "launch/filter_hold_out.h"
#include "refine/admm_steps.h"

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
    const double theta = rule->tv / hada_refine_rho_at(rule, step);
    if (!(rule->tv > 0.0))
        return hada_refine_nonnegative(r, err);
    return rule->noise > 0.0 ? hada_refine_ridge_step(r->refiner, r->sets * r->depths, rule->noise, err)
                             : hada_refine_tv_step(r->refiner, r->sets * r->depths, theta, rule->tv_colour, fresh, err);
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
    HADA_TRY(hada_refine_fetch(r, first, end - first, err));
    for (int step = first; step < end; step++) {
        const int in_frame = r->padded && step;
        hada_refine_add_up(r, step, refiner->shape.channels, in_frame ? frame_slices(r) : step_slices(r),
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
    HADA_TRY(now == KEEP_FIRST ? hada_refine_keep(r, err) : hada_refine_change(r, place, err));
    if (both && now == FIRST)
        HADA_TRY(hada_refine_set_aside(r, err));
    if (now == KEEP_FIRST || (both && now == FIRST))
        return HADA_OK;
    HADA_TRY(hada_refine_changes(r, place + 1, change, err));
    *settled = change[place] < rule->settle;
    if (place && change[0] < rule->settle) {
        HADA_TRY(hada_refine_take_back(r, err));
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
    return hada_refine_fetch_later(&r, 0, refiner->arriving.linear_slices ? 2 : 1, err);
}

void hada_refiner_residual_arrived(hada_refiner *refiner, double *energy)
{
    const hada_refine_arriving *arriving = &refiner->arriving;
    const hada_refine_run r = {.refiner = refiner, .sets = arriving->sets};
    const int channels = refiner->shape.channels;
    hada_refine_add_up(&r, 0, channels, arriving->slices, arriving->factor, energy);
    if (arriving->linear_slices)
        hada_refine_add_up(&r, 1, channels, arriving->linear_slices, arriving->factor,
                           refiner->energy + refiner->shape.max_sets);
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
    HADA_TRY(fused ? hada_refine_fused_score(&r, &band, &slices, err) : hada_refine_score(&r, &band, 0, err));
    refiner->half_there = 0;
    if (frame)
        HADA_TRY(hada_refine_score(&whole, &band, 1, err));
    HADA_TRY(hada_refine_fetch(&r, 0, frame ? 2 : 1, err));
    hada_refine_add_up(&r, 0, 1, slices, hada_refine_per_pixel(refiner), energy);
    if (frame)
        hada_refine_add_up(&whole, 1, 1, hada_refine_slices(refiner->layout.count), hada_refine_per_pixel(refiner),
                           frame);
    return HADA_OK;
}
