#include "image/small_fft.h"

hada_status hada_small_fft_create(hada_small_fft *fft, int size, hada_error *err)
{
    *fft = (hada_small_fft){.size = size};
    HADA_TRY(HADA_NEW(fft->twiddles, (size_t)size, "a transform", err));
    HADA_TRY(HADA_NEW(fft->order, (size_t)size, "a transform", err));
    for (int k = 0; k < size / 2; k++) {
        const double angle = -2.0 * 3.14159265358979323846 * k / size;
        fft->twiddles[2 * k] = (float)cos(angle);
        fft->twiddles[2 * k + 1] = (float)sin(angle);
    }
    for (int i = 1; i < size; i++)
        fft->order[i] = fft->order[i / 2] / 2 + (i % 2 ? size / 2 : 0);
    return HADA_OK;
}

void hada_small_fft_destroy(hada_small_fft *fft)
{
    HADA_FREE(fft->twiddles, fft->order);
    *fft = (hada_small_fft){0};
}

/* Along columns, all at once: bits reversed, then butterflies (Cooley and Tukey 1965). */
static void columns(const hada_small_fft *fft, float *data)
{
    const size_t size = (size_t)fft->size, row = 2 * size;
    for (size_t i = 0; i < size; i++) {
        const size_t j = (size_t)fft->order[i];
        for (size_t k = 0; j > i && k < row; k++) {
            const float value = data[i * row + k];
            data[i * row + k] = data[j * row + k];
            data[j * row + k] = value;
        }
    }
    for (size_t half = 1; half < size; half *= 2)
        for (size_t first = 0; first < size; first += 2 * half)
            for (size_t k = 0; k < half; k++) {
                float *restrict a = data + (first + k) * row, *restrict b = a + half * row;
                const float re = fft->twiddles[2 * k * (size / 2 / half)];
                const float im = fft->twiddles[2 * k * (size / 2 / half) + 1];
                for (size_t c = 0; c < row; c += 2) {
                    const float x = b[c] * re - b[c + 1] * im, y = b[c] * im + b[c + 1] * re;
                    b[c] = a[c] - x;
                    b[c + 1] = a[c + 1] - y;
                    a[c] += x;
                    a[c + 1] += y;
                }
            }
}

static void transpose(const hada_small_fft *fft, float *data)
{
    const size_t size = (size_t)fft->size;
    for (size_t r = 0; r < size; r++)
        for (size_t c = 0; c < r; c++)
            for (int part = 0; part < 2; part++) {
                const float value = data[2 * (r * size + c) + (size_t)part];
                data[2 * (r * size + c) + (size_t)part] = data[2 * (c * size + r) + (size_t)part];
                data[2 * (c * size + r) + (size_t)part] = value;
            }
}

void hada_small_fft_run(const hada_small_fft *fft, float *data)
{
    columns(fft, data);
    transpose(fft, data);
    columns(fft, data);
}

/* From Z(k) and Z(-k). */
void hada_small_fft_part(const hada_small_fft *fft, const float *work, float *first, float *second)
{
    const size_t size = (size_t)fft->size;
    for (size_t kx = 0; kx <= size / 2; kx++)
        for (size_t ky = 0; ky < size; ky++) {
            const float *at = work + 2 * (kx * size + ky);
            const float *opposite = work + 2 * ((size - kx) % size * size + (size - ky) % size);
            float *a = first + 2 * (kx * size + ky), *b = second + 2 * (kx * size + ky);
            a[0] = 0.5f * (at[0] + opposite[0]);
            a[1] = 0.5f * (at[1] - opposite[1]);
            b[0] = 0.5f * (at[1] + opposite[1]);
            b[1] = -0.5f * (at[0] - opposite[0]);
        }
}

/* The conjugate of A + iB, so that a forward transform is the inverse one. */
void hada_small_fft_join(const hada_small_fft *fft, const float *first, const float *second, float *work)
{
    const size_t size = (size_t)fft->size;
    for (size_t kx = 0; kx < size; kx++)
        for (size_t ky = 0; ky < size; ky++) {
            const int half = 2 * kx <= size;
            const size_t i = half ? kx * size + ky : (size - kx) * size + (size - ky) % size;
            const float *a = first + 2 * i, *b = second + 2 * i, sign = half ? 1.0f : -1.0f;
            work[2 * (kx * size + ky)] = a[0] - sign * b[1];
            work[2 * (kx * size + ky) + 1] = -(sign * a[1] + b[0]);
        }
}

double hada_small_fft_match(const hada_small_fft *fft, float *work, const float *other, double *row, double *col)
{
    const int n = fft->size, mask = n - 1;
    const size_t area = (size_t)n * (size_t)n;
    size_t best = 0;
    for (size_t i = 0; i < area; i++) {
        const float re = work[2 * i], im = work[2 * i + 1], a = other[2 * i], b = other[2 * i + 1];
        work[2 * i] = a * re + b * im;
        work[2 * i + 1] = -(b * re - a * im); /* conjugate: a forward transform is then the inverse one */
    }
    hada_small_fft_run(fft, work);
    for (size_t i = 1; i < area; i++)
        best = work[2 * i] > work[2 * best] ? i : best;
    const int r = (int)(best / (size_t)n), c = (int)(best % (size_t)n);
#define AT(row, col) ((double)work[2 * ((size_t)((row)&mask) * (size_t)n + (size_t)((col)&mask))])
    *row = (r < n / 2 ? r : r - n) + hada_parabola_top(AT(r - 1, c), AT(r, c), AT(r + 1, c));
    *col = (c < n / 2 ? c : c - n) + hada_parabola_top(AT(r, c - 1), AT(r, c), AT(r, c + 1));
    return AT(r, c) / (double)area;
#undef AT
}

double hada_small_fft_put(const hada_small_fft *fft, const hada_image *image, float *to)
{
    const size_t count = hada_image_count(image), size = (size_t)fft->size;
    double mean = 0.0, energy = 0.0;
    for (size_t i = 0; i < count; i++)
        mean += (double)image->data[i] / (double)count;
    memset(to, 0, 2 * size * size * sizeof *to);
    for (size_t i = 0; i < count; i++) {
        const float value = (float)(image->data[i] - mean);
        to[2 * (i / (size_t)image->cols * size + i % (size_t)image->cols)] = value;
        energy += (double)value * value;
    }
    hada_small_fft_run(fft, to);
    return energy;
}
