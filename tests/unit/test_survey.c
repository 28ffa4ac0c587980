/* What pairs say of themselves: the response of their scenes and the exposures of their frames are found, whatever the
 * response, with and without exposures that differ, on sensors that crop; and nothing is found where there is nothing.
 * Pairs that contradict the others are left out, and none of sound ones. */
#include "camera_small.h"
#include "dataset/dataset.h"
#include "fit/fitter.h"
#include "image/correct.h"
#include "image/mosaic.h"

enum { ROWS = 48, COLS = 64, WINDOW = 24, DEPTHS = 4, CHANNELS = 3, PAIRS = 5 };

typedef struct pairs {
    hada_image frame[DEPTHS][PAIRS], scene[DEPTHS][PAIRS];
    double gain[DEPTHS][PAIRS];
    int shown, refuse;
} pairs;

/* Frames of scenes with large and small detail, as the sensor sees them; then the scenes are encoded. */
static void make_pairs(pairs *set, double response, int exposed, double noise, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 3);
    *set = (pairs){0};
    for (int z = 0; z < DEPTHS; z++) {
        SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 9, seed + (uint64_t)z);
        for (int i = 0; i < PAIRS; i++) {
            const double gain = exposed ? exp2(hada_random_range(&random, -1.0, 1.0)) : 1.0;
            hada_image *scene = &set->scene[z][i], *frame = &set->frame[z][i];
            ASSERT_OK(
                hada_scene_procedural(scene, seed * 1000 + (uint64_t)(z * PAIRS + i), CHANNELS, WINDOW, WINDOW, err));
            hada_response_convert(scene->data, hada_image_count(scene), response, HADA_RESPONSE_LINEAR);
            *frame = small_frame(&psf, scene, 1, noise, seed + (uint64_t)i);
            for (size_t k = 0; k < hada_image_count(frame); k++)
                frame->data[k] *= (float)gain;
            hada_response_convert(scene->data, hada_image_count(scene), HADA_RESPONSE_LINEAR, response);
            set->gain[z][i] = gain;
        }
    }
}

static void free_pairs(pairs *set)
{
    destroy_images(set->frame[0], DEPTHS * PAIRS);
    destroy_images(set->scene[0], DEPTHS * PAIRS);
}

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    pairs *set = user;
    if (set->refuse && ++set->shown == set->refuse) {
        error->status = HADA_ERROR_FILE_READ;
        return HADA_ERROR_FILE_READ;
    }
    ASSERT_OK(hada_image_crop(raw, &set->frame[depth][pair], 0, 0, ROWS, COLS, err));
    ASSERT_OK(hada_image_crop(scene, &set->scene[depth][pair], 0, 0, WINDOW, WINDOW, err));
    return HADA_OK;
}

static const double distances[DEPTHS] = {100.0, 200.0, 300.0, 400.0};

static hada_dataset *data_of(pairs *set, const int *counts)
{
    hada_dataset *data;
    ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, counts, read_pair, set, NULL, err));
    return data;
}

static hada_fit_options sizes(void)
{
    return helpers_fit(DEPTHS, CHANNELS, NULL, ROWS, COLS, WINDOW);
}

static const int counts[DEPTHS] = {PAIRS, PAIRS, PAIRS, PAIRS};

static const int two_each[DEPTHS] = {2, 1, 2, 2}, one_depth[DEPTHS] = {4, 0, 0, 0};

static hada_survey *ask_some(pairs *set, const int *some, hada_exposure exposure)
{
    const hada_fit_options options = sizes();
    SCOPED(hada_dataset) *data = data_of(set, some);
    hada_survey *survey;
    ASSERT_OK(hada_survey_create(&survey, &options, data, exposure, err));
    return survey;
}

static hada_survey *ask(pairs *set, hada_exposure exposure)
{
    return ask_some(set, counts, exposure);
}

static double gain_of(const hada_survey *survey, int z, int i)
{
    return survey->gains ? survey->gains[z][i] : 1.0;
}

/* The gains of a depth over their geometric mean. */
static double expected_gain(const pairs *set, int z, int i)
{
    double sum = 0.0;
    for (int k = 0; k < PAIRS; k++)
        sum += log(set->gain[z][k]) / PAIRS;
    return set->gain[z][i] / exp(sum);
}

TEST(response_is_found)
{
    static const double responses[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, 1.5, 2.2};
    for (int exposed = 0; exposed < 2; exposed++)
        for (size_t r = 0; r < sizeof responses / sizeof *responses; r++) {
            pairs set;
            make_pairs(&set, responses[r], exposed, 0.003, 11 + r);
            hada_survey *survey = ask(&set, HADA_EXPOSURE_AUTO);
            /* sRGB and the power 2.2 are nearly one curve */
            const double found = survey->response;
            if (fabs(found - responses[r]) > 1e-9 && !(responses[r] == 2.2 && found == HADA_RESPONSE_SRGB))
                fail_msg("response %g was found for %g, exposed %d", found, responses[r], exposed);
            assert_int_equal(survey->exposed, exposed);
            assert_non_null(survey->rows[3]);
            for (int z = 0; z < DEPTHS; z++)
                for (int i = 0; i < PAIRS; i++) {
                    const double gain = gain_of(survey, z, i), expected = expected_gain(&set, z, i);
                    if (fabs(gain / expected - 1.0) > 0.04)
                        fail_msg("exposure %g was found for %g", gain, expected);
                }
            hada_survey_destroy(&survey);
            assert_null(survey);
            free_pairs(&set);
        }
}

/* Two pairs of a depth tell it as well. */
TEST(two_pairs_suffice)
{
    static const double responses[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, 1.5};
    for (uint64_t seed = 1; seed <= 6; seed++) {
        pairs set;
        make_pairs(&set, responses[seed % 3], 0, 0.003, seed);
        hada_survey *survey = ask_some(&set, two_each, HADA_EXPOSURE_AUTO);
        if (survey->response != responses[seed % 3] || survey->exposed)
            fail_msg("seed %d: response %g was found for %g, exposed %d", (int)seed, survey->response,
                     responses[seed % 3], survey->exposed);
        hada_survey_destroy(&survey);
        free_pairs(&set);
    }
}

/* Scenes that say nothing of their frames stay linear, and their exposures alike. */
TEST(noise_is_no_evidence)
{
    for (uint64_t seed = 1; seed <= 6; seed++) {
        pairs set, other;
        make_pairs(&set, HADA_RESPONSE_LINEAR, 0, 0.003, seed);
        make_pairs(&other, HADA_RESPONSE_LINEAR, 0, 0.003, seed + 50);
        for (int z = 0; z < DEPTHS; z++)
            for (int i = 0; i < PAIRS; i++)
                for (size_t k = 0; k < hada_image_count(&set.frame[z][i]); k++)
                    set.frame[z][i].data[k] = other.frame[z][(i + 2) % PAIRS].data[k];
        for (int few = 0; few < 2; few++) {
            hada_survey *survey = ask_some(&set, few ? two_each : counts, HADA_EXPOSURE_AUTO);
            assert_true(survey->response == HADA_RESPONSE_LINEAR);
            hada_survey_destroy(&survey);
        }
        free_pairs(&set);
        free_pairs(&other);
    }
}

static double dark_of(pairs *set, const int *some, int find)
{
    hada_fit_options options = sizes();
    SCOPED(hada_dataset) *data = data_of(set, some);
    options.find_dark = find;
    ASSERT_OK(hada_fit_find_dark(&options, data, NULL, NULL, err));
    assert_int_equal(options.find_dark, options.dark > 0.0);
    return options.dark;
}

static void darken(hada_image *image)
{
    for (size_t at = 0; at < hada_image_count(image); at++)
        image->data[at] *= 0.03f;
}

/* Frames without a level have none. A scene that is nearly black gains most by a level; that makes others no less sure.
 */
TEST(dark_level_is_found)
{
    for (int k = 0; k < 10; k++) {
        const float level = k >= 8 ? 0.01f : 0.06f;
        const int *some = k >= 8 ? one_depth : k & 4 ? two_each : counts;
        pairs set;
        make_pairs(&set, k & 1 ? HADA_RESPONSE_SRGB : HADA_RESPONSE_LINEAR, k & 2, 0.003, 1 + (uint64_t)k);
        if (k >= 8) {
            darken(&set.frame[0][1]);
            darken(&set.scene[0][1]);
        }
        assert_true(dark_of(&set, some, 1) == 0.0);
        for (int i = 0; i < DEPTHS * PAIRS; i++) {
            hada_image *frame = &set.frame[i / PAIRS][i % PAIRS];
            for (size_t at = 0; at < hada_image_count(frame); at++)
                frame->data[at] += level;
        }
        assert_true(dark_of(&set, some, 0) == 0.0);
        print_message("%d: %g\n", k, dark_of(&set, some, 1));
        assert_float_equal(dark_of(&set, some, 1), level, 0.002);
        free_pairs(&set);
    }
}

/* A point spread function nearly as wide as the sensor, with some detail. */
static hada_image wide_psf(uint64_t seed)
{
    hada_image psf;
    hada_random random;
    double total = 0.0;
    const int area = ROWS * COLS;
    ASSERT_OK(hada_image_create(&psf, CHANNELS, ROWS, COLS, err));
    hada_random_seed(&random, seed, 11);
    for (int i = 0; i < CHANNELS * area; i++)
        psf.data[i] = (float)hada_random_uniform(&random);
    small_soften(&psf);
    for (int i = 0; i < CHANNELS * area; i++) {
        const double y = (i % area / COLS - ROWS / 2) / (0.4 * ROWS), x = (i % COLS - COLS / 2) / (0.4 * COLS);
        psf.data[i] *= (float)exp(-0.5 * (y * y + x * x));
        total += i < area ? psf.data[i] : 0.0;
    }
    for (int i = 0; i < CHANNELS * area; i++)
        psf.data[i] /= (float)total;
    return psf;
}

/* Frames of a wide point spread function look alike, whatever the scene, and much of its light is lost: a dark level
 * and a surface are told from that, from none, and from light of each frame's own. */
TEST(dark_level_of_wide_functions_is_found)
{
    for (int k = 0; k < 6; k++) {
        const float level = k % 3 ? 0.03f : 0.0f, slope = k % 3 == 2 ? 0.03f : 0.0f;
        hada_fit_options options = sizes();
        hada_own_light own;
        pairs set;
        SCOPED(hada_image) found = {0};
        make_pairs(&set, k < 3 ? HADA_RESPONSE_LINEAR : HADA_RESPONSE_SRGB, 0, 0.0, 91);
        for (int i = 0; i < DEPTHS * PAIRS; i++) {
            const int z = i / PAIRS, pair = i % PAIRS;
            SCOPED(hada_image) psf = wide_psf(5 + (uint64_t)z);
            SCOPED(hada_image) light = {0};
            hada_image *frame = &set.frame[z][pair];
            ASSERT_OK(hada_image_copy(&light, &set.scene[z][pair], err));
            hada_response_convert(light.data, hada_image_count(&light),
                                  k < 3 ? HADA_RESPONSE_LINEAR : HADA_RESPONSE_SRGB, HADA_RESPONSE_LINEAR);
            hada_image_destroy(frame);
            *frame = small_frame(&psf, &light, 1, 0.001, 7 + (uint64_t)i);
            for (size_t at = 0; at < hada_image_count(frame); at++)
                frame->data[at] += level + slope * (float)(at % COLS) / COLS;
        }
        SCOPED(hada_dataset) *data = data_of(&set, counts);
        options.boundary = HADA_BOUNDARY_PADDED;
        options.find_dark = 1;
        ASSERT_OK(hada_fit_find_dark(&options, data, &found, &own, err));
        assert_int_equal(own, HADA_OWN_LIGHT_NONE);
        assert_int_equal(found.data != NULL, slope > 0.0f);
        if (slope == 0.0f)
            assert_float_equal(options.dark, level, 0.001);
        for (size_t at = 0; at < hada_image_count(&found); at++)
            assert_float_equal(found.data[at], level + slope * (float)(at % COLS) / COLS, 0.002);
        free_pairs(&set);
    }
}

/* Light of a room: a surface of each channel. Frames without have none, nor frames with a level alone. */
TEST(light_of_the_room_is_found)
{
    static const int cases[] = {0, 1, 6};
    for (size_t which = 0; which < HADA_COUNT(cases); which++) {
        const int k = cases[which];
        const int *some = k & 4 ? two_each : counts, is_level = k & 1;
        hada_fit_options options = sizes();
        pairs set;
        SCOPED(hada_image) found = {0};
        make_pairs(&set, k & 2 ? HADA_RESPONSE_SRGB : HADA_RESPONSE_LINEAR, 0, 0.003, 31 + (uint64_t)k);
        SCOPED(hada_dataset) *data = data_of(&set, some);
        ASSERT_OK(hada_fit_find_dark(&options, data, &found, NULL, err));
        assert_true(!found.data && options.dark == 0.0 && !options.find_dark);
        SCOPED(hada_image) room = {0};
        ASSERT_OK(hada_image_create(&room, CHANNELS, ROWS, COLS, err));
        for (int i = 0; i < CHANNELS * ROWS * COLS; i++) {
            const double y = i / COLS % ROWS / (double)ROWS, x = i % COLS / (double)COLS;
            room.data[i] =
                is_level ? 0.06f : (float)((0.03 + 0.02 * (i / (ROWS * COLS))) * (1.0 + y + 0.5 * x * x + 0.3 * x * y));
        }
        for (int i = 0; i < DEPTHS * PAIRS; i++)
            for (size_t at = 0; at < hada_image_count(&room); at++)
                set.frame[i / PAIRS][i % PAIRS].data[at] += room.data[at];
        SCOPED(hada_dataset) *lit = data_of(&set, some);
        options.find_dark = 1;
        ASSERT_OK(hada_fit_find_dark(&options, lit, &found, NULL, err));
        assert_int_equal(options.find_dark, 1);
        assert_true(is_level ? fabs(options.dark - 0.06) < 0.002 : found.data != NULL);
        if (!is_level && relative_change(found.data, room.data, hada_image_count(&room)) > 0.05)
            fail_msg("case %d: the surface is wrong by %g", k,
                     relative_change(found.data, room.data, hada_image_count(&room)));
        SCOPED(hada_dataset) *dark = NULL;
        ASSERT_OK(hada_dataset_mend(&dark, lit, NULL, &room, err));
        options.find_dark = 1; /* pairs with a dark frame are not looked at */
        options.dark = 0.0;
        ASSERT_OK(hada_fit_find_dark(&options, dark, NULL, NULL, err));
        assert_true(options.dark == 0.0 && !options.find_dark);
        free_pairs(&set);
    }
}

/* What a sensor with a colour filter mosaic keeps of a frame. */
static void keep_mosaic(hada_image *frame)
{
    hada_mosaic_take(HADA_MOSAIC_GRBG, frame->data, ROWS, COLS, frame->data);
    frame->channels = 1;
}

/* Light of each frame's own is found, in mosaics as well and with exposures that differ, and told from one light for
 * all frames and from none. */
TEST(light_of_each_frame_is_found)
{
    hada_context *context;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    for (int k = 0; k < 5; k++) {
        hada_fit_options options = helpers_fit(DEPTHS, CHANNELS, distances, ROWS, COLS, WINDOW);
        hada_own_light own;
        SCOPED(hada_image) all = {0};
        enum { EACH = CHANNELS * HADA_SMOOTH_TERMS };
        double room[DEPTHS * PAIRS * EACH], *light = NULL;
        DEFAULTS(hada_dataset_options, how);
        hada_random random;
        pairs set;
        make_pairs(&set, HADA_RESPONSE_LINEAR, k == 4, 0.003, 71 + (uint64_t)k);
        hada_random_seed(&random, 5, 0);
        for (int i = 0; i < DEPTHS * PAIRS * EACH; i++)
            room[i] = k >= 2 ? (i % HADA_SMOOTH_TERMS ? 0.02 : 0.08) * hada_random_uniform(&random) : k ? 0.02 : 0.0;
        for (int i = 0; k == 3 && i < 3 * DEPTHS * PAIRS; i++)
            small_soften(&set.frame[i / 3 / PAIRS][i / 3 % PAIRS]);
        for (int i = 0; i < DEPTHS * PAIRS; i++)
            hada_smooth_add(room + (size_t)i * EACH, 1.0, &set.frame[i / PAIRS][i % PAIRS]);
        how.mosaic = k == 3 ? HADA_MOSAIC_GRBG : HADA_MOSAIC_NONE;
        for (int i = 0; k == 3 && i < DEPTHS * PAIRS; i++)
            keep_mosaic(&set.frame[i / PAIRS][i % PAIRS]);
        SCOPED(hada_dataset) * data;
        ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, counts, read_pair, &set, &how, err));
        options.find_dark = 1;
        ASSERT_OK(hada_fit_find_dark(&options, data, &all, &own, err));
        const int better = own != HADA_OWN_LIGHT_NONE;
        if (better)
            ASSERT_OK(hada_fit_find_own_light(&options, data, own == HADA_OWN_LIGHT_APART, &light, err));
        assert_int_equal(better, k >= 2);
        for (int i = 0; i < DEPTHS * PAIRS && better; i++) {
            const size_t at = (size_t)hada_pair_number(data, i / PAIRS, i % PAIRS) * EACH;
            for (int c = 0; c < CHANNELS; c++) {
                const size_t first = (size_t)c * HADA_SMOOTH_TERMS;
                const double is = hada_smooth_mean(light + at + first),
                             was = hada_smooth_mean(room + (size_t)i * EACH + first);
                if (fabs(is - was) > 0.01)
                    fail_msg("pair %d, channel %d: %g for %g", i, c, is, was);
            }
        }
        free(light);
        free_pairs(&set);
    }
    close_context(&context);
}

/* Hot, dead and stuck pixels are found, two beside each other as well, at borders, of mosaics; and none of sound
 * sensors, nor of those of which too many seem bad. */
TEST(bad_pixels_are_found)
{
    enum { BAD = 9 };
    static const struct {
        int row, col;
        float value;
    } bad[BAD] = {{0, 0, 1.0f},   {20, 31, 0.9f}, {20, 32, 1.0f},      {47, 40, 0.8f}, {11, 63, 1.0f},
                  {30, 10, 0.0f}, {33, 12, 0.7f}, {ROWS - 1, 0, 1.0f}, {9, 50, 1.0f}};
    static const int cases[] = {0, 1, 5};
    for (size_t which = 0; which < HADA_COUNT(cases); which++) {
        const int k = cases[which];
        const int mosaic = k & 1, *some = k & 4 ? two_each : counts;
        DEFAULTS(hada_dataset_options, how);
        hada_fit_options options = sizes();
        hada_dataset *data;
        pairs set;
        size_t found = 0, marked = 0;
        SCOPED(hada_image) none = {0};
        SCOPED(hada_image) flat = {0};
        how.mosaic = mosaic ? HADA_MOSAIC_GRBG : HADA_MOSAIC_NONE;
        make_pairs(&set, HADA_RESPONSE_LINEAR, 0, 0.002, 71 + (uint64_t)k);
        for (int i = 0; i < DEPTHS * PAIRS; i++) {
            hada_image *frame = &set.frame[i / PAIRS][i % PAIRS];
            for (size_t at = 0; at < hada_image_count(frame); at++)
                frame->data[at] = 0.1f + 0.4f * frame->data[at]; /* dead pixels show */
            if (mosaic)
                keep_mosaic(frame);
        }
        ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, some, read_pair, &set, &how, err));
        ASSERT_OK(hada_fit_find_bad_pixels(&options, data, &none, &found, err));
        assert_true(!found && !none.data);
        hada_dataset_destroy(&data);
        for (int i = 0; i < DEPTHS * PAIRS; i++)
            for (int n = 0; n < BAD; n++) /* of colour frames in one channel */
                set.frame[i / PAIRS][i % PAIRS].data[bad[n].row * COLS + bad[n].col] = bad[n].value;
        ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, some, read_pair, &set, &how, err));
        ASSERT_OK(hada_fit_find_bad_pixels(&options, data, &flat, &found, err));
        for (size_t i = 0; i < hada_image_count(&flat); i++)
            marked += flat.data[i] == 0.0f;
        for (int n = 0; n < BAD; n++) {
            const int channel = mosaic ? hada_mosaic_channel(HADA_MOSAIC_GRBG, bad[n].row, bad[n].col) : 0;
            if (!flat.data || flat.data[(channel * ROWS + bad[n].row) * COLS + bad[n].col] != 0.0f)
                fail_msg("case %d: bad pixel %d was not found", k, n);
        }
        if (found != BAD || marked != BAD)
            fail_msg("case %d: %zu values were found for %d, and %zu are marked", k, found, BAD, marked);
        hada_dataset_destroy(&data);
        for (int i = 0; i < DEPTHS * PAIRS; i++)
            for (int n = 0; n < ROWS * COLS; n += 61) /* every 61st pixel */
                set.frame[i / PAIRS][i % PAIRS].data[n] = 1.0f;
        ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, some, read_pair, &set, &how, err));
        ASSERT_OK(hada_fit_find_bad_pixels(&options, data, &none, &found, err));
        assert_true(!found && !none.data);
        hada_dataset_destroy(&data);
        free_pairs(&set);
    }
}

/* Frames that were encoded for displays are recognised, others are not, whatever dark level both have, and whether
 * exposures differ. */
TEST(encoded_frames_are_recognised)
{
    hada_context *context;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    for (int k = 0; k < 8; k++) {
        const hada_fit_options options = helpers_fit(DEPTHS, CHANNELS, distances, ROWS, COLS, WINDOW);
        pairs set;
        int seem;
        make_pairs(&set, k & 1 ? HADA_RESPONSE_SRGB : HADA_RESPONSE_LINEAR, k & 4, 0.003, 51 + (uint64_t)k);
        for (int i = 0; i < DEPTHS * PAIRS; i++) {
            hada_image *frame = &set.frame[i / PAIRS][i % PAIRS];
            for (size_t at = 0; at < hada_image_count(frame); at++)
                frame->data[at] += k & 1 ? 0.1f : 0.0f;
            if (k & 2)
                hada_response_convert(frame->data, hada_image_count(frame), HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB);
        }
        SCOPED(hada_dataset) *data = data_of(&set, counts);
        ASSERT_OK(hada_fit_seem_encoded(&options, context, data, HADA_RESPONSE_SRGB, &seem, err));
        assert_int_equal(seem, k >> 1 & 1);
        free_pairs(&set);
    }
    close_context(&context);
}

/* A scene made as bright as its frame was exposed, in its own encoding. */
TEST(scenes_are_evened)
{
    pairs set;
    make_pairs(&set, 2.0, 1, 0.0, 5);
    hada_survey *survey = ask(&set, HADA_EXPOSURE_EACH);
    assert_true(survey->response == 2.0);
    const double gain = gain_of(survey, 1, 2);
    hada_dataset *data = data_of(&set, counts), *even, *part, *rest;
    hada_image raw, scene;
    ASSERT_OK(hada_survey_apply(&even, survey, data, err));
    ASSERT_OK(hada_dataset_split(even, 3, &part, &rest, err)); /* a part keeps the exposures of its pairs */
    hada_dataset_destroy(&data);
    for (int k = 0; k < 2; k++) {
        ASSERT_OK(hada_dataset_read(k ? rest : even, 1, k ? 0 : 2, &raw, &scene, err));
        assert_true(fabs((double)scene.data[7] - (double)set.scene[1][2].data[7] * sqrt(gain)) < 1e-6);
        hada_image_destroy(&raw);
        hada_image_destroy(&scene);
    }
    hada_dataset_destroy(&even);
    hada_dataset_destroy(&part);
    hada_dataset_destroy(&rest);
    hada_survey_destroy(&survey);
    free_pairs(&set);
}

/* What is given is not chosen; too few pairs say nothing; pairs that do not fit are left to the fit; errors pass on. */
TEST(given_and_missing)
{
    static const int few[DEPTHS] = {1, 1, 1, 1};
    pairs set;
    hada_survey *survey;
    hada_fit_options options = sizes();
    hada_error error;
    make_pairs(&set, 2.0, 1, 0.003, 7);
    options.scene_response = 1.5;
    hada_dataset *all = data_of(&set, counts), *some = data_of(&set, few);
    ASSERT_OK(hada_survey_create(&survey, &options, all, HADA_EXPOSURE_SAME, err));
    assert_true(survey->response == 1.5 && !survey->exposed);
    hada_survey_destroy(&survey);
    options.scene_response = HADA_AUTO;
    ASSERT_OK(hada_survey_create(&survey, &options, some, HADA_EXPOSURE_AUTO, err));
    assert_true(survey->response == HADA_RESPONSE_LINEAR && !survey->exposed);
    assert_null(survey->rows[0]);
    assert_true(gain_of(survey, 0, 0) == 1.0);
    hada_survey_destroy(&survey);
    set.frame[0][1].data[3] = NAN;
    survey = ask(&set, HADA_EXPOSURE_AUTO);
    assert_true(survey->response == 2.0);
    assert_true(gain_of(survey, 0, 1) == 1.0);
    hada_survey_destroy(&survey);
    for (set.refuse = 1; set.refuse < 40; set.refuse += 7) {
        set.shown = 0;
        hada_dataset *data = data_of(&set, counts); /* nothing is in its cache yet */
        const hada_status status = hada_survey_create(&survey, &options, data, HADA_EXPOSURE_EACH, &error);
        hada_dataset_destroy(&data);
        assert_int_equal(status, set.shown >= set.refuse ? HADA_ERROR_FILE_READ : HADA_OK);
        hada_survey_destroy(&survey);
    }
    options.scene_response = 7.0;
    assert_int_equal(hada_survey_create(&survey, &options, all, HADA_EXPOSURE_AUTO, &error), HADA_ERROR_ARGUMENT);
    hada_dataset_destroy(&all);
    hada_dataset_destroy(&some);
    free_pairs(&set);
}

/* Leaves pairs out; *sound: the others, NULL: none is left out. */
static unsigned char **screen(pairs *set, hada_dataset **all, hada_dataset **sound)
{
    const hada_fit_options options = sizes();
    unsigned char **left_out;
    *all = data_of(set, counts);
    ASSERT_OK(hada_fit_screen(sound, &left_out, *all, &options, err));
    assert_true((*sound == NULL) == (left_out == NULL));
    return left_out;
}

TEST(sound_pairs_stay)
{
    static const double responses[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, 1.6};
    for (uint64_t seed = 1; seed <= 12; seed++) {
        pairs set;
        hada_dataset *all, *sound;
        make_pairs(&set, responses[seed % 3], seed % 2, seed % 4 ? 0.01 : 0.1, 200 + seed);
        unsigned char **left_out = screen(&set, &all, &sound);
        if (left_out)
            fail_msg("of sound pairs of seed %d one was left out", (int)seed);
        hada_dataset_destroy(&all);
        free_pairs(&set);
    }
}

static void same_images(const hada_dataset *data, int depth, int pair, const pairs *set, int of)
{
    SCOPED(hada_image) raw;
    SCOPED(hada_image) scene;
    SCOPED(hada_image) held;
    ASSERT_OK(hada_image_crop(&held, &set->frame[depth][of], 0, 0, ROWS, COLS, err));
    ASSERT_OK(hada_dataset_read(data, depth, pair, &raw, &scene, err));
    assert_memory_equal(raw.data, held.data, hada_image_count(&held) * sizeof(float));
}

/* A frame that is cut off at depth 1, a scene that is another one at depth 3. */
TEST(spoilt_pairs_are_left_out)
{
    static const int kept[] = {0, 1, 3, 4};
    pairs set, other;
    hada_dataset *all, *sound, *part, *bright;
    make_pairs(&set, HADA_RESPONSE_LINEAR, 0, 0.003, 31);
    make_pairs(&other, HADA_RESPONSE_LINEAR, 0, 0.003, 32);
    hada_image *frame = &set.frame[1][2];
    float most = 0.0f;
    for (size_t k = 0; k < hada_image_count(frame); k++)
        most = fmaxf(most, frame->data[k]);
    for (size_t k = 0; k < hada_image_count(frame); k++)
        frame->data[k] = fminf(3.0f * frame->data[k], 0.6f * most);
    for (size_t k = 0; k < hada_image_count(&set.scene[3][2]); k++)
        set.scene[3][2].data[k] = other.scene[0][0].data[k];
    unsigned char **left_out = screen(&set, &all, &sound);
    assert_non_null(left_out);
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++)
            assert_int_equal(left_out[z][i], (z == 1 || z == 3) && i == 2);
    const hada_dataset_info *info = hada_dataset_get_info(sound);
    assert_int_equal(info->pairs, DEPTHS * PAIRS - 2);
    assert_int_equal(info->least_pairs, PAIRS - 1);
    for (int i = 0; i < PAIRS - 1; i++) {
        same_images(sound, 1, i, &set, kept[i]);
        assert_string_equal(info->files[1][i].raw, hada_dataset_get_info(all)->files[1][kept[i]].raw);
    }
    same_images(sound, 2, 4, &set, 4);
    /* parts of what is left, and brighter ones, are those pairs still */
    ASSERT_OK(hada_dataset_split(sound, 2, &part, &bright, err));
    assert_int_equal(hada_dataset_get_info(part)->counts[1], PAIRS - 3);
    same_images(bright, 1, 0, &set, kept[2]);
    same_images(bright, 2, 1, &set, 4);
    hada_dataset_destroy(&bright);
    hada_dataset_destroy(&part);
    hada_fit_left_out_free(&left_out, DEPTHS);
    assert_null(left_out);
    hada_dataset_destroy(&sound);
    hada_dataset_destroy(&all);
    free_pairs(&set);
    free_pairs(&other);
}
