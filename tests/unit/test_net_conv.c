/* Convolutions against PyTorch (tests/golden/make_conv.py): the references in double precision (the check tool
 * compares the device with them); bytes and errors of the interface. */
#include "dry.h"
#include "net_fixture.h"
#include "patience.h"

#include "io/safetensors.h"
#include "ref/ref_conv.h"

static const char *const names[] = {"same", "strided", "one", "large", "flat", "doubling", "growing", "channels"};

typedef struct values {
    size_t count;
    double *exact;
    float *single;
    const int64_t *shape;
} values;

static values part_of(const hada_tensors *file, const char *name, const char *part)
{
    char full[64];
    snprintf(full, sizeof full, "%s.%s", name, part);
    const hada_stored_tensor *tensor = hada_tensors_find(file, full);
    if (!tensor)
        fail_msg("there is no %s in the golden file", full);
    assert_int_equal(tensor->type, HADA_F64);
    values v = {tensor->bytes / sizeof(double), malloc(tensor->bytes), malloc(tensor->bytes), tensor->shape};
    assert_non_null(v.exact);
    assert_non_null(v.single);
    memcpy(v.exact, tensor->data, tensor->bytes);
    for (size_t i = 0; i < v.count; i++)
        v.single[i] = (float)v.exact[i];
    return v;
}

enum { X, W, B, Y, DY, DX, DW, DB, HOW, PARTS };

typedef struct golden_case {
    values part[PARTS];
    hada_conv_desc desc;
    int rows, cols; /* of y */
} golden_case;

static golden_case open_case(const char *name)
{
    static const char *const parts[PARTS] = {"x", "w", "b", "y", "dy", "dx", "dw", "db", "how"};
    golden_case c;
    hada_tensors *file;
    ASSERT_OK(hada_tensors_open(&file, HADALENS_SOURCE_DIR "/tests/golden/conv.safetensors", err));
    for (int i = 0; i < PARTS; i++)
        c.part[i] = part_of(file, name, parts[i]);
    const int64_t *x = c.part[X].shape, *w = c.part[W].shape, *y = c.part[Y].shape;
    const double *how = c.part[HOW].exact;
    c.desc = (hada_conv_desc){.images = (int)x[0],
                              .in_channels = (int)x[1],
                              .out_channels = (int)y[1],
                              .in_rows = (int)x[2],
                              .in_cols = (int)x[3],
                              .kernel_rows = (int)w[2],
                              .kernel_cols = (int)w[3],
                              .stride = (int)how[0],
                              .pad_rows = (int)how[1],
                              .pad_cols = (int)how[2],
                              .transposed = (int)how[3],
                              .output_pad = (int)how[4],
                              .training = 1};
    hada_conv_output_size(&c.desc, &c.rows, &c.cols);
    assert_int_equal(c.rows, y[2]);
    assert_int_equal(c.cols, y[3]);
    hada_tensors_close(&file);
    return c;
}

static void close_case(golden_case *c)
{
    for (int i = 0; i < PARTS; i++) {
        HADA_FREE(c->part[i].exact, c->part[i].single);
    }
}

static void same(const char *name, const char *what, const double *got, const values *expected)
{
    for (size_t i = 0; i < expected->count; i++)
        if (!(fabs(got[i] - expected->exact[i]) <= 1e-11 * (1.0 + fabs(expected->exact[i]))))
            fail_msg("%s: %s: value %zu is %.15g, PyTorch has %.15g", name, what, i, got[i], expected->exact[i]);
}

TEST(references)
{
    for (size_t n = 0; n < HADA_COUNT(names); n++) {
        golden_case c = open_case(names[n]);
        const hada_conv_desc *d = &c.desc;
        hada_ref_conv shape = {.coarse_channels = d->out_channels,
                               .coarse_rows = c.rows,
                               .coarse_cols = c.cols,
                               .fine_channels = d->in_channels,
                               .fine_rows = d->in_rows,
                               .fine_cols = d->in_cols,
                               .kernel_rows = d->kernel_rows,
                               .kernel_cols = d->kernel_cols,
                               .stride = d->stride,
                               .pad_rows = d->pad_rows,
                               .pad_cols = d->pad_cols};
        if (d->transposed) {
            shape.coarse_channels = d->in_channels;
            shape.coarse_rows = d->in_rows;
            shape.coarse_cols = d->in_cols;
            shape.fine_channels = d->out_channels;
            shape.fine_rows = c.rows;
            shape.fine_cols = c.cols;
        }
        const size_t images = (size_t)d->images, in = c.part[X].count / images, out = c.part[Y].count / images;
        const size_t pixels = out / (size_t)d->out_channels;
        double *y = calloc(c.part[Y].count, sizeof *y), *dx = calloc(c.part[X].count, sizeof *dx);
        double *dw = calloc(c.part[W].count, sizeof *dw), *db = calloc(c.part[B].count, sizeof *db);
        for (size_t i = 0; i < images; i++) {
            const float *x = c.part[X].single + i * in, *dy = c.part[DY].single + i * out, *w = c.part[W].single;
            if (d->transposed) {
                hada_ref_conv_to_fine(&shape, w, x, y + i * out);
                hada_ref_conv_to_coarse(&shape, w, dy, dx + i * in);
                hada_ref_conv_weights(&shape, x, dy, dw);
            } else {
                hada_ref_conv_to_coarse(&shape, w, x, y + i * out);
                hada_ref_conv_to_fine(&shape, w, dy, dx + i * in);
                hada_ref_conv_weights(&shape, dy, x, dw);
            }
            hada_ref_conv_bias(dy, d->out_channels, (int)pixels, db);
            for (size_t k = 0; k < out; k++)
                y[i * out + k] += c.part[B].exact[k / pixels];
        }
        same(names[n], "y", y, &c.part[Y]);
        same(names[n], "dx", dx, &c.part[DX]);
        same(names[n], "dw", dw, &c.part[DW]);
        same(names[n], "db", db, &c.part[DB]);
        HADA_FREE(y, dx, dw, db);
        close_case(&c);
    }
}

TEST(bytes_are_stated_before)
{
    net_device *device = *state;
    hada_context *context = device->context;
    hada_conv *conv;
    for (int plain = 0; plain < 2; plain++) {
        hada_conv_desc desc = net_conv3(1, 4, 5, 6, 7);
        desc.method = plain ? HADA_CONV_PLAIN : HADA_CONV_AUTO;
        const uint64_t before = hada_context_bytes(context);
        ASSERT_OK(hada_conv_create(&conv, device->slot, &desc, err));
        ASSERT_DRY(hada_context_bytes(context) - before, context, hada_conv,
                   hada_conv_create(&object, &dry.slot, &desc, NULL), hada_conv_destroy);
        hada_conv_destroy(&conv);
    }
}

/* y of a convolution, whose launches may take so many seconds while a monitor is asked. */
static float *run_watched(hada_slot *slot, hada_conv *conv, const hada_tensor *x, const hada_tensor *y, double seconds,
                          patience *caller, uint64_t *launches, hada_status expected)
{
    const hada_monitor monitor = patience_monitor(caller);
    const size_t count = y->image_stride * (size_t)y->images;
    float *got = malloc(count * sizeof *got);
    hada_buffer out = {.mem = y->mem, .bytes = (y->offset + count) * sizeof(float)};
    assert_non_null(got);
    ASSERT_OK(hada_buffer_clear(&out, slot, y->offset * sizeof(float), count * sizeof(float), err));
    hada_slot_watch(slot, seconds > 0 ? &monitor : NULL);
    slot->most_unasked = seconds;
    const uint64_t before = slot->calls.launches;
    assert_int_equal(hada_conv_forward(conv, x, NULL, (hada_floats){0}, y, NULL, NULL), expected);
    *launches = slot->calls.launches - before;
    hada_slot_watch(slot, NULL);
    ASSERT_OK(hada_buffer_read(&out, slot, y->offset * sizeof(float), got, count * sizeof(float), err));
    return got;
}

/* One that takes seconds becomes several launches while somebody may want to stop: the same bits. */
TEST(large_ones_are_divided)
{
    static const struct {
        int in, out, kernel, stride, method;
    } rows[] = {{3, 16, 3, 1, HADA_CONV_AUTO},  {16, 24, 3, 1, HADA_CONV_AUTO}, {64, 64, 3, 1, HADA_CONV_AUTO},
                {8, 3, 3, 1, HADA_CONV_AUTO},   {12, 16, 5, 1, HADA_CONV_AUTO}, {16, 16, 1, 1, HADA_CONV_AUTO},
                {16, 16, 4, 2, HADA_CONV_AUTO}, {5, 9, 3, 1, HADA_CONV_PLAIN}};
    enum { SIDE = 45, FLOATS = 1 << 20 };
    net_device *device = *state;
    hada_context *context = device->context;
    SCOPED(hada_buffer) buffer;
    SCOPED_MEMORY float *random = malloc(FLOATS * sizeof *random);
    int divided = 0;
    net_fill(random, FLOATS, 1);
    ASSERT_OK(hada_buffer_create(&buffer, context, 4 * FLOATS * sizeof(float), "tensors", err));
    for (size_t i = 0; i < HADA_COUNT(rows); i++) {
        hada_conv_desc desc = net_conv3(2, rows[i].in, rows[i].out, SIDE, SIDE + 6);
        desc.kernel_rows = desc.kernel_cols = rows[i].kernel;
        desc.pad_rows = desc.pad_cols = rows[i].kernel / 2;
        desc.stride = rows[i].stride;
        desc.method = (hada_conv_method)rows[i].method;
        int high, wide;
        SCOPED(hada_conv) * conv;
        uint64_t once, often, few;
        hada_conv_output_size(&desc, &high, &wide);
        const hada_tensor x = hada_tensor_at(context, buffer.mem, 0, 2, rows[i].in, SIDE, SIDE + 6),
                          y = hada_tensor_at(context, buffer.mem, FLOATS, 2, rows[i].out, high, wide);
        ASSERT_OK(hada_buffer_write(&buffer, device->slot, 0, random, FLOATS * sizeof(float), err));
        const hada_planar in = {buffer.mem, (size_t)2 * FLOATS, (size_t)rows[i].in * SIDE * (SIDE + 6),
                                (size_t)SIDE * (SIDE + 6), SIDE + 6};
        ASSERT_OK(hada_buffer_write(&buffer, device->slot, (size_t)2 * FLOATS * sizeof(float), random,
                                    FLOATS * sizeof(float), err));
        ASSERT_OK(hada_tensor_load(device->slot, &in, &x, err));
        ASSERT_OK(hada_conv_create(&conv, device->slot, &desc, err));
        ASSERT_OK(hada_conv_set_weights(conv, (hada_floats){buffer.mem, (size_t)2 * FLOATS}, err));
        patience none = {.most = -1}, little = {.most = 3};
        SCOPED_MEMORY float *whole = run_watched(device->slot, conv, &x, &y, 0, &none, &once, HADA_OK),
                            *parts = run_watched(device->slot, conv, &x, &y, 1e-6, &none, &often, HADA_OK);
        assert_memory_equal(whole, parts, y.image_stride * 2 * sizeof(float));
        divided += often > once;
        if (often > once + 4)
            free(run_watched(device->slot, conv, &x, &y, 1e-6, &little, &few, HADA_ERROR_CANCELLED));
    }
    if (context->shape != HADA_SHAPE_GROUPS)
        assert_true(divided >= 6);
}

FIXTURE(net_device_open, net_device_close)
