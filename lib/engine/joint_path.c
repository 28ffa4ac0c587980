/* The joint path: planes of the occupied depths that explain the frame together, by refinement or a classic method.
 */

#include "engine/stages.h"
#include "filter/hadamard.h"
#include "image/mosaic.h"

/* What is known of a frame: `count` depths are in pipeline->occupied; the energy that planes leave after a few steps,
 * and that a surface leaves, which is in pipeline->surface. */
typedef struct knowledge {
    int count;
    hada_pursuit_result found; /* zeros where the caller listed the depths */
    double planes, surface;    /* energies; negative: not known */
    double vain;               /* no surface was found that leaves less than this; 0: not searched */
    int solved;                /* 1: the refiner holds the planes of these first steps */
    int volume;                /* 1: it is a volume, whatever the others say */
} knowledge;

static void take_found(hada_pipeline *pipeline, knowledge *k)
{
    k->count = k->found.all ? pipeline->setup->config.depths : k->found.count;
    for (int i = 0; i < k->count; i++)
        pipeline->occupied[i] = k->found.all ? i : k->found.list[i];
}

/* By what a frame is brought to the units of the pairs where it must be in others, as floats that count electrons: no
 * exposure is so much longer. How well the pairs knew a camera matters where depths are found, and was learned there.
 */
static double scale_of(const hada_pipeline *pipeline, const hada_frame *frame)
{
    const double longest = 16.0;
    const double brighter = pipeline->usual_energy > 0.0 ? sqrt(frame->exposure.energy / pipeline->usual_energy) : 0.0;
    return brighter > longest ? longest / brighter : 1.0;
}

/* Which computed depths the frame occupies. */
static hada_status pursue(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "pursuit");
    HADA_TRY(
        hada_pursuit_run(pipeline->pursuit, pipeline->stage->spectrum.mem, scale_of(pipeline, frame), &k->found, err));
    take_found(pipeline, k);
    hada_frame_progress(frame, 1 + HADA_WORK_PURSUIT);
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_pursuit, err);
}

static void take_listed(hada_pipeline *pipeline, knowledge *k)
{
    for (int z = 0; z < pipeline->setup->config.depths; z++)
        if (pipeline->setup->listed[z])
            pipeline->occupied[k->count++] = z;
}

/* Where saturated values are more than this share of a frame, refinement takes more steps, and the split at the frame
 * has less weight (perf/results/weights.md); not in planes that are compared with a surface. */
#define MANY_SATURATED 0.04
#define SATURATED_MU   0.1

static int is_saturated(const hada_frame_exposure *exposure)
{
    return (double)exposure->saturated > MANY_SATURATED * (double)hada_exposure_count(exposure);
}

/* settle: several depths are refined until they no longer change. */
static hada_status refine(hada_pipeline *pipeline, hada_frame *frame, int count, int settle, int last, hada_error *err)
{
    const hada_setup *setup = pipeline->setup;
    const double given = setup->config.weights.tv;
    const int psf_alone = hada_model_get_info(setup->model)->refine_tv == HADA_AUTO; /* rho was not fitted either */
    const int last_steps = hada_maker_ridge_steps(&pipeline->maker, setup->config.steps);
    const int saturated = is_saturated(&frame->exposure) && (settle || last || count == 1),
              is_wrapping = hada_model_get_info(setup->model)->boundary == HADA_BOUNDARY_CIRCULAR,
              whole = saturated ? setup->config.saturated_steps : setup->config.steps;
    const hada_maker_steps steps = {.steps = whole - last_steps,
                                    .whole = whole,
                                    .mu = saturated && (count > 1 || is_wrapping) ? SATURATED_MU : 0.0,
                                    .stop = setup->options.refine >= 0 ? 0
                                            : settle                   ? count
                                                                       : 1,
                                    .tv = psf_alone ? given : 0.0};
    hada_report *report = &frame->result->memory->report;
    hada_maker_choice choice = {0};
    if (setup->config.choose) /* may be known from planes that were refined before, or from an earlier frame */
        choice = (hada_maker_choice){.tv = report->refine_tv > 0.0 ? report->refine_tv : frame->kept_tv,
                                     .factor = report->refine_tv_factor};
    if (last && setup->config.warm)
        HADA_TRY(hada_maker_go_on(&pipeline->maker, &frame->exposure, &steps, count, pipeline->occupied,
                                  &pipeline->past, &choice, &report->refine_steps, &report->warm_started, err));
    else
        HADA_TRY(hada_maker_refine_exposure(&pipeline->maker, &frame->exposure, &steps, count, pipeline->occupied,
                                            &choice, &report->refine_steps, err));
    report->gain = report->warm_started ? pipeline->past.gain : 0.0;
    report->refine_tv = setup->config.choose ? choice.tv : given;
    report->refine_tv_factor = choice.factor;
    report->refine_tv_kept = frame->kept_tv > 0.0;
    HADA_TRY(hada_refiner_residual_later(pipeline->refiner, &pipeline->maker.data, 1, count, pipeline->occupied, err));
    pipeline->residual_due = 1;
    return HADA_OK;
}

typedef struct classic_progress {
    hada_frame *frame;
    int before; /* units of work */
} classic_progress;

static void tell_progress(void *user, int iterations)
{
    const classic_progress *now = user;
    hada_frame_progress(now->frame, now->before + iterations);
}

static hada_status solve_classic(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err)
{
    const hada_config *config = &pipeline->setup->config;
    const hada_frame_exposure *exposure = &frame->exposure;
    hada_plane_maker *maker = &pipeline->maker;
    hada_report *report = &frame->result->memory->report;
    classic_progress progress = {frame, 1};
    hada_classic_job job = {.data = &maker->data,
                            .camera = &pipeline->setup->camera,
                            .depths = count,
                            .list = pipeline->occupied,
                            .weight = config->method.options.weight,
                            .brightness = hada_exposure_light(exposure),
                            .progress = tell_progress,
                            .user = &progress};
    hada_classic_result result;
    if (frame->kept_tv > 0.0) {
        job.weight = frame->kept_tv;
        report->refine_tv_kept = 1;
    } else if (config->choose) {
        hada_maker_choice choice;
        HADA_TRY(hada_maker_hold_out(maker, exposure, 1, 0, err));
        HADA_TRY(hada_classic_choose(pipeline->classic, &job, maker->held.mem, exposure, &choice, err));
        job.weight = choice.tv;
        report->refine_tv_factor = choice.factor;
        progress.before += hada_classic_search_most(&config->method);
    }
    HADA_TRY(hada_maker_weigh(maker, exposure, err));
    if (config->method.sieve)
        return hada_pipeline_solve_volume(pipeline, frame, err);
    HADA_TRY(hada_classic_run(pipeline->classic, &job, &result, err));
    report->method = config->method.options.method;
    report->scene = config->scene == HADA_SCENE_VOLUME ? HADA_SCENE_VOLUME : HADA_SCENE_PLANES;
    report->refine_steps = result.iterations;
    report->refine_tv = config->method.options.prior == HADA_PRIOR_TV ? job.weight : 0.0;
    if (frame->exposure.energy > 0)
        report->residual = sqrt(result.energy / frame->exposure.energy);
    return HADA_OK;
}

/* The last steps of refined planes, with the learned regulariser. What they leave of the frame was measured before. */
static hada_status regularise(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err)
{
    hada_report *report = &frame->result->memory->report;
    int steps = hada_maker_ridge_steps(&pipeline->maker, pipeline->setup->config.steps);
    if (pipeline->classic)
        return HADA_OK;
    if (pipeline->past.kept && steps > pipeline->past.ridge)
        steps = pipeline->past.ridge;
    hada_slot_stage(pipeline->slot, "refine");
    HADA_TRY(hada_maker_regularise(&pipeline->maker, steps, report->refine_tv, count, pipeline->occupied,
                                   &report->refine_steps, err));
    return hada_pipeline_lap(pipeline, frame, &report->seconds_refine, err);
}

static hada_status solve(hada_pipeline *pipeline, hada_frame *frame, int count, int settle, int last, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "refine");
    HADA_TRY(pipeline->classic ? solve_classic(pipeline, frame, count, err)
                               : refine(pipeline, frame, count, settle, last, err));
    hada_frame_progress(frame, frame->work - 1);
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_refine, err);
}

/* What has the planes: a classic method, of a plan or of a frame that is a volume; NULL: the refiner. */
static const hada_classic *classic_of(const hada_pipeline *pipeline, const hada_frame *frame)
{
    return frame->result->memory->report.scene == HADA_SCENE_VOLUME && pipeline->volume ? pipeline->volume
                                                                                        : pipeline->classic;
}

static cl_mem planes_of(const hada_pipeline *pipeline, const hada_frame *frame)
{
    const hada_classic *classic = classic_of(pipeline, frame);
    return classic ? hada_classic_planes(classic) : hada_refiner_planes(pipeline->refiner);
}

/* The refined plane and that of the linear filter, as their errors on held-out pairs say. Only of a single depth: each
 * linear plane holds the light of all depths (docs/explanation/refinement.md). */
static hada_status blend(hada_pipeline *pipeline, const hada_frame *frame, int count, hada_error *err)
{
    const double share = pipeline->setup->config.share;
    if (share >= 1.0 || count != 1 || classic_of(pipeline, frame))
        return HADA_OK;
    HADA_TRY(hada_hadamard_run(pipeline->stage, pipeline->constants->bank, pipeline->occupied[0], 1,
                               pipeline->planes.mem, 0, err));
    return hada_image_blend(pipeline->slot, planes_of(pipeline, frame), 0, pipeline->planes.mem,
                            hada_plane_values(hada_model_get_info(pipeline->setup->model)), share, err);
}

/* The planes are in the order of pipeline->occupied. */
static hada_status focus(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err)
{
    hada_slot_stage(pipeline->slot, "focus");
    HADA_TRY(hada_focus_begin(pipeline->focus, frame->result->memory->occupied, err));
    HADA_TRY(hada_focus_push_list(pipeline->focus, pipeline->occupied, count, planes_of(pipeline, frame), err));
    HADA_TRY(hada_slot_finish(pipeline->slot, err));
    hada_pipeline_residual(pipeline, frame);
    return hada_pipeline_pictures(pipeline, frame, hada_pipeline_noise_light(frame), err);
}

static hada_status read_planes(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err)
{
    const size_t values = hada_plane_values(hada_model_get_info(pipeline->setup->model));
    const hada_buffer planes = {.mem = planes_of(pipeline, frame), .bytes = values * (size_t)count * sizeof(float)};
    for (int i = 0, next; i < count; i = next) {
        /* depths that follow each other, at once */
        for (next = i + 1; next < count && pipeline->occupied[next] == pipeline->occupied[next - 1] + 1;)
            next++;
        HADA_TRY(hada_pipeline_read_planes(pipeline, frame, &planes, i, pipeline->occupied[i], next - i, err));
    }
    return HADA_OK;
}

/* A surface has two unknowns of a pixel, its light and its distance. It is tried where four planes and more are needed,
 * or all there are, and where one more depth would have explained this part of what the planes leave, which is too
 * little for a plane: the most that any did was 0.075 on flat scenes, nearly always less on two planes and on three,
 * and 0.09 to 0.3 on surfaces that two or three planes were taken for, as they are where noise is strong
 * (docs/explanation/surfaces.md). */
enum { SURFACE_UNKNOWNS = 2, FEW_PLANES = 3 };
#define SURFACE_DOUBT 0.085

/* A single plane that leaves so many times the noise's energy may also be one, where no single depth more explains
 * much: behind a diffuser neighbouring depths look alike. A model that does not fit its frames leaves as much, so that
 * the surface has to leave clearly less (perf/results/surface-choices.md). */
#define POOR_PLANE         1.5
#define POOR_PLANE_SURFACE 0.8

/* What a surface may leave of the frame, in units of what so many planes leave, for it to be one: against one plane it
 * has to pay for unknowns that this does without. Surfaces left 0.5 to 1.08 of what the planes did that they were taken
 * for, on scenes of planes 1.06 times as much and more; a surface that is missed loses more than two neighbours that
 * are taken for one (docs/explanation/surfaces.md). */
static double surface_leaves(const knowledge *k)
{
    const double against_one = k->found.more >= SURFACE_DOUBT ? 0.99 : POOR_PLANE_SURFACE;
    return k->count < SURFACE_UNKNOWNS ? against_one : 1.085;
}

static int may_be_surface(const hada_pipeline *pipeline, const knowledge *k)
{
    const int all = k->count > SURFACE_UNKNOWNS && k->count == pipeline->setup->config.depths;
    return pipeline->setup->config.scene == HADA_SCENE_AUTO && k->count > 0 &&
           (all || k->count > FEW_PLANES || k->found.more >= SURFACE_DOUBT);
}

/* The energy that planes leave, from the first steps. */
static hada_status try_planes(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, hada_error *err)
{
    const hada_report *report = &frame->result->memory->report;
    if (k->planes >= 0)
        return HADA_OK;
    HADA_TRY(solve(pipeline, frame, k->count, 0, 0, err));
    HADA_TRY(hada_slot_finish(pipeline->slot, err));
    hada_pipeline_residual(pipeline, frame);
    k->planes = report->residual * report->residual * frame->exposure.energy;
    k->solved = 1;
    return HADA_OK;
}

/* Whether a single plane leaves too much of the frame. Not where the caller has set the steps, with which planes may
 * not have settled, nor in a sequence where the frame before had the same plane. */
static hada_status is_poor(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, int *poor, hada_error *err)
{
    const hada_config *config = &pipeline->setup->config;
    *poor = 0;
    if (config->scene != HADA_SCENE_AUTO || pipeline->setup->options.refine >= 0 || k->count != 1 || k->found.hides ||
        (config->warm && hada_refiner_remembers(pipeline->refiner, k->count, pipeline->occupied)))
        return HADA_OK;
    HADA_TRY(try_planes(pipeline, frame, k, err));
    *poor = k->planes > POOR_PLANE * hada_exposure_noise_energy(&frame->exposure);
    return HADA_OK;
}

/* Whether a surface explains the frame as well as the planes do. */
static hada_status is_surface(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, int *surface, hada_error *err)
{
    HADA_TRY(try_planes(pipeline, frame, k, err));
    const double enough = surface_leaves(k) * k->planes;
    if (k->surface < 0 && enough > k->vain) {
        HADA_TRY(hada_pipeline_find_surface(pipeline, frame, enough, surface, &k->surface, err));
        k->vain = *surface ? 0.0 : enough;
    }
    *surface = k->surface >= 0 && k->surface < enough;
    return HADA_OK;
}

/* The caller asked for a surface. */
static hada_status only_surface(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    int found;
    double energy;
    HADA_TRY(hada_pipeline_find_surface(pipeline, frame, 0.0, &found, &energy, err));
    return hada_pipeline_take_surface(pipeline, frame, energy, err);
}

/* Depths that are not occupied have dark planes. */
static hada_status mark_occupied(hada_pipeline *pipeline, hada_frame *frame, int count, hada_error *err)
{
    hada_result *result = frame->result;
    hada_report *report = &result->memory->report;
    memset(result->memory->occupied, 0, (size_t)result->depths);
    for (int i = 0; i < count; i++)
        result->memory->occupied[pipeline->occupied[i]] = 1;
    report->occupied_count = count;
    return hada_pipeline_dark_planes(pipeline, frame, err);
}

/* Hidden depths between those that were found. */
static hada_status pursue_hidden(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, hada_error *err)
{
    const hada_pursuit_result before = k->found;
    hada_slot_stage(pipeline->slot, "pursuit");
    HADA_TRY(hada_pursuit_part(pipeline->pursuit, &k->found, err));
    k->solved = 0; /* it may have worked in the same memory */
    take_found(pipeline, k);
    if (k->found.all || k->found.count != before.count || memcmp(k->found.list, before.list, sizeof before.list) != 0)
        k->planes = -1.0;
    return hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_pursuit, err);
}

/* Looks for a volume where there are many depths, given what planes or a surface leave. */
static hada_status find_volume(hada_pipeline *pipeline, hada_frame *frame, double energy, hada_support_of against,
                               knowledge *k, hada_error *err)
{
    against.count = k->count;
    return pipeline->setup->config.volume > 1
               ? hada_pipeline_find_volume(pipeline, frame, energy, &against, &k->volume, err)
               : HADA_OK;
}

/* The same before the steps that take longest. A single depth hides nothing, and may explain the frame. */
static hada_status find_early(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, hada_error *err)
{
    if (k->count == 1)
        HADA_TRY(try_planes(pipeline, frame, k, err));
    return find_volume(pipeline, frame, k->count == 1 ? k->planes : frame->exposure.energy,
                       (hada_support_of){.early = 1}, k, err);
}

/* The depths of the frame, and whether it is a surface. Where that is plain, hidden depths are not looked for, which
 * takes longer; a third plane that hides makes two leave more than a surface does. */
static hada_status look(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, int *surface, hada_error *err)
{
    HADA_TRY(pursue(pipeline, frame, k, err));
    if (may_be_surface(pipeline, k) && pipeline->setup->config.volume == 1)
        HADA_TRY(hada_pipeline_find_volume(pipeline, frame, -1.0, NULL, &k->volume, err));
    if (!k->volume && (k->found.hides || may_be_surface(pipeline, k)))
        HADA_TRY(find_early(pipeline, frame, k, err));
    if (k->volume)
        return HADA_OK;
    int possible = may_be_surface(pipeline, k) && (k->count > SURFACE_UNKNOWNS || !k->found.hides);
    if (!possible)
        HADA_TRY(is_poor(pipeline, frame, k, &possible, err));
    if (possible)
        HADA_TRY(is_surface(pipeline, frame, k, surface, err));
    if (*surface || !k->found.hides)
        return HADA_OK;
    HADA_TRY(pursue_hidden(pipeline, frame, k, err));
    if (may_be_surface(pipeline, k))
        HADA_TRY(is_surface(pipeline, frame, k, surface, err));
    return HADA_OK;
}

static int is_same(const hada_pursuit_result *a, const hada_pursuit_result *b)
{
    return a->all == b->all && a->count == b->count && !memcmp(a->list, b->list, sizeof a->list);
}

/* Fills saturated values for steps that use no weights, by planes of the depths that a pursuit finds, until it finds
 * them again. Planes that have not settled predict too little light: with them a surface's depth was three times as
 * wrong. */
static hada_status fill_saturated(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    enum { MOST = 3 };
    hada_report *report = &frame->result->memory->report;
    hada_pursuit_result before = {.count = -1};
    for (int i = 0; i < MOST; i++) {
        knowledge k = {0};
        HADA_TRY(pursue(pipeline, frame, &k, err));
        if (!k.count || is_same(&k.found, &before))
            break;
        before = k.found;
        HADA_TRY(solve(pipeline, frame, k.count, pipeline->setup->config.parting, 0, err));
        HADA_TRY(hada_pipeline_fill(pipeline, frame, k.count, err));
    }
    pipeline->residual_due = 0;
    report->refine_tv = report->refine_tv_factor = 0.0;
    return HADA_OK;
}

/* Whether the depths are those of the frame before, of a sequence. */
static hada_status follow(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, int *same, hada_error *err)
{
    const hada_config *config = &pipeline->setup->config;
    *same = 0;
    if (!config->warm || !config->pursuit || pipeline->weighing.used)
        return HADA_OK;
    HADA_TRY(hada_maker_expects(&pipeline->maker, &frame->exposure, pipeline->occupied, &pipeline->past, same, err));
    k->count = *same ? pipeline->past.count : 0;
    return HADA_OK;
}

/* What the frame is as far as that shows before its planes are refined, and its depths. */
static hada_status find_depths(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, int *surface, hada_error *err)
{
    int same;
    HADA_TRY(follow(pipeline, frame, k, &same, err));
    if (same)
        return HADA_OK;
    HADA_TRY(find_volume(pipeline, frame, -1.0, (hada_support_of){0}, k, err));
    if (k->volume)
        return HADA_OK;
    if (pipeline->setup->config.pursuit)
        return look(pipeline, frame, k, surface, err);
    take_listed(pipeline, k);
    return HADA_OK;
}

/* What the frame is: one of the three, its depths, and the planes of all but a surface. */
static hada_status find_scene(hada_pipeline *pipeline, hada_frame *frame, knowledge *k, int *surface, hada_error *err)
{
    const hada_config *config = &pipeline->setup->config;
    const hada_report *report = &frame->result->memory->report;
    HADA_TRY(find_depths(pipeline, frame, k, surface, err));
    if (k->volume || (!*surface && !k->count))
        return HADA_OK;
    if (*surface)
        return find_volume(pipeline, frame, k->surface, (hada_support_of){.surface = 1}, k, err);
    const int parting = config->parting && k->count > 1;
    if (parting || config->warm || !k->solved)
        HADA_TRY(solve(pipeline, frame, k->count, parting, 1, err));
    HADA_TRY(regularise(pipeline, frame, k->count, err));
    if (config->volume < 2)
        return HADA_OK;
    HADA_TRY(hada_slot_finish(pipeline->slot, err));
    hada_pipeline_residual(pipeline, frame);
    return find_volume(pipeline, frame, report->residual * report->residual * frame->exposure.energy,
                       (hada_support_of){0}, k, err);
}

static hada_status joint(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const hada_config *config = &pipeline->setup->config;
    knowledge k = {.planes = -1.0, .surface = -1.0};
    int surface = 0, weighs = 0;
    pipeline->volume_now = (hada_classic_result){0};
    pipeline->sieved = (hada_classic_sieved){0};
    pipeline->past.kept = 0;
    pipeline->past.now = -1.0;
    pipeline->past.gain = 1.0;
    pipeline->past.asked = pipeline->past.follows = 0;
    if (hada_pipeline_has_gaps(pipeline, frame))
        HADA_TRY(hada_pipeline_weigh(pipeline, &weighs, err));
    if (weighs && config->pursuit && frame->exposure.saturated)
        HADA_TRY(fill_saturated(pipeline, frame, err));
    if (config->scene == HADA_SCENE_SURFACE)
        return only_surface(pipeline, frame, err);
    HADA_TRY(find_scene(pipeline, frame, &k, &surface, err));
    if (k.volume)
        k.count = config->depths;
    else if (surface)
        return hada_pipeline_take_surface(pipeline, frame, k.surface, err);
    HADA_TRY(mark_occupied(pipeline, frame, k.count, err));
    if (!k.count)
        return hada_pipeline_no_pictures(pipeline, frame, err);
    if (!classic_of(pipeline, frame)) { /* planes of a classic method are not changed */
        HADA_TRY(hada_maker_fade(&pipeline->maker, k.count, config->crosstalk, err));
        HADA_TRY(hada_refiner_crop(pipeline->refiner, k.count, err));
    }
    HADA_TRY(blend(pipeline, frame, k.count, err));
    if (!k.volume) /* a net was trained behind refined planes */
        HADA_TRY(hada_pipeline_enhance(pipeline, frame, planes_of(pipeline, frame), k.count, 1, err));
    HADA_TRY(hada_pipeline_lap(pipeline, frame, &frame->result->memory->report.seconds_enhance, err));
    HADA_TRY(focus(pipeline, frame, k.count, err));
    return read_planes(pipeline, frame, k.count, err);
}

hada_status hada_pipeline_joint(hada_pipeline *pipeline, hada_frame *frame, hada_error *err)
{
    const hada_status status = hada_pipeline_without_stray_light(pipeline, frame, joint, err);
    if (status && pipeline->weighing.used)
        frame->examined = 0; /* its values may be filled */
    return status;
}
