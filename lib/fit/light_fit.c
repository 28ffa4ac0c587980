#include "fit/light_fit.h"

#include "core/numbers.h"
#include "image/correct.h"

enum { TERMS = HADA_SMOOTH_TERMS, MOST = 1 + TERMS };
/* Conjugate gradients: iterations, and the share of the first residual's energy at which they end; where exposures are
 * found as well, in so many rounds of so many iterations. */
enum { ITERATIONS = 60, ROUNDS = 8, ROUND_ITERATIONS = 15 };
#define CONVERGED 1e-10
/* The weight of the transfer function's energy beside the mean power of the scenes. */
#define WEIGHT 0.003
/* Pixels a side of squares whose means count. */
enum { SQUARE = 4 };
/* Exposures lie within this factor of their mean. */
#define MOST_GAIN 1e3
/* Of normal equations the diagonal is so much larger. */
#define SOLVABLE 1e-9

struct hada_light_fit {
    const hada_sample *sample;
    hada_small_fft fft;
    size_t plane, area;           /* of half a spectrum; of a reduced frame */
    int count, rows, cols, terms; /* terms of the light that is assumed */
    int own, learned;
    int with[HADA_SAMPLE_MOST];          /* the pairs that are learned from, then the others */
    int depths, depth[HADA_SAMPLE_MOST]; /* of each pair, from 0 on */
    float *scene;                        /* [pair][plane] complex */
    float *frame, *made;                 /* [pair][area] */
    double *term;                        /* [TERMS][area] */
    double gram[TERMS * TERMS];          /* factors of the terms' products */
    double gain[HADA_SAMPLE_MOST], weight[TERMS];
    double *h, *residual, *direction, *product, *power; /* [depth][plane], the first four complex */
    double floor[HADA_SAMPLE_DEPTHS];                   /* weights of the transfer functions' energies */
    float *spectrum;                                    /* [2][plane] complex */
    float *work;                                        /* a transform */
};

void hada_light_fit_destroy(hada_light_fit **pointer)
{
    hada_light_fit *of = hada_taken(pointer);
    if (!of)
        return;
    hada_small_fft_destroy(&of->fft);
    HADA_FREE(of->scene, of->frame, of->made, of->term, of->h, of->residual, of->direction, of->product, of->power,
              of->spectrum, of->work, of);
}

static hada_status create(hada_light_fit *of, int crops, hada_error *err)
{
    static const char what[] = "light in the frames of pairs";
    const hada_sample *sample = of->sample;
    const size_t side = (size_t)sample->reducer.grid, pairs = (size_t)of->count;
    for (int k = 0; k < of->count; k++)
        of->depth[k] = of->depths += k && sample->depth[k] != sample->depth[k - 1];
    const size_t depths = (size_t)++of->depths;
    const hada_image *frame = &sample->frame[0];
    of->rows = crops ? frame->rows : sample->reducer.grid;
    of->cols = crops ? frame->cols : sample->reducer.grid;
    of->area = (size_t)of->rows * (size_t)of->cols;
    of->plane = side * (side / 2 + 1);
    HADA_TRY(hada_small_fft_create(&of->fft, sample->reducer.grid, err));
    HADA_TRY(HADA_NEW_RAW(of->scene, pairs * 2 * of->plane, what, err));
    HADA_TRY(HADA_NEW(of->frame, pairs * of->area, what, err));
    HADA_TRY(HADA_NEW_RAW(of->made, pairs * of->area, what, err));
    HADA_TRY(HADA_NEW(of->term, TERMS * of->area, what, err));
    HADA_TRY(HADA_NEW_RAW(of->h, depths * 2 * of->plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->residual, depths * 2 * of->plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->direction, depths * 2 * of->plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->product, depths * 2 * of->plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->power, depths * of->plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->spectrum, 4 * of->plane, what, err));
    HADA_TRY(HADA_NEW_RAW(of->work, 2 * side * side, what, err));
    for (int k = 0; k < TERMS; k++)
        for (int row = 0; row < frame->rows; row++)
            for (int col = 0; col < frame->cols; col++)
                of->term[(size_t)k * of->area + (size_t)row * (size_t)of->cols + (size_t)col] =
                    hada_sample_term(sample, k, row, col);
    return HADA_OK;
}

hada_status hada_light_fit_create(hada_light_fit **out, const hada_sample *sample, int crops, hada_error *err)
{
    hada_status status;
    *out = NULL;
    HADA_TRY(HADA_NEW(*out, 1, "light in the frames of pairs", err));
    (*out)->sample = sample;
    (*out)->count = sample->count;
    status = create(*out, crops, err);
    if (status)
        hada_light_fit_destroy(out);
    return status;
}

/* The numbers of all transfer functions. */
static size_t length_of(const hada_light_fit *of)
{
    return (size_t)of->depths * 2 * of->plane;
}

/* Two images, the second of which may be NULL, into a transform. */
static void put(hada_light_fit *of, const float *first, const float *second)
{
    const size_t size = (size_t)of->fft.size, rows = (size_t)of->rows, cols = (size_t)of->cols;
    memset(of->work, 0, 2 * size * size * sizeof *of->work);
    for (size_t row = 0; row < rows; row++)
        for (size_t col = 0; col < cols; col++) {
            of->work[2 * (row * size + col)] = first[row * cols + col];
            of->work[2 * (row * size + col) + 1] = second ? second[row * cols + col] : 0.0f;
        }
    hada_small_fft_run(&of->fft, of->work);
    hada_small_fft_part(&of->fft, of->work, of->spectrum, of->spectrum + 2 * of->plane);
}

/* The spectra of scenes, of a response; windows lie in the grid's corner, as frames do. */
static void take(hada_light_fit *of, int channel, int response)
{
    const size_t size = (size_t)of->fft.size;
    for (int k = 0; k < of->count; k++) {
        const hada_image *scene = &of->sample->scene[k][response], *frame = &of->sample->frame[k];
        const size_t rows = (size_t)scene->rows, cols = (size_t)scene->cols;
        const float *from = scene->data + (size_t)channel * rows * cols;
        const size_t high = (size_t)frame->rows, wide = (size_t)frame->cols;
        for (size_t row = 0; row < high; row++)
            memcpy(of->frame + (size_t)k * of->area + row * (size_t)of->cols,
                   frame->data + ((size_t)channel * high + row) * wide, wide * sizeof *of->frame);
        memset(of->work, 0, 2 * size * size * sizeof *of->work);
        for (size_t i = 0; i < rows * cols; i++)
            of->work[2 * (i / cols * size + i % cols)] = from[i];
        hada_small_fft_run(&of->fft, of->work);
        hada_small_fft_part(&of->fft, of->work, of->scene + (size_t)k * 2 * of->plane, of->spectrum);
    }
}

/* The spectrum of what a pair's scene makes. */
static void multiply(const hada_light_fit *of, int pair, const double *h, float *to)
{
    const float *x = of->scene + (size_t)pair * 2 * of->plane;
    const double gain = of->gain[pair];
    h += (size_t)of->depth[pair] * 2 * of->plane;
    for (size_t i = 0; i < 2 * of->plane; i += 2) {
        to[i] = (float)(gain * (h[i] * x[i] - h[i + 1] * x[i + 1]));
        to[i + 1] = (float)(gain * (h[i] * x[i + 1] + h[i + 1] * x[i]));
    }
}

/* What the scenes of so many pairs make on the sensor. */
static void make(hada_light_fit *of, const double *h, int count)
{
    const size_t size = (size_t)of->fft.size, cols = (size_t)of->cols;
    const float scale = (float)(1.0 / ((double)of->fft.size * of->fft.size));
    for (int k = 0; k < count; k += 2) {
        const int two = k + 1 < count;
        float *first = of->made + (size_t)of->with[k] * of->area,
              *second = of->made + (size_t)of->with[k + two] * of->area, *other = of->spectrum + 2 * of->plane;
        multiply(of, of->with[k], h, of->spectrum);
        multiply(of, of->with[k + two], h, other);
        hada_small_fft_join(&of->fft, of->spectrum, other, of->work);
        hada_small_fft_run(&of->fft, of->work);
        for (size_t i = 0; i < of->area; i++) {
            const float *at = of->work + 2 * (i / cols * size + i % cols);
            second[i] = -scale * at[1];
            first[i] = scale * at[0];
        }
    }
}

/* Sums of an image's products with the terms of the light. */
static void products(const hada_light_fit *of, const float *image, double *sum)
{
    for (int k = 0; k < of->terms; k++)
        for (size_t i = 0; i < of->area; i++)
            sum[k] += of->term[(size_t)k * of->area + i] * (double)image[i];
}

static void subtract(const hada_light_fit *of, const double *weight, float *image)
{
    for (int k = 0; k < of->terms; k++)
        for (size_t i = 0; i < of->area; i++)
            image[i] -= (float)(weight[k] * of->term[(size_t)k * of->area + i]);
}

/* Takes off images the light that explains most of those that are learned from; its weights, where all frames have one.
 */
static void clear(hada_light_fit *of, float *images, int count, double *weight)
{
    double all[TERMS] = {0.0};
    for (int k = 0; k < count; k++) {
        float *image = images + (size_t)of->with[k] * of->area;
        double sum[TERMS] = {0.0};
        products(of, image, sum);
        for (int j = 0; j < of->terms && k < of->learned; j++)
            all[j] += sum[j] / of->learned;
        if (of->own && of->terms) {
            hada_cholesky_solve(of->gram, of->terms, sum);
            subtract(of, sum, image);
        }
    }
    if (of->own || !of->terms)
        return;
    hada_cholesky_solve(of->gram, of->terms, all);
    for (int k = 0; k < count; k++)
        subtract(of, all, images + (size_t)of->with[k] * of->area);
    if (weight)
        memcpy(weight, all, (size_t)of->terms * sizeof *weight);
}

/* The transposed model, of images that are learned from, whose light is taken off. */
static void gather(hada_light_fit *of, const float *images, double *out)
{
    memset(out, 0, length_of(of) * sizeof *out);
    for (int k = 0; k < of->learned; k += 2) {
        const int two = k + 1 < of->learned;
        put(of, images + (size_t)of->with[k] * of->area, two ? images + (size_t)of->with[k + 1] * of->area : NULL);
        for (int j = 0; j <= two; j++) {
            const int pair = of->with[k + j];
            const float *x = of->scene + (size_t)pair * 2 * of->plane, *b = of->spectrum + (size_t)j * 2 * of->plane;
            double *to = out + (size_t)of->depth[pair] * 2 * of->plane;
            for (size_t i = 0; i < 2 * of->plane; i += 2) {
                to[i] += of->gain[pair] * ((double)x[i] * b[i] + (double)x[i + 1] * b[i + 1]);
                to[i + 1] += of->gain[pair] * ((double)x[i] * b[i + 1] - (double)x[i + 1] * b[i]);
            }
        }
    }
}

/* How often a frequency counts: in both halves or one. */
static double often(const hada_light_fit *of, size_t i)
{
    const size_t size = (size_t)of->fft.size, kx = i % of->plane / size;
    return kx == 0 || 2 * kx == size ? 1.0 : 2.0;
}

/* The preconditioner: the diagonal of the normal equations, but for the crop. */
static double under(const hada_light_fit *of, size_t i)
{
    return of->power[i] + of->floor[i / of->plane];
}

/* inverse: divided by the preconditioner. */
static double product_of(const hada_light_fit *of, const double *a, const double *b, int inverse)
{
    double sum = 0.0;
    for (size_t i = 0; i < length_of(of) / 2; i++)
        sum += often(of, i) * (a[2 * i] * b[2 * i] + a[2 * i + 1] * b[2 * i + 1]) / (inverse ? under(of, i) : 1.0);
    return sum;
}

/* The power of the scenes that are learned from. */
static void add_power(hada_light_fit *of)
{
    const double size = of->fft.size;
    memset(of->power, 0, length_of(of) / 2 * sizeof *of->power);
    for (int k = 0; k < of->learned; k++) {
        const int pair = of->with[k];
        const float *x = of->scene + (size_t)pair * 2 * of->plane;
        double *to = of->power + (size_t)of->depth[pair] * of->plane;
        for (size_t i = 0; i < of->plane; i++)
            to[i] +=
                of->gain[pair] * of->gain[pair] * ((double)x[2 * i] * x[2 * i] + (double)x[2 * i + 1] * x[2 * i + 1]);
    }
    memset(of->floor, 0, sizeof of->floor);
    for (size_t i = 0; i < length_of(of) / 2; i++)
        of->floor[i / of->plane] += WEIGHT * often(of, i) * of->power[i] / (size * size);
}

/* The normal equations' left side. */
static void apply(hada_light_fit *of, const double *h, double *out)
{
    make(of, h, of->learned);
    clear(of, of->made, of->learned, NULL);
    gather(of, of->made, out);
    for (size_t i = 0; i < length_of(of); i++)
        out[i] += of->floor[i / 2 / of->plane] * h[i];
}

/* Goes on from the transfer functions of before. */
static void iterate(hada_light_fit *of, int iterations)
{
    const size_t length = length_of(of);
    double *r = of->residual, *p = of->direction, *ap = of->product, keep = 0.0;
    add_power(of);
    memcpy(of->made, of->frame, (size_t)of->count * of->area * sizeof *of->made);
    clear(of, of->made, of->learned, NULL);
    gather(of, of->made, r);
    const double first = product_of(of, r, r, 1);
    apply(of, of->h, ap);
    for (size_t i = 0; i < length; i++)
        r[i] -= ap[i];
    memset(p, 0, length * sizeof *p);
    double norm = product_of(of, r, r, 1);
    for (int k = 0; k < iterations && norm > CONVERGED * first; k++) {
        for (size_t i = 0; i < length; i++)
            p[i] = keep * p[i] + r[i] / under(of, i / 2);
        apply(of, p, ap);
        const double curvature = product_of(of, p, ap, 0);
        if (!(curvature > 0.0))
            return;
        for (size_t i = 0; i < length; i++) {
            of->h[i] += norm / curvature * p[i];
            r[i] -= norm / curvature * ap[i];
        }
        const double now = product_of(of, r, r, 1);
        keep = now / norm;
        norm = now;
    }
}

/* The exposure of a pair by what its scene makes, with light beside it. */
static double expose(const hada_light_fit *of, int pair)
{
    const float *made = of->made + (size_t)pair * of->area, *frame = of->frame + (size_t)pair * of->area;
    const int n = 1 + of->terms;
    double normal[MOST * MOST] = {0.0}, right[MOST] = {0.0}, term[MOST];
    for (size_t i = 0; i < of->area; i++)
        for (int k = 0; k < n; k++) {
            term[k] = k ? of->term[(size_t)(k - 1) * of->area + i] : (double)made[i] / of->gain[pair];
            right[k] += term[k] * (double)frame[i];
            for (int j = 0; j <= k; j++)
                normal[k * n + j] += term[k] * term[j];
        }
    for (int k = 0; k < n; k++)
        normal[k * n + k] *= 1.0 + SOLVABLE;
    if (!hada_cholesky_factor(normal, n))
        return 1.0;
    hada_cholesky_solve(normal, n, right);
    return right[0] > 1.0 / MOST_GAIN ? fmin(right[0], MOST_GAIN) : 1.0 / MOST_GAIN;
}

/* All exposures; the geometric mean of those of a depth that are learned from is 1. */
static void expose_all(hada_light_fit *of)
{
    double sum[HADA_SAMPLE_DEPTHS] = {0.0}, members[HADA_SAMPLE_DEPTHS] = {0.0};
    make(of, of->h, of->count);
    for (int k = 0; k < of->count; k++) {
        const int pair = of->with[k];
        of->gain[pair] = expose(of, pair);
        sum[of->depth[pair]] += k < of->learned ? log(of->gain[pair]) : 0.0;
        members[of->depth[pair]] += k < of->learned;
    }
    for (int k = 0; k < of->count; k++)
        of->gain[k] /= exp(sum[of->depth[k]] / fmax(1.0, members[of->depth[k]]));
}

static hada_light_left left_of(const hada_light_fit *of, const float *image)
{
    hada_light_left left = {0.0, 0.0};
    for (int row = 0; row < of->rows; row += SQUARE)
        for (int col = 0; col < of->cols; col += SQUARE) {
            const int high = hada_least(SQUARE, of->rows - row), wide = hada_least(SQUARE, of->cols - col);
            double sum = 0.0;
            for (int i = 0; i < high * wide; i++) {
                const double off = (double)image[(row + i / wide) * of->cols + col + i % wide];
                left.whole += off * off;
                sum += off;
            }
            left.coarse += sum * sum / (high * wide);
        }
    return left;
}

void hada_light_fit_run(hada_light_fit *of, int channel, hada_light_guess guess, const unsigned char *held_out,
                        hada_light_left *left, double *weight)
{
    int others = 0;
    of->learned = 0;
    of->own = guess.kind == HADA_LIGHT_OWN;
    of->terms = guess.kind == HADA_LIGHT_NONE ? 0 : guess.kind == HADA_LIGHT_LEVEL ? 1 : TERMS;
    for (int k = 0; k < of->count; k++) {
        of->gain[k] = 1.0;
        if (!held_out || !held_out[k])
            of->with[of->learned++] = k;
    }
    for (int k = 0; k < of->count; k++)
        if (held_out && held_out[k])
            of->with[of->learned + others++] = k;
    take(of, channel, guess.response);
    for (int k = 0; k < of->terms; k++)
        for (int j = 0; j < of->terms; j++) {
            double sum = 0.0;
            for (size_t i = 0; i < of->area; i++)
                sum += of->term[(size_t)k * of->area + i] * of->term[(size_t)j * of->area + i];
            of->gram[k * of->terms + j] = k == j ? sum * (1.0 + SOLVABLE) : sum;
        }
    hada_cholesky_factor(of->gram, of->terms);
    memset(of->h, 0, length_of(of) * sizeof *of->h);
    for (int round = 0; round < ROUNDS && guess.apart; round++) {
        iterate(of, ROUND_ITERATIONS);
        expose_all(of);
    }
    iterate(of, guess.apart ? ROUND_ITERATIONS : ITERATIONS);
    if (guess.apart)
        expose_all(of);
    make(of, of->h, of->count);
    for (size_t i = 0; i < (size_t)of->count * of->area; i++)
        of->made[i] = of->frame[i] - of->made[i];
    memset(of->weight, 0, sizeof of->weight);
    clear(of, of->made, of->count, of->weight);
    for (int k = 0; k < of->count && left; k++)
        left[k] = left_of(of, of->made + (size_t)k * of->area);
    if (weight)
        memcpy(weight, of->weight, sizeof of->weight);
}
