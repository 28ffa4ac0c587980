/* What the channels of a sensor see of the colours of the scenes: its filters are not the primaries of a display, so
 * its red sees some of the green. A frame is a 3 x 3 matrix times what each of the scene's colours makes by itself;
 * each row has the sum 1, for brightness is in the transfer functions.
 *
 * Transfer functions and matrix in turns (alternating least squares), with the crop in the model: frames times the
 * inverse matrix give transfer functions, and these what the colours make; then each channel's row is the solution of
 * three normal equations. Pixels count in blocks, in which there is little noise: what transfer functions make of
 * scenes holds some of the noise that they were learned from. Saturated pixels do not count, nor blocks of many. Smooth
 * surfaces are left out, as light of the room or a dark level may be there still. Exposures that differ are found anew
 * in each turn: by one channel, or by mixed colours, they look different. */
#include "fit/look.h"
#include "fit/pair_level.h"
#include "image/correct.h"

/* Pairs that are looked at, turns, pixels of a side of a block, and the change of a matrix that is none any more. */
enum { PAIRS = 6, TURNS = 12, EXPOSED_TURNS = 16, BLOCK = 8 };
#define SETTLED 0.002
/* Light adds up: no channel sees less than nothing of a colour, but by noise and by what few pairs leave open. */
#define LEAST_SEEN (-0.2)
/* A first matrix that is this near to none is none; and blocks of frames must be left with so much less by the last
 * one, in the geometric mean of the channels: simulated sensors that mix a twentieth leave 0.04 to 0.16, real pairs
 * whose results get no better 0.77. */
#define NONE 0.01
#define SURE 0.5

typedef struct colour_trial {
    const hada_fit_options *options; /* of one depth */
    hada_look at;                    /* its first pairs, with frames in the scenes' colours */
    hada_pair pair[PAIRS];
    hada_image frame[PAIRS], scene[PAIRS], weights[PAIRS]; /* frames are its own; weights as hada_look has them */
    int blocks;                                            /* of a frame */
    float *known;                                          /* [block]: 1; 0: too few of its pixels are */
    float *seen[HADA_COLOURS], *made[HADA_COLOURS]; /* [pair][block]: frames, and what each colour makes of them */
    double left[HADA_COLOURS], before[HADA_COLOURS];
    double m[HADA_COLOUR_MATRIX];
} colour_trial;

/* Whether all channels of a pixel are known. */
static int is_known(const hada_image *weights, size_t at)
{
    const size_t area = (size_t)weights->rows * (size_t)weights->cols;
    for (size_t c = 0; weights->data && c < HADA_COLOURS; c++)
        if (weights->data[c * area + at] != 1.0f)
            return 0;
    return 1;
}

/* Means of blocks of one channel of a pair's frame, less the smooth surface that is nearest to them; 0 where less than
 * half of a block is known. */
static void reduce(const colour_trial *of, int pair, const float *channel, float *to)
{
    const hada_fit_options *options = of->options;
    hada_image blocks = {1, options->raw_rows / BLOCK, options->raw_cols / BLOCK, to};
    const int high = blocks.rows, wide = blocks.cols;
    double surface[HADA_SMOOTH_TERMS];
    for (int r = 0; r < high; r++)
        for (int c = 0; c < wide; c++) {
            double sum = 0.0;
            int count = 0;
            for (int i = 0; i < BLOCK * BLOCK; i++) {
                const size_t at =
                    (size_t)(r * BLOCK + i / BLOCK) * (size_t)options->raw_cols + (size_t)(c * BLOCK + i % BLOCK);
                if (!is_known(&of->weights[pair], at))
                    continue;
                sum += (double)channel[at];
                count++;
            }
            of->known[r * wide + c] = 2 * count >= BLOCK * BLOCK ? 1.0f : 0.0f;
            to[r * wide + c] = (float)(sum / hada_most(count, 1));
        }
    hada_smooth_nearest(to, of->known, high, wide, surface);
    hada_smooth_add(surface, -1.0, &blocks);
    for (int i = 0; i < of->blocks; i++)
        to[i] = of->known[i] != 0.0f ? to[i] : 0.0f;
}

static double product(const colour_trial *of, const float *a, const float *b)
{
    const size_t count = (size_t)of->at.group * (size_t)of->blocks;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (double)a[i] * (double)b[i];
    return sum;
}

/* *fits: whether all pairs are such that the fit will take them. */
static hada_status begin(colour_trial *of, const hada_dataset *pairs, int depth, int *fits, hada_error *err)
{
    const hada_reducer rule = {.options = of->options};
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        of->m[i] = i % (HADA_COLOURS + 1) == 0;
    for (int k = 0; k < HADA_COLOURS; k++) {
        HADA_TRY(HADA_NEW_RAW(of->seen[k], (size_t)of->at.group * (size_t)of->blocks, "blocks", err));
        HADA_TRY(HADA_NEW_RAW(of->made[k], (size_t)of->at.group * (size_t)of->blocks, "blocks", err));
    }
    HADA_TRY(HADA_NEW_RAW(of->known, (size_t)of->blocks, "blocks", err));
    *fits = 1;
    for (int i = 0; i < of->at.group && *fits; i++) {
        hada_pair *pair = &of->pair[i];
        hada_image *raw = &of->frame[i];
        HADA_TRY(hada_pair_take(pair, pairs, depth, i, err));
        HADA_TRY(hada_image_copy(raw, pair->raw, err));
        of->scene[i] = *pair->scene;
        of->weights[i] = pair->weights ? *pair->weights : (hada_image){0};
        *fits = hada_reducer_fits(&rule, raw, &of->scene[i]);
        for (size_t k = 0; k < HADA_COLOURS && *fits; k++)
            reduce(of, i, raw->data + k * hada_image_count(raw) / HADA_COLOURS,
                   of->seen[k] + (size_t)i * (size_t)of->blocks);
    }
    return HADA_OK;
}

static void end(colour_trial *of)
{
    for (int i = 0; i < PAIRS; i++) {
        hada_image_destroy(&of->frame[i]);
        hada_pair_return(&of->pair[i]);
    }
    for (int k = 0; k < HADA_COLOURS; k++)
        HADA_FREE(of->seen[k], of->made[k]);
    free(of->known);
}

/* What each colour of the scenes makes, with the matrix that there is. */
static hada_status make(colour_trial *of, hada_error *err)
{
    const size_t area = (size_t)of->options->raw_rows * (size_t)of->options->raw_cols;
    double dark[PAIRS];
    float *made = NULL;
    hada_image frame[PAIRS];
    hada_dataset *few = NULL, *pure = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(made, PAIRS * area, "frames", err));
    HADA_TRY_OR_DONE(hada_dataset_from_weighted(&few, 1, of->options->distances_mm, &of->at.group, of->frame, of->scene,
                                                of->weights, err));
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, few, of->m, err));
    for (int k = 0; k < HADA_COLOURS; k++) {
        of->at.channel = k + 1;
        HADA_TRY_OR_DONE(hada_look_take(&of->at, pure, err));
        HADA_TRY_OR_DONE(hada_look_predict(&of->at, made, frame, dark, err));
        for (int i = 0; i < of->at.group; i++)
            reduce(of, i, made + (size_t)i * area, of->made[k] + (size_t)i * (size_t)of->blocks);
        hada_look_return(&of->at);
    }
done:
    free(made);
    hada_look_return(&of->at);
    hada_dataset_destroy(&pure);
    hada_dataset_destroy(&few);
    return status;
}

/* Brings frames nearer to one exposure, by what the colours make of all channels. *change: by how much the most, too.
 */
static void expose(colour_trial *of, double *change)
{
    double by[PAIRS], mean = 0.0;
    for (int i = 0; i < of->at.group; i++) {
        double cross = 0.0, power = 0.0;
        for (int b = i * of->blocks; b < (i + 1) * of->blocks; b++)
            for (int c = 0; c < HADA_COLOURS; c++) {
                double all = 0.0;
                for (int k = 0; k < HADA_COLOURS; k++)
                    all += of->m[c * HADA_COLOURS + k] * (double)of->made[k][b];
                cross += all * (double)of->seen[c][b];
                power += all * all;
            }
        by[i] = cross > 0.0 && power > 0.0 ? log(cross / power) : 0.0;
        mean += by[i] / of->at.group;
    }
    for (int i = 0; i < of->at.group; i++) {
        const float times = (float)exp(mean - by[i]);
        *change = fmax(*change, fabs(mean - by[i]));
        for (size_t k = 0; k < hada_image_count(&of->frame[i]); k++)
            of->frame[i].data[k] *= times;
        for (int b = i * of->blocks; b < (i + 1) * of->blocks; b++)
            for (int c = 0; c < HADA_COLOURS; c++)
                of->seen[c][b] *= times;
    }
}

/* The rows that explain frames best by what the colours make. *change: by how much the most; of->left: what was left
 * with the rows before. */
static void find_rows(colour_trial *of, double *change)
{
    double normal[HADA_COLOUR_MATRIX], inverse[HADA_COLOUR_MATRIX];
    for (int k = 0; k < HADA_COLOUR_MATRIX; k++)
        normal[k] = product(of, of->made[k / HADA_COLOURS], of->made[k % HADA_COLOURS]);
    hada_colours_invert(normal, inverse);
    *change = 0.0;
    for (int c = 0; c < HADA_COLOURS; c++) {
        double right[HADA_COLOURS], row[HADA_COLOURS] = {0.0}, *m = of->m + (size_t)c * HADA_COLOURS;
        of->left[c] = product(of, of->seen[c], of->seen[c]);
        for (int k = 0; k < HADA_COLOURS; k++) {
            right[k] = product(of, of->made[k], of->seen[c]);
            of->left[c] -= 2.0 * m[k] * right[k];
            for (int j = 0; j < HADA_COLOURS; j++)
                of->left[c] += m[k] * m[j] * normal[k * HADA_COLOURS + j];
        }
        for (int k = 0; k < HADA_COLOUR_MATRIX; k++)
            row[k / HADA_COLOURS] += inverse[k] * right[k % HADA_COLOURS];
        const double sum = row[0] + row[1] + row[2];
        for (int k = 0; k < HADA_COLOURS; k++) {
            *change = fmax(*change, fabs(row[k] / sum - m[k]));
            m[k] = row[k] / sum;
        }
    }
}

hada_status hada_fit_find_colours(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                  int exposed, double m[HADA_COLOUR_MATRIX], int *found, hada_error *err)
{
    const int depth = hada_look_depth(fit, pairs), turns = exposed ? EXPOSED_TURNS : TURNS;
    hada_fit_options one = *fit;
    colour_trial of = {.options = &one};
    double change = 1.0, less = 1.0;
    int fits;
    hada_status status = HADA_OK;
    *found = 0;
    of.blocks = fit->raw_rows / BLOCK * (fit->raw_cols / BLOCK);
    if (fit->channels != HADA_COLOURS || depth == fit->depths || !of.blocks)
        return HADA_OK;
    one.depths = 1;
    one.distances_mm = fit->distances_mm + depth;
    of.at = (hada_look){.context = context, .options = &one};
    of.at.group = hada_least(hada_dataset_get_info(pairs)->counts[depth], PAIRS);
    hada_look_ignore_light(&of.at, pairs, depth);
    HADA_TRY_OR_DONE(begin(&of, pairs, depth, &fits, err));
    if (!fits)
        goto done;
    for (int turn = 0; turn < turns && change > SETTLED; turn++) {
        HADA_TRY_OR_DONE(make(&of, err));
        find_rows(&of, &change);
        if (!turn)
            memcpy(of.before, of.left, sizeof of.left);
        if (!hada_colours_usable(of.m) || (!turn && change < NONE))
            goto done;
        if (exposed)
            expose(&of, &change);
    }
    for (int c = 0; c < HADA_COLOURS; c++)
        less *= cbrt(of.left[c] / of.before[c]);
    *found = less < SURE;
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        *found &= of.m[i] > LEAST_SEEN;
done:
    for (int i = 0; !status && i < HADA_COLOUR_MATRIX; i++)
        m[i] = *found ? of.m[i] : 0.0;
    end(&of);
    return status;
}
