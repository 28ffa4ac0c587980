/* The clFFT back end at one small size (each cold compilation of it takes seconds), its refusals, the choice between
 * the back ends, and that a process's locale stays what it was. */
#include <locale.h>

#include "testing.h"

#include "fft/fft.h"
#include "ref/ref_fft.h"
#include "runtime/tuning.h"

enum { ROWS = 16, COLS = 24, HALF = COLS / 2 + 1, BATCH = 3, SMALL = 7, COUNT = ROWS * HALF };

static hada_context *context;
static hada_slot *slot;
static hada_error err;

static void ok(hada_status status)
{
    if (status)
        fprintf(stderr, "%s\n%s\n", err.message, err.detail);
    assert_int_equal(status, HADA_OK);
}

static float value(unsigned *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / 8388608.0f - 1.0f;
}

static hada_fft_desc window(hada_fft_direction direction)
{
    return (hada_fft_desc){.direction = direction,
                           .backend = HADA_FFT_CLFFT,
                           .rows = ROWS,
                           .cols = COLS,
                           .batch = BATCH,
                           .row0 = 3,
                           .col0 = 5,
                           .real_rows = SMALL,
                           .real_cols = SMALL,
                           .real_pitch = SMALL + 1,
                           .real_distance = SMALL * (SMALL + 1) + 2};
}

TEST(test_forward)
{
    const hada_fft_desc desc = window(HADA_FFT_FORWARD);
    float a[BATCH * 64 + 5], b[2 * BATCH * COUNT];
    double image[ROWS * COLS], want[2 * COUNT];
    hada_fft *plan;
    hada_buffer real, spectrum;
    unsigned seed = 1;
    for (size_t i = 0; i < sizeof a / sizeof *a; i++)
        a[i] = value(&seed);
    ok(hada_fft_create(&plan, slot, &desc, &err));
    assert_int_equal(hada_fft_serving(plan), HADA_FFT_CLFFT);
    assert_int_equal(hada_fft_plan_layout(plan)->count, COUNT);
    ok(hada_buffer_create_from(&real, slot, a, sizeof a, "images", &err));
    ok(hada_buffer_create(&spectrum, context, sizeof b, "spectra", &err));
    for (int batch = 1; batch <= BATCH; batch += 2) {
        ok(hada_fft_forward(plan, batch, real.mem, 5, spectrum.mem, 0, &err));
        ok(hada_buffer_read(&spectrum, slot, 0, b, sizeof b, &err));
        for (int m = 0; m < batch; m++) {
            memset(image, 0, sizeof image);
            for (int y = 0; y < SMALL; y++)
                for (int x = 0; x < SMALL; x++)
                    image[(3 + y) * COLS + 5 + x] = a[5 + m * (int)desc.real_distance + y * (SMALL + 1) + x];
            ok(hada_ref_fft_forward(image, ROWS, COLS, want, &err));
            for (int i = 0; i < 2 * COUNT; i++)
                assert_true(fabs(b[2 * COUNT * m + i] - want[i]) < 1e-5);
        }
    }
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
}

TEST(test_inverse)
{
    hada_fft_desc desc = window(HADA_FFT_INVERSE);
    float a[2 * COUNT], w[2 * COUNT * (BATCH + 1)], b[BATCH * 64];
    double given[2 * COUNT], image[ROWS * COLS];
    hada_fft *plan;
    hada_buffer real, spectrum, filter;
    unsigned seed = 2;
    for (int i = 0; i < 2 * COUNT; i++)
        a[i] = value(&seed);
    for (size_t i = 0; i < sizeof w / sizeof *w; i++)
        w[i] = value(&seed);
    desc.band_rows = 5;
    desc.band_cols = 12;
    ok(hada_fft_create(&plan, slot, &desc, &err));
    ok(hada_buffer_create(&real, context, sizeof b, "images", &err));
    ok(hada_buffer_create_from(&spectrum, slot, a, sizeof a, "spectra", &err));
    ok(hada_buffer_create_from(&filter, slot, w, sizeof w, "filters", &err));
    const hada_fft_filter use = {
        .product = HADA_FFT_COMPLEX, .filter = filter.mem, .spectrum_count = 1, .filter_first = 1};
    ok(hada_fft_inverse(plan, BATCH, spectrum.mem, 0, real.mem, 0, &use, &err));
    ok(hada_buffer_read(&real, slot, 0, b, sizeof b, &err));
    for (int m = 0; m < BATCH; m++) {
        for (int i = 0; i < COUNT; i++) {
            const float *f = w + 2 * (COUNT * (m + 1) + i);
            const int y = i / HALF, away = y < ROWS - y ? y : ROWS - y;
            given[2 * i] = away > 5 ? 0.0 : (double)a[2 * i] * f[0] - (double)a[2 * i + 1] * f[1];
            given[2 * i + 1] = away > 5 ? 0.0 : (double)a[2 * i] * f[1] + (double)a[2 * i + 1] * f[0];
        }
        ok(hada_ref_fft_inverse(given, ROWS, COLS, image, &err));
        for (int y = 0; y < SMALL; y++)
            for (int x = 0; x < SMALL; x++)
                assert_true(fabs(b[m * (int)desc.real_distance + y * (SMALL + 1) + x] - image[(3 + y) * COLS + 5 + x]) <
                            1e-6);
    }
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
    hada_buffer_destroy(&filter);
}

/* Torn down with the last plan, and set up again. */
TEST(test_again)
{
    const hada_fft_desc desc = window(HADA_FFT_FORWARD);
    const uint64_t before = hada_context_bytes(context);
    for (int i = 0; i < 2; i++) {
        hada_fft *plan, *second;
        ok(hada_fft_create(&plan, slot, &desc, &err));
        ok(hada_fft_create(&second, slot, &desc, &err));
        assert_true(hada_context_bytes(context) - before <= 2 * hada_fft_bytes(context, &desc));
        hada_fft_destroy(&plan);
        hada_fft_destroy(&second);
        assert_int_equal(hada_context_bytes(context), before);
    }
}

TEST(test_refusals)
{
    hada_fft_desc desc = window(HADA_FFT_FORWARD);
    hada_fft *plan;
    desc.rows = 17;
    assert_int_equal(hada_fft_create(&plan, slot, &desc, &err), HADA_ERROR_UNSUPPORTED);
    assert_null(plan);
    assert_non_null(strstr(err.message, "17 x 24"));
    desc.rows = ROWS;
    context->quirks.avoid_clfft = 1;
    assert_int_equal(hada_fft_create(&plan, slot, &desc, &err), HADA_ERROR_UNSUPPORTED);
    context->quirks.avoid_clfft = 0;
}

TEST(test_choice)
{
    char name[] = "/tmp/hadalens-tuning-XXXXXX";
    hada_tuning *const before = context->tuning;
    const int file = mkstemp(name);
    assert_true(file >= 0);
    FILE *text = fdopen(file, "w");
    fputs("# a comment\nfft gpu * clfft\nfft cpu 16x24 clfft\nfft cpu 34x24 clfft\nfft * 32x32 clfft\n"
          "fft cpu 32x32 own\n",
          text);
    fclose(text);
    assert_int_equal(hada_fft_layout(context, 16, 24, HADA_FFT_AUTO).block, 8);
    assert_int_equal(hada_tuning_read(&context->tuning, name, &err), HADA_OK);
    assert_int_equal(hada_fft_layout(context, 16, 24, HADA_FFT_AUTO).block, 13);
    assert_int_equal(hada_fft_layout(context, 24, 16, HADA_FFT_AUTO).block, 8);
    assert_int_equal(hada_fft_layout(context, 34, 24, HADA_FFT_AUTO).block, 8); /* clFFT cannot */
    assert_int_equal(hada_fft_layout(context, 32, 32, HADA_FFT_AUTO).block, 8); /* the last line wins */
    assert_int_equal(hada_fft_layout(context, 8, 8, HADA_FFT_AUTO).block, 8);
    hada_tuning_destroy(&context->tuning);
    context->tuning = before;
    remove(name);
}

static int open_device(void **user)
{
    (void)user;
    DEFAULTS(hada_context_options, options);
    options.device = "cpu";
    setlocale(LC_ALL, "C");
    return hada_context_create(&context, &options, &err) || hada_slot_create(&slot, context, &err);
}

static int close_device(void **user)
{
    (void)user;
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return strcmp(setlocale(LC_ALL, NULL), "C") != 0;
}

FIXTURE(open_device, close_device)
