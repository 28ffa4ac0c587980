/* Registration of the pairs of one depth; registered scenes. */

#include "core/callers.h"
#include "register/register_inside.h"

/* The best orientation must explain this many times as much (in log residual) as the second best, and this much. */
#define CLEARLY 1.5
#define LEAST   0.01
/* Perspective is taken where it explains this many times as much (in log residual). Without any, up to 1.02,
 * and more where scenes are small, which it does not move by a pixel then. */
#define SLANTWISE 1.03

static hada_status check_options(hada_register_options *options, const hada_image *raws, const hada_image *scenes,
                                 hada_error *err)
{
    const double frame = raws->rows > raws->cols ? raws->rows : raws->cols;
    const double scene = scenes->rows > scenes->cols ? scenes->rows : scenes->cols;
    if (options->least_magnification == HADA_AUTO)
        options->least_magnification = 0.15 * frame / scene;
    if (options->most_magnification == HADA_AUTO)
        options->most_magnification = 2.5 * frame / scene;
    if (!(options->least_magnification > 0.0) || !(options->most_magnification >= options->least_magnification) ||
        !(options->most_magnification <= 1000.0 * options->least_magnification))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "magnifications from %g to %g cannot be searched",
                         options->least_magnification, options->most_magnification);
    if (!(options->most_rotation_deg >= 0.0 && options->most_rotation_deg <= 45.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.rotation takes 0 to 45 degrees, to either side of every quarter turn, not %g",
                         options->most_rotation_deg);
    return HADA_OK;
}

static void keep_best(hada_registration *best, double *scores, int count)
{
    for (int i = 1; i < count; i++)
        for (int k = i; k && scores[k] < scores[k - 1]; k--) {
            const hada_registration one = best[k];
            const double score = scores[k];
            best[k] = best[k - 1];
            scores[k] = scores[k - 1];
            best[k - 1] = one;
            scores[k - 1] = score;
        }
}

/* Whether there is a grid of this size for the frames. */
static int is_fine(const hada_register_set *set, int size)
{
    return size <= HADA_REGISTER_FINEST && size <= 1.2 * set->frame_side;
}

/* All orientations on the coarse grid; the best three refined there. */
static hada_status search(const hada_register_set *set, const hada_register_options *options, hada_registration *out,
                          double *score, hada_error *err)
{
    enum { REFINED = 3 };
    hada_register_level level = {0};
    hada_registration best[8];
    double scores[8];
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_register_level_create(&level, set, HADA_REGISTER_COARSE, err));
    HADA_TRY_OR_DONE(hada_register_scan(&level, options, best, scores, err));
    keep_best(best, scores, 8);
    for (int o = 0; o < REFINED; o++)
        HADA_TRY_OR_DONE(hada_register_refine(&level, options, 0, 0.5 * HADA_REGISTER_STEP, &best[o], &scores[o], err));
    keep_best(best, scores, REFINED);
    *out = best[0];
    *score = scores[0];
    out->size = sizeof *out;
    out->explained = 1.0 - exp(scores[0]);
    out->explained_otherwise = 1.0 - exp(scores[1]);
    if (-scores[0] < LEAST || -scores[0] < CLEARLY * -scores[1])
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_DATASET,
                      "the pairs do not show where the scenes lie: the best transform explains %.1f %% of the "
                      "frames' structure, another orientation %.1f %%. More pairs help, and scenes with more "
                      "detail and without symmetry; scenes may also belong to other frames, or lie outside the "
                      "range searched (magnification %.3g to %.3g)",
                      100.0 * out->explained, 100.0 * out->explained_otherwise, options->least_magnification,
                      options->most_magnification));
done:
    hada_register_level_destroy(&level);
    return status;
}

double hada_register_perspective(const hada_registration *at, int rows, int cols)
{
    const double far = 0.5 * at->magnification * hypot(rows, cols);
    return far * far * hypot(at->perspective_row, at->perspective_col);
}

hada_status hada_register_pairs(hada_registration *out, const hada_image *raws, const hada_image *scenes, int count,
                                const hada_register_options *given, hada_error *err)
{
    hada_register_options options = *given;
    hada_register_set set = {0};
    hada_register_level level = {0};
    hada_status status = HADA_OK;
    hada_registration slantwise;
    double score, slant_score = 0.0;
    hada_registration_init(out);
    HADA_TRY_OR_DONE(hada_register_set_create(&set, raws, scenes, count, err));
    HADA_TRY_OR_DONE(check_options(&options, raws, scenes, err));
    HADA_TRY_OR_DONE(search(&set, &options, out, &score, err));
    slantwise = *out;
    for (int size = HADA_REGISTER_COARSE; size == HADA_REGISTER_COARSE || is_fine(&set, size); size *= 2) {
        const double step = HADA_REGISTER_STEP * HADA_REGISTER_COARSE / size;
        HADA_TRY_OR_DONE(hada_register_level_create(&level, &set, size, err));
        if (size > HADA_REGISTER_COARSE)
            HADA_TRY_OR_DONE(hada_register_refine(&level, &options, 0, 0.25 * step, out, &score, err));
        HADA_TRY_OR_DONE(hada_register_refine(&level, &options, 1, step, &slantwise, &slant_score, err));
        if (size == HADA_REGISTER_COARSE) /* the grid on which orientations are compared */
            slantwise.explained = 1.0 - exp(slant_score);
        hada_register_level_destroy(&level);
    }
    if (slant_score < SLANTWISE * score && hada_register_perspective(&slantwise, scenes->rows, scenes->cols) >= 1.0)
        *out = slantwise;
done:
    hada_register_level_destroy(&level);
    hada_register_set_destroy(&set);
    return status;
}

void hada_register_size(const hada_registration *registration, int scene_rows, int scene_cols, int *rows, int *cols)
{
    if (!registration || !rows || !cols)
        return;
    const int turned = registration->quarter_turns & 1;
    const double height = registration->magnification * (turned ? scene_cols : scene_rows);
    const double width = registration->magnification * (turned ? scene_rows : scene_cols);
    *rows = height < 1.0 ? 1 : (int)floor(height + 0.5);
    *cols = width < 1.0 ? 1 : (int)floor(width + 0.5);
}

hada_status hada_register_apply(hada_image *out, const hada_image *scene, const hada_registration *callers, int rows,
                                int cols, hada_error *err)
{
    hada_registration own, *registration = &own;
    hada_register_plane plane = {0};
    hada_register_view view = {0};
    hada_status status = HADA_OK;
    hada_registration_init(registration);
    HADA_TRY(HADA_OPTIONS_TAKE(registration, callers, hada_registration, err));
    if (!out || !scene || !scene->data || !callers || !(registration->magnification > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_register_apply: an argument is missing or not possible");
    if (!rows && !cols)
        hada_register_size(registration, scene->rows, scene->cols, &rows, &cols);
    HADA_TRY_OR_DONE(hada_image_create(out, scene->channels, rows, cols, err));
    const hada_register_map map = hada_register_map_of(registration);
    for (int c = 0; c < scene->channels; c++) {
        HADA_TRY_OR_DONE(hada_register_plane_create(&plane,
                                                    scene->data + (size_t)c * (size_t)scene->rows * (size_t)scene->cols,
                                                    scene->rows, scene->cols, err));
        HADA_TRY_OR_DONE(hada_register_view_create(&view, &plane, 1.0 / registration->magnification, err));
        hada_register_sample(&view, &map, 1.0, rows, cols, out->data + (size_t)c * (size_t)rows * (size_t)cols, cols,
                             1);
        hada_register_view_destroy(&view);
        hada_register_plane_destroy(&plane);
    }
done:
    hada_register_view_destroy(&view);
    hada_register_plane_destroy(&plane);
    if (status)
        hada_image_destroy(out);
    return status;
}
