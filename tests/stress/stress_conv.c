/* Convolutions of nets by every implementation, against double precision. */
#include "net_fixture.h"
#include "ref/ref_conv.h"
#include "stress.h"

typedef struct method {
    hada_conv_method method;
    const char *name;
    double amplification; /* of rounding errors by the transforms */
    double sums;          /* terms of a sum over those of a channel */
} method;

/* N1: Winograd's transforms bring out what rounding did to their products. */
static double bound_of(const method *m, int channels)
{
    return 1.5 * m->amplification * STRESS_U * sqrt(1.5 + 0.06 * m->sums * channels);
}

static void convolve(const stress_device *device, const method *m, int rows, int cols, int in, int out, int range)
{
    hada_conv_desc desc = net_conv3(1, in, out, rows, cols);
    const hada_ref_conv shape = {.coarse_channels = out,
                                 .coarse_rows = rows,
                                 .coarse_cols = cols,
                                 .fine_channels = in,
                                 .fine_rows = rows,
                                 .fine_cols = cols,
                                 .kernel_rows = 3,
                                 .kernel_cols = 3,
                                 .stride = 1,
                                 .pad_rows = 1,
                                 .pad_cols = 1};
    const size_t area = (size_t)rows * (size_t)cols, inputs = area * (size_t)in, outputs = area * (size_t)out;
    const size_t weights = 9 * (size_t)in * (size_t)out;
    desc.method = m->method;
    float *x = stress_memory(inputs, sizeof *x), *w = stress_memory(weights, sizeof *w);
    float *got = stress_memory(outputs, sizeof *got);
    double *want = stress_memory(outputs, sizeof *want);
    hada_conv *conv;
    hada_buffer x_planar, y_planar, w_buffer, x_buffer, y_buffer;
    stress_fill_normal(w, weights, 1);
    if (range)
        stress_fill_range(x, inputs, 2);
    else
        stress_fill_normal(x, inputs, 2);
    ASSERT_OK(hada_conv_create(&conv, device->slot, &desc, err));
    if (m->method && hada_conv_serving(conv) != m->method) { /* not on this device */
        hada_conv_destroy(&conv);
        goto done;
    }
    hada_tensor tx = hada_tensor_at(device->context, NULL, 0, 1, in, rows, cols);
    hada_tensor ty = hada_tensor_at(device->context, NULL, 0, 1, out, rows, cols);
    ASSERT_OK(hada_buffer_create_from(&x_planar, device->slot, x, inputs * sizeof *x, "an image", err));
    ASSERT_OK(hada_buffer_create(&y_planar, device->context, outputs * sizeof *got, "an image", err));
    ASSERT_OK(hada_buffer_create_from(&w_buffer, device->slot, w, weights * sizeof *w, "weights", err));
    ASSERT_OK(hada_buffer_create(&x_buffer, device->context, tx.image_stride * sizeof *x, "a tensor", err));
    ASSERT_OK(hada_buffer_create(&y_buffer, device->context, ty.image_stride * sizeof *x, "a tensor", err));
    tx.mem = x_buffer.mem;
    ty.mem = y_buffer.mem;
    const hada_planar from = {x_planar.mem, 0, inputs, area, (size_t)cols},
                      to = {y_planar.mem, 0, outputs, area, (size_t)cols};
    ASSERT_OK(hada_tensor_load(device->slot, &from, &tx, err));
    ASSERT_OK(hada_conv_set_weights(conv, (hada_floats){w_buffer.mem, 0}, err));
    ASSERT_OK(hada_conv_forward(conv, &tx, NULL, (hada_floats){0}, &ty, NULL, err));
    ASSERT_OK(hada_tensor_store(device->slot, &ty, &to, err));
    ASSERT_OK(hada_buffer_read(&y_planar, device->slot, 0, got, outputs * sizeof *got, err));
    hada_ref_conv_to_coarse(&shape, w, x, want);
    stress_row("N1", stress_distance(got, want, outputs) / stress_norm_double(want, outputs),
               bound_of(m, in) * (range ? 2.0 : 1.0), "convolution, %s, %d to %d channels of %d x %d%s", m->name, in,
               out, rows, cols, range ? ", values from 1 to 1e12" : "");
    hada_conv_destroy(&conv);
    HADA_DESTROY_BUFFERS(&x_planar, &y_planar, &w_buffer, &x_buffer, &y_buffer);
done:
    HADA_FREE(x, w, got, want);
}

void stress_convolutions(void **state)
{
    (void)state;
    static const method methods[] = {{HADA_CONV_DIRECT, "direct", 1.0, 9.0},
                                     {HADA_CONV_WINOGRAD4, "Winograd F(4x4)", 10.8, 1.0}};
    const int small = stress_form_now == STRESS_TINY;
    stress_device device = stress_open();
    for (size_t i = 0; i < HADA_COUNT(methods); i++) {
        convolve(&device, &methods[i], small ? 8 : 33, small ? 8 : 29, 8, 16, 0);
        if (small)
            continue;
        convolve(&device, &methods[i], 32, 32, 16, 16, 1);
        convolve(&device, &methods[i], 16, 16, stress_form_now == STRESS_FULL ? 256 : 64, 32, 0);
    }
    stress_close(&device);
    stress_end_group();
}
