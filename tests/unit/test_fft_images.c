/* Batches of small images, which go through both passes of a transform in one launch. */
#include "fft_fixture.h"

/* One plan for each of two numbers of compute units, of which one shares out whole images and the other does not. */
static void same_bits(hada_fft_desc desc)
{
    static const unsigned units[2] = {3, 8};
    hada_buffer input, result;
    float *got[2];
    unsigned state = 11;
    const int inverse = desc.direction == HADA_FFT_INVERSE;
    const size_t images = desc.real_distance * (size_t)desc.batch;
    const size_t spectra = 2 * hada_fft_layout(context, desc.rows, desc.cols, desc.backend).count * (size_t)desc.batch;
    const size_t in = inverse ? spectra : images, out = inverse ? images : spectra;
    float *a = memory(in, sizeof *a), *zeros = memory(out, sizeof *zeros);
    for (size_t i = 0; i < in; i++)
        a[i] = value(&state);
    ok(hada_buffer_create_from(&input, slot, a, in * sizeof *a, "input", &err));
    for (int k = 0; k < 2; k++) {
        hada_fft *plan;
        context->info.compute_units = units[k];
        ok(hada_buffer_create_from(&result, slot, zeros, out * sizeof *zeros, "output", &err));
        ok(hada_fft_create(&plan, slot, &desc, &err));
        ok(inverse ? hada_fft_inverse(plan, desc.batch, input.mem, 0, result.mem, 0, NULL, &err)
                   : hada_fft_forward(plan, desc.batch, input.mem, 0, result.mem, 0, &err));
        got[k] = memory(out, sizeof *got[k]);
        ok(hada_buffer_read(&result, slot, 0, got[k], out * sizeof *got[k], &err));
        hada_fft_destroy(&plan);
        hada_buffer_destroy(&result);
    }
    assert_memory_equal(got[0], got[1], out * sizeof *got[0]);
    hada_buffer_destroy(&input);
    free(a);
    free(zeros);
    free(got[0]);
    free(got[1]);
}

/* Right, and with the bits that two launches give. Cases: size, rectangle and band; the last two do not fit local
 * memory and go by two launches all the same. */
TEST(test_images)
{
    static const int cases[][8] = {{1, 1, 0, 0, 1, 1, 0, 0},         {16, 24, 0, 0, 16, 24, 0, 0},
                                   {48, 64, 14, 20, 19, 23, 5, 7},   {86, 129, 20, 31, 41, 57, 0, 0},
                                   {131, 37, 50, 6, 33, 17, 60, 9},  {256, 256, 0, 0, 256, 256, 0, 0},
                                   {96, 1024, 0, 0, 96, 1024, 0, 0}, {384, 256, 0, 0, 384, 256, 0, 0}};
    const unsigned units = context->info.compute_units;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int *c = cases[i];
        for (int direction = HADA_FFT_FORWARD; direction <= HADA_FFT_INVERSE; direction++) {
            hada_fft_desc desc = whole((hada_fft_direction)direction, c[0], c[1], 3);
            desc = rectangle(desc, c[2], c[3], c[4], c[5], (int)(i % 3));
            if (direction == HADA_FFT_INVERSE) {
                desc.band_rows = c[6];
                desc.band_cols = c[7];
            }
            context->info.compute_units = 3;
            if (direction == HADA_FFT_FORWARD) {
                check_forward(desc);
            } else {
                check_inverse(desc, HADA_FFT_PLAIN, 0, 3);
                check_inverse(desc, HADA_FFT_COMPLEX, 1, 2);
                check_inverse(desc, HADA_FFT_SPLIT, 0, 1);
            }
            same_bits(desc);
        }
    }
    context->info.compute_units = units;
}

FIXTURE(open_device, close_device)
