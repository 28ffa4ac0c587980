/* The reference transforms against the definition, and against each other. */
#include <complex.h>

#include "testing.h"

#include "ref/ref_fft.h"

static const int sizes[][2] = {{1, 1}, {1, 2}, {2, 1}, {3, 1},  {1, 5},  {2, 2},   {3, 4},
                               {4, 3}, {5, 5}, {7, 6}, {12, 9}, {1, 43}, {16, 10}, {11, 13}};

static double value(unsigned *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (double)(*state >> 8) / 8388608.0 - 1.0;
}

TEST(test_forward)
{
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const int rows = sizes[s][0], cols = sizes[s][1], half = cols / 2 + 1;
        double image[300], spectrum[400];
        unsigned seed = 1;
        for (int i = 0; i < rows * cols; i++)
            image[i] = value(&seed);
        assert_int_equal(hada_ref_fft_forward(image, rows, cols, spectrum, NULL), HADA_OK);
        for (int ky = 0; ky < rows; ky++)
            for (int kx = 0; kx < half; kx++) {
                double complex sum = 0.0;
                for (int y = 0; y < rows; y++)
                    for (int x = 0; x < cols; x++)
                        sum += image[y * cols + x] *
                               cexp(-2.0 * acos(-1.0) * I * ((double)ky * y / rows + (double)kx * x / cols));
                assert_true(fabs(spectrum[2 * (ky * half + kx)] - creal(sum)) < 1e-12 * rows * cols);
                assert_true(fabs(spectrum[2 * (ky * half + kx) + 1] - cimag(sum)) < 1e-12 * rows * cols);
            }
    }
}

/* Of any half spectrum, also one that no real image has, the inverse is the real part of the sum in which all columns
 * but 0 and cols/2 count twice. */
TEST(test_inverse)
{
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const int rows = sizes[s][0], cols = sizes[s][1], half = cols / 2 + 1;
        double image[300], spectrum[400];
        unsigned seed = 2;
        for (int i = 0; i < 2 * rows * half; i++)
            spectrum[i] = value(&seed);
        assert_int_equal(hada_ref_fft_inverse(spectrum, rows, cols, image, NULL), HADA_OK);
        for (int y = 0; y < rows; y++)
            for (int x = 0; x < cols; x++) {
                double sum = 0.0;
                for (int ky = 0; ky < rows; ky++)
                    for (int kx = 0; kx < half; kx++) {
                        const double angle = 2.0 * acos(-1.0) * ((double)ky * y / rows + (double)kx * x / cols);
                        const double *v = spectrum + 2 * (ky * half + kx);
                        sum += (kx == 0 || 2 * kx == cols ? 1.0 : 2.0) * (v[0] * cos(angle) - v[1] * sin(angle));
                    }
                assert_true(fabs(image[y * cols + x] - sum / (rows * cols)) < 1e-12);
            }
    }
}

TEST(test_round_trip)
{
    const int rows = 86, cols = 131, half = cols / 2 + 1;
    SCOPED_MEMORY double *image = malloc(sizeof(double) * (size_t)(2 * rows * cols + 2 * rows * half));
    double *back = image + rows * cols;
    unsigned seed = 3;
    for (int i = 0; i < rows * cols; i++)
        image[i] = value(&seed);
    assert_int_equal(hada_ref_fft_forward(image, rows, cols, back + rows * cols, NULL), HADA_OK);
    assert_int_equal(hada_ref_fft_inverse(back + rows * cols, rows, cols, back, NULL), HADA_OK);
    for (int i = 0; i < rows * cols; i++)
        assert_true(fabs(image[i] - back[i]) < 1e-13);
}

TEST(test_bad_size)
{
    double one[4] = {0};
    hada_error err;
    assert_int_equal(hada_ref_fft_forward(one, 0, 4, one, &err), HADA_ERROR_SIZE);
    assert_int_equal(hada_ref_fft_inverse(one, 4, -1, one, &err), HADA_ERROR_SIZE);
}
