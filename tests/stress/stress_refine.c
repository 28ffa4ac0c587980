/* Refinement over many steps, at extreme rho, with transfer functions that are zero, against double precision. */
#include <time.h>

#include "ref/ref_refine.h"
#include "stress.h"
#include "tiny_camera.h"

enum { DEPTHS = 2 };

typedef struct problem {
    const char *what;
    int padded, steps;
    double rho; /* in units of |OTF(0)|^2 = 1 */
    int zeros;  /* 1: a band of frequencies and (2) the whole second depth are lost */
    int range;  /* pixels from 1 to 1e12 instead of a scene */
} problem;

static void make_frame(const problem *p, const tiny_camera *camera, double *image)
{
    double *scenes = tiny_zeros(DEPTHS * camera->window_area);
    tiny_scene(camera, 11, scenes);
    tiny_scene(camera, 12, scenes + camera->window_area);
    for (size_t i = 0; i < camera->window_area; i++)
        scenes[(i % (size_t)camera->window.cols < (size_t)camera->window.cols / 2 ? camera->window_area : 0) + i] = 0.0;
    tiny_shoot(camera, scenes, 0.01, 3, image);
    free(scenes);
    SCOPED_MEMORY float *range = stress_memory(camera->pixels, sizeof *range);
    stress_fill_range(range, camera->pixels, 1);
    for (size_t i = 0; i < camera->pixels; i++)
        image[i] = (float)(p->range ? (image[i] != 0.0 ? range[i] : 0.0) : image[i]);
}

static void lose_frequencies(const problem *p, tiny_camera *camera)
{
    const size_t half = (size_t)camera->cols / 2 + 1;
    for (size_t i = 0; p->zeros && i < camera->values; i++) {
        double *first = camera->otf + 2 * i, *second = first + 2 * camera->values;
        if (p->zeros == 2)
            second[0] = second[1] = 0.0;
        if (i % half % 5 == 3) /* whole columns, so that the images stay real */
            first[0] = first[1] = second[0] = second[1] = 0.0;
    }
    /* both sides start from the same numbers */
    for (size_t i = 0; i < 2 * DEPTHS * camera->values; i++)
        camera->otf[i] = (float)camera->otf[i];
}

static void refine(const problem *p)
{
    const int small = stress_form_now == STRESS_TINY, side = small ? 8 : 24;
    static const int list[DEPTHS] = {0, 1};
    const int steps = small ? 4 : stress_form_now == STRESS_BRIEF && p->steps > 100 ? 100 : p->steps;
    tiny_camera camera = tiny_make(side, side + 8, side / 2, side / 2, DEPTHS, 1, p->padded);
    tiny_device device;
    hada_refiner *refiner;
    const size_t area = camera.window_area;
    SCOPED_MEMORY double *image = stress_memory(camera.pixels, sizeof *image),
                         *want = stress_memory(DEPTHS * area, sizeof *want);
    SCOPED_MEMORY double *residual = stress_memory((size_t)steps + 1, sizeof *residual);
    SCOPED_MEMORY float *got = stress_memory(DEPTHS * area, sizeof *got);
    lose_frequencies(p, &camera);
    make_frame(p, &camera, image);
    tiny_upload(&device, &camera);
    tiny_expose(&device, &camera, image, 1.0);
    device.shape.max_steps = steps;
    ASSERT_OK(hada_refiner_create(&refiner, device.slot, &device.shape, err));
    DEFAULTS(hada_refine_rule, rule);
    rule.steps = steps;
    rule.rho = p->rho;
    const hada_ref_refine reference = {.rows = camera.rows,
                                       .cols = camera.cols,
                                       .window = camera.window,
                                       .padded = p->padded,
                                       .frame = camera.frame,
                                       .depths = DEPTHS,
                                       .channels = 1,
                                       .otf = camera.otf,
                                       .image = image,
                                       .rho = rule.rho,
                                       .relaxation = rule.relaxation,
                                       .mu = rule.mu,
                                       .steps = steps};
    ASSERT_OK(hada_ref_refine_run(&reference, want, residual, NULL, err));
    ASSERT_OK(hada_refiner_run(refiner, &device.data, &rule, 1, DEPTHS, list, NULL, err));
    const cl_int code = clEnqueueReadBuffer(device.slot->queue, hada_refiner_planes(refiner), CL_TRUE, 0,
                                            DEPTHS * area * sizeof *got, got, 0, NULL, NULL);
    assert_int_equal(code, CL_SUCCESS);
    double left;
    ASSERT_OK(hada_refiner_residual(refiner, &device.data, 1, DEPTHS, list, &left, err));
    /* Each step adds the rounding errors of its transforms to planes and duals, and ADMM lets no error grow: R1. */
    const double planes = stress_norm_double(want, DEPTHS * area);
    const double each = 2.0 * stress_fft_bound(camera.rows, camera.cols) + 16.0 * STRESS_U;
    const double frame = stress_norm_double(image, camera.pixels);
    const double state = planes + (sqrt(residual[steps]) + each * frame) / rule.rho * DEPTHS;
    stress_row("R1",
               stress_not_finite(got, DEPTHS * area) ? INFINITY : stress_distance(got, want, DEPTHS * area) / planes,
               each * steps * state / planes, "refinement, %s, %d steps", p->what, steps);
    /* not diverging: what is left unexplained is what double precision leaves, up to the error of its own sum */
    const double sum = 2.0 * stress_fft_bound(camera.rows, camera.cols) + stress_sum_bound(2048.0 / 8);
    stress_row("R2", fabs(sqrt(left) - sqrt(residual[steps])) / frame, sum + each * steps * state / frame,
               "refinement, %s, %d steps: residual", p->what, steps);
    hada_refiner_destroy(&refiner);
    tiny_release(&device);
    tiny_free(&camera);
}

static double seconds_of(hada_refiner *refiner, const hada_refine_data *data, int steps)
{
    static const int list[DEPTHS] = {0, 1};
    struct timespec from, to;
    DEFAULTS(hada_refine_rule, rule);
    rule.rho = 3e-3;
    rule.steps = steps;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    ASSERT_OK(hada_refiner_run(refiner, data, &rule, 1, DEPTHS, list, NULL, err));
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    return (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec);
}

/* Denormal numbers would show as steps that take longer the further planes converge (R3). The least processor time of
 * seven rounds, since others may be at work as well. */
static void pace(void)
{
    static const problem usual = {"", 0, 1000, 3e-3, 0, 0};
    tiny_camera camera = tiny_make(64, 64, 32, 32, DEPTHS, 1, 0);
    tiny_device device;
    hada_refiner *refiner;
    SCOPED_MEMORY double *image = stress_memory(camera.pixels, sizeof *image);
    double early = INFINITY, all = INFINITY;
    make_frame(&usual, &camera, image);
    tiny_upload(&device, &camera);
    tiny_expose(&device, &camera, image, 1.0);
    device.shape.max_steps = usual.steps;
    ASSERT_OK(hada_refiner_create(&refiner, device.slot, &device.shape, err));
    seconds_of(refiner, &device.data, 10);
    for (int i = 0; i < 7; i++) {
        early = fmin(early, seconds_of(refiner, &device.data, 100));
        all = fmin(all, seconds_of(refiner, &device.data, 1000));
    }
    stress_row("R3", (all - early) / 9.0 / early, 2.0,
               "refinement, processor time of steps 101 to 1000 over that of the first 100");
    hada_refiner_destroy(&refiner);
    tiny_release(&device);
    tiny_free(&camera);
}

void stress_refinement(void **state)
{
    (void)state;
    static const problem problems[] = {{"circular", 0, 1000, 3e-3, 0, 0},
                                       {"cropped by the sensor", 1, 1000, 3e-3, 0, 0},
                                       {"rho 1e-4", 0, 50, 1e-4, 0, 0},
                                       {"rho 1e4", 0, 50, 1e4, 0, 0},
                                       {"zeros in the transfer functions", 0, 1000, 3e-3, 1, 0},
                                       {"a depth without light", 0, 50, 3e-3, 2, 0},
                                       {"pixels from 1 to 1e12", 0, 50, 3e-3, 0, 1}};
    for (size_t i = 0; i < HADA_COUNT(problems); i++)
        refine(&problems[i]);
    if (stress_form_now == STRESS_FULL)
        pace();
    stress_end_group();
}
