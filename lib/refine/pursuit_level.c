/* The grids of depth pursuit, and the residual that each set of depths leaves of a frame on them. */
#include "refine/pursuit_level.h"

#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "launch/refine.h"

enum { MARGIN = 2 /* pixels: the window is wider by this on every side, for the blur of its edge */ };

/* The unknown is the scene under a Gaussian window over the frequencies that falls to 2^-TAPER at the grid's last ones:
 * a scene cut off there would ring, and ringing is not non-negative. */
#define TAPER 3.0

/* Of rho where it begins: depths part early while it is low. */
#define FIRST_RHO 0.05

static hada_refine_shape shape_of(const hada_pursuit_options *options, const hada_level_spec *spec, double shrink)
{
    const hada_refine_shape *full = &options->shape;
    const int planes = spec->max_sets * options->max_depths;
    hada_refine_shape shape = {.grid_rows = hada_rect_grid_size(full->grid_rows, shrink),
                               .grid_cols = hada_rect_grid_size(full->grid_cols, shrink),
                               .boundary = full->boundary,
                               .channels = spec->separate ? full->channels : 1,
                               .max_sets = spec->max_sets,
                               .max_planes = spec->all_depths && options->depths > planes ? options->depths : planes,
                               .max_steps = spec->max_steps};
    shape.window =
        hada_rect_shrink(&full->window, full->grid_rows, full->grid_cols, shape.grid_rows, shape.grid_cols, 1, MARGIN);
    if (full->boundary == HADA_BOUNDARY_PADDED)
        shape.frame =
            hada_rect_shrink(&full->frame, full->grid_rows, full->grid_cols, shape.grid_rows, shape.grid_cols, 0, 0);
    return shape;
}

/* OTFs of a level: where sets of several sizes may stand side by side, one of a depth that is not there, which is 0. */
static int takes_no_depth(const hada_context *context)
{
    return context->shape == HADA_SHAPE_GROUPS;
}

static size_t otfs_of(const hada_context *context, const hada_pursuit_options *options)
{
    return (size_t)options->depths + (takes_no_depth(context) ? 1 : 0);
}

/* Sets that a run may hold at no more time than one, 0: each costs its own. */
static int room_of(const hada_pursuit_level *l)
{
    return takes_no_depth(l->slot->context) ? l->spec.max_sets : 0;
}

/* Padded: sums of pixels that an energy takes on the device, where sets are many enough to be added up there. */
enum { EVIDENCE_SLICE = 4096 };

static size_t slices_of(const hada_context *context, const hada_refine_shape *evidence)
{
    return takes_no_depth(context) ? hada_divide_up(hada_rect_area(&evidence->frame), EVIDENCE_SLICE) : 0;
}

static size_t sums_bytes(const hada_context *context, const hada_refine_shape *evidence)
{
    return ((size_t)evidence->max_sets + 1) * slices_of(context, evidence) * sizeof(float);
}

/* From spectra to the pixels of the frame, padded boundary. */
static hada_fft_desc frame_plan(const hada_refine_shape *shape, int batch)
{
    return hada_fft_of(HADA_FFT_INVERSE, shape->grid_rows, shape->grid_cols, batch, shape->frame);
}

/* What the padded boundary needs beside. */
static hada_status make_frames(hada_pursuit_level *l, hada_error *err)
{
    static const char what[] = "the depth pursuit";
    hada_context *context = l->slot->context;
    const hada_refine_shape evidence = shape_of(l->options, &l->spec, l->spec.evidence);
    const size_t sets = (size_t)l->spec.max_sets;
    const hada_fft_desc plan = frame_plan(&l->shape, l->shape.channels), back = frame_plan(&evidence, l->spec.max_sets);
    l->evidence_layout = hada_fft_layout(context, evidence.grid_rows, evidence.grid_cols, HADA_FFT_AUTO);
    l->evidence_area = hada_rect_area(&evidence.frame);
    HADA_TRY(hada_buffer_create(
        &l->frame, context, hada_rect_area(&l->shape.frame) * (size_t)l->shape.channels * sizeof(float), what, err));
    HADA_TRY(hada_buffer_create(&l->evidence, context, sets * hada_spectra_bytes(&l->evidence_layout, 1), what, err));
    HADA_TRY(hada_buffer_create(&l->evidence_frame, context, sets * l->evidence_area * sizeof(float), what, err));
    l->evidence_slices = slices_of(context, &evidence);
    if (l->evidence_slices)
        HADA_TRY(hada_buffer_create(&l->evidence_sums, context, sums_bytes(context, &evidence), what, err));
    HADA_TRY(hada_allocated(
        l->host_evidence = hada_alloc(l->evidence_slices ? (sets + 1) * l->evidence_slices : sets * l->evidence_area,
                                      sizeof(float), what, err)));
    HADA_TRY(hada_fft_create(&l->frame_inverse, l->slot, &plan, err));
    return hada_fft_create(&l->evidence_inverse, l->slot, &back, err);
}

hada_status hada_level_create(hada_pursuit_level *l, hada_slot *slot, const hada_pursuit_options *options,
                              const hada_level_spec *spec, hada_error *err)
{
    static const char what[] = "the depth pursuit";
    hada_context *context = slot->context;
    const hada_refine_shape *full = &options->shape;
    *l = (hada_pursuit_level){.slot = slot, .options = options, .spec = *spec};
    l->shape = shape_of(options, spec, spec->shrink);
    l->full = hada_fft_layout(context, full->grid_rows, full->grid_cols, HADA_FFT_AUTO);
    l->layout = hada_fft_layout(context, l->shape.grid_rows, l->shape.grid_cols, HADA_FFT_AUTO);
    const size_t spectrum = hada_spectra_bytes(&l->layout, l->shape.channels), depths = otfs_of(context, options);
    const size_t there = (size_t)options->depths * spectrum, last = depths * spectrum - there;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_refiner_create(&l->refiner, slot, &l->shape, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&l->otf, context, depths * spectrum, what, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&l->prior, context, spectrum / 2, what, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&l->variance, context, depths * spectrum / 2, what, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&l->spectrum, context, spectrum, what, err));
    if (last) {
        HADA_TRY_OR_DONE(hada_buffer_clear(&l->otf, slot, there, last, err));
        HADA_TRY_OR_DONE(hada_buffer_clear(&l->variance, slot, there / 2, last / 2, err));
    }
    if (l->shape.boundary == HADA_BOUNDARY_PADDED)
        HADA_TRY_OR_DONE(make_frames(l, err));
    HADA_TRY_OR_DONE(hada_prepare_refine(slot, HADA_PROGRAM_REFINE_DEFAULT, err));
done:
    if (status)
        hada_level_destroy(l);
    return status;
}

void hada_level_destroy(hada_pursuit_level *l)
{
    hada_refiner_destroy(&l->refiner);
    hada_fft_destroy(&l->frame_inverse);
    hada_fft_destroy(&l->evidence_inverse);
    hada_buffer *buffers[] = {&l->otf,   &l->prior,    &l->variance,       &l->spectrum,
                              &l->frame, &l->evidence, &l->evidence_frame, &l->evidence_sums};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    free(l->host_evidence);
    l->host_evidence = NULL;
}

/* How images of one layout become images of another: see refine_crop in kernels/refine.cl. */
typedef struct crop {
    const hada_spectrum_layout *from, *to;
    int channels; /* of an image that is read; one is written */
    int parts;    /* 2: complex */
    double factor, tapers;
    int invert;
} crop;

static hada_status crop_images(hada_pursuit_level *l, const crop *how, cl_mem in, size_t in_offset, int images,
                               const hada_buffer *out, int first_image, hada_error *err)
{
    const int rows = how->to->rows, cols = how->to->cols, block = how->to->block;
    const hada_range range =
        hada_range_of((size_t)how->to->blocks * (size_t)block, block < 8 ? 1 : 8, (size_t)rows, (size_t)images);
    const hada_refine_crop numbers = {.parts = how->parts,
                                      .channels = how->channels,
                                      .factor = (float)how->factor,
                                      .tapers = (float)how->tapers,
                                      .invert = how->invert};
    hada_slot_cost(l->slot, 4.0 * how->parts * images * (how->channels + 1.0) * rows * (cols / 2 + 1.0), 0);
    return hada_launch_refine_crop(l->slot, HADA_PROGRAM_REFINE_DEFAULT, &range, err, .in = in, .in_offset = in_offset,
                                   .in_shape = hada_spectrum_shape_of(how->from), .out = out->mem,
                                   .out_offset = (cl_uint)((size_t)first_image * how->to->count),
                                   .out_shape = hada_spectrum_shape_of(how->to), .crop = numbers);
}

/* A crop of the camera's images: to one of their mean, or channel by channel. */
static crop of_camera(const hada_pursuit_level *l, int parts, double tapers)
{
    return (crop){.from = &l->full,
                  .to = &l->layout,
                  .channels = l->spec.separate ? 1 : l->options->shape.channels,
                  .parts = parts,
                  .factor = 1.0,
                  .tapers = tapers * TAPER};
}

/* Image values are kept by the ratio of the sizes; OTFs are values already. */
static double area_ratio(const hada_spectrum_layout *to, const hada_spectrum_layout *from)
{
    return (double)to->rows * to->cols / ((double)from->rows * from->cols);
}

hada_status hada_level_set_otf(hada_pursuit_level *l, cl_mem otf, size_t offset, hada_error *err)
{
    const crop how = of_camera(l, 2, -1.0);
    return crop_images(l, &how, otf, offset, l->options->depths * l->shape.channels, &l->otf, 0, err);
}

hada_status hada_level_set_prior(hada_pursuit_level *l, cl_mem prior, hada_error *err)
{
    crop how = of_camera(l, 1, -2.0);
    how.factor = 1.0 / how.channels; /* the noise of a mean of channels is smaller than theirs */
    l->has_prior = 1;
    return crop_images(l, &how, prior, 0, l->shape.channels, &l->prior, 0, err);
}

hada_status hada_level_set_power(hada_pursuit_level *l, int depth, cl_mem power, hada_error *err)
{
    const double ratio = area_ratio(&l->layout, &l->full);
    crop how = of_camera(l, 1, 2.0);
    how.factor = how.channels * ratio * ratio;
    how.invert = 1;
    l->has_variance = 1;
    return crop_images(l, &how, power, 0, l->shape.channels, &l->variance, depth * l->shape.channels, err);
}

/* Padded: `sets` spectra [set][channel] within the frame, at the frequencies of the evidence; where sums are taken on
 * the device, these too, from place `first` on. */
static hada_status show(hada_pursuit_level *l, cl_mem spectra, int sets, int first, hada_error *err)
{
    const crop how = {.from = &l->layout,
                      .to = &l->evidence_layout,
                      .channels = l->shape.channels,
                      .parts = 2,
                      .factor = area_ratio(&l->evidence_layout, &l->layout)};
    const double pixels = (double)sets * (double)l->evidence_area;
    const hada_refine_frame_step now = {.channels = 1,
                                        .pixels = (cl_uint)l->evidence_area,
                                        .scale = 1.0f,
                                        .sums = {EVIDENCE_SLICE, (unsigned)((size_t)first * l->evidence_slices)}};
    const size_t group = (size_t)hada_macros_of_refine(HADA_PROGRAM_REFINE_GROUPS)->refine_group;
    const hada_range range = hada_range_groups(l->evidence_slices, group, (size_t)sets, 1);
    HADA_TRY(crop_images(l, &how, spectra, 0, sets, &l->evidence, 0, err));
    HADA_TRY(hada_fft_inverse(l->evidence_inverse, sets, l->evidence.mem, 0, l->evidence_frame.mem, 0, NULL, err));
    if (!l->evidence_slices)
        return HADA_OK;
    hada_slot_cost(l->slot, 8.0 * pixels, 3.0 * pixels);
    HADA_TRY(hada_launch_refine_frame(l->slot, HADA_PROGRAM_REFINE_GROUPS, &range, err, .a = l->evidence_frame.mem,
                                      .frame = NULL, .weights = NULL, .partial = l->evidence_sums.mem, .now = now));
    return HADA_OK;
}

/* The energies of `count` places that were shown, from the first one on: sums on the device, or else pixels. */
static hada_status measure(hada_pursuit_level *l, int count, double *energy, hada_error *err)
{
    const hada_buffer *from = l->evidence_slices ? &l->evidence_sums : &l->evidence_frame;
    const size_t each = l->evidence_slices ? l->evidence_slices : l->evidence_area;
    HADA_TRY(hada_buffer_read(from, l->slot, 0, l->host_evidence, (size_t)count * each * sizeof(float), err));
    hada_refiner_waited(l->refiner);
    for (size_t set = 0; set < (size_t)count; set++) {
        energy[set] = 0.0;
        for (size_t i = set * each; i < (set + 1) * each; i++)
            energy[set] += l->evidence_slices ? l->host_evidence[i] : (double)l->host_evidence[i] * l->host_evidence[i];
    }
    return HADA_OK;
}

static hada_refine_data data_of(const hada_pursuit_level *l)
{
    return (hada_refine_data){.spectrum = l->spectrum.mem,
                              .frame = l->frame.mem,
                              .otf = l->otf.mem,
                              .otf_depths = (int)otfs_of(l->slot->context, l->options),
                              .prior = l->has_prior ? l->prior.mem : NULL,
                              .variance = l->has_variance ? l->variance.mem : NULL};
}

/* Rows and columns of the grid whose frequencies count. */
static void band_of(const hada_pursuit_level *l, int *rows, int *cols)
{
    *rows = hada_rect_grid_size(l->options->shape.grid_rows, l->spec.evidence);
    *cols = hada_rect_grid_size(l->options->shape.grid_cols, l->spec.evidence);
}

void hada_level_set_frame(hada_pursuit_level *l, cl_mem spectrum, double scale)
{
    l->whole = spectrum;
    l->scale = scale;
    l->loaded = l->measured = 0;
}

/* Brings the frame in hand to the grid, unless it is there. */
static hada_status load_frame(hada_pursuit_level *l, hada_error *err)
{
    crop how = of_camera(l, 2, 0.0);
    if (l->loaded)
        return HADA_OK;
    how.factor = l->scale * area_ratio(&l->layout, &l->full);
    HADA_TRY(crop_images(l, &how, l->whole, 0, l->shape.channels, &l->spectrum, 0, err));
    if (l->frame_inverse)
        HADA_TRY(hada_fft_inverse(l->frame_inverse, l->shape.channels, l->spectrum.mem, 0, l->frame.mem, 0, NULL, err));
    l->loaded = 1;
    return HADA_OK;
}

/* Padded: the frame's energy alone. */
static hada_status measure_frame(hada_pursuit_level *l, hada_error *err)
{
    HADA_TRY(show(l, l->spectrum.mem, 1, 0, err));
    return measure(l, 1, &l->energy, err);
}

/* The frame's own energy, measured as that of residuals is. */
static hada_status frame_energy(hada_pursuit_level *l, double *energy, hada_error *err)
{
    const hada_refine_data data = data_of(l);
    int rows, cols;
    HADA_TRY(load_frame(l, err));
    band_of(l, &rows, &cols);
    if (!l->measured)
        HADA_TRY(l->evidence_inverse
                     ? measure_frame(l, err)
                     : hada_refiner_score(l->refiner, &data, 1, 0, NULL, rows, cols, &l->energy, NULL, err));
    l->measured = 1;
    *energy = l->energy;
    return HADA_OK;
}

/* Padded: only what is missing within the frame counts. */
static hada_status residuals_within(hada_pursuit_level *l, const hada_refine_data *data, int sets, int depths,
                                    const int *list, int with_frame, double *residual, hada_error *err)
{
    double energies[HADA_PURSUIT_DEPTHS + 1];
    cl_mem spectra;
    HADA_TRY(hada_refiner_residual_spectra(l->refiner, data, sets, depths, list, &spectra, err));
    HADA_TRY(show(l, spectra, sets, 0, err));
    if (with_frame)
        HADA_TRY(show(l, l->spectrum.mem, 1, sets, err));
    HADA_TRY(measure(l, sets + with_frame, energies, err));
    memcpy(residual, energies, (size_t)sets * sizeof *residual);
    if (with_frame)
        l->energy = energies[sets];
    return HADA_OK;
}

/* The residuals of sets that were just refined. Where looks are waited for, the first one brings the frame's energy. */
static hada_status residuals(hada_pursuit_level *l, const hada_refine_data *data, int sets, int depths, const int *list,
                             double *residual, hada_error *err)
{
    const int with_frame = room_of(l) && !l->measured;
    int rows, cols;
    band_of(l, &rows, &cols);
    HADA_TRY(l->evidence_inverse ? residuals_within(l, data, sets, depths, list, with_frame, residual, err)
                                 : hada_refiner_score(l->refiner, data, sets, depths, list, rows, cols, residual,
                                                      with_frame ? &l->energy : NULL, err));
    l->measured |= with_frame;
    return HADA_OK;
}

/* A place of a set that has none. Only for levels with room. */
enum { NO_DEPTH = -1 };

/* residual[k]: the energy that set k of list[sets][depths], refined from nothing by `steps` steps, in which rho grows
 * by the factor `growth` each, leaves unexplained of the mean over channels, at the frequencies of the evidence. */
static hada_status residuals_of_list(hada_pursuit_level *l, int steps, double growth, int sets, int depths,
                                     const int *list, double *residual, hada_error *err)
{
    const hada_refine_data data = data_of(l);
    int places[HADA_PURSUIT_DEPTHS * HADA_PURSUIT_MAX];
    hada_refine_rule rule;
    HADA_TRY(load_frame(l, err));
    hada_refine_rule_init(&rule);
    rule.rho = l->options->rho;
    rule.first_rho = FIRST_RHO * rule.rho;
    rule.growth = growth;
    rule.steps = steps;
    rule.quiet = 1;
    rule.scored = !l->evidence_inverse;
    for (int first = 0; first < sets; first += l->spec.max_sets) {
        const int n = sets - first < l->spec.max_sets ? sets - first : l->spec.max_sets, *part = places;
        for (int i = 0; i < n * depths; i++) {
            const int depth = list[first * depths + i];
            places[i] = depth == NO_DEPTH ? l->options->depths : depth;
        }
        HADA_TRY(hada_refiner_run(l->refiner, &data, &rule, n, depths, part, NULL, err));
        HADA_TRY(residuals(l, &data, n, depths, part, residual + first, err));
    }
    return HADA_OK;
}

int hada_set_same(const hada_set *a, const hada_set *b)
{
    return a->count == b->count && !memcmp(a->depth, b->depth, (size_t)a->count * sizeof *a->depth);
}

void hada_residuals_forget(hada_pursuit *p)
{
    free(p->known);
    p->known = NULL;
    p->known_count = 0;
    p->ahead_count = 0;
}

static hada_pursuit_level *level_of(hada_pursuit *p, hada_fidelity fidelity)
{
    return &p->levels[p->fidelity[fidelity].level];
}

/* Fidelities differ in steps or in grid: where two are the same, the first one's results serve. */
static hada_fidelity first_alike(const hada_pursuit *p, hada_fidelity fidelity)
{
    for (int i = 0; i < (int)fidelity; i++)
        if (p->fidelity[i].level == p->fidelity[fidelity].level && p->fidelity[i].steps == p->fidelity[fidelity].steps)
            return (hada_fidelity)i;
    return fidelity;
}

static const hada_known_residual *find(const hada_pursuit *p, hada_fidelity fidelity, const hada_set *set)
{
    for (size_t i = 0; i < p->known_count; i++)
        if (p->known[i].fidelity == fidelity && hada_set_same(&p->known[i].set, set))
            return &p->known[i];
    return NULL;
}

hada_status hada_residuals_frame(hada_pursuit *p, hada_fidelity fidelity, double *energy, hada_error *err)
{
    return frame_energy(level_of(p, fidelity), energy, err);
}

void hada_residuals_ahead(hada_pursuit *p, hada_fidelity fidelity, const hada_set *sets, int count)
{
    for (int i = 0; i < count && p->ahead_count < HADA_RESIDUALS_AHEAD; i++) {
        p->ahead_fidelity[p->ahead_count] = first_alike(p, fidelity);
        p->ahead[p->ahead_count++] = sets[i];
    }
}

/* Sets that are to be refined side by side: those that are not known yet. */
typedef struct batch {
    const hada_set *sets[HADA_PURSUIT_DEPTHS];
    int count, places;
} batch;

static void add_unknown(batch *all, const hada_pursuit *p, hada_fidelity fidelity, const hada_set *set)
{
    if (!set->count || find(p, fidelity, set))
        return;
    for (int i = 0; i < all->count; i++)
        if (hada_set_same(all->sets[i], set))
            return;
    all->sets[all->count++] = set;
    all->places = set->count > all->places ? set->count : all->places;
}

/* Those of this fidelity that there is room for. What is left of them is forgotten, the others wait. */
static void take_ahead(batch *all, hada_pursuit *p, hada_fidelity fidelity)
{
    const int room = room_of(level_of(p, fidelity));
    int kept = 0;
    for (int i = 0; i < p->ahead_count; i++) {
        if (p->ahead_fidelity[i] != fidelity) {
            p->ahead_fidelity[kept] = p->ahead_fidelity[i];
            p->ahead[kept++] = p->ahead[i];
        } else if (all->count < room) {
            p->taken[all->count] = p->ahead[i];
            add_unknown(all, p, fidelity, &p->taken[all->count]);
        }
    }
    p->ahead_count = kept;
}

/* Refines them and takes down what they leave. Smaller sets have places without a depth, which stay dark. */
static hada_status refine(hada_pursuit *p, hada_fidelity fidelity, const batch *all, hada_error *err)
{
    int list[HADA_PURSUIT_DEPTHS * HADA_PURSUIT_MAX];
    double energy[HADA_PURSUIT_DEPTHS];
    for (int i = 0; i < all->count; i++)
        for (int k = 0; k < all->places; k++)
            list[i * all->places + k] = k < all->sets[i]->count ? all->sets[i]->depth[k] : NO_DEPTH;
    HADA_TRY(HADA_GROW(p->known, p->known_count, (size_t)all->count, "the depth pursuit", err));
    const hada_effort *effort = &p->fidelity[fidelity];
    HADA_TRY(residuals_of_list(level_of(p, fidelity), effort->steps, effort->growth, all->count, all->places, list,
                               energy, err));
    for (int i = 0; i < all->count; i++)
        p->known[p->known_count++] = (hada_known_residual){fidelity, *all->sets[i], energy[i]};
    return HADA_OK;
}

hada_status hada_residuals_of(hada_pursuit *p, hada_fidelity asked, const hada_set *sets, int count, double *energy,
                              hada_error *err)
{
    const hada_fidelity fidelity = first_alike(p, asked);
    batch all = {0};
    if (!sets[0].count)
        return hada_residuals_frame(p, fidelity, energy, err);
    for (int i = 0; i < count; i++)
        add_unknown(&all, p, fidelity, &sets[i]);
    if (all.count)
        take_ahead(&all, p, fidelity);
    if (all.count)
        HADA_TRY(refine(p, fidelity, &all, err));
    for (int i = 0; i < count; i++)
        energy[i] = find(p, fidelity, &sets[i])->energy;
    return HADA_OK;
}

hada_status hada_residuals_of_all(hada_pursuit *p, double *energy, hada_error *err)
{
    int list[HADA_PURSUIT_DEPTHS];
    for (int depth = 0; depth < p->options.depths; depth++)
        list[depth] = depth;
    const hada_effort *effort = &p->fidelity[HADA_FIDELITY_COARSE];
    return residuals_of_list(level_of(p, HADA_FIDELITY_COARSE), effort->steps, effort->growth, 1, p->options.depths,
                             list, energy, err);
}
