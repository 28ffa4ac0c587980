#include "fit/trial.h"

#include "fit/trial_frame.h"

/* Planes are compared after each of PARTS equal parts of the steps, and before the first, when they are the linear
 * filter's. After the last part come the steps with the learned regulariser. Optics that pass some frequencies weakly
 * need more steps: they get SLOW ones, and SLOWEST times as many, where each further one gains SLOW_GAIN decibels.
 * Where the sensor crops, fewer do. */
enum { PARTS = 4, TRIED = PARTS + 1, SLOW = 32, SLOW_CROPPED = 24, SLOWEST = 2 };
_Static_assert((int)SLOW *(int)SLOWEST <= (int)HADA_TRIAL_MOST_STEPS, "room for steps");
#define SLOW_GAIN 0.0125

/* Weights of total variation that are tried, by what the noise says: the best of simulated cameras with 0.3 to 3 %
 * noise were about 0.1 of its standard deviation over the rms of the pairs' frames (docs/explanation/refinement.md).
 * That and a step of TV_RATIO to both sides, and further ones as long as the outermost is best; the best of all lies
 * where a parabola through three has its top. A few steps on one depth rank them as many on two do; where the sensor
 * crops they settle later. */
enum { TV_SIDE = 5, TV_PLACES = 2 * TV_SIDE + 1, TV_ROWS = 2 + 3 * TV_PLACES, TV_STEPS = 10, TV_STEPS_CROPPED = 12 };
#define TV_RATIO     1.6
#define TV_PER_NOISE 0.1
#define TV_MOSAIC    0.5 /* times that of a mosaic, a third of whose values are known */
#define TV_UNKNOWN   0.003
#define TV_LEAST     1e-5

/* Weights of colour that are tried beside HADA_REFINE_COLOUR. The heavier colour is, the less total variation is
 * needed: by this power of the weights' ratio (docs/explanation/refinement.md). */
enum { CHOICES = 3 };
static const double colours_tried[CHOICES] = {1.0, 2.0, 3.0};
#define TV_PER_COLOUR 0.6

/* Strengths of the learned regulariser that are tried. The stronger it is, the less total variation is needed beside
 * it: this share at a strength of 1 (docs/explanation/refinement.md). The best strength differs between scenes by a
 * factor of three, and the trial has few of them, so total variation alone must be this much better, in decibels. */
static const double ridges_tried[CHOICES] = {0.7, HADA_REFINE_RIDGE, 1.4};
#define TV_PER_RIDGE 0.65
#define RIDGE_DOUBT  1.0

_Static_assert((int)TRIED + (int)TV_ROWS <= (int)HADA_FIT_TRIAL_ROWS, "room for rows");

/* A reconstruction stops by itself once its residual has settled, so the number of steps to keep is the largest that
 * still has most of the best gain; the sum of two whole scenes is a hard case and its curve is uneven. Gains below a
 * hundredth of a decibel are none. */
#define MOST_OF_THE_GAIN 0.8
#define LEAST_GAIN       0.01

/* Shares of the refined plane that are tried where one depth is occupied, the rest being the linear filter's: where the
 * camera is known badly, the two err differently (L. Breiman, "Stacked regressions", Machine Learning 24, 1996). Less
 * than a fifth of a decibel is not worth filtering as well. */
static const double shares_tried[] = {1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1};
enum { SHARES = sizeof shares_tried / sizeof *shares_tried };
_Static_assert((int)SHARES <= (int)HADA_TRIAL_SHARES, "room for shares");
#define SHARE_GAIN 0.2

typedef struct trial_work {
    hada_trial_bench bench;
    double sum[2][TRIED][SHARES]; /* decibels: one depth, two depths; of these the first share alone */
    int count[2];
    hada_refine_weights weights; /* what is refined with */
    int rank_steps;              /* after which weights are compared */
    int whole;                   /* number of steps */
    hada_fit_refine_score tv_rows[TV_ROWS];
    int tv_count;
} trial_work;

static int slow_steps(const trial_work *work)
{
    const hada_model_info *info = &work->bench.grid->info;
    return info->boundary == HADA_BOUNDARY_PADDED && info->mosaic == HADA_MOSAIC_NONE ? SLOW_CROPPED : SLOW;
}

/* Exposes a frame, and keeps its linear planes for blends. */
static hada_status expose(trial_work *work, const hada_trial_frame *frame, hada_error *err)
{
    HADA_TRY(hada_trial_expose(&work->bench, frame, err));
    HADA_TRY(hada_trial_filter(&work->bench, frame, err));
    memcpy(work->bench.linear, work->bench.planes,
           (size_t)frame->members * hada_fit_window_floats(work->bench.grid) * sizeof *work->bench.linear);
    return HADA_OK;
}

/* The best share by its decibels: refined planes alone, unless another one is clearly better. */
static int best_share(const double *psnr)
{
    int best = 0;
    for (int s = 1; s < SHARES; s++)
        if (psnr[s] > psnr[best])
            best = s;
    return psnr[best] - psnr[0] > SHARE_GAIN ? best : 0;
}

/* Every number of steps. */
static hada_status try_frame(trial_work *work, const hada_trial_frame *frame, hada_error *err)
{
    double(*sum)[SHARES] = work->sum[frame->members - 1];
    const int shares = frame->members == 1 ? SHARES : 1;
    HADA_TRY(expose(work, frame, err));
    hada_trial_compare(&work->bench, frame, shares_tried, shares, sum[0]);
    for (int i = 1; i < TRIED; i++) {
        const hada_maker_steps steps = {
            .steps = work->whole / PARTS, .before = (i - 1) * work->whole / PARTS, .whole = work->whole};
        HADA_TRY(hada_trial_refine(&work->bench, frame, &work->weights, &steps, i == PARTS, err));
        hada_trial_compare(&work->bench, frame, shares_tried, shares, sum[i]);
    }
    work->count[frame->members - 1]++;
    return HADA_OK;
}

/* The weight of total variation that the noise of the camera and the light of a frame suggest. */
static double guess_weight(const trial_work *work, const hada_trial_frame *frame)
{
    const hada_model_info *info = &work->bench.grid->info;
    const size_t images = (size_t)info->depths * (size_t)info->channels;
    const double light =
        hada_trial_energy(frame->member[0]->raw, hada_fit_raw_floats(work->bench.grid)) / (double)info->channels;
    double noise = 0.0;
    for (size_t i = 0; i < images; i++)
        noise += work->bench.with->model->noise_power[i] / (double)images;
    const double each = info->mosaic == HADA_MOSAIC_NONE ? 1.0 : TV_MOSAIC;
    return fmax(each * (noise > 0.0 && light > 0.0 ? TV_PER_NOISE * sqrt(noise / light) : TV_UNKNOWN), TV_LEAST);
}

/* Frames of one pair each, with filters that were learned without these pairs. */
typedef struct trial_set {
    const hada_trial_frame *frames;
    int count;
} trial_set;

/* Mean decibels of the frames with each of some weights, blended as is best; a frame is exposed once for all. */
static hada_status rank(trial_work *work, const trial_set *set, const hada_refine_weights *weights, int count,
                        double *psnr, hada_error *err)
{
    const hada_maker_steps steps = {.steps = work->rank_steps, .whole = work->whole};
    double sum[TV_PLACES][SHARES] = {{0.0}};
    for (int k = 0; k < set->count; k++) {
        if (!hada_is_mine(&work->bench.grid->communicator, k))
            continue;
        HADA_TRY(expose(work, &set->frames[k], err));
        for (int i = 0; i < count; i++) {
            HADA_TRY(hada_trial_refine(&work->bench, &set->frames[k], &weights[i], &steps, 1, err));
            hada_trial_compare(&work->bench, &set->frames[k], shares_tried, SHARES, sum[i]);
        }
    }
    HADA_TRY(hada_reduce(&work->bench.grid->communicator, sum[0], (size_t)count * SHARES, err));
    for (int i = 0; i < count; i++) {
        for (int s = 0; s < SHARES; s++)
            sum[i][s] /= set->count;
        psnr[i] = sum[i][best_share(sum[i])];
    }
    return HADA_OK;
}

/* The same for weights of total variation with the other weights at hand, each with a row of the table. */
static hada_status rank_tv(trial_work *work, const trial_set *set, const double *tv, int count, double *psnr,
                           hada_error *err)
{
    const hada_model_info *info = &work->bench.with->model->info;
    hada_refine_weights weights[TV_PLACES] = {{0.0, 0.0, 0.0}};
    for (int i = 0; i < count; i++)
        weights[i] = (hada_refine_weights){tv[i], work->weights.colour, work->weights.ridge};
    HADA_TRY(rank(work, set, weights, count, psnr, err));
    for (int i = 0; i < count; i++)
        work->tv_rows[work->tv_count++] = (hada_fit_refine_score){.steps = work->rank_steps,
                                                                  .rho = hada_refine_rho(info->boundary, tv[i]),
                                                                  .tv = tv[i],
                                                                  .psnr_single = psnr[i],
                                                                  .psnr_double = NAN};
    return HADA_OK;
}

/* The best weight of total variation, from `guess` to both sides; psnr: of the best that was tried. */
static hada_status sweep_tv(trial_work *work, const trial_set *set, double guess, double *psnr, hada_error *err)
{
    enum { NEAR = 3 };
    double tv[TV_PLACES], value[TV_PLACES];
    int first = TV_SIDE - 1, last = TV_SIDE + 1, best = TV_SIDE;
    for (int i = 0; i < TV_PLACES; i++)
        tv[i] = fmax(guess * pow(TV_RATIO, i - TV_SIDE), TV_LEAST);
    HADA_TRY(rank_tv(work, set, tv + first, NEAR, value + first, err));
    for (;;) {
        for (int i = first; i <= last; i++)
            if (value[i] > value[best])
                best = i;
        const int next = best == first ? first - 1 : last + 1;
        if ((best != first && best != last) || next < 0 || next == TV_PLACES)
            break;
        HADA_TRY(rank_tv(work, set, tv + next, 1, value + next, err));
        first -= next < first;
        last += next > last;
    }
    const int inside = best != first && best != last;
    const double top = inside ? hada_parabola_top(value[best - 1], value[best], value[best + 1]) : 0.0;
    *psnr = value[best];
    work->weights.tv = fmax(guess * pow(TV_RATIO, best - TV_SIDE + top), TV_LEAST);
    return HADA_OK;
}

/* Chooses the weight of total variation, 0 where the prior of the pairs is better. */
static hada_status choose_tv(trial_work *work, const trial_set *set, double *psnr, hada_error *err)
{
    const double none = 0.0;
    double without;
    HADA_TRY(rank_tv(work, set, &none, 1, &without, err));
    HADA_TRY(sweep_tv(work, set, guess_weight(work, set->frames), psnr, err));
    if (*psnr <= without) { /* which settles earlier behind slow optics */
        work->rank_steps = work->whole = slow_steps(work);
        HADA_TRY(rank_tv(work, set, &none, 1, &without, err));
        HADA_TRY(sweep_tv(work, set, work->weights.tv, psnr, err));
    }
    if (*psnr <= without) {
        work->weights.tv = 0.0;
        work->whole = HADA_TRIAL_STEPS;
    }
    return HADA_OK;
}

/* Takes the best of some weights, where it is better than what is at hand; psnr: with that. */
static hada_status choose_of(trial_work *work, const trial_set *set, const hada_refine_weights weights[CHOICES],
                             double *psnr, hada_error *err)
{
    double value[CHOICES];
    HADA_TRY(rank(work, set, weights, CHOICES, value, err));
    for (int i = 0; i < CHOICES; i++)
        if (value[i] > *psnr) {
            *psnr = value[i];
            work->weights = weights[i];
        }
    return HADA_OK;
}

/* Chooses the weight of colour; psnr: with the weights at hand. */
static hada_status choose_colour(trial_work *work, const trial_set *set, double *psnr, hada_error *err)
{
    const hada_refine_weights now = work->weights;
    hada_refine_weights weights[CHOICES];
    for (int i = 0; i < CHOICES; i++)
        weights[i] =
            (hada_refine_weights){now.tv * pow(now.colour / colours_tried[i], TV_PER_COLOUR), colours_tried[i], 0.0};
    return choose_of(work, set, weights, psnr, err);
}

/* Weights with this strength of the learned regulariser in place of none. */
static hada_refine_weights with_ridge(const hada_refine_weights *without, double ridge)
{
    return (hada_refine_weights){without->tv * TV_PER_RIDGE / ridge, without->colour, ridge};
}

/* Chooses the strength of the learned regulariser, unless it is given, and total variation's weight beside it. Planes
 * that have not settled gain less by it. psnr: without it. */
static hada_status choose_ridge(trial_work *work, const trial_set *set, double psnr, hada_error *err)
{
    const hada_refine_weights without = work->weights;
    if (work->bench.with->ridge < 0.0) {
        hada_refine_weights weights[CHOICES];
        for (int i = 0; i < CHOICES; i++)
            weights[i] = with_ridge(&without, ridges_tried[i]);
        psnr -= RIDGE_DOUBT;
        HADA_TRY(choose_of(work, set, weights, &psnr, err));
    } else {
        work->weights = with_ridge(&without, work->bench.with->ridge);
    }
    return work->weights.ridge > 0.0 ? sweep_tv(work, set, work->weights.tv, &psnr, err) : HADA_OK;
}

/* Chooses the whole number of steps, after which weights are compared from here on. psnr: with total variation alone.
 */
static hada_status choose_whole(trial_work *work, const trial_set *set, double *psnr, hada_error *err)
{
    const hada_refine_weights without = {work->weights.tv, work->weights.colour, 0.0};
    const int slow = slow_steps(work);
    int settled = HADA_TRIAL_STEPS;
    work->rank_steps = work->whole = settled;
    HADA_TRY(rank(work, set, &without, 1, psnr, err));
    for (int steps = slow; steps <= SLOWEST * slow; steps *= SLOWEST) {
        double more;
        work->rank_steps = work->whole = steps;
        HADA_TRY(rank(work, set, &without, 1, &more, err));
        if (!(more - *psnr > SLOW_GAIN * (steps - settled)))
            break;
        *psnr = more;
        settled = steps;
    }
    work->rank_steps = work->whole = settled;
    return HADA_OK;
}

static hada_status choose_weights(trial_work *work, const trial_set *set, hada_error *err)
{
    const double ridge = work->weights.ridge;
    double psnr;
    work->weights.ridge = 0.0;
    HADA_TRY(choose_tv(work, set, &psnr, err));
    if (work->weights.tv > 0.0 && work->bench.with->colour < 0.0 && work->bench.grid->info.channels > 1)
        HADA_TRY(choose_colour(work, set, &psnr, err));
    if (work->weights.tv > 0.0)
        HADA_TRY(choose_whole(work, set, &psnr, err));
    if (work->weights.tv > 0.0 && ridge > 0.0)
        HADA_TRY(choose_ridge(work, set, psnr, err));
    else
        work->weights.ridge = ridge;
    return HADA_OK;
}

/* Frames of one pair, on which the weights are chosen, too. */
static hada_status try_singles(trial_work *work, hada_error *err)
{
    const hada_fit_kept *kept = work->bench.with->kept;
    const hada_communicator *ranks = &work->bench.grid->communicator;
    hada_trial_frame frames[HADA_FIT_KEPT];
    double psnr;
    for (int k = 0; k < kept->count; k++) {
        frames[k] = (hada_trial_frame){{&kept->pair[k]}, 1, k};
        if (hada_is_mine(ranks, k))
            HADA_TRY(hada_trial_hold_out(&work->bench, &frames[k], err));
    }
    if (work->bench.with->tv < 0.0)
        HADA_TRY(choose_weights(work, &(trial_set){frames, kept->count}, err));
    else if (work->weights.tv > 0.0)
        HADA_TRY(choose_whole(work, &(trial_set){frames, kept->count}, &psnr, err));
    for (int k = 0; k < kept->count; k++)
        if (hada_is_mine(ranks, k))
            HADA_TRY(try_frame(work, &frames[k], err));
    return HADA_OK;
}

/* Frames that are the sum of two depths' pairs. */
static hada_status try_doubles(trial_work *work, hada_error *err)
{
    const hada_fit_kept *kept = work->bench.with->kept;
    const hada_communicator *ranks = &work->bench.grid->communicator;
    long number = 0;
    for (int k = 0; k + 2 < kept->count; k++) {
        const hada_trial_frame two = {{&kept->pair[k], &kept->pair[k + 2]}, 2, 0};
        if (two.member[0]->depth == two.member[1]->depth || !hada_is_mine(ranks, number++))
            continue;
        HADA_TRY(hada_trial_hold_out(&work->bench, &two, err));
        HADA_TRY(try_frame(work, &two, err));
    }
    return HADA_OK;
}

/* The decibels of all ranks' frames. */
static hada_status share(trial_work *work, hada_error *err)
{
    const hada_communicator *ranks = &work->bench.grid->communicator;
    double count[2] = {work->count[0], work->count[1]};
    HADA_TRY(hada_reduce(ranks, count, HADA_COUNT(count), err));
    HADA_TRY(hada_reduce(ranks, &work->sum[0][0][0], sizeof work->sum / sizeof(double), err));
    work->count[0] = (int)count[0];
    work->count[1] = (int)count[1];
    return HADA_OK;
}

static double mean(const trial_work *work, int occupied, int i, int share)
{
    return work->count[occupied] ? work->sum[occupied][i][share] / work->count[occupied] : 0.0;
}

static double blend_score(const trial_work *work, int i, int share)
{
    return mean(work, 0, i, share) + mean(work, 1, i, 0);
}

/* The best share after so many steps. */
static int share_of(const trial_work *work, int i)
{
    double psnr[SHARES];
    for (int s = 0; s < SHARES; s++)
        psnr[s] = blend_score(work, i, s);
    return best_share(psnr);
}

static double score(const trial_work *work, int i)
{
    return blend_score(work, i, share_of(work, i));
}

/* Which number of steps to keep. */
static int best_of(const trial_work *work)
{
    int best = 0, chosen = 0;
    for (int i = 1; i < TRIED; i++)
        if (score(work, i) > score(work, best))
            best = i;
    const double gain = score(work, best) - score(work, 0);
    for (int i = 1; gain > LEAST_GAIN && i < TRIED; i++)
        if (score(work, i) - score(work, 0) >= MOST_OF_THE_GAIN * gain)
            chosen = i;
    return chosen;
}

/* The numbers of steps, then the weights that were compared. */
static void fill_rows(const trial_work *work, int best, hada_fit_trial_result *result)
{
    const hada_model_info *info = &work->bench.with->model->info;
    result->row_count = TRIED + work->tv_count;
    for (int k = 0; k < TRIED; k++) {
        const double tv = k ? work->weights.tv : 0.0;
        result->rows[k] =
            (hada_fit_refine_score){.steps = k * work->whole / PARTS,
                                    .rho = hada_refine_rho(info->boundary, tv),
                                    .tv = tv,
                                    .psnr_single = work->count[0] ? mean(work, 0, k, share_of(work, k)) : NAN,
                                    .psnr_double = work->count[1] ? mean(work, 1, k, 0) : NAN,
                                    .chosen = k == best};
    }
    memcpy(result->rows + TRIED, work->tv_rows, (size_t)work->tv_count * sizeof *work->tv_rows);
}

hada_status hada_fit_trial_run(const hada_fit_trial *trial, hada_fit_trial_result *result, hada_error *err)
{
    const int cropped = trial->sums->grid->info.boundary == HADA_BOUNDARY_PADDED;
    trial_work work = {.bench = {.with = trial, .grid = trial->sums->grid},
                       .weights = {fmax(trial->tv, 0.0), trial->colour >= 0.0 ? trial->colour : HADA_REFINE_COLOUR,
                                   trial->ridge >= 0.0 ? trial->ridge : HADA_REFINE_RIDGE},
                       .rank_steps = cropped ? TV_STEPS_CROPPED : TV_STEPS,
                       .whole = HADA_TRIAL_STEPS};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_trial_bench_create(&work.bench, err));
    HADA_TRY_OR_DONE(try_singles(&work, err));
    HADA_TRY_OR_DONE(try_doubles(&work, err));
    HADA_TRY_OR_DONE(share(&work, err));
    const int best = best_of(&work);
    *result = (hada_fit_trial_result){.steps = best * work.whole / PARTS,
                                      .share = best ? shares_tried[share_of(&work, best)] : 1.0,
                                      .weights = work.weights,
                                      .noise = work.bench.maker.noise_share,
                                      .gain = score(&work, best) - score(&work, 0)};
    if (!best)
        result->weights.tv = 0.0;
    fill_rows(&work, best, result);
done:
    hada_trial_bench_destroy(&work.bench);
    return status;
}
