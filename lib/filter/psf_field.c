/* Components of point spread functions that vary over the field: h(p) = sum_k w_k(p) h_k, from those measured at some
 * positions p. Each is shifted so that its position comes to the middle. The first component is the mean PSF, its
 * weight the light of each, so that no number of components changes the light of the scene; the others are the singular
 * vectors of what that leaves, the least-squares ones for every number of them (Yanny et al., Optica 7, 1012 (2020),
 * Eq. 2, without the first one: perf/results/field-varying.md has both). Their weights at the positions are
 * interpolated by thin-plate splines. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "filter/psf.h"
#include "image/pixels.h"
#include "model/model.h"

enum { LEAST_POSITIONS = 4, SWEEPS = 60 };

hada_status hada_psf_positions_check(const double *rows, const double *cols, int count, hada_error *err)
{
    double size = 0.0, area = 0.0;
    if (count > HADA_MOST_POSITIONS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "PSFs of %d positions; %d of a depth are possible", count,
                         HADA_MOST_POSITIONS);
    for (int i = 0; i < count; i++)
        if (!isfinite(rows[i]) || !isfinite(cols[i]))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "the positions of PSFs must be finite");
    for (int i = 0; i < count; i++)
        for (int k = 0; k < i; k++) {
            const double far = hypot(rows[i] - rows[k], cols[i] - cols[k]);
            size = fmax(size, far);
            if (far == 0.0)
                return hada_fail(err, HADA_ERROR_ARGUMENT,
                                 "two PSFs of a depth have the position (%g, %g): average them first, or correct one",
                                 cols[i], rows[i]);
        }
    for (int i = 2; i < count; i++)
        area = fmax(area, fabs((rows[1] - rows[0]) * (cols[i] - cols[0]) - (cols[1] - cols[0]) * (rows[i] - rows[0])));
    if (count < LEAST_POSITIONS || !(area > 1e-3 * size * size))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "weights over the field need PSFs of %d positions at least that are not on a line; there are "
                         "%d%s",
                         LEAST_POSITIONS, count, count < LEAST_POSITIONS ? "" : ", on a line");
    return HADA_OK;
}

static hada_status shift(hada_image *image, double rows, double cols, hada_error *err)
{
    hada_image moved = {0};
    HADA_TRY(hada_image_magnify(&moved, image, 1.0, rows, cols, image->rows, image->cols, err));
    hada_image_destroy(image);
    *image = moved;
    return HADA_OK;
}

/* Whether place `at` of `size` was within the image before it was shifted. */
static int is_known(int at, double shifted, int size)
{
    const double from = at - shifted;
    return from > -0.5 && from < size - 0.5;
}

typedef struct measured {
    hada_image *image;
    const double *rows, *cols;
    int count;
} measured;

/* What lay beyond the borders of an image, from the others that saw it: their mean by the inverse square of distance.
 */
static void fill_unseen(const measured *of)
{
    const int rows = of->image->rows, cols = of->image->cols;
    const size_t area = (size_t)rows * (size_t)cols;
    for (int n = 0; n < of->count; n++)
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < cols; j++) {
                double sum = 0.0;
                if (is_known(i, -of->rows[n], rows) && is_known(j, -of->cols[n], cols))
                    continue;
                for (int c = 0; c < of->image->channels; c++)
                    of->image[n].data[(size_t)c * area + (size_t)i * (size_t)cols + (size_t)j] = 0.0f;
                for (int m = 0; m < of->count; m++) {
                    if (m == n || !is_known(i, -of->rows[m], rows) || !is_known(j, -of->cols[m], cols))
                        continue;
                    const double down = of->rows[m] - of->rows[n], across = of->cols[m] - of->cols[n];
                    const double share = 1.0 / (down * down + across * across);
                    sum += share;
                    for (int c = 0; c < of->image->channels; c++) {
                        const size_t at = (size_t)c * area + (size_t)i * (size_t)cols + (size_t)j;
                        of->image[n].data[at] += (float)share * of->image[m].data[at];
                    }
                }
                for (int c = 0; c < of->image->channels && sum > 0.0; c++)
                    of->image[n].data[(size_t)c * area + (size_t)i * (size_t)cols + (size_t)j] /= (float)sum;
            }
}

/* Eigenvalues of a symmetric matrix, descending, and its vectors as columns: Jacobi's rotations. */
static void eigen(double *a, double *vectors, double *values, int n)
{
    memset(vectors, 0, (size_t)n * (size_t)n * sizeof *vectors);
    for (int i = 0; i < n; i++)
        vectors[i * n + i] = 1.0;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double off = 0.0, all = 0.0;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                all += a[i * n + j] * a[i * n + j];
                off += i == j ? 0.0 : a[i * n + j] * a[i * n + j];
            }
        if (off <= 1e-30 * all)
            break;
        for (int p = 0; p < n; p++)
            for (int q = p + 1; q < n; q++) {
                if (a[p * n + q] == 0.0)
                    continue;
                const double theta = (a[q * n + q] - a[p * n + p]) / (2.0 * a[p * n + q]);
                const double t = (theta >= 0.0 ? 1.0 : -1.0) / (fabs(theta) + sqrt(theta * theta + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < n; k++) {
                    const double kp = a[k * n + p], kq = a[k * n + q];
                    a[k * n + p] = c * kp - s * kq;
                    a[k * n + q] = s * kp + c * kq;
                }
                for (int k = 0; k < n; k++) {
                    const double pk = a[p * n + k], qk = a[q * n + k];
                    a[p * n + k] = c * pk - s * qk;
                    a[q * n + k] = s * pk + c * qk;
                    const double vp = vectors[k * n + p], vq = vectors[k * n + q];
                    vectors[k * n + p] = c * vp - s * vq;
                    vectors[k * n + q] = s * vp + c * vq;
                }
            }
    }
    for (int i = 0; i < n; i++)
        values[i] = a[i * n + i];
    for (int i = 0; i < n; i++) { /* in order */
        int most = i;
        for (int j = i + 1; j < n; j++)
            most = values[j] > values[most] ? j : most;
        const double value = values[i];
        values[i] = values[most];
        values[most] = value;
        for (int k = 0; k < n && most != i; k++) {
            const double v = vectors[k * n + i];
            vectors[k * n + i] = vectors[k * n + most];
            vectors[k * n + most] = v;
        }
    }
}

hada_status hada_psf_register(hada_image *images, const double *rows, const double *cols, int count, hada_error *err)
{
    const measured of = {images, rows, cols, count};
    for (int i = 0; i < count; i++)
        HADA_TRY(shift(&images[i], -rows[i], -cols[i], err));
    fill_unseen(&of);
    return HADA_OK;
}

/* g becomes (1 - u u') g (1 - u u'), u a unit vector. Returns u' g u. */
static double deflate(double *g, const double *u, double *room, int n)
{
    double inside = 0.0;
    for (int i = 0; i < n; i++) {
        room[i] = 0.0;
        for (int k = 0; k < n; k++)
            room[i] += g[i * n + k] * u[k];
        inside += u[i] * room[i];
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            g[i * n + k] += inside * u[i] * u[k] - room[i] * u[k] - u[i] * room[k];
    return inside;
}

/* The vectors and singular values of PSFs with the products `gram`, whose light is `light`; `room`: n x n + 2 n. */
static void decompose(hada_psf_field *out, double *gram, const double *light, double *room)
{
    const int n = out->count;
    double *vectors = room, *first = room + n * n, *values = first + n, square = 0.0;
    for (int i = 0; i < n; i++)
        square += light[i] * light[i];
    for (int i = 0; i < n; i++)
        first[i] = light[i] / sqrt(square);
    out->singular[0] = sqrt(fmax(deflate(gram, first, values, n), 0.0));
    eigen(gram, vectors, values, n);
    for (int k = 0; k < n; k++) {
        if (k)
            out->singular[k] = sqrt(fmax(values[k - 1], 0.0));
        for (int i = 0; i < n; i++)
            out->vectors[i * n + k] = k ? vectors[i * n + k - 1] : first[i];
    }
}

hada_status hada_psf_field_of(hada_psf_field *out, const hada_image *images, const double *rows, const double *cols,
                              int count, hada_error *err)
{
    const size_t n = (size_t)count;
    double *gram = NULL, *light = NULL, all = 0.0, together = 0.0, most = 0.0;
    hada_status status = HADA_OK;
    *out = (hada_psf_field){.rows = rows, .cols = cols, .count = count};
    HADA_TRY_OR_DONE(HADA_NEW(gram, 2 * n * n + 2 * n, "the components of PSFs", err));
    HADA_TRY_OR_DONE(HADA_NEW(light, n, "the components of PSFs", err));
    HADA_TRY_OR_DONE(HADA_NEW(out->vectors, n * n, "the components of PSFs", err));
    HADA_TRY_OR_DONE(HADA_NEW(out->singular, n, "the components of PSFs", err));
    for (int i = 0; i < count; i++) {
        light[i] = hada_psf_light(&images[i]);
        most = fmax(most, light[i]);
        for (int k = 0; k <= i; k++) {
            gram[(size_t)i * n + (size_t)k] = gram[(size_t)k * n + (size_t)i] =
                hada_product(images[i].data, images[k].data, hada_image_count(&images[i]));
            all += i == k ? gram[(size_t)i * n + (size_t)k] : 0.0;
            together += (i == k ? 1.0 : 2.0) * gram[(size_t)i * n + (size_t)k];
        }
    }
    if (!(most > 0.0 && all > 0.0))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NUMERIC, "the PSFs of all positions are dark"));
    out->lost_single = fmax(0.0, 1.0 - together / count / all);
    decompose(out, gram, light, gram + n * n);
done:
    HADA_FREE(gram, light);
    if (status)
        hada_psf_field_free(out);
    return status;
}

void hada_psf_field_free(hada_psf_field *field)
{
    HADA_FREE(field->vectors, field->singular);
    *field = (hada_psf_field){0};
}

double hada_psf_field_lost(const hada_psf_field *field, int components)
{
    double all = 0.0, lost = 0.0;
    for (int k = 0; k < field->count; k++) {
        const double energy = field->singular[k] * field->singular[k];
        all += energy;
        lost += k < components ? 0.0 : energy;
    }
    return all > 0.0 ? lost / all : 0.0;
}

/* Weights at the positions have a mean square of 1. */
hada_status hada_psf_field_component(hada_image *out, const hada_psf_field *field, const hada_image *images,
                                     int component, hada_error *err)
{
    HADA_TRY(hada_image_create(out, images->channels, images->rows, images->cols, err));
    for (size_t i = 0; i < hada_image_count(out); i++) {
        double sum = 0.0;
        for (int n = 0; n < field->count; n++)
            sum += (component < 0 ? sqrt(1.0 / field->count) : field->vectors[n * field->count + component]) *
                   images[n].data[i];
        out->data[i] = (float)(sum / sqrt(field->count));
    }
    return HADA_OK;
}

/* Solves a x = b in place of b by elimination with pivots; b has `right` columns. 0: singular. */
static int solve(double *a, double *b, int n, int right)
{
    for (int k = 0; k < n; k++) {
        int most = k;
        for (int i = k + 1; i < n; i++)
            most = fabs(a[i * n + k]) > fabs(a[most * n + k]) ? i : most;
        if (!(fabs(a[most * n + k]) > 1e-12))
            return 0;
        for (int j = 0; j < n; j++) {
            const double kept = a[k * n + j];
            a[k * n + j] = a[most * n + j];
            a[most * n + j] = kept;
        }
        for (int j = 0; j < right; j++) {
            const double kept = b[k * right + j];
            b[k * right + j] = b[most * right + j];
            b[most * right + j] = kept;
        }
        for (int i = k + 1; i < n; i++) {
            const double times = a[i * n + k] / a[k * n + k];
            for (int j = k; j < n; j++)
                a[i * n + j] -= times * a[k * n + j];
            for (int j = 0; j < right; j++)
                b[i * right + j] -= times * b[k * right + j];
        }
    }
    for (int i = n - 1; i >= 0; i--)
        for (int j = 0; j < right; j++) {
            for (int k = i + 1; k < n; k++)
                b[i * right + j] -= a[i * n + k] * b[k * right + j];
            b[i * right + j] /= a[i * n + i];
        }
    return 1;
}

/* r^2 log r, of the thin-plate spline. */
static double thin_plate(double down, double across)
{
    const double square = down * down + across * across;
    return square > 0.0 ? 0.5 * square * log(square) : 0.0;
}

hada_status hada_psf_field_weights(float *out, const hada_psf_field *field, int components, int rows, int cols,
                                   double row0, double col0, hada_error *err)
{
    const int n = field->count, all = n + 3;
    const double scale = 1.0 / fmax(rows, cols); /* so that the matrix is of about one size */
    double *a = NULL, *b = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(a, (size_t)all * (size_t)all, "weights of components", err));
    HADA_TRY_OR_DONE(HADA_NEW(b, (size_t)all * (size_t)components, "weights of components", err));
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < n; k++)
            a[i * all + k] =
                thin_plate(scale * (field->rows[i] - field->rows[k]), scale * (field->cols[i] - field->cols[k]));
        const double plane[3] = {1.0, scale * field->rows[i], scale * field->cols[i]};
        for (int k = 0; k < 3; k++)
            a[i * all + n + k] = a[(n + k) * all + i] = plane[k];
        for (int k = 0; k < components; k++)
            b[i * components + k] = field->vectors[i * n + k] * sqrt(n);
    }
    if (!solve(a, b, all, components))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_NUMERIC, "no smooth weights pass through the positions of the PSFs"));
    for (int row = 0; row < rows; row++)
        for (int col = 0; col < cols; col++) {
            const double down = scale * (row + row0), across = scale * (col + col0);
            double sums[HADA_MOST_COMPONENTS];
            for (int k = 0; k < components; k++)
                sums[k] =
                    b[n * components + k] + down * b[(n + 1) * components + k] + across * b[(n + 2) * components + k];
            for (int i = 0; i < n; i++) {
                const double value = thin_plate(down - scale * field->rows[i], across - scale * field->cols[i]);
                for (int k = 0; k < components; k++)
                    sums[k] += value * b[i * components + k];
            }
            for (int k = 0; k < components; k++)
                out[((size_t)k * (size_t)rows + (size_t)row) * (size_t)cols + (size_t)col] = (float)sums[k];
        }
done:
    HADA_FREE(a, b);
    return status;
}
