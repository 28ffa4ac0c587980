#include "refine/admm_steps.h"

#include <math.h>

hada_status hada_refine_prepare(hada_refiner *refiner, hada_error *err)
{
    /* vectors need whole ones of eight frequencies in a row of the layout */
    refiner->program = HADA_PROGRAM_VARIANT(REFINE, refiner->slot->context, refiner->layout.block % 8 == 0);
    refiner->group = (size_t)hada_macros_of_refine(refiner->program)->refine_group;
    return hada_prepare_refine(refiner->slot, refiner->program, err);
}

size_t hada_refine_slices(size_t count)
{
    return hada_divide_up(count, HADA_REFINE_SLICE);
}

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

double hada_refine_rho_at(const hada_refine_rule *rule, int step)
{
    return rule->first_rho > 0.0 ? fmin(rule->rho, rule->first_rho * pow(rule->growth, step + rule->before))
                                 : rule->rho;
}

static double relaxation_at(const hada_refine_rule *rule, int step)
{
    return step + rule->before < rule->first_steps ? rule->first_relaxation : rule->relaxation;
}

/* Sums over slices go to the place `place`, one for each step. */
static hada_refine_sums sums_at(const hada_refine_run *r, int place)
{
    return (hada_refine_sums){HADA_REFINE_SLICE, (unsigned)(r->refiner->partials * (size_t)place)};
}

hada_refine_problem hada_refine_problem_of(const hada_refine_run *r, int place)
{
    return (hada_refine_problem){.otf_offset = r->data->otf_offset,
                                 .frame_offset = r->data->spectrum_offset,
                                 .spectrum = hada_spectrum_shape_of(&r->refiner->layout),
                                 .depths = r->depths,
                                 .channels = (unsigned)r->refiner->shape.channels,
                                 .sums = sums_at(r, place)};
}

static hada_range slices_range(const hada_refine_run *r, size_t count, int rows, int planes)
{
    return hada_range_groups(hada_refine_slices(count), r->refiner->group, (size_t)rows, (size_t)planes);
}

hada_refine_step hada_refine_step_of(const hada_refine_run *r, const hada_refine_rule *rule, int start, int step,
                                     int place)
{
    return (hada_refine_step){
        .problem = hada_refine_problem_of(r, place),
        .split = r->refiner->split,
        .rho = (float)(hada_refine_rho_at(rule, step) / r->refiner->mu),
        .keep = rule->noise > 0.0        ? 0.0f
                : !step && rule->resumes ? (float)(r->refiner->last_rho / hada_refine_rho_at(rule, step))
                : step + rule->before    ? (float)(hada_refine_rho_at(rule, step - 1) / hada_refine_rho_at(rule, step))
                                         : 1.0f,
        .relaxation = start == HADA_REFINE_CONTINUE ? (float)relaxation_at(rule, step) : 1.0f,
        .start = start,
        .padded = r->padded,
        .has_prior = r->data->prior && !(rule->tv > 0.0)};
}

/* Linear step `step` of a run. The sums go to the place `place`. */
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

hada_status hada_refine_score(const hada_refine_run *r, const hada_refine_band *band, int place, hada_error *err)
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
                                        .sums = sums_at(r, step)};
    return frame_step(r, dual, use_frame ? r->data->frame : NULL, weights, (size_t)(r->sets * channels), &now, err);
}

hada_status hada_refine_nonnegative(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t floats = (size_t)(r->sets * r->depths * refiner->shape.channels) * refiner->window_area;
    const size_t group = HADA_REFINE_PAD / 8;
    const hada_range range = hada_range_of(hada_divide_up(floats, HADA_REFINE_PAD) * group,
                                           refiner->slot->context->info.max_work_group < group ? 1 : group, 1, 1);
    hada_slot_cost(refiner->slot, 8.0 * (double)floats, (double)floats);
    return hada_launch_refine_prox(refiner->slot, refiner->program, &range, err, .w = refiner->planes.mem);
}

hada_status hada_refine_tv_step(hada_refiner *refiner, int planes, double theta, double colour, int fresh,
                                hada_error *err)
{
    const cl_mem duals[2] = {refiner->tv[0].mem, refiner->tv[1].mem};
    return hada_variation_step(&refiner->variation, refiner->slot, refiner->planes.mem, duals, planes, theta, colour,
                               fresh, err);
}

hada_status hada_refine_ridge_step(hada_refiner *refiner, int planes, double noise, hada_error *err)
{
    /* total variation's duals are in the first buffer, and the second is free */
    return hada_ridge_apply(&refiner->ridge, refiner->slot, refiner->planes.mem, refiner->tv[1].mem, planes, noise,
                            err);
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

hada_status hada_refine_keep(const hada_refine_run *r, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    return hada_buffer_copy(refiner->slot, refiner->planes.mem, 0, refiner->kept.mem, 0, planes_bytes(r), err);
}

hada_status hada_refine_set_aside(const hada_refine_run *r, hada_error *err)
{
    const size_t bytes = planes_bytes(r);
    return hada_buffer_copy(r->refiner->slot, r->refiner->planes.mem, 0, r->refiner->kept.mem, bytes, bytes, err);
}

hada_status hada_refine_take_back(const hada_refine_run *r, hada_error *err)
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

/* The same of what is kept, with the energies behind those of all steps. */
static hada_status kept_energy(const hada_refine_run *r, int use_planes, size_t first, hada_error *err)
{
    return energy_before(r, r->refiner->kept.mem, use_planes, (hada_refine_sums){HADA_REFINE_SLICE, (unsigned)first},
                         err);
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

hada_status hada_refine_change(const hada_refine_run *r, size_t look, hada_error *err)
{
    size_t count;
    const size_t first = changes_at(r, &count) + look * 2 * count;
    HADA_TRY(kept_energy(r, 1, first, err));
    HADA_TRY(hada_refine_keep(r, err));
    return kept_energy(r, 0, first + count, err);
}

hada_status hada_refine_changes(const hada_refine_run *r, size_t looks, double *change, hada_error *err)
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

/* Parseval: from energies of spectra to energies of images. */
double hada_refine_per_pixel(const hada_refiner *refiner)
{
    return 1.0 / ((double)refiner->layout.rows * refiner->layout.cols);
}

/* Brings the partial sums of `count` steps to the host. */
hada_status hada_refine_fetch(const hada_refine_run *r, int step, int count, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t first = refiner->partials * (size_t)step, floats = refiner->partials * (size_t)count;
    const hada_status status = hada_buffer_read(&refiner->partial, refiner->slot, first * sizeof(float),
                                                refiner->host_partial + first, floats * sizeof(float), err);
    refiner->list_busy &= status != HADA_OK;
    return status;
}

hada_status hada_refine_fetch_later(const hada_refine_run *r, int step, int count, hada_error *err)
{
    hada_refiner *refiner = r->refiner;
    const size_t first = refiner->partials * (size_t)step, floats = refiner->partials * (size_t)count;
    return hada_buffer_read_later(&refiner->partial, refiner->slot, first * sizeof(float),
                                  refiner->host_partial + first, floats * sizeof(float), err);
}

/* Adds a step's partial sums, those of `parts` images a set, up, in order and in double. */
void hada_refine_add_up(const hada_refine_run *r, int step, int parts, size_t slices, double factor, double *energy)
{
    const size_t each = (size_t)parts * slices;
    const float *partial = r->refiner->host_partial + r->refiner->partials * (size_t)step;
    for (int set = 0; set < r->sets; set++)
        energy[set] = add(partial + (size_t)set * each, each) * factor;
}

hada_status hada_refine_energies(const hada_refine_run *r, int parts, size_t slices, double factor, double *energy,
                                 hada_error *err)
{
    HADA_TRY(hada_refine_fetch(r, 0, 1, err));
    hada_refine_add_up(r, 0, parts, slices, factor, energy);
    return HADA_OK;
}
