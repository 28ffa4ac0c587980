/* Frames on their way up: as few bytes as give the same floats, to the bit. */
#include <math.h>
#include <string.h>

#include "filter/hadamard.h"
#include "testing.h"

enum { NUMBERS = 65536 };

/* Numbers first, first + 1, ... over a scale. */
static void fill(float *values, size_t count, float scale, unsigned first)
{
    for (size_t i = 0; i < count; i++)
        values[i] = (float)((first + i) % NUMBERS) / scale;
}

TEST(stores_what_cameras_store)
{
    static const struct {
        float scale;
        size_t count;
        int bytes;
    } rows[] = {{255.0f, 256, 1},   {65535.0f, NUMBERS, 2}, {1023.0f, 1024, 2},
                {4095.0f, 4096, 2}, {16383.0f, 16384, 2},   {1.0f, NUMBERS, 2}};
    static float values[NUMBERS], out[NUMBERS];
    for (size_t k = 0; k < HADA_COUNT(rows); k++) {
        hada_stored stored = {0};
        fill(values, rows[k].count, rows[k].scale, 0);
        hada_stored_pack(values, rows[k].count, out, &stored);
        assert_int_equal(stored.bytes, rows[k].bytes);
        for (size_t i = 0; i < rows[k].count; i++) {
            const unsigned number = stored.bytes == 1 ? ((unsigned char *)out)[i] : ((unsigned short *)(void *)out)[i];
            const float back = (float)number / stored.scale;
            assert_memory_equal(&back, &values[i], sizeof back);
        }
    }
}

TEST(keeps_what_is_no_such_number)
{
    static const float odd[] = {-0.0f, -1.0f / 255.0f, 1.5f, 0.3f, 70000.0f, 1e30f, 1e-30f, INFINITY, NAN};
    static float values[4096], out[4096];
    for (size_t k = 0; k < HADA_COUNT(odd); k++) {
        hada_stored stored = {0};
        fill(values, 4096, 65535.0f, 17);
        values[4095 - k] = odd[k];
        hada_stored_pack(values, 4096, out, &stored);
        assert_int_equal(stored.bytes, 4);
        assert_memory_equal(out, values, sizeof values);
    }
    /* what the frame before was stored as does not hold for ever */
    hada_stored stored = {1, 255.0f};
    fill(values, 4096, 65535.0f, 17);
    hada_stored_pack(values, 4096, out, &stored);
    assert_int_equal(stored.bytes, 2);
}

/* A frame through a stage of a device with memory of its own, in as many bytes; what the device has of it. */
static void send(hada_hadamard *stage, const float *frame, size_t count, size_t bytes, float *got)
{
    const double before = stage->slot->calls.bytes_up;
    ASSERT_OK(hada_hadamard_frame_later(stage, frame, NULL, err));
    assert_true(stage->slot->calls.bytes_up - before == (double)(count * bytes));
    ASSERT_OK(hada_buffer_read(&stage->raw, stage->slot, 0, got, count * sizeof *got, err));
    assert_memory_equal(got, frame, count * sizeof *got);
}

TEST(gives_the_device_the_same_bits)
{
    static const int sides[][2] = {{256, 256}, {1, 1}, {3, 5}, {17, 31}};
    static float frame[NUMBERS], got[NUMBERS];
    hada_context *context;
    const double distance = 100.0;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    context->info.unified_memory = 0;
    for (size_t k = 0; k < HADA_COUNT(sides); k++) {
        hada_model_info info = {.depths = 1,
                                .channels = 1,
                                .form = HADA_FORM_COMPLEX,
                                .boundary = HADA_BOUNDARY_CIRCULAR,
                                .distances_mm = &distance};
        hada_slot *slot;
        hada_hadamard *stage;
        const int rows = sides[k][0], cols = sides[k][1];
        const size_t count = (size_t)rows * (size_t)cols;
        static const float scales[] = {65535.0f, 1023.0f, 4095.0f, 16383.0f, 1.0f};
        ASSERT_OK(hada_model_set_sizes(&info, rows, cols, rows, cols, err));
        ASSERT_OK(hada_slot_create(&slot, context, err));
        ASSERT_OK(hada_hadamard_create(&stage, slot, NULL, &info, 1, err));
        assert_true(hada_upload_stages(&stage->upload));
        for (size_t s = 0; s < HADA_COUNT(scales); s++) {
            fill(frame, count, scales[s], 300);
            send(stage, frame, count, 2, got);
        }
        for (size_t i = 0; i < count; i++)
            frame[i] = (float)(i % 256 ^ 1) / 255.0f;
        send(stage, frame, count, 1, got);
        frame[count / 2] = 0.123f;
        send(stage, frame, count, 4, got);
        hada_hadamard_destroy(&stage);
        hada_slot_destroy(&slot);
    }
    hada_context_destroy(&context);
}
