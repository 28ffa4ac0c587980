/* Depth pursuit when a residual cannot be had: the n-th evaluation of sets fails and leaves NaN behind. The search must
 * return that failure at once, and compare nothing with what failed: an ordered comparison with NaN raises an exception
 * of the floating-point unit, which is looked for. */
#include <fenv.h>

#include "refine/pursuit_level.h"
#include "tiny_camera.h"

enum { DEPTHS = 16, WINDOW = 36 };

static _Thread_local struct {
    int calls, fail_at; /* 0: none */
} evaluation;

hada_status __real_hada_residuals_of(hada_pursuit *pursuit, hada_fidelity fidelity, const hada_set *sets, int count,
                                     double *energy, hada_error *err);
hada_status __wrap_hada_residuals_of(hada_pursuit *pursuit, hada_fidelity fidelity, const hada_set *sets, int count,
                                     double *energy, hada_error *err);

hada_status __wrap_hada_residuals_of(hada_pursuit *pursuit, hada_fidelity fidelity, const hada_set *sets, int count,
                                     double *energy, hada_error *err)
{
    if (++evaluation.calls != evaluation.fail_at)
        return __real_hada_residuals_of(pursuit, fidelity, sets, count, energy, err);
    for (int i = 0; i < count; i++)
        energy[i] = NAN;
    feclearexcept(FE_INVALID);
    return hada_fail(err, HADA_ERROR_DEVICE, "evaluation %d was made to fail", evaluation.calls);
}

TEST(searches_end_where_an_evaluation_fails)
{
    tiny_camera camera = tiny_make(96, 128, WINDOW, WINDOW, DEPTHS, 1, 0);
    tiny_device device;
    hada_pursuit *pursuit;
    hada_pursuit_result result;
    SCOPED_MEMORY double *scenes = tiny_zeros(DEPTHS * camera.window_area), *image = tiny_zeros(camera.pixels);
    tiny_upload(&device, &camera);
    DEFAULTS(hada_pursuit_options, options);
    options.shape = device.shape;
    options.depths = DEPTHS;
    ASSERT_OK(hada_pursuit_create(&pursuit, device.slot, &options, err));
    ASSERT_OK(hada_pursuit_set_otf(pursuit, device.otf.mem, 0, err));
    /* one half of the window at a depth, the other, faint, at the next: sets are moved and compared on the finer grid
     */
    for (int z = 1; z < 3; z++) {
        double *scene = scenes + (size_t)z * camera.window_area;
        tiny_scene(&camera, 40 + (unsigned)z, scene);
        for (size_t i = 0; i < camera.window_area; i++)
            scene[i] *= (i % WINDOW < WINDOW / 2) == (z == 1) ? 0.0 : z == 1 ? 1.0 : 0.1;
    }
    tiny_shoot(&camera, scenes, 0.01, 5, image);
    tiny_expose(&device, &camera, image, 1.0);
    evaluation.calls = evaluation.fail_at = 0;
    ASSERT_OK(hada_pursuit_run(pursuit, device.spectrum.mem, 1.0, &result, err));
    assert_true(result.fine_comparisons > 0);
    const int calls = evaluation.calls;
    assert_true(calls > 20);
    for (int n = 1; n <= calls; n++) {
        hada_error error = {0};
        evaluation.calls = 0;
        evaluation.fail_at = n;
        assert_int_equal(hada_pursuit_run(pursuit, device.spectrum.mem, 1.0, &result, &error), HADA_ERROR_DEVICE);
        if (fetestexcept(FE_INVALID))
            fail_msg("evaluation %d of %d failed, and its result was compared with something", n, calls);
        assert_int_equal(evaluation.calls, n);
        assert_true(strstr(error.message, "made to fail") != NULL);
    }
    evaluation.fail_at = 0;
    hada_pursuit_destroy(&pursuit);
    tiny_release(&device);
    tiny_free(&camera);
}
