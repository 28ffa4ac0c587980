/* What a call of an inverse transform can choose: every n-th filter and image, and a band within the plan's. */
#include "fft_fixture.h"

enum { CHANNELS = 3, DEPTHS = 4, ROWS = 18, COLS = 29, TOP = 3, LEFT = 5, HIGH = 9, WIDE = 13 };

typedef struct images {
    hada_fft_desc desc;
    hada_buffer spectra, filters, real;
    size_t count, pixels; /* of a spectrum, of an image */
    float *whole, *some;
} images;

static void make(images *all, hada_fft_backend backend)
{
    unsigned state = 21;
    all->desc = rectangle(whole(HADA_FFT_INVERSE, ROWS, COLS, CHANNELS * DEPTHS), TOP, LEFT, HIGH, WIDE, 0);
    all->desc.backend = backend;
    all->count = hada_fft_layout(context, ROWS, COLS, backend).count;
    all->pixels = all->desc.real_distance;
    const size_t floats = 2 * all->count * CHANNELS * DEPTHS, out = all->pixels * CHANNELS * DEPTHS;
    float *values = memory(floats, sizeof *values);
    for (size_t i = 0; i < floats; i++)
        values[i] = value(&state);
    ok(hada_buffer_create_from(&all->spectra, slot, values, 2 * all->count * CHANNELS * sizeof *values, "spectra",
                               &err));
    ok(hada_buffer_create_from(&all->filters, slot, values, floats * sizeof *values, "filters", &err));
    ok(hada_buffer_create(&all->real, context, out * sizeof *values, "images", &err));
    all->whole = memory(out, sizeof *values);
    all->some = memory(out, sizeof *values);
    free(values);
}

static void run(images *all, const hada_fft_desc *desc, int batch, int channel, const hada_fft_filter *filter,
                float *result)
{
    hada_fft *plan;
    const size_t out = all->pixels * CHANNELS * DEPTHS;
    for (size_t i = 0; i < out; i++)
        result[i] = MARK;
    ok(hada_buffer_write(&all->real, slot, 0, result, out * sizeof *result, &err));
    ok(hada_fft_create(&plan, slot, desc, &err));
    ok(hada_fft_inverse(plan, batch, all->spectra.mem, (size_t)channel * all->count, all->real.mem,
                        (size_t)channel * all->pixels, filter, &err));
    ok(hada_buffer_read(&all->real, slot, 0, result, out * sizeof *result, &err));
    hada_fft_destroy(&plan);
}

static void drop(images *all)
{
    hada_buffer_destroy(&all->spectra);
    hada_buffer_destroy(&all->filters);
    hada_buffer_destroy(&all->real);
    free(all->whole);
    free(all->some);
}

/* One of several channels by itself: the bits that it has among the others, which stay as they were. */
TEST(one_channel_alone)
{
    for (int backend = HADA_FFT_OWN; backend <= HADA_FFT_CLFFT; backend++) {
        images all;
        make(&all, (hada_fft_backend)backend);
        hada_fft_filter filter = {
            .product = HADA_FFT_COMPLEX, .filter = all.filters.mem, .spectrum_count = CHANNELS, .filter_first = 0};
        hada_fft_desc desc = all.desc;
        if (backend == HADA_FFT_CLFFT) /* 29 has no place there */
            desc.cols = 28;
        run(&all, &desc, CHANNELS * DEPTHS, 0, &filter, all.whole);
        filter.spectrum_count = 1;
        filter.stride = CHANNELS;
        for (int channel = 0; channel < CHANNELS; channel++) {
            filter.filter_first = channel;
            run(&all, &desc, DEPTHS, channel, &filter, all.some);
            for (int image = 0; image < CHANNELS * DEPTHS; image++)
                for (size_t i = 0; i < all.pixels; i++) {
                    const size_t at = (size_t)image * all.pixels + i;
                    assert_true(all.some[at] == (image % CHANNELS == channel ? all.whole[at] : MARK));
                }
        }
        drop(&all);
    }
}

/* A band of the call gives the bits of a plan with that band, and none may go beyond the plan's. */
TEST(bands_of_a_call)
{
    static const int bands[][2] = {{1, 1}, {3, 0}, {0, 7}, {6, 8}, {9, 14}};
    for (size_t i = 0; i < sizeof bands / sizeof *bands; i++) {
        images all;
        make(&all, HADA_FFT_OWN);
        hada_fft_filter filter = {.product = HADA_FFT_SPLIT, .filter = all.filters.mem, .spectrum_count = CHANNELS};
        hada_fft_desc limited = all.desc;
        limited.band_rows = bands[i][0];
        limited.band_cols = bands[i][1];
        run(&all, &limited, CHANNELS * DEPTHS, 0, &filter, all.whole);
        filter.band_rows = bands[i][0];
        filter.band_cols = bands[i][1];
        run(&all, &all.desc, CHANNELS * DEPTHS, 0, &filter, all.some);
        assert_memory_equal(all.whole, all.some, all.pixels * CHANNELS * DEPTHS * sizeof(float));
        filter.band_rows = filter.band_cols = 100;
        run(&all, &limited, CHANNELS * DEPTHS, 0, &filter, all.some);
        assert_memory_equal(all.whole, all.some, all.pixels * CHANNELS * DEPTHS * sizeof(float));
        drop(&all);
    }
}

FIXTURE(open_device, close_device)
