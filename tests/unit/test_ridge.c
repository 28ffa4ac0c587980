/* The learned ridge regulariser: what its mathematics needs of the weights, and what it makes of images. That kernels
 * compute it: tests/check/check_refine_ridge.c. */
#include "device_fixture.h"

#include "core/random.h"
#include "kernels/shared_ridge_weights.h"
#include "ref/ref_ridge.h"
#include "refine/proximal.h"

FIXTURE(open_device, close_device)

enum { SIDE = 40, AREA = SIDE * SIDE, MOST = 3 * AREA, RESPONSES = HADA_RIDGE_FILTERS * AREA };

static double image[MOST], back[MOST], responses[RESPONSES];
static float values[MOST];

static double norm(const double *x, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += x[i] * x[i];
    return sqrt(sum);
}

static void fill_noise(double *x, size_t count, double deviation, unsigned seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 0);
    for (size_t i = 0; i < count; i++)
        x[i] = deviation * hada_random_normal(&random);
}

/* The largest singular value of a step's filters together, by the power method. */
static double largest(int channels, int number)
{
    const size_t count = (size_t)channels * AREA;
    double found = 0.0;
    fill_noise(image, count, 1.0, 3);
    for (int i = 0; i < 60; i++) {
        const double size = norm(image, count);
        for (size_t k = 0; k < count; k++)
            image[k] /= size;
        hada_ref_ridge_respond(image, channels, SIDE, SIDE, number, responses);
        found = norm(responses, (size_t)HADA_RIDGE_FILTERS * (SIDE - 4) * (SIDE - 4));
        hada_ref_ridge_gather(responses, channels, SIDE, SIDE, number, image);
    }
    return found;
}

/* psi'' is at least -1/8, so 1/2 |x - y|^2 + sum (m / a^2) psi(a W x) is convex where m |W|^2 < 8, with the modulus
 * 1 - m |W|^2 / 8 at least. */
TEST(objectives_are_convex)
{
    double steepest = 0.0;
    for (int i = 0; i < HADA_RIDGE_STEPS * HADA_RIDGE_FILTERS; i++) {
        assert_true(hada_ridge_share[i] > 0.0f && hada_ridge_in[i] > 0.0f);
        steepest = fmax(steepest, hada_ridge_share[i]);
    }
    for (int number = 0; number < HADA_RIDGE_STEPS; number++)
        for (int channels = 1; channels <= 3; channels += 2) {
            const double most = largest(channels, number);
            assert_true(most <= 1.005); /* of a larger image than they were scaled on */
            assert_true(steepest * most * most < 8.0);
        }
}

/* <W x, r> = <x, W^T r>. */
TEST(gathers_as_the_transpose_of_responding)
{
    static double other[RESPONSES];
    for (int channels = 1; channels <= 3; channels += 2) {
        const size_t count = (size_t)channels * AREA, all = (size_t)HADA_RIDGE_FILTERS * (SIDE - 4) * (SIDE - 4);
        double left = 0.0, right = 0.0;
        fill_noise(image, count, 1.0, 4);
        fill_noise(other, all, 1.0, 5);
        hada_ref_ridge_respond(image, channels, SIDE, SIDE, 1, responses);
        hada_ref_ridge_gather(other, channels, SIDE, SIDE, 1, back);
        for (size_t i = 0; i < all; i++)
            left += responses[i] * other[i];
        for (size_t i = 0; i < count; i++)
            right += image[i] * back[i];
        assert_true(fabs(left - right) < 1e-9 * norm(responses, all) * norm(other, all));
    }
}

/* On the device, in place. */
static void apply(float *x, int channels, double noise)
{
    SCOPED(hada_slot) * slot;
    hada_buffer planes, scratch;
    hada_ridge ridge;
    const size_t bytes = (size_t)channels * AREA * sizeof *x;
    ASSERT_OK(hada_slot_create(&slot, context, err));
    ASSERT_OK(hada_ridge_prepare(&ridge, slot, channels, SIDE, SIDE, err));
    ASSERT_OK(hada_buffer_create(&planes, context, bytes, "planes", err));
    ASSERT_OK(
        hada_buffer_create(&scratch, context, hada_ridge_floats(channels, SIDE, SIDE, 1) * sizeof *x, "room", err));
    ASSERT_OK(hada_buffer_write(&planes, slot, 0, x, bytes, err));
    ASSERT_OK(hada_ridge_apply(&ridge, slot, planes.mem, scratch.mem, 1, noise, err));
    ASSERT_OK(hada_buffer_read(&planes, slot, 0, x, bytes, err));
    HADA_DESTROY_BUFFERS(&planes, &scratch);
}

TEST(leaves_even_brightness_as_it_is)
{
    for (int channels = 1; channels <= 3; channels++) {
        for (size_t i = 0; i < (size_t)channels * AREA; i++)
            values[i] = 0.25f * (float)(1 + i / AREA);
        apply(values, channels, 0.1);
        for (size_t i = 0; i < (size_t)channels * AREA; i++)
            assert_true(fabs(values[i] - 0.25 * (double)(1 + i / AREA)) < 2e-4);
    }
}

/* A disc before a slope: noise of 5 % falls to less than half in colour, in grey to 0.6, and the unit of brightness
 * does not matter. */
TEST(takes_noise_out)
{
    static float scaled[MOST];
    for (int channels = 1; channels <= 3; channels += 2) {
        const size_t count = (size_t)channels * AREA;
        double error = 0.0;
        fill_noise(back, count, 0.05, 6);
        for (size_t i = 0; i < count; i++) {
            const double y = (double)(i / SIDE % SIDE) - 20.0, x = (double)(i % SIDE) - 18.0;
            image[i] = x * x + y * y < 120.0 ? 0.8 - 0.1 * (double)(i / AREA) : 0.3 + 0.004 * y;
            values[i] = (float)(image[i] + back[i]);
            scaled[i] = 1000.0f * values[i];
        }
        apply(values, channels, 0.05);
        apply(scaled, channels, 50.0);
        for (size_t i = 0; i < count; i++) {
            error += (values[i] - image[i]) * (values[i] - image[i]);
            assert_true(fabs(scaled[i] - 1000.0 * values[i]) < 0.01);
        }
        assert_true(sqrt(error / (double)count) < 0.05 * (channels == 3 ? 0.5 : 0.6));
    }
}

/* Points of light, as beads are, twenty times as bright as the noise: they keep most of it, and where none is, nothing
 * as bright as the noise twice over is made up. */
TEST(keeps_points_and_makes_none_up)
{
    const double noise = 0.05;
    double light = 0.0;
    int points = 0;
    fill_noise(back, AREA, noise, 7);
    for (size_t i = 0; i < AREA; i++) {
        image[i] = i / SIDE % 10 == 5 && i % SIDE % 10 == 5 ? 1.0 : 0.0;
        values[i] = (float)(image[i] + back[i]);
    }
    apply(values, 1, noise);
    for (int y = 3; y < SIDE - 3; y++)
        for (int x = 3; x < SIDE - 3; x++) {
            const int dy = abs(y % 10 - 5), dx = abs(x % 10 - 5);
            const double value = values[y * SIDE + x];
            light += !dx && !dy ? value : 0.0;
            points += !dx && !dy;
            if (dx > 2 || dy > 2)
                assert_true(value < 2.0 * noise);
        }
    assert_true(light > 0.8 * points);
}
