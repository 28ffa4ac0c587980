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

/* One line: bits reversed, then butterflies (Cooley and Tukey 1965). */
static void line(const hada_small_fft *fft, float *x)
{
    const int size = fft->size;
    for (int i = 0; i < size; i++) {
        const int j = fft->order[i];
        if (j > i) {
            const float re = x[2 * i], im = x[2 * i + 1];
            x[2 * i] = x[2 * j];
            x[2 * i + 1] = x[2 * j + 1];
            x[2 * j] = re;
            x[2 * j + 1] = im;
        }
    }
    for (int half = 1; half < size; half *= 2)
        for (int first = 0; first < size; first += 2 * half)
            for (int k = 0; k < half; k++) {
                float *a = x + 2 * (first + k), *b = a + 2 * half;
                const float *w = fft->twiddles + 2 * (size_t)k * (size_t)(size / 2 / half);
                const float re = b[0] * w[0] - b[1] * w[1], im = b[0] * w[1] + b[1] * w[0];
                b[0] = a[0] - re;
                b[1] = a[1] - im;
                a[0] += re;
                a[1] += im;
            }
}

void hada_small_fft_run(const hada_small_fft *fft, float *data)
{
    const size_t size = (size_t)fft->size;
    for (size_t r = 0; r < size; r++)
        line(fft, data + 2 * r * size);
    for (size_t r = 0; r < size; r++)
        for (size_t c = 0; c < r; c++)
            for (int part = 0; part < 2; part++) {
                const float value = data[2 * (r * size + c) + (size_t)part];
                data[2 * (r * size + c) + (size_t)part] = data[2 * (c * size + r) + (size_t)part];
                data[2 * (c * size + r) + (size_t)part] = value;
            }
    for (size_t r = 0; r < size; r++)
        line(fft, data + 2 * r * size);
}
