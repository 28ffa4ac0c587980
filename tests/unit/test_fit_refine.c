/* The choice of refinement by leave-one-out: it pays for a camera that the model describes, and is left out for one
 * that it does not describe. */
#include "camera_small.h"
#include "fit/fitter.h"
#include "fit/trial_frame.h"
#include "io/text.h"
#include "patience.h"

enum { ROWS = 48, COLS = 60, WINDOW = 20, DEPTHS = 2, PAIRS = 6 };
static const double distances[] = {100.0, 300.0};

/* Scenes of bright squares on black: light that must not be negative, so refinement has something to gain. */
static hada_image squares(uint64_t seed)
{
    hada_image scene;
    hada_random random;
    ASSERT_OK(hada_image_create(&scene, 1, WINDOW, WINDOW, err));
    hada_random_seed(&random, seed, 3);
    for (int k = 0; k < 4; k++) {
        const int row = (int)hada_random_below(&random, WINDOW - 5), col = (int)hada_random_below(&random, WINDOW - 5);
        const float value = (float)hada_random_range(&random, 0.3, 1.0);
        for (int i = 0; i < 25; i++)
            scene.data[(row + i / 5) * WINDOW + col + i % 5] = value;
    }
    return scene;
}

/* A caller may stop the end of a fit at any question; nothing is left of it, and the sums are as they were. */
static void stop_anywhere(hada_fitter *fitter, const hada_dataset *data, patience *of)
{
    hada_model *model;
    of->asked = 0; /* at the first end the device still had work of the pairs, for which it was asked once more */
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    hada_model_destroy(&model);
    const int asked = of->asked;
    assert_true(asked > 20);
    for (int k = 0; k < 4; k++) {
        *of = (patience){.most = k * (asked - 1) / 3};
        ASSERT_FAILS(hada_fitter_finish(fitter, data, &model, err), HADA_ERROR_CANCELLED, "");
        assert_null(model);
        assert_int_equal(of->asked, of->most + 1);
    }
    *of = (patience){.most = -1};
}

enum { NOISE_PER_MILLE = 10 };

/* The noise of the kept frames, as a share of their light and of their largest value. */
static void check_noise(const hada_fit_kept *kept, const hada_model_info *info)
{
    double light = 0.0, most = 0.0;
    for (int k = 0; k < kept->count; k++) {
        double energy = 0.0, largest = 0.0;
        for (int i = 0; i < ROWS * COLS; i++) {
            energy += (double)kept->pair[k].raw[i] * kept->pair[k].raw[i] / (ROWS * COLS);
            largest = fmax(largest, kept->pair[k].raw[i]);
        }
        light += log(1e-3 * NOISE_PER_MILLE / sqrt(energy)) / kept->count;
        most += log(1e-3 * NOISE_PER_MILLE / largest) / kept->count;
    }
    if (info->refine_tv > 0.0 && !(fabs(info->refine_noise / exp(light) - 1.0) < 0.2 &&
                                   fabs(info->refine_noise_largest / exp(most) - 1.0) < 0.2))
        fail_msg("noise %g, %g instead of %g, %g", info->refine_noise, info->refine_noise_largest, exp(light),
                 exp(most));
}

static hada_model *fit(hada_context *context, int strange, hada_fit_rows *rows)
{
    patience of = {.most = -1};
    const hada_monitor monitor = patience_monitor(&of);
    hada_fitter *fitter;
    hada_model *model;
    hada_image scene[DEPTHS][PAIRS], frame[DEPTHS][PAIRS];
    hada_fit_options options = helpers_fit(DEPTHS, 1, distances, ROWS, COLS, WINDOW);
    options.monitor = &monitor;
    options.outside = 1.0;
    ASSERT_OK(hada_fitter_create(&fitter, context, &options, err));
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++) {
            /* a strange camera has another mask every time */
            hada_image psf = small_psf(1, ROWS, COLS, 20, (uint64_t)(strange ? 10 * z + i + 1 : z + 1));
            scene[z][i] = squares((uint64_t)(20 * z + i));
            frame[z][i] = small_frame(&psf, &scene[z][i], 0, 1e-3 * NOISE_PER_MILLE, (uint64_t)(40 * z + i));
            hada_image_destroy(&psf);
            ASSERT_OK(hada_fitter_add_pair(fitter, z, &frame[z][i], &scene[z][i], err));
        }
    const int counts[DEPTHS] = {PAIRS, PAIRS};
    hada_dataset *data;
    ASSERT_OK(hada_dataset_from_images(&data, DEPTHS, distances, counts, frame[0], scene[0], err));
    of.asked = 0;
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    assert_int_equal(fitter->kept.count, HADA_FIT_KEPT);
    *rows = fitter->rows;
    check_noise(&fitter->kept, &model->info);
    stop_anywhere(fitter, data, &of);

    /* the trial leaves the sums as they were: a second end gives the same model */
    hada_model *again;
    ASSERT_OK(hada_fitter_finish(fitter, data, &again, err));
    const size_t values = hada_model_plane(model) * 2 * DEPTHS;
    assert_memory_equal(model->filter, again->filter, values * sizeof(float));
    assert_memory_equal(model->otf, again->otf, values * sizeof(float));
    assert_int_equal(model->info.refine_steps, again->info.refine_steps);
    hada_model_destroy(&again);
    hada_fitter_destroy(&fitter);
    hada_dataset_destroy(&data);
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++) {
            hada_image_destroy(&scene[z][i]);
            hada_image_destroy(&frame[z][i]);
        }
    return model;
}

TEST(refinement_is_chosen_where_it_pays)
{
    SCOPED(hada_context) * context;
    hada_fit_rows rows;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    for (int strange = 0; strange < 2; strange++) {
        SCOPED(hada_model) *model = fit(context, strange, &rows);
        double linear = NAN, chosen = NAN;
        int marked = 0;
        for (int i = 0; i < rows.refinements; i++) {
            const hada_fit_refine_score *row = &rows.refinement[i];
            const double both = row->psnr_single + row->psnr_double;
            assert_true(isfinite(row->psnr_single) && row->rho > 0.0);
            assert_true(!i == !row->steps);
            if (!i)
                linear = both;
            if (row->chosen) {
                chosen = both;
                marked++;
                assert_int_equal(row->steps, model->info.refine_steps);
            }
        }
        assert_int_equal(marked, 1);
        assert_true(chosen >= linear); /* never worse than the linear filter */
        if (!strange && !(chosen > linear + 2.0))
            fail_msg("refinement gained only %g dB", chosen - linear);
        if (!strange)
            assert_true(model->info.refine_steps > 0);
    }
    assert_int_equal(hada_context_bytes(context), 0);
}

/* Planes are compared with scenes as results are written, in the scenes' encoding; of large ones a sample is. */
TEST(planes_are_compared_in_the_encoding_of_scenes)
{
    const double responses[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, 2.2}, shares[] = {1.0, 0.7, 0.1};
    static float planes[2 * 90 * 130], linear[2 * 90 * 130], scene[2 * 90 * 130];
    const int sides[][2] = {{9, 13}, {90, 130}};
    hada_random random;
    hada_random_seed(&random, 8, 0);
    for (size_t i = 0; i < HADA_COUNT(scene); i++) {
        const double light = hada_random_uniform(&random);
        scene[i] = (float)(light * light);
        planes[i] = scene[i] + (float)(0.05 * hada_random_normal(&random));
        linear[i] = scene[i] + (float)(0.1 * hada_random_normal(&random));
    }
    for (int k = 0; k < 6; k++) {
        const int rows = sides[k % 2][0], cols = sides[k % 2][1], values = 2 * rows * cols;
        const double response = responses[k / 2];
        const hada_fit_grid grid = {
            .info = {.channels = 2, .window_rows = rows, .window_cols = cols, .scene_response = response}};
        const hada_fit_kept_pair pair = {.scene = scene};
        const hada_trial_frame frame = {{&pair}, 1, 0};
        const hada_trial_bench bench = {.grid = &grid, .planes = planes, .linear = linear};
        double psnr[3] = {0.0};
        hada_trial_compare(&bench, &frame, shares, 3, psnr);
        for (int s = 0; s < 3; s++) {
            double error = 0.0;
            for (int i = 0; i < values; i++) {
                const double blend = shares[s] * fmax(planes[i], 0.0) + (1.0 - shares[s]) * fmax(linear[i], 0.0),
                             wrong = hada_response_from_light(response, blend) -
                                     hada_response_from_light(response, scene[i]);
                error += wrong * wrong / values;
            }
            /* all of the small ones; of the large ones, an eighth of a decibel is four deviations of the sample's mean
             */
            if (!(fabs(psnr[s] + 10.0 * log10(error)) < (k % 2 && k > 1 ? 0.125 : 1e-4)))
                fail_msg("response %g, %d values, share %g: %g dB instead of %g", response, values, shares[s], psnr[s],
                         -10.0 * log10(error));
        }
    }
}
