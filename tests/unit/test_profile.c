/* Profiles of slots: nothing when off; when on, launches are counted, their times and costs add up. */
#include "fft/fft.h"
#include "runtime/profile.h"
#include "testing.h"

enum { SIDE = 32, BATCH = 3 };

typedef struct fixture {
    hada_context *context;
    hada_slot *slot;
    hada_buffer real, spectrum;
    hada_fft *forward;
} fixture;

static hada_fft_desc square(hada_fft_backend backend)
{
    hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, SIDE, SIDE, BATCH);
    desc.backend = backend;
    return desc;
}

static void begin(fixture *f, hada_fft_backend backend)
{
    DEFAULTS(hada_context_options, options);
    options.device = "cpu";
    const hada_fft_desc desc = square(backend);
    *f = (fixture){0};
    ASSERT_OK(hada_context_create(&f->context, &options, err));
    ASSERT_OK(hada_slot_create(&f->slot, f->context, err));
    ASSERT_OK(hada_buffer_create(&f->real, f->context, BATCH * SIDE * SIDE * 4, "images", err));
    ASSERT_OK(hada_buffer_create(&f->spectrum, f->context, BATCH * SIDE * SIDE * 8, "spectra", err));
    ASSERT_OK(hada_buffer_clear(&f->real, f->slot, 0, f->real.bytes, err));
    ASSERT_OK(hada_fft_create(&f->forward, f->slot, &desc, err));
}

static void end(fixture *f)
{
    hada_fft_destroy(&f->forward);
    HADA_DESTROY_BUFFERS(&f->real, &f->spectrum);
    hada_slot_destroy(&f->slot);
    hada_context_destroy(&f->context);
}

static void transform(fixture *f, int times)
{
    for (int i = 0; i < times; i++)
        ASSERT_OK(hada_fft_forward(f->forward, BATCH, f->real.mem, 0, f->spectrum.mem, 0, err));
}

static const hada_kernel_time *find(const hada_kernel_time *rows, size_t count, const char *stage, const char *name)
{
    for (size_t i = 0; i < count; i++)
        if (!strcmp(rows[i].stage, stage) && !strcmp(rows[i].name, name))
            return &rows[i];
    fail_msg("no row %s, %s", stage, name);
    return NULL;
}

static double seconds_of(const hada_kernel_time *rows, size_t count, const char *stage)
{
    double seconds = 0;
    for (size_t i = 0; i < count; i++)
        seconds += strcmp(rows[i].stage, stage) ? 0.0 : rows[i].seconds;
    return seconds;
}

TEST(off_records_nothing)
{
    fixture f;
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    begin(&f, HADA_FFT_OWN);
    transform(&f, 2);
    assert_null(f.slot->profile);
    ASSERT_FAILS(hada_slot_times(f.slot, &rows, &count, err), HADA_ERROR_STATE, "");
    assert_null(rows);
    assert_int_equal(count, 0);
    /* turned on now, what came before does not count */
    ASSERT_OK(hada_slot_profile(f.slot, 1, err));
    ASSERT_OK(hada_slot_times(f.slot, &rows, &count, err));
    assert_int_equal(count, 0);
    end(&f);
}

TEST(launches_are_counted_by_stage)
{
    fixture f;
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    float values[8] = {0};
    begin(&f, HADA_FFT_OWN);
    ASSERT_OK(hada_slot_profile(f.slot, 1, err));
    transform(&f, 1);
    hada_slot_stage(f.slot, "linear");
    transform(&f, 700); /* more than are held at a time */
    ASSERT_OK(hada_buffer_write(&f.real, f.slot, 0, values, sizeof values, err));
    ASSERT_OK(hada_buffer_read(&f.real, f.slot, 0, values, sizeof values, err));
    ASSERT_OK(hada_buffer_read(&f.real, f.slot, 0, values, sizeof values, err));
    ASSERT_OK(hada_buffer_clear(&f.real, f.slot, 0, 16, err));
    ASSERT_OK(hada_slot_times(f.slot, &rows, &count, err));

    /* three images on two units would leave one idle: two passes; one launch does all where it may */
    uint64_t transforms = 0;
    double bytes = 0, flops = 0;
    for (size_t i = 0; i < count; i++)
        if (!strcmp(rows[i].stage, "linear") && !rows[i].transfer) {
            transforms = rows[i].launches;
            assert_int_equal(transforms, 700);
            bytes += rows[i].bytes / 700;
            flops += rows[i].flops / 700;
        }
    assert_int_equal(transforms, 700);
    /* 2.5 n log2 n along rows, 5 n log2 n along the half spectrum's columns; images and spectra once at least */
    assert_float_equal(flops, BATCH * (SIDE * 2.5 * SIDE * 5 + (SIDE / 2 + 1) * 5.0 * SIDE * 5), 0.01);
    assert_true(bytes >= BATCH * (4.0 * SIDE * SIDE + 8.0 * SIDE * (SIDE / 2 + 1)));
    assert_true(bytes <= 3 * BATCH * (4.0 * SIDE * SIDE + 8.0 * SIDE * (SIDE / 2 + 1)));
    assert_int_equal(find(rows, count, "linear", "write")->launches, 1);
    assert_int_equal(find(rows, count, "linear", "read")->launches, 2);
    assert_float_equal(find(rows, count, "linear", "read")->bytes, 2 * sizeof values, 0);
    assert_int_equal(find(rows, count, "linear", "fill")->launches, 1);
    assert_true(find(rows, count, "linear", "fill")->transfer);
    for (size_t i = 0; i < count; i++) {
        assert_true(rows[i].seconds > 0);
        assert_true(rows[i].launches > 0);
    }
    const double seconds = seconds_of(rows, count, "linear");
    assert_true(seconds_of(rows, count, "other") > 0);

    /* asked again into the same rows, everything is there twice, and no row more */
    const size_t before = count;
    const double read_bytes = find(rows, count, "linear", "read")->bytes;
    ASSERT_OK(hada_slot_times(f.slot, &rows, &count, err));
    assert_int_equal(count, before);
    assert_float_equal(find(rows, count, "linear", "read")->bytes, 2 * read_bytes, 0);
    free(rows);

    /* one more adds its time */
    rows = NULL;
    count = 0;
    transform(&f, 1);
    ASSERT_OK(hada_slot_times(f.slot, &rows, &count, err));
    assert_true(seconds_of(rows, count, "linear") > seconds);
    free(rows);

    ASSERT_OK(hada_slot_profile(f.slot, 0, err));
    assert_null(f.slot->profile);
    end(&f);
}

TEST(another_librarys_commands_have_a_row)
{
    fixture f;
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    begin(&f, HADA_FFT_CLFFT);
    assert_int_equal(hada_fft_serving(f.forward), HADA_FFT_CLFFT);
    ASSERT_OK(hada_slot_profile(f.slot, 1, err));
    hada_slot_stage(f.slot, "upload");
    transform(&f, 3);
    ASSERT_OK(hada_slot_times(f.slot, &rows, &count, err));
    const hada_kernel_time *row = find(rows, count, "upload", "clfft");
    assert_int_equal(row->launches, 3);
    assert_true(row->seconds > 0);
    assert_true(row->flops > 0);
    assert_int_equal(find(rows, count, "upload", "fft_plain_pad")->launches, 3);
    assert_int_equal(find(rows, count, "upload", "copy")->launches, 3);
    free(rows);
    end(&f);
}

TEST(peaks_are_plausible)
{
    SCOPED(hada_context) * context;
    double copy = 0, flops = 0, again = 0;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    ASSERT_OK(hada_device_peaks(context, &copy, &flops, err));
    ASSERT_OK(hada_device_peaks(context, &again, NULL, err));
    /* from a slow single-board computer to a large GPU */
    assert_true(copy > 1e8 && copy < 1e14);
    assert_true(flops > 1e8 && flops < 1e16);
    assert_true(again > 1e8 && again < 1e14);
    assert_int_equal(hada_context_bytes(context), 0);
}

TEST(costs_of_calls_are_plausible)
{
    SCOPED(hada_context) * context;
    double launch = 0, wait = -1, rate = 0;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    ASSERT_OK(hada_device_call_costs(context, &launch, &wait, &rate, err));
    assert_true(launch > 1e-8 && launch < 1e-1);
    assert_true(wait >= 0 && wait < 1);
    assert_true(rate > 1e7);
    ASSERT_OK(hada_device_call_costs(context, NULL, NULL, NULL, err));
}
