/* The wander of a stack of point spread functions, and how alike two are. Each is magnified to the next depth and
 * compared by cross-correlation; of the sum of all shifts, what an axis beside the middle explains is taken off. */
#include "fit/psf_depths.h"

#include "image/pixels.h"
#include "image/small_fft.h"

/* Pixels a side at which they are compared, at most: larger ones are binned. Finer where small changes count. */
enum { MOST_SIDE = 256, FINE_SIDE = 1024 };
static const char what[] = "the drift of point spread functions";

typedef struct drift {
    int factor, rows, cols; /* of bins */
    hada_image one, next;   /* mean of channels, of two depths that follow each other */
    hada_small_fft fft;
    float *first, *second; /* complex */
} drift;

/* Means over channels and bins. */
static void reduce(const drift *of, const hada_image *from, hada_image *to)
{
    memset(to->data, 0, hada_image_count(to) * sizeof *to->data);
    for (int c = 0; c < from->channels; c++)
        for (int y = 0; y < of->rows * of->factor; y++)
            for (int x = 0; x < of->cols * of->factor; x++)
                to->data[y / of->factor * of->cols + x / of->factor] +=
                    from->data[((size_t)c * (size_t)from->rows + (size_t)y) * (size_t)from->cols + (size_t)x];
}

/* Root of the mean square distance of the light from its own centre. */
static double spread_of(const hada_image *image)
{
    double light = 0.0, row = 0.0, col = 0.0, square = 0.0;
    for (int y = 0; y < image->rows; y++)
        for (int x = 0; x < image->cols; x++) {
            const double value = (double)image->data[y * image->cols + x];
            light += value;
            row += value * y;
            col += value * x;
            square += value * ((double)y * y + (double)x * x);
        }
    return light > 0.0 ? sqrt(fmax(square / light - pow(row / light, 2.0) - pow(col / light, 2.0), 0.0)) : 0.0;
}

/* Least squares of values = a + b / distance. */
static void fit_law(const double *values, int stride, const double *distances, int count, double *a, double *b)
{
    double mean = 0.0, mean_inverse = 0.0, product = 0.0, square = 0.0;
    for (int k = 0; k < count; k++) {
        mean += values[k * stride] / count;
        mean_inverse += 1.0 / distances[k] / count;
    }
    for (int k = 0; k < count; k++) {
        const double inverse = 1.0 / distances[k] - mean_inverse;
        product += inverse * (values[k * stride] - mean);
        square += inverse * inverse;
    }
    *b = square > 0.0 ? product / square : 0.0;
    *a = mean - *b * mean_inverse;
}

/* By how much `next` stands beside `one`, in bins; returns how much they are alike then. */
static double compare(const drift *of, double *shift)
{
    const double energy = hada_small_fft_put(&of->fft, &of->one, of->first);
    const double both = sqrt(energy * hada_small_fft_put(&of->fft, &of->next, of->second));
    const double most = hada_small_fft_match(&of->fft, of->first, of->second, &shift[0], &shift[1]);
    return both > 0.0 ? most / both : 0.0;
}

static hada_status begin(drift *of, const hada_image *first, int most, hada_error *err)
{
    const int side = first->rows > first->cols ? first->rows : first->cols;
    int size = 8;
    of->factor = (side + most - 1) / most;
    of->rows = first->rows / of->factor;
    of->cols = first->cols / of->factor;
    while (size < of->rows || size < of->cols)
        size *= 2;
    HADA_TRY(hada_small_fft_create(&of->fft, size, err));
    HADA_TRY(HADA_NEW(of->first, 2 * (size_t)size * (size_t)size, what, err));
    HADA_TRY(HADA_NEW(of->second, 2 * (size_t)size * (size_t)size, what, err));
    HADA_TRY(hada_image_create(&of->one, 1, of->rows, of->cols, err));
    return hada_image_create(&of->next, 1, of->rows, of->cols, err);
}

static void end(drift *of)
{
    hada_small_fft_destroy(&of->fft);
    hada_image_destroy(&of->one);
    hada_image_destroy(&of->next);
    HADA_FREE(of->first, of->second);
}

hada_status hada_psf_drift(double (*out)[2], const hada_psfs *psfs, hada_error *err)
{
    drift of = {0};
    double *spread = NULL, a, b;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(spread, (size_t)psfs->count, what, err));
    HADA_TRY_OR_DONE(begin(&of, psfs->image, MOST_SIDE, err));
    for (int k = 0; k < psfs->count; k++) {
        reduce(&of, &psfs->image[k], &of.next);
        spread[k] = spread_of(&of.next);
    }
    fit_law(spread, 1, psfs->distances_mm, psfs->count, &a, &b);
    out[0][0] = out[0][1] = 0.0;
    for (int k = 0; k + 1 < psfs->count; k++) {
        const double here = a + b / psfs->distances_mm[k], there = a + b / psfs->distances_mm[k + 1];
        const double scale = here > 0.0 && there > 0.0 ? there / here : 1.0;
        double shift[2];
        hada_image_destroy(&of.one);
        reduce(&of, &psfs->image[k], &of.next);
        HADA_TRY_OR_DONE(hada_image_magnify(&of.one, &of.next, scale, 0.0, 0.0, of.rows, of.cols, err));
        reduce(&of, &psfs->image[k + 1], &of.next);
        compare(&of, shift);
        for (int i = 0; i < 2; i++)
            out[k + 1][i] = scale * out[k][i] + of.factor * shift[i];
    }
    for (int i = 0; i < 2; i++) {
        fit_law(&out[0][i], 2, psfs->distances_mm, psfs->count, &a, &b);
        for (int k = 0; k < psfs->count; k++)
            out[k][i] -= a + b / psfs->distances_mm[k];
    }
done:
    end(&of);
    free(spread);
    return status;
}

hada_status hada_psf_alike(double *alike, double *moved, const hada_image *one, const hada_image *other,
                           hada_error *err)
{
    drift of = {0};
    double shift[2] = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(begin(&of, one, FINE_SIDE, err));
    reduce(&of, one, &of.one);
    reduce(&of, other, &of.next);
    *alike = compare(&of, shift);
    *moved = of.factor * hypot(shift[0], shift[1]);
done:
    end(&of);
    return status;
}
