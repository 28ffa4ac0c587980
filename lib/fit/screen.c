/* Pairs that a fit is better without: a frame that is cut off, or that belongs to another scene, spoils the transfer
 * functions that the others give. Reduced frames of one depth are explained by convolutions that the others of it give
 * (pair_level.h); a pair is left out where that explains all others far better. */
#include <hadalens/response.h>

#include "core/callers.h"
#include "dataset/dataset.h"
#include "fit/look.h"
#include "fit/pair_level.h"
#include "image/pixels.h"

/* Of depths with fewer pairs nobody can say which is wrong; of many one does little harm. */
enum { LEAST_PAIRS = 4, MOST_PAIRS = 32 };
/* At most one pair of so many is left out. */
enum { ONE_OF = 3 };
/* A median share that is unexplained below this is that of sound pairs. */
#define SOUND 0.0005
/* Without the pairs that are left out, so much less is unexplained of the others (geometric mean), by so many standard
 * errors; and of those that are left out so many times the others' median is unexplained. */
#define LESS_BY     1.4
#define LESS_ERRORS 3.0
#define WORSE_BY    4.0
/* Or they contradict the others: this much, and so many times the others' median, is unexplained of each even if it is
 * among those that explain it; a pair that only shows what others do not show explains itself. Then the others need not
 * be explained better, but as well. */
#define CONTRADICTS    0.05
#define CONTRADICTS_BY 20.0
#define AS_WELL        0.1
/* Scenes with so large a share of their values at their largest one may have been cut off at white. All of a depth are
 * left out, if LEAST_SOUND others remain, where these are then explained better by so much, by so many standard errors.
 */
#define AT_WHITE     0.02
#define WHITE_BY     1.5
#define WHITE_ERRORS 1.25
enum { LEAST_SOUND = 3 };
/* What was filled in is of no use where so many times more of the others is unexplained with it. */
#define USELESS_BY 2.0
/* The least number of pairs with this much of what the most gain is left out. */
#define MOST_OF_THE_GAIN 0.8

enum { RESPONSES = 2, ROUNDS = 2 };
static const double responses[RESPONSES] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB};

/* Logarithms of unexplained shares, whatever the exposure of the frame that is judged. */
typedef struct shares {
    double log[MOST_PAIRS];
} shares;

/* Pairs that are left out, in the order of their harm. */
typedef struct suspects {
    int pair[MOST_PAIRS], count;
    int white;    /* the first ones, which were cut off */
    double times; /* so much less is unexplained of the others without them */
    double left;  /* logarithm of what is, the median */
} suspects;

typedef struct screening {
    const hada_dataset *pairs;
    const hada_fit_options *options;
    hada_reducer reducer;
    hada_pair_level level[RESPONSES];
    int tried, at[MOST_PAIRS], count; /* responses; the numbers of the pairs that are looked at */
    double white[MOST_PAIRS][2]; /* shares of their scenes, and frames, that are as bright as their brightest value */
} screening;

float hada_fit_white(const hada_image *image)
{
    return 0.999f * hada_image_brightest(image);
}

/* The share of values at white. */
static double at_white(const hada_image *image)
{
    const size_t count = hada_image_count(image);
    const float white = hada_fit_white(image);
    size_t there = 0;
    for (size_t i = 0; i < count; i++)
        there += image->data[i] >= white;
    return white > 0.0f ? (double)there / (double)count : 0.0;
}

/* Puts a pair beside those that were taken, with its scene in all responses tried. */
static hada_status take_pair(screening *of, int depth, int number, hada_error *err)
{
    hada_pair pair = {0};
    hada_image frame = {0}, scene = {0};
    hada_status status = HADA_OK;
    HADA_TRY(hada_monitor_check(of->options->monitor, err));
    HADA_TRY(hada_pair_take(&pair, of->pairs, depth, number, err));
    if (!hada_reducer_fits(&of->reducer, pair.raw, pair.scene))
        goto done;
    HADA_TRY_OR_DONE(hada_reduce_frame(&of->reducer, pair.raw, &frame, err));
    for (int r = 0; r < of->tried; r++) {
        const double response = of->tried == 1 ? of->options->scene_response : responses[r];
        hada_image_destroy(&scene);
        HADA_TRY_OR_DONE(hada_reduce_scene(&of->reducer, pair.scene, response, &scene, err));
        hada_pair_level_put(&of->level[r], of->count, 0, &frame, &scene);
    }
    of->white[of->count][0] = at_white(pair.scene);
    of->white[of->count][1] = at_white(pair.raw);
    of->at[of->count++] = number;
done:
    hada_image_destroy(&frame);
    hada_image_destroy(&scene);
    hada_pair_return(&pair);
    return status;
}

static hada_status take_depth(screening *of, int depth, int pairs, hada_error *err)
{
    of->count = 0;
    for (int r = 0; r < of->tried; r++)
        of->level[r].count = 0;
    for (int i = 0; i < pairs; i++)
        HADA_TRY(take_pair(of, depth, i, err));
    return HADA_OK;
}

/* What others leave of each frame with these exposures; a pair of exposure 0 says nothing to them. */
static void judge(hada_pair_level *level, const double *gain, int itself, shares *out)
{
    double unexplained[MOST_PAIRS];
    hada_pair_level_judge(level, gain, itself, unexplained, NULL);
    for (int k = 0; k < level->count; k++) {
        const hada_judgement *one = &level->judged[k];
        const double most = one->power * one->energy;
        out->log[k] = log(fmax(most > 0.0 ? 1.0 - one->cross * one->cross / most : 1.0, 1e-9));
    }
}

/* Exposures of the pairs that are not left out: all alike, or, apart, from each other. */
static void expose(hada_pair_level *level, const unsigned char *out, int apart, double *gain)
{
    double unexplained[MOST_PAIRS], room[MOST_PAIRS];
    for (int k = 0; k < level->count; k++)
        gain[k] = out[k] ? 0.0 : 1.0;
    hada_pair_level_even(level, apart ? ROUNDS : 0, gain, unexplained, room);
}

static double median(const hada_pair_level *level, const shares *of, const unsigned char *out)
{
    double sorted[MOST_PAIRS] = {0.0};
    int count = 0;
    for (int k = 0; k < level->count; k++)
        if (!out[k])
            sorted[count++] = of->log[k];
    return hada_median(sorted, (size_t)count);
}

/* How much less is left of the others; *errors: in standard errors. */
static double gain_of(const hada_pair_level *level, const shares *all, const shares *now, const unsigned char *out,
                      double *errors)
{
    double mean = 0.0, square = 0.0;
    int count = 0;
    for (int k = 0; k < level->count; k++)
        if (!out[k]) {
            const double less = all->log[k] - now->log[k];
            mean += less;
            square += less * less;
            count++;
        }
    mean /= count;
    const double spread = fmax(square / count - mean * mean, 1e-12);
    *errors = mean / sqrt(spread / fmax(1.0, count - 1.0));
    return mean;
}

/* The pair without which the others are explained best. */
static int most_harmful(hada_pair_level *level, const double *gain, const shares *now, const unsigned char *out)
{
    double changed[MOST_PAIRS], most = -1e30;
    int worst = 0;
    memcpy(changed, gain, (size_t)level->count * sizeof *changed);
    for (int j = 0; j < level->count; j++) {
        shares without;
        double sum = 0.0;
        if (out[j])
            continue;
        changed[j] = 0.0;
        judge(level, changed, 0, &without);
        changed[j] = gain[j];
        for (int k = 0; k < level->count; k++)
            sum += k == j || out[k] ? 0.0 : now->log[k] - without.log[k];
        if (sum > most) {
            most = sum;
            worst = j;
        }
    }
    return worst;
}

/* Whether all that are left out are far worse explained than the others. */
static int are_worse(const hada_pair_level *level, const shares *now, const unsigned char *out)
{
    const double usual = median(level, now, out);
    for (int k = 0; k < level->count; k++)
        if (out[k] && now->log[k] < fmin(usual + log(WORSE_BY), log(0.5)))
            return 0;
    return 1;
}

/* Pairs that contradict the others are the first that are left out. */
static int most_contradicting(const hada_pair_level *level, const shares *itself, const unsigned char *out)
{
    const double usual = median(level, itself, out);
    int worst = -1;
    for (int k = 0; k < level->count; k++)
        if (!out[k] && itself->log[k] > log(CONTRADICTS) && itself->log[k] > usual + log(CONTRADICTS_BY) &&
            (worst < 0 || itself->log[k] > itself->log[worst]))
            worst = k;
    return worst;
}

/* All pairs but those that are left out already, with exposures alike or apart. */
typedef struct beginning {
    double gain[MOST_PAIRS], left; /* the median of all */
    shares all;
    unsigned char out[MOST_PAIRS];
} beginning;

static void begin(hada_pair_level *level, int apart, beginning *from)
{
    expose(level, from->out, apart, from->gain);
    judge(level, from->gain, 0, &from->all);
    from->left = median(level, &from->all, from->out);
}

/* Leaves out pairs that were cut off. *times: so much less is unexplained of the others. Their number. */
static int leave_white(const screening *of, hada_pair_level *level, int apart, beginning *from, double *times)
{
    beginning without = {.left = 0.0};
    double errors;
    int count = 0;
    for (int k = 0; k < of->count; k++)
        count += without.out[k] = fmax(of->white[k][0], of->white[k][1]) > AT_WHITE;
    *times = 1.0;
    if (!count || of->count - count < LEAST_SOUND || from->left < log(SOUND))
        return 0;
    begin(level, apart, &without);
    const double less = gain_of(level, &from->all, &without.all, without.out, &errors);
    if (less < log(WHITE_BY) || errors < WHITE_ERRORS)
        return 0;
    *from = without;
    *times = exp(less);
    return count;
}

/* Leaves out one after the other. */
static void suspect(hada_pair_level *level, int apart, const beginning *from, suspects *found)
{
    unsigned char out[MOST_PAIRS] = {0};
    double gain[MOST_PAIRS], best[MOST_PAIRS] = {0.0}, left[MOST_PAIRS], errors, most = 0.0;
    shares now, itself;
    int pair[MOST_PAIRS], sound = 0;
    *found = (suspects){.times = 1.0, .left = from->left};
    for (int k = 0; k < level->count; k++) {
        out[k] = from->out[k];
        sound += !out[k];
    }
    const int tries = sound / ONE_OF;
    if (from->left < log(SOUND) || sound < LEAST_PAIRS)
        return;
    memcpy(gain, from->gain, (size_t)level->count * sizeof *gain);
    now = from->all;
    for (int m = 0, contradict = 1; m < tries; m++) {
        judge(level, gain, 1, &itself);
        const int contradicts = contradict ? most_contradicting(level, &itself, out) : -1;
        contradict = contradicts >= 0;
        pair[m] = contradict ? contradicts : most_harmful(level, gain, &now, out);
        out[pair[m]] = 1;
        expose(level, out, apart, gain);
        judge(level, gain, 0, &now);
        const double less = gain_of(level, &from->all, &now, out, &errors);
        if (less > log(LESS_BY) && errors > LESS_ERRORS && are_worse(level, &now, out))
            best[m] = less;
        else if (contradict && less > -AS_WELL)
            best[m] = fmax(less, 1e-3 * (m + 1)); /* each further one counts */
        left[m] = median(level, &now, out);
        most = fmax(most, best[m]);
    }
    for (int m = 0; m < tries && most > 0.0; m++)
        if (best[m] >= MOST_OF_THE_GAIN * most) {
            found->count = m + 1;
            found->times = exp(best[m]);
            found->left = left[m];
            memcpy(found->pair, pair, (size_t)found->count * sizeof *pair);
            return;
        }
}

/* What suspect() finds, behind the pairs that were cut off. */
static void suspect_after(const screening *of, hada_pair_level *level, int apart, const beginning *all, suspects *found)
{
    beginning from = *all;
    double times;
    const int white = leave_white(of, level, apart, &from, &times);
    suspects more;
    suspect(level, apart, &from, &more);
    *found = (suspects){.count = more.count, .white = white, .times = times * more.times, .left = more.left};
    for (int k = 0, i = 0; k < of->count; k++)
        if (from.out[k])
            found->pair[i++] = k;
    memcpy(found->pair + white, more.pair, (size_t)more.count * sizeof *more.pair);
    found->count += white;
}

/* With the response that leaves least: what the kind of exposures says that does. */
static void suspect_all(screening *of, suspects *found)
{
    beginning from[RESPONSES][2] = {{{.left = 0.0}}};
    int best = 0;
    for (int r = 0; r < of->tried; r++) {
        begin(&of->level[r], 0, &from[r][0]);
        begin(&of->level[r], 1, &from[r][1]);
        if (fmin(from[r][0].left, from[r][1].left) < fmin(from[best][0].left, from[best][1].left))
            best = r;
    }
    suspects apart;
    suspect_after(of, &of->level[best], 0, &from[best][0], found);
    suspect_after(of, &of->level[best], 1, &from[best][1], &apart);
    if (apart.left < found->left)
        *found = apart;
}

static void tell(const screening *of, int depth, int pair, double times)
{
    const hada_pair_files *files = &hada_dataset_get_info(of->pairs)->files[depth][pair];
    char better[80] = "";
    if (times > LESS_BY)
        snprintf(better, sizeof better, ", of which %.2g times less is unexplained without it", times);
    hada_monitor_tell(
        of->options->monitor, HADA_MESSAGE_NOTE,
        "%s is left out, for it contradicts the other pairs of its depth%s: check its exposure, and that %s "
        "is its scene (options.all_pairs takes it nevertheless)",
        files->raw, better, files->scene);
}

/* leave[depth][pair]: a hada_left_out. */
static hada_status screen(screening *of, unsigned char *const *leave, int *count, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(of->pairs);
    for (int z = 0; z < info->depths; z++) {
        suspects found;
        if (info->counts[z] < LEAST_PAIRS || info->counts[z] > MOST_PAIRS)
            continue;
        HADA_TRY(take_depth(of, z, info->counts[z], err));
        if (of->count < LEAST_PAIRS)
            continue;
        suspect_all(of, &found);
        for (int k = 0; k < found.count; k++) {
            const double *white = of->white[found.pair[k]];
            const int cut = k < found.white && white[1] <= AT_WHITE; /* the scene, not its frame */
            leave[z][of->at[found.pair[k]]] = cut ? HADA_CUT_OFF : HADA_CONTRADICTS;
            if (!cut)
                tell(of, z, of->at[found.pair[k]], found.times);
        }
        *count += found.count;
    }
    return HADA_OK;
}

/* Room for the pairs of a depth. */
static hada_status make_levels(screening *of, hada_error *err)
{
    HADA_TRY(hada_reducer_create(&of->reducer, of->options, 0, err));
    for (int r = 0; r < of->tried; r++) {
        HADA_TRY(hada_pair_level_create(&of->level[r], of->reducer.grid, of->options->channels, MOST_PAIRS, err));
        of->level[r].sharp = hada_look_is_lit(of->options, of->pairs);
    }
    return HADA_OK;
}

static void free_levels(screening *of)
{
    for (int r = 0; r < of->tried; r++)
        hada_pair_level_destroy(&of->level[r]);
    hada_reducer_destroy(&of->reducer);
}

hada_status hada_fit_screen(hada_dataset **out, unsigned char ***left_out, const hada_dataset *pairs,
                            const hada_fit_options *options, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    screening of = {.pairs = pairs, .options = options, .tried = options->scene_response == HADA_AUTO ? RESPONSES : 1};
    unsigned char **leave = NULL;
    int count = 0;
    hada_status status = HADA_OK;
    *out = NULL;
    *left_out = NULL;
    HADA_TRY_OR_DONE(make_levels(&of, err));
    HADA_TRY_OR_DONE(HADA_NEW(leave, (size_t)info->depths, "the pairs", err));
    for (int z = 0; z < info->depths; z++)
        HADA_TRY_OR_DONE(HADA_NEW(leave[z], (size_t)info->counts[z] + 1, "the pairs", err));
    HADA_TRY_OR_DONE(screen(&of, leave, &count, err));
    if (!count)
        goto done;
    HADA_TRY_OR_DONE(hada_dataset_select(out, pairs, (const unsigned char *const *)leave, err));
    *left_out = leave;
    leave = NULL;
done:
    hada_fit_left_out_free(&leave, info->depths);
    free_levels(&of);
    return status;
}

/* Whether what was filled in is of use: the others are not explained far worse with it. */
static int filled_help(screening *of, const unsigned char *leave)
{
    beginning with[2] = {{.left = 0.0}}, without[2] = {{.left = 0.0}};
    double errors;
    for (int apart = 0; apart < 2; apart++) {
        for (int k = 0; k < of->count; k++) {
            with[apart].out[k] = leave[of->at[k]] == HADA_CONTRADICTS;
            without[apart].out[k] = leave[of->at[k]] != HADA_STAYS;
        }
        begin(of->level, apart, &with[apart]);
        begin(of->level, apart, &without[apart]);
    }
    const int apart = fmin(with[1].left, without[1].left) < fmin(with[0].left, without[0].left);
    return gain_of(of->level, &without[apart].all, &with[apart].all, without[apart].out, &errors) > -log(USELESS_BY);
}

hada_status hada_fit_judge_filled(const hada_dataset *pairs, unsigned char *const *leave,
                                  const hada_fit_options *options, double response, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    hada_fit_options known = *options;
    screening of = {.pairs = pairs, .options = &known, .tried = 1};
    hada_status status = HADA_OK;
    known.scene_response = response;
    HADA_TRY_OR_DONE(make_levels(&of, err));
    for (int z = 0; z < info->depths; z++) {
        if (info->counts[z] > MOST_PAIRS || !memchr(leave[z], HADA_FILLED, (size_t)info->counts[z]))
            continue;
        HADA_TRY_OR_DONE(take_depth(&of, z, info->counts[z], err));
        const hada_left_out becomes = filled_help(&of, leave[z]) ? HADA_STAYS : HADA_CONTRADICTS;
        for (int i = 0; i < info->counts[z]; i++)
            if (leave[z][i] == HADA_FILLED) {
                leave[z][i] = becomes;
                hada_monitor_tell(options->monitor, HADA_MESSAGE_NOTE,
                                  becomes ? "%s is cut off at white, and %s is left out"
                                          : "%s is cut off at white: what is brighter there is taken from %s",
                                  info->files[z][i].scene, info->files[z][i].raw);
            }
    }
done:
    free_levels(&of);
    return status;
}

void hada_fit_left_out_free(unsigned char ***left_out, int depths)
{
    for (int z = 0; *left_out && z < depths; z++)
        free((*left_out)[z]);
    free(*left_out);
    *left_out = NULL;
}
