/* Frames on their way to the device: in the form in which they came, the host's floats there, to the bit. */
#include "filter/hadamard.h"
#include "testing.h"

enum { NUMBERS = 65536, CHANNELS = 3, SIDES = 4 };

static const int sides[SIDES][2] = {{128, 170}, {1, 1}, {3, 5}, {17, 31}};

/* What the device is sent of a frame, and the floats that it makes of it. */
static void send(hada_hadamard *stage, const hada_pixels *frame, size_t bytes)
{
    static float expected[NUMBERS], got[NUMBERS];
    const size_t plane = (size_t)frame->rows * (size_t)frame->cols, count = CHANNELS * plane;
    const double before = stage->slot->calls.bytes_up;
    assert_true(hada_pixels_uploads(frame));
    ASSERT_OK(hada_hadamard_frame(stage, frame, NULL, err));
    assert_true(stage->slot->calls.bytes_up - before == (double)bytes);
    ASSERT_OK(hada_buffer_read(&stage->raw, stage->slot, 0, got, count * sizeof *got, err));
    for (int c = 0; c < CHANNELS; c++) {
        const float *values = hada_pixels_floats(frame, c, 0, plane, expected);
        assert_memory_equal(got + (size_t)c * plane, values, plane * sizeof *got);
    }
}

/* Dense in either order, upside down, and with gaps between rows. */
static void send_all(hada_hadamard *stage, const void *samples, hada_pixel_type type, double scale, int rows, int cols)
{
    const ptrdiff_t bytes = type == HADA_PIXEL_U8 ? 1 : type == HADA_PIXEL_U16 ? 2 : 4;
    const size_t count = (size_t)(CHANNELS * rows * cols);
    DEFAULTS(hada_pixels, pixels);
    hada_pixels_planar(&pixels, samples, type, CHANNELS, rows, cols);
    pixels.full_scale = scale;
    send(stage, &pixels, count * (size_t)bytes);
    pixels.data = (const char *)samples + pixels.row_stride * (rows - 1);
    pixels.row_stride = -pixels.row_stride;
    send(stage, &pixels, count * (size_t)bytes);
    hada_pixels_interleaved(&pixels, samples, type, CHANNELS, rows, cols);
    send(stage, &pixels, count * (size_t)bytes);
    if (type == HADA_PIXEL_F32)
        return;
    pixels.row_stride += CHANNELS * bytes;
    send(stage, &pixels, (count + (size_t)(CHANNELS * (rows - 1))) * (size_t)bytes);
}

TEST(gives_the_device_the_same_bits)
{
    static const double scales[] = {HADA_AUTO, 255, 1023, 4095, 16383, 1, 999};
    static uint8_t bytes[2 * NUMBERS];
    static uint16_t words[2 * NUMBERS];
    static float floats[2 * NUMBERS];
    SCOPED(hada_context) * context;
    const double distance = 100.0;
    for (int i = 0; i < 2 * NUMBERS; i++) {
        bytes[i] = (uint8_t)(i * 7);
        words[i] = (uint16_t)((unsigned)i * 40503u);
        floats[i] = 0.37f * (float)i;
    }
    ASSERT_OK(hada_context_create(&context, NULL, err));
    for (int k = 0; k < 2 * SIDES; k++) {
        hada_model_info info = {.depths = 1,
                                .channels = CHANNELS,
                                .form = HADA_FORM_COMPLEX,
                                .boundary = HADA_BOUNDARY_CIRCULAR,
                                .distances_mm = &distance};
        SCOPED(hada_slot) * slot;
        SCOPED(hada_hadamard) * stage;
        const int rows = sides[k % SIDES][0], cols = sides[k % SIDES][1], apart = k >= SIDES;
        context->info.unified_memory = !apart;
        ASSERT_OK(hada_model_set_sizes(&info, rows, cols, rows, cols, err));
        ASSERT_OK(hada_slot_create(&slot, context, err));
        ASSERT_OK(hada_hadamard_create(&stage, slot, &info, 1, err));
        assert_true((stage->upload.staged != NULL) == apart);
        for (size_t s = 0; s < HADA_COUNT(scales); s++) {
            send_all(stage, bytes, HADA_PIXEL_U8, scales[s], rows, cols);
            send_all(stage, words, HADA_PIXEL_U16, scales[s], rows, cols);
        }
        send_all(stage, floats, HADA_PIXEL_F32, HADA_AUTO, rows, cols);
    }
}

/* Memory with wide gaps, and scales whose quotients the device was not tested for, are converted on the host. */
TEST(knows_what_the_device_does_not_take)
{
    static const double scales[] = {0.5, 1.5, 65536, 1e30};
    static uint16_t words[NUMBERS];
    DEFAULTS(hada_pixels, pixels);
    hada_pixels_planar(&pixels, words, HADA_PIXEL_U16, 1, 8, 8);
    assert_true(hada_pixels_uploads(&pixels));
    pixels.row_stride *= 3;
    assert_false(hada_pixels_uploads(&pixels));
    hada_pixels_planar(&pixels, words, HADA_PIXEL_U16, 1, 8, 8);
    for (size_t i = 0; i < HADA_COUNT(scales); i++) {
        pixels.full_scale = scales[i];
        assert_false(hada_pixels_uploads(&pixels));
    }
}
