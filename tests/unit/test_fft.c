/* The library's transforms beyond what the check tool compares (fft_forward, fft_inverse): what a call of an inverse
 * can choose, bytes, refusals, the choice between the back ends, and that a process's locale stays what it was. */
#include <locale.h>

#include "testing.h"

#include "fft/fft.h"
#include "runtime/tuning.h"

#define MARK 12345.0f

enum { CHANNELS = 3, DEPTHS = 4, ROWS = 18, COLS = 29, TOP = 3, LEFT = 5, HIGH = 9, WIDE = 13 };

static hada_context *context;
static hada_slot *slot;

/* Whole images of a grid. */
static hada_fft_desc whole(hada_fft_direction direction, int rows, int cols, int batch)
{
    hada_fft_desc desc = hada_fft_whole(direction, rows, cols, batch);
    desc.backend = HADA_FFT_OWN;
    return desc;
}

/* A window of the grid. */
static hada_fft_desc window(hada_fft_direction direction, int batch)
{
    hada_fft_desc desc = hada_fft_of(direction, ROWS, COLS, batch, (hada_rectangle){TOP, LEFT, HIGH, WIDE});
    desc.backend = HADA_FFT_OWN;
    return desc;
}

typedef struct images {
    hada_fft_desc desc;
    hada_buffer spectra, filters, real;
    size_t count, pixels; /* of a spectrum, of an image */
    float *whole, *some;
} images;

static void make(images *all, hada_fft_backend backend)
{
    hada_random random;
    hada_random_seed(&random, 21, 0);
    all->desc = window(HADA_FFT_INVERSE, CHANNELS * DEPTHS);
    all->desc.backend = backend;
    all->count = hada_fft_layout(context, ROWS, COLS, backend).count;
    all->pixels = all->desc.real_distance;
    const size_t floats = 2 * all->count * CHANNELS * DEPTHS, out = all->pixels * CHANNELS * DEPTHS;
    SCOPED_MEMORY float *values = calloc(floats, sizeof *values);
    for (size_t i = 0; i < floats; i++)
        values[i] = (float)hada_random_normal(&random);
    ASSERT_OK(hada_buffer_create_from(&all->spectra, slot, values, 2 * all->count * CHANNELS * sizeof *values,
                                      "spectra", err));
    ASSERT_OK(hada_buffer_create_from(&all->filters, slot, values, floats * sizeof *values, "filters", err));
    ASSERT_OK(hada_buffer_create(&all->real, context, out * sizeof *values, "images", err));
    all->whole = calloc(out, sizeof *values);
    all->some = calloc(out, sizeof *values);
}

static void run(images *all, const hada_fft_desc *desc, int batch, int channel, const hada_fft_filter *filter,
                float *result)
{
    SCOPED(hada_fft) * plan;
    const size_t out = all->pixels * CHANNELS * DEPTHS;
    for (size_t i = 0; i < out; i++)
        result[i] = MARK;
    ASSERT_OK(hada_buffer_write(&all->real, slot, 0, result, out * sizeof *result, err));
    ASSERT_OK(hada_fft_create(&plan, slot, desc, err));
    ASSERT_OK(hada_fft_inverse(plan, batch, all->spectra.mem, (size_t)channel * all->count, all->real.mem,
                               (size_t)channel * all->pixels, filter, err));
    ASSERT_OK(hada_buffer_read(&all->real, slot, 0, result, out * sizeof *result, err));
}

static void drop(images *all)
{
    HADA_DESTROY_BUFFERS(&all->spectra, &all->filters, &all->real);
    HADA_FREE(all->whole, all->some);
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

/* What a plan holds is what hada_fft_bytes() said, and nothing stays behind. */
TEST(bytes_are_as_stated)
{
    static const int sizes[][2] = {{64, 96}, {131, 43}, {1, 1}, {2, 16384}};
    const uint64_t before = hada_context_bytes(context);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int direction = HADA_FFT_FORWARD; direction <= HADA_FFT_INVERSE; direction++) {
            hada_fft *plan;
            hada_fft_desc desc = whole((hada_fft_direction)direction, sizes[i][0], sizes[i][1], 3);
            ASSERT_OK(hada_fft_create(&plan, slot, &desc, err));
            assert_int_equal(hada_context_bytes(context) - before, hada_fft_bytes(context, &desc));
            hada_fft_destroy(&plan);
            assert_int_equal(hada_context_bytes(context), before);
        }
}

static void refuse(hada_fft_desc desc, hada_status status)
{
    hada_fft *plan = (hada_fft *)&desc;
    ASSERT_FAILS(hada_fft_create(&plan, slot, &desc, err), status, "");
    assert_null(plan);
    assert_int_equal(hada_fft_bytes(context, &desc), 0);
}

TEST(wrong_plans_and_calls_are_refused)
{
    const hada_fft_desc good = whole(HADA_FFT_FORWARD, 16, 24, 2);
    hada_fft_desc bad;
    SCOPED(hada_fft) * plan;
    SCOPED(hada_buffer) a;
#define REFUSE(FIELD, VALUE, STATUS) (bad = good, bad.FIELD = (VALUE), refuse(bad, STATUS))
    REFUSE(direction, (hada_fft_direction)0, HADA_ERROR_ARGUMENT);
    REFUSE(rows, 0, HADA_ERROR_SIZE);
    REFUSE(cols, -4, HADA_ERROR_SIZE);
    REFUSE(batch, 0, HADA_ERROR_ARGUMENT);
    REFUSE(row0, 1, HADA_ERROR_SIZE);
    REFUSE(col0, -1, HADA_ERROR_SIZE);
    REFUSE(real_rows, 0, HADA_ERROR_SIZE);
    REFUSE(real_cols, 25, HADA_ERROR_SIZE);
    REFUSE(real_pitch, 23, HADA_ERROR_SIZE);
    REFUSE(real_distance, 100, HADA_ERROR_SIZE);
    REFUSE(band_rows, -3, HADA_ERROR_ARGUMENT);
#undef REFUSE
    ASSERT_OK(hada_fft_create(&plan, slot, &good, err));
    ASSERT_OK(hada_buffer_create(&a, context, 1 << 16, "a test", err));
    ASSERT_FAILS(hada_fft_forward(plan, 3, a.mem, 0, a.mem, 0, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_fft_forward(plan, 0, a.mem, 0, a.mem, 0, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_fft_inverse(plan, 1, a.mem, 0, a.mem, 0, NULL, err), HADA_ERROR_STATE, "");
    ASSERT_FAILS(hada_fft_forward(plan, 1, a.mem, 0, a.mem, 1, err), HADA_ERROR_ARGUMENT, "");
    hada_fft_destroy(&plan);
    hada_fft_destroy(&plan);
    bad = whole(HADA_FFT_INVERSE, 16, 24, 2);
    ASSERT_OK(hada_fft_create(&plan, slot, &bad, err));
    const hada_fft_filter none = {.product = HADA_FFT_COMPLEX, .spectrum_count = 1};
    ASSERT_FAILS(hada_fft_inverse(plan, 1, a.mem, 0, a.mem, 0, &none, err), HADA_ERROR_ARGUMENT, "");
}

TEST(good_sizes)
{
    assert_int_equal(hada_fft_good_size(0), 2);
    assert_int_equal(hada_fft_good_size(3), 4);
    assert_int_equal(hada_fft_good_size(11), 12);
    assert_int_equal(hada_fft_good_size(1376), 1400);
    assert_int_equal(hada_fft_good_size(1024), 1024);
}

/* Torn down with the last plan, and set up again. */
TEST(clfft_is_torn_down_with_the_last_plan)
{
    hada_fft_desc desc = whole(HADA_FFT_FORWARD, 16, 24, 3);
    desc.backend = HADA_FFT_CLFFT;
    const uint64_t before = hada_context_bytes(context);
    for (int i = 0; i < 2; i++) {
        hada_fft *plan, *second;
        ASSERT_OK(hada_fft_create(&plan, slot, &desc, err));
        ASSERT_OK(hada_fft_create(&second, slot, &desc, err));
        assert_true(hada_context_bytes(context) - before <= 2 * hada_fft_bytes(context, &desc));
        hada_fft_destroy(&plan);
        hada_fft_destroy(&second);
        assert_int_equal(hada_context_bytes(context), before);
    }
}

TEST(clfft_refuses_sizes)
{
    hada_fft_desc desc = whole(HADA_FFT_FORWARD, 16, 24, 3);
    desc.backend = HADA_FFT_CLFFT;
    hada_fft *plan;
    desc.rows = 17;
    ASSERT_FAILS(hada_fft_create(&plan, slot, &desc, err), HADA_ERROR_UNSUPPORTED, "17 x 24");
    assert_null(plan);
    desc.rows = 16;
    context->quirks.avoid_clfft = 1;
    ASSERT_FAILS(hada_fft_create(&plan, slot, &desc, err), HADA_ERROR_UNSUPPORTED, "");
    context->quirks.avoid_clfft = 0;
}

TEST(rows_of_tuning_choose_the_back_end)
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
    ASSERT_OK(hada_tuning_read(&context->tuning, name, err));
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
    ASSERT_OK(hada_context_create(&context, &options, err));
    ASSERT_OK(hada_slot_create(&slot, context, err));
    return 0;
}

static int open_groups(void **user)
{
    open_device(user);
    context->shape = HADA_SHAPE_GROUPS;
    return 0;
}

static int close_device(void **user)
{
    (void)user;
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return strcmp(setlocale(LC_ALL, NULL), "C") != 0;
}

FIXTURE(open_device, close_device)
AGAIN(open_groups, close_device, bytes_are_as_stated)
