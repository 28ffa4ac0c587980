/* Refinement: against the reference, its invariances, and what it gains over linear filters. */
#include "dry.h"
#include "ref/ref_refine.h"
#include "refine_fixture.h"

/* Relative L2 difference allowed after 8 steps. Every step is two transforms (relative error about 2e-7 each) and a
 * linear step whose gain is at most 1 for the data and 1 for u - d; errors add up over the steps, and the division by
 * rho + |H|^2 raises the error of spectra that nearly vanish by up to |Y| / sqrt(rho): 8 x 4e-7 x 10 is 3e-5. */
#define TOLERANCE 1e-4

/* Runs the same on the device and by the reference, and compares planes and energies. */
static void compare(fixture *f, const hada_refine_rule *rule, int depths, const int *list, const double *prior)
{
    const tiny_camera *camera = &f->camera;
    const size_t count = camera->values * 2, area = camera->window_area;
    SCOPED_MEMORY double *otf = tiny_zeros((size_t)depths * count), *planes = tiny_zeros((size_t)depths * area);
    double residual[41], split[41], energy;
    for (int s = 0; s < depths; s++)
        memcpy(otf + (size_t)s * count, camera->otf + (size_t)list[s] * count, count * sizeof *otf);
    const hada_ref_refine problem = {.rows = camera->rows,
                                     .cols = camera->cols,
                                     .window = camera->window,
                                     .padded = camera->padded,
                                     .frame = camera->frame,
                                     .depths = depths,
                                     .channels = 1,
                                     .otf = otf,
                                     .prior = prior,
                                     .image = f->image,
                                     .rho = rule->rho / rule->mu,
                                     .relaxation = rule->relaxation,
                                     .mu = rule->mu,
                                     .steps = rule->steps};
    ASSERT_OK(hada_ref_refine_run(&problem, planes, residual, split, err));
    ASSERT_OK(hada_refiner_run(f->refiner, &f->device.data, rule, 1, depths, list, NULL, err));
    double channels = 0.0;
    for (int c = 0; c < camera->channels; c++)
        channels += 1.0 / ((1 + c) * (1 + c));
    for (int k = 0; k < rule->steps; k++)
        assert_near(hada_refiner_energy(f->refiner, 0, k), channels * (camera->padded ? split[k] : residual[k]), 1e-3);
    SCOPED_MEMORY float *got = read_planes(f, depths);
    for (int s = 0; s < depths; s++)
        for (int c = 0; c < camera->channels; c++) {
            double error = 0.0, size = 0.0;
            for (size_t i = 0; i < area; i++) {
                const double a = got[(size_t)(s * camera->channels + c) * area + i];
                const double b = planes[(size_t)s * area + i] / (1 + c);
                assert_true(a >= 0.0);
                error += (a - b) * (a - b);
                size += b * b;
            }
            if (!(sqrt(error) <= TOLERANCE * sqrt(size)))
                fail_msg("plane %d, channel %d: relative error %.3g", s, c, sqrt(error / size));
        }
    ASSERT_OK(hada_refiner_residual(f->refiner, &f->device.data, 1, depths, list, &energy, err));
    assert_near(energy, channels * residual[rule->steps], 1e-3);
}

TEST(equals_the_reference)
{
    static const int sizes[][4] = {{48, 64, 20, 24}, {45, 63, 17, 21}, {40, 50, 40, 50}};
    for (size_t k = 0; k < HADA_COUNT(sizes); k++) {
        fixture f;
        set_up(&f, sizes[k][0], sizes[k][1], sizes[k][2], sizes[k][3], 4, 2, 0);
        two_depths(&f, 1, 3);
        expose(&f, 0.01, 1.0);
        DEFAULTS(hada_refine_rule, rule);
        compare(&f, &rule, 2, (const int[]){1, 3}, NULL);
        compare(&f, &rule, 1, (const int[]){3}, NULL);
        rule.relaxation = 1.0;
        rule.rho = 1e-2;
        compare(&f, &rule, 4, (const int[]){0, 1, 2, 3}, NULL);
        /* with a prior that grows with frequency */
        double *prior = tiny_zeros(f.camera.values);
        float *rows = calloc(f.camera.values, sizeof *rows), *packed = calloc(f.device.layout.count * 2, sizeof *rows);
        for (size_t i = 0; i < f.camera.values; i++) {
            rows[i] = 1e-3f * (float)(1 + i % (size_t)(f.camera.cols / 2 + 1));
            prior[i] = rows[i];
        }
        hada_layout_pack_real(&f.device.layout, rows, packed);
        hada_layout_pack_real(&f.device.layout, rows, packed + f.device.layout.count);
        ASSERT_OK(hada_buffer_create_from(&f.device.prior, f.device.slot, packed, f.device.layout.count * 8,
                                          "the prior", err));
        f.device.data.prior = f.device.prior.mem;
        rule.relaxation = 1.6;
        compare(&f, &rule, 3, (const int[]){3, 0, 1}, prior);
        HADA_FREE(prior, rows, packed);
        tear_down(&f);
    }
}

TEST(equals_the_reference_where_the_sensor_crops)
{
    fixture f;
    set_up(&f, 40, 48, 36, 44, 3, 2, 1);
    two_depths(&f, 0, 2);
    expose(&f, 0.01, 1.0);
    DEFAULTS(hada_refine_rule, rule);
    compare(&f, &rule, 2, (const int[]){0, 2}, NULL);
    rule.mu = 0.25;
    compare(&f, &rule, 1, (const int[]){2}, NULL);
    rule.mu = 3.0;
    rule.relaxation = 1.0;
    compare(&f, &rule, 3, (const int[]){0, 1, 2}, NULL);
    tear_down(&f);
}

TEST(gives_the_same_bits_whatever_runs_beside)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        static const int sets[] = {1, 3, 0, 2, 1, 2}, alone[] = {0, 2};
        set_up(&f, 40, 48, 20, 24, 4, 2, padded);
        const size_t two = 2 * 2 * f.camera.window_area, bytes = two * sizeof(float);
        two_depths(&f, 0, 2);
        expose(&f, 0.01, 1.0);
        DEFAULTS(hada_refine_rule, rule);
        rule.first_rho = 0.1 * rule.rho;
        rule.growth = 1.5;
        rule.first_relaxation = 1.95;
        rule.first_steps = 4;
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 3, 2, sets, NULL, err));
        float *beside = read_planes(&f, 6);
        const double energy = hada_refiner_energy(f.refiner, 1, rule.steps - 1);
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, alone, NULL, err));
        float *first = read_planes(&f, 2);
        assert_memory_equal(beside + two, first, bytes);
        assert_true(energy == hada_refiner_energy(f.refiner, 0, rule.steps - 1));
        /* half the steps, then the other half */
        rule.steps = 3;
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, alone, NULL, err));
        rule.steps = 5;
        rule.before = 3;
        rule.start = HADA_REFINE_CONTINUE;
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, alone, NULL, err));
        float *halves = read_planes(&f, 2);
        assert_memory_equal(halves, first, bytes);
        HADA_FREE(halves, beside, first);
        tear_down(&f);
    }
}

/* A result that has a part of the window has its bits. */
TEST(shows_a_part_of_the_window)
{
    enum { ROWS = 21, COLS = 26, DEPTHS = 2, CHANNELS = 3, ROW0 = 4, COL0 = 7, PART_ROWS = 10, PART_COLS = 13 };
    static const int list[DEPTHS] = {0, 1};
    fixture f;
    hada_refine_rule rule;
    hada_refiner *refiner;
    set_up(&f, 30, 36, ROWS, COLS, DEPTHS, CHANNELS, 1);
    two_depths(&f, 0, 1);
    expose(&f, 0.01, 1.0);
    hada_refine_rule_init(&rule);
    rule.steps = 4;
    ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, DEPTHS, list, NULL, err));
    SCOPED_MEMORY float *whole = read_planes(&f, DEPTHS);
    hada_refine_shape shape = f.device.shape;
    shape.shown = (hada_rectangle){shape.window.row0 + ROW0, shape.window.col0 + COL0, PART_ROWS, PART_COLS};
    ASSERT_OK(hada_refiner_create(&refiner, f.device.slot, &shape, err));
    ASSERT_OK(hada_refiner_run(refiner, &f.device.data, &rule, 1, DEPTHS, list, NULL, err));
    ASSERT_OK(hada_refiner_crop(refiner, DEPTHS, err));
    float part[DEPTHS * CHANNELS][PART_ROWS][PART_COLS];
    const cl_int code = clEnqueueReadBuffer(f.device.slot->queue, hada_refiner_planes(refiner), CL_TRUE, 0, sizeof part,
                                            part, 0, NULL, NULL);
    assert_int_equal(code, CL_SUCCESS);
    for (int image = 0; image < DEPTHS * CHANNELS; image++)
        for (int row = 0; row < PART_ROWS; row++)
            assert_memory_equal(part[image][row], whole + (image * ROWS + ROW0 + row) * COLS + COL0, sizeof part[0][0]);
    hada_refiner_destroy(&refiner);
    tear_down(&f);
}

TEST(scales_with_the_frame)
{
    for (int k = 0; k < 4; k++) {
        fixture f;
        static const int list[] = {0, 2};
        set_up(&f, 40, 48, 20, 24, 3, 1, k % 2);
        const size_t count = 2 * f.camera.window_area;
        two_depths(&f, 0, 2);
        DEFAULTS(hada_refine_rule, rule);
        const double tv = k < 2 ? 0.0 : 1e-4;
        rule.tv = tv;
        expose(&f, 0.01, 1.0);
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err));
        float *once = read_planes(&f, 2);
        rule.tv = 1024.0 * tv;
        expose(&f, 0.01, 1024.0); /* a power of two: exact */
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err));
        float *exact = read_planes(&f, 2);
        rule.tv = 1000.0 * tv;
        expose(&f, 0.01, 1000.0);
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err));
        float *thousand = read_planes(&f, 2);
        double top = 0.0;
        for (size_t i = 0; i < count; i++)
            top = fmax(top, once[i]);
        for (size_t i = 0; i < count; i++) {
            assert_true(exact[i] == 1024.0f * once[i]);
            assert_true(fabs(thousand[i] / 1000.0 - once[i]) < 1e-5 * top);
        }
        HADA_FREE(once, exact, thousand);
        tear_down(&f);
    }
}

/* The best of a grid of pooled filters conj(H_z) / (|H_z|^2 + alpha sum of the others + lambda): mean PSNR of planes.
 */
static double best_linear(const fixture *f, int depths, const int *list)
{
    const tiny_camera *camera = &f->camera;
    const size_t count = camera->values, area = camera->window_area;
    SCOPED_MEMORY double *spectrum = tiny_zeros(2 * count), *x = tiny_zeros(2 * count),
                         *grid = tiny_zeros(camera->pixels);
    double *plane = tiny_zeros(area), best = -99.0;
    ASSERT_OK(hada_ref_fft_forward(f->image, camera->rows, camera->cols, spectrum, err));
    for (double alpha = 0.01; alpha < 2.0; alpha *= 3.0)
        for (double lambda = 1e-4; lambda < 1.0; lambda *= 3.0) {
            double mean = 0.0;
            for (int s = 0; s < depths; s++) {
                for (size_t i = 0; i < count; i++) {
                    const double *h = camera->otf + 2 * ((size_t)list[s] * count + i), *b = spectrum + 2 * i;
                    double g = lambda;
                    for (int z = 0; z < camera->depths; z++) {
                        const double *o = camera->otf + 2 * ((size_t)z * count + i);
                        g += (o[0] * o[0] + o[1] * o[1]) * (z == list[s] ? 1.0 : alpha);
                    }
                    x[2 * i] = (h[0] * b[0] + h[1] * b[1]) / g;
                    x[2 * i + 1] = (h[0] * b[1] - h[1] * b[0]) / g;
                }
                ASSERT_OK(hada_ref_fft_inverse(x, camera->rows, camera->cols, grid, err));
                for (size_t i = 0; i < area; i++)
                    plane[i] = fmax(
                        0.0,
                        grid[(i / (size_t)camera->window.cols + (size_t)camera->window.row0) * (size_t)camera->cols +
                             i % (size_t)camera->window.cols + (size_t)camera->window.col0]);
                mean += tiny_psnr(plane, f->scenes + (size_t)list[s] * area, area) / depths;
            }
            best = fmax(best, mean);
        }
    free(plane);
    return best;
}

static double refined(const fixture *f, int depths, const int *list)
{
    const size_t area = f->camera.window_area;
    SCOPED_MEMORY float *planes = read_planes(f, depths);
    double *values = doubles(planes, (size_t)depths * area), mean = 0.0;
    for (int s = 0; s < depths; s++)
        mean += tiny_psnr(values + (size_t)s * area, f->scenes + (size_t)list[s] * area, area) / depths;
    free(values);
    return mean;
}

TEST(beats_linear_filters)
{
    static const int lists[][2] = {{1, 1}, {0, 3}, {1, 2}};
    fixture f;
    set_up(&f, 96, 128, 32, 40, 4, 1, 0);
    DEFAULTS(hada_refine_rule, rule);
    rule.steps = 16;
    for (size_t k = 0; k < HADA_COUNT(lists); k++) {
        const int depths = lists[k][0] == lists[k][1] ? 1 : 2;
        if (depths == 2) {
            two_depths(&f, lists[k][0], lists[k][1]);
        } else {
            memset(f.scenes, 0, 4 * f.camera.window_area * sizeof *f.scenes);
            tiny_scene(&f.camera, 11, f.scenes + f.camera.window_area);
        }
        expose(&f, 0.01, 1.0);
        tiny_prior(&f.device, &f.camera, f.image, 0.01);
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, depths, lists[k], NULL, err));
        const double linear = best_linear(&f, depths, lists[k]), here = refined(&f, depths, lists[k]);
        print_message("%d depths %d %d: linear %.2f dB, refined %.2f dB\n", depths, lists[k][0], lists[k][1], linear,
                      here);
        assert_true(here > linear + (depths == 2 ? 3.0 : 0.5));
    }
    tear_down(&f);
}

TEST(explains_more_with_every_step)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        static const int list[] = {0, 1, 2, 3};
        set_up(&f, 48, 64, 20, 24, 4, 1, padded);
        for (int z = 0; z < 4; z++) /* every depth: a slanted plane, one strip a depth */
            for (size_t i = 0; i < f.camera.window_area; i++)
                f.scenes[(size_t)z * f.camera.window_area + i] =
                    i % 24 / 6 == (size_t)z ? 0.3 + 0.7 * ((i / 24 / 3) % 2) : 0.0;
        expose(&f, 0.003, 1.0);
        DEFAULTS(hada_refine_rule, rule);
        rule.rho = 1e-2;
        double before = INFINITY, start;
        for (int steps = 2; steps <= 32; steps *= 2) {
            double energy;
            rule.steps = steps;
            ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 4, list, NULL, err));
            ASSERT_OK(hada_refiner_residual(f.refiner, &f.device.data, 1, 4, list, &energy, err));
            assert_true(energy < before);
            before = energy;
        }
        start = hada_refiner_energy(f.refiner, 0, 0);
        assert_true(before < 1e-3 * start);
        /* the rule by which it stops */
        int steps;
        rule.steps = 40;
        rule.stop = 0.02;
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 4, list, &steps, err));
        print_message("stopped after %d steps\n", steps);
        assert_in_range(steps, 4, 40);
        /* never before as many steps as it is told, nor while rho grows for one depth of a sensor that crops */
        rule.least = steps + 3;
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 4, list, &steps, err));
        assert_in_range(steps, rule.least, 39);
        hada_refine_rule grows = {.steps = 16, .rho = 3e-2, .first_rho = 1e-3, .growth = 1.25, .tv = 1e-3};
        hada_refine_rule_stop(&grows, padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR, 1);
        assert_int_equal(grows.least, padded ? 16 : 0); /* 1e-3 * 1.25^16 > 3e-2 */
        tear_down(&f);
    }
}

/* The kernels for work-groups and for odd layouts do what the vector kernels do. */
TEST(all_kernel_shapes_agree)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        static const int list[] = {0, 2};
        double energy[2], left[2];
        set_up(&f, 40, 48, 20, 24, 3, 2, padded);
        two_depths(&f, 0, 2);
        expose(&f, 0.01, 1.0);
        DEFAULTS(hada_refine_rule, rule);
        float *planes[2];
        const hada_kernel_shape shape = f.device.context->shape;
        for (int k = 0; k < 2; k++) {
            f.device.context->shape = k ? HADA_SHAPE_GROUPS : HADA_SHAPE_LANES;
            const hada_status status = hada_refine_prepare(f.refiner, NULL);
            f.device.context->shape = shape;
            assert_int_equal(status, HADA_OK);
            ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err));
            energy[k] = hada_refiner_energy(f.refiner, 0, 5);
            ASSERT_OK(hada_refiner_residual(f.refiner, &f.device.data, 1, 2, list, &left[k], err));
            planes[k] = read_planes(&f, 2);
        }
        assert_near(energy[1], energy[0], 1e-4);
        assert_near(left[1], left[0], 1e-4);
        for (size_t i = 0; i < 4 * f.camera.window_area; i++)
            assert_true(fabs((double)planes[0][i] - planes[1][i]) < 1e-4);
        HADA_FREE(planes[0], planes[1]);
        tear_down(&f);
    }
}

/* What a run leaves behind for the score is what the score would make. */
TEST(scores_what_a_run_leaves)
{
    fixture f;
    static const int sets[] = {1, 3, 0, 2};
    double energy[2], again[2], beside, frame;
    set_up(&f, 40, 48, 20, 24, 4, 2, 0);
    two_depths(&f, 0, 2);
    expose(&f, 0.01, 1.0);
    DEFAULTS(hada_refine_rule, rule);
    rule.quiet = rule.scored = 1;
    ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 2, 2, sets, NULL, err));
    ASSERT_OK(hada_refiner_score(f.refiner, &f.device.data, 2, 2, sets, 40, 48, energy, NULL, err));
    ASSERT_OK(hada_refiner_score(f.refiner, &f.device.data, 2, 2, sets, 40, 48, again, &beside, err));
    ASSERT_OK(hada_refiner_score(f.refiner, &f.device.data, 1, 0, NULL, 40, 48, &frame, NULL, err));
    assert_true(energy[0] > 0.0 && energy[0] == again[0] && energy[1] == again[1]);
    assert_true(frame > energy[0] && beside == frame);
    tear_down(&f);
}

TEST(black_and_constant_frames_are_fine)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        static const int list[] = {0, 2};
        set_up(&f, 40, 48, 20, 24, 3, 1, padded);
        const size_t count = 2 * f.camera.window_area;
        DEFAULTS(hada_refine_rule, rule);
        rule.stop = 0.01;
        expose(&f, 0.0, 1.0);
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err));
        float *planes = read_planes(&f, 2);
        for (size_t i = 0; i < count; i++)
            assert_true(planes[i] == 0.0f);
        free(planes);
        for (int i = f.camera.frame.row0; i < f.camera.frame.row0 + f.camera.frame.rows; i++)
            for (int j = f.camera.frame.col0; j < f.camera.frame.col0 + f.camera.frame.cols; j++)
                f.image[(size_t)i * (size_t)f.camera.cols + (size_t)j] = 0.5;
        tiny_expose(&f.device, &f.camera, f.image, 1.0);
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err));
        planes = read_planes(&f, 2);
        for (size_t i = 0; i < count; i++)
            assert_true(planes[i] >= 0.0f && planes[i] < 1e3f);
        free(planes);
        tear_down(&f);
    }
}

TEST(refuses_what_it_cannot_do)
{
    fixture f;
    hada_refiner *none;
    static const int list[] = {0, 9};
    set_up(&f, 40, 48, 20, 24, 3, 1, 1);
    DEFAULTS(hada_refine_rule, rule);
    ASSERT_FAILS(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, list, NULL, err), HADA_ERROR_ARGUMENT,
                 "depth 9");
    ASSERT_FAILS(hada_refiner_run(f.refiner, &f.device.data, &rule, 9, 1, list, NULL, err), HADA_ERROR_ARGUMENT, "");
    rule.rho = 0.0;
    ASSERT_FAILS(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 1, list, NULL, err), HADA_ERROR_ARGUMENT, "");
    hada_refine_rule_init(&rule);
    rule.steps = 41;
    ASSERT_FAILS(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 1, list, NULL, err), HADA_ERROR_ARGUMENT, "");
    rule.steps = 1;
    f.device.data.frame = NULL;
    ASSERT_FAILS(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 1, list, NULL, err), HADA_ERROR_ARGUMENT, "");
    f.device.data.frame = f.device.data.spectrum; /* never read */
    rule.tv = 1.0;
    rule.noise = 0.1;
    ASSERT_FAILS(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 1, list, NULL, err), HADA_ERROR_ARGUMENT,
                 "regulariser");
    f.device.shape.tv = f.device.shape.settle = 0;
    hada_refiner *plain;
    ASSERT_OK(hada_refiner_create(&plain, f.device.slot, &f.device.shape, err));
    rule.tv = 1.0;
    ASSERT_FAILS(hada_refiner_run(plain, &f.device.data, &rule, 1, 1, list, NULL, err), HADA_ERROR_ARGUMENT,
                 "total variation");
    rule.settle = 0.01;
    rule.tv = 0.0;
    ASSERT_FAILS(hada_refiner_run(plain, &f.device.data, &rule, 1, 1, list, NULL, err), HADA_ERROR_ARGUMENT, "settled");
    hada_refiner_destroy(&plain);
    f.device.shape.window.cols = 999;
    ASSERT_FAILS(hada_refiner_create(&none, f.device.slot, &f.device.shape, err), HADA_ERROR_SIZE, "");
    assert_null(none);
    tear_down(&f);
}

TEST(holds_the_bytes_it_states)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        set_up(&f, 40, 48, 20, 24, 3, 2, padded);
        const uint64_t with = hada_context_bytes(f.device.context);
        hada_refiner_destroy(&f.refiner);
        const uint64_t without = hada_context_bytes(f.device.context);
        ASSERT_DRY(with - without, f.device.context, hada_refiner,
                   hada_refiner_create(&object, &dry.slot, &f.device.shape, NULL), hada_refiner_destroy);
        tear_down(&f);
    }
}
