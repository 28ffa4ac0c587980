/* Registration: transforms of scenes, and finding them from pairs with an unknown PSF. Frames are made here, by adding
 * up shifted scenes. */
#include "testing.h"

#include "image/small_fft.h"
#include "patience.h"
#include "ref/ref_fft.h"
#include "register/register_inside.h"

enum { ROWS = 112, COLS = 144, WINDOW_ROWS = 56, WINDOW_COLS = 64, SPOTS = 12, PAIRS = 5 };

static const hada_register_options search_all = {
    .least_magnification = HADA_AUTO, .most_magnification = HADA_AUTO, .most_rotation_deg = 15.0};

static float *pixel(const hada_image *image, int row, int col)
{
    return &image->data[(size_t)row * (size_t)image->cols + (size_t)col];
}

TEST(transforms)
{
    enum { SIZE = 32 };
    SCOPED(hada_small_fft) fft;
    hada_random random;
    static float data[2 * SIZE * SIZE];
    static double image[SIZE * SIZE], spectrum[SIZE * (SIZE / 2 + 1) * 2];
    hada_random_seed(&random, 3, 0);
    for (int i = 0; i < SIZE * SIZE; i++) {
        data[2 * i] = (float)hada_random_range(&random, -1, 1);
        image[i] = data[2 * i];
    }
    ASSERT_OK(hada_small_fft_create(&fft, SIZE, err));
    ASSERT_OK(hada_ref_fft_forward(image, SIZE, SIZE, spectrum, err));
    hada_small_fft_run(&fft, data);
    for (int ky = 0; ky < SIZE; ky++)
        for (int kx = 0; kx <= SIZE / 2; kx++)
            for (int part = 0; part < 2; part++) {
                const double want = spectrum[2 * (ky * (SIZE / 2 + 1) + kx) + part];
                assert_true(fabs(data[2 * (kx * SIZE + ky) + part] - want) < 1e-4);
            }
}

/* What the header promises of directions, by one bright pixel; flips and quarter turns move pixels exactly. */
TEST(directions)
{
    static const struct {
        hada_registration by;
        int row, col; /* of 7 x 9 about the middle, where the pixel one above and three right of the middle comes to */
    } cases[] = {
        {{.size = sizeof(hada_registration), .magnification = 1}, -1, 3},
        {{.size = sizeof(hada_registration), .magnification = 1, .mirrored = 1}, -1, -3},
        {{.size = sizeof(hada_registration), .magnification = 1, .quarter_turns = 1}, -3, -1},
        {{.size = sizeof(hada_registration), .magnification = 1, .quarter_turns = 2}, 1, -3},
        {{.size = sizeof(hada_registration), .magnification = 1, .quarter_turns = 3}, 3, 1},
        {{.size = sizeof(hada_registration), .magnification = 1, .mirrored = 1, .quarter_turns = 2}, 1, 3},
        {{.size = sizeof(hada_registration), .magnification = 1, .mirrored = 1, .quarter_turns = 1}, 3, -1},
        {{.size = sizeof(hada_registration), .magnification = 2, .offset_row = 1, .offset_col = -2}, -1, 4},
        {{.size = sizeof(hada_registration), .magnification = 1, .rotation_deg = 90}, -3, -1},
        {{.size = sizeof(hada_registration), .magnification = 2, .perspective_col = 1.0 / 6.0}, -1, 3},
        {{.size = sizeof(hada_registration), .magnification = 2, .quarter_turns = 1, .perspective_row = -1.0 / 6.0},
         -3,
         -1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        SCOPED(hada_image) scene, out;
        ASSERT_OK(hada_image_create(&scene, 2, 7, 9, err));
        *pixel(&scene, 3 - 1, 4 + 3) = 1.0f;
        scene.data[63 + 5] = 0.25f;
        ASSERT_OK(hada_register_apply(&out, &scene, &cases[i].by, 21, 21, err));
        assert_true(fabs(*pixel(&out, 10 + cases[i].row, 10 + cases[i].col) - 1.0) < 1e-6);
        double sum = 0.0;
        for (int k = 0; k < 21 * 21; k++)
            sum += out.data[k];
        if (cases[i].by.magnification == 1.0 && !cases[i].by.rotation_deg) {
            assert_true(sum == 1.0);
            int rows, cols;
            hada_register_size(&cases[i].by, 7, 9, &rows, &cols);
            assert_int_equal(rows, cases[i].by.quarter_turns % 2 ? 9 : 7);
            assert_int_equal(cols, cases[i].by.quarter_turns % 2 ? 7 : 9);
        }
    }
}

/* Shrinking keeps brightness and does not alias: a fine chequerboard becomes grey. */
TEST(shrinking)
{
    hada_image scene, out;
    hada_registration by = {.size = sizeof(hada_registration), .magnification = 0.37, .rotation_deg = 5};
    ASSERT_OK(hada_image_create(&scene, 1, 101, 99, err));
    for (int i = 0; i < 101 * 99; i++)
        scene.data[i] = (float)(i % 2);
    ASSERT_OK(hada_register_apply(&out, &scene, &by, 21, 21, err));
    for (int i = 0; i < 21 * 21; i++)
        assert_true(fabs(out.data[i] - 0.5) < 0.01);
    hada_image_destroy(&scene);
    hada_image_destroy(&out);
    by.magnification = 0.0;
    ASSERT_FAILS(hada_register_apply(&out, &scene, &by, 21, 21, err), HADA_ERROR_ARGUMENT, "");
}

/* Pairs: scene files, and frames of them placed by the true registration, through a mask of a few holes. */
typedef struct pairs {
    hada_image raws[HADA_REGISTER_PAIRS], scenes[HADA_REGISTER_PAIRS];
    int count;
} pairs;

typedef struct hole {
    double row, col, light;
} hole;

/* raw(p) = sum over holes of scene(p - hole * scale); the scene by linear interpolation. Light that leaves is lost. */
static void expose(hada_image *raw, const hada_image *scene, const hole *holes, double scale)
{
    const int top = (ROWS - scene->rows) / 2, left = (COLS - scene->cols) / 2;
    for (int h = 0; h < SPOTS; h++) {
        const double dy = top + holes[h].row * scale, dx = left + holes[h].col * scale;
        const int y0 = (int)floor(dy), x0 = (int)floor(dx);
        for (int part = 0; part < 4; part++) {
            const int down = part / 2, right = part % 2;
            const double share = (down ? dy - y0 : 1 - dy + y0) * (right ? dx - x0 : 1 - dx + x0) * holes[h].light;
            for (int r = 0; r < scene->rows; r++)
                for (int c = 0; c < scene->cols; c++) {
                    const int row = r + y0 + down, col = c + x0 + right;
                    if (row >= 0 && row < ROWS && col >= 0 && col < COLS)
                        *pixel(raw, row, col) += (float)(share * *pixel(scene, r, c));
                }
        }
    }
}

static const hole *mask_holes(void)
{
    static hole holes[SPOTS];
    hada_random random;
    hada_random_seed(&random, 11, 0);
    for (int h = 0; h < SPOTS; h++)
        holes[h] = (hole){hada_random_range(&random, -25, 25), hada_random_range(&random, -32, 32),
                          hada_random_range(&random, 0.05, 0.15)};
    return holes;
}

static pairs make_pairs(const hada_registration *truth, int count, double scale, double noise, uint64_t seed)
{
    pairs all = {.count = count};
    hada_random random;
    hada_random_seed(&random, seed, 1);
    const double m = truth->magnification;
    const int turned = truth->quarter_turns % 2;
    for (int i = 0; i < count; i++) {
        SCOPED(hada_image) stands;
        ASSERT_OK(hada_scene_procedural(&all.scenes[i], seed + (uint64_t)i, 1,
                                        (int)((turned ? WINDOW_COLS : WINDOW_ROWS) / m),
                                        (int)((turned ? WINDOW_ROWS : WINDOW_COLS) / m), err));
        ASSERT_OK(hada_register_apply(&stands, &all.scenes[i], truth, WINDOW_ROWS + 10, WINDOW_COLS + 10, err));
        ASSERT_OK(hada_image_create(&all.raws[i], 1, ROWS, COLS, err));
        expose(&all.raws[i], &stands, mask_holes(), scale);
        for (int k = 0; k < ROWS * COLS; k++) /* noise, and stray light that is the same in all frames */
            all.raws[i].data[k] += (float)(noise * hada_random_normal(&random) + 0.2 * sin(k / 2000.0));
    }
    return all;
}

static void free_pairs(pairs *all)
{
    destroy_images(all->raws, all->count);
    destroy_images(all->scenes, all->count);
}

static void expect(const hada_registration *found, const hada_registration *truth, double pixels)
{
    /* how far a corner of the window is off */
    const double radius = 0.5 * hypot(WINDOW_ROWS, WINDOW_COLS);
    const double off = radius * hypot(found->magnification / truth->magnification - 1.0,
                                      (found->rotation_deg - truth->rotation_deg) * 3.14159265358979323846 / 180.0);
    const double slant =
        radius * radius *
        hypot(found->perspective_row - truth->perspective_row, found->perspective_col - truth->perspective_col);
    if (found->mirrored != truth->mirrored || found->quarter_turns != truth->quarter_turns || !(off < pixels) ||
        !(slant < 2.0 * pixels))
        fail_msg(
            "mirrored %d, %d quarter turns, x %.5f, %.4f degrees instead of %d, %d, x %.5f, %.4f: %.2f pixels off, %.2f by "
            "perspective",
            found->mirrored, found->quarter_turns, found->magnification, found->rotation_deg, truth->mirrored,
            truth->quarter_turns, truth->magnification, truth->rotation_deg, off, slant);
    assert_true(found->explained > 2.0 * found->explained_otherwise);
}

TEST(recovered)
{
    static const struct {
        hada_registration truth;
        double noise;
        int count;
    } cases[] = {
        {{.size = sizeof(hada_registration), .magnification = 1.0}, 0.003, PAIRS},
        {{.size = sizeof(hada_registration), .magnification = 0.5, .mirrored = 1, .rotation_deg = 4.0}, 0.003, PAIRS},
        {{.size = sizeof(hada_registration), .magnification = 2.0, .quarter_turns = 1, .rotation_deg = -5.0},
         0.003,
         PAIRS},
        {{.size = sizeof(hada_registration), .magnification = 0.8, .mirrored = 1, .quarter_turns = 2}, 0.03, PAIRS},
        {{.size = sizeof(hada_registration),
          .magnification = 1.3,
          .mirrored = 1,
          .quarter_turns = 3,
          .rotation_deg = 2.5},
         0.03,
         8},
        {{.size = sizeof(hada_registration), .magnification = 0.7, .quarter_turns = 2, .rotation_deg = -1.0}, 0.003, 2},
        {{.size = sizeof(hada_registration),
          .magnification = 0.8,
          .quarter_turns = 1,
          .rotation_deg = 3.0,
          .perspective_row = 0.001,
          .perspective_col = -0.0015},
         0.003,
         PAIRS},
        {{.size = sizeof(hada_registration), .magnification = 1.2, .perspective_col = 0.003}, 0.02, PAIRS},
    };
    hada_register_options options = search_all;
    options.most_rotation_deg = 6.0;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        pairs all = make_pairs(&cases[i].truth, cases[i].count, 1.0, cases[i].noise, 100 * i);
        hada_registration found = {.size = sizeof found}, again = {.size = sizeof again};
        ASSERT_OK(hada_register_pairs(&found, all.raws, all.scenes, all.count, &options, err));
        expect(&found, &cases[i].truth, 0.25);
        if (!i) {
            ASSERT_OK(hada_register_pairs(&again, all.raws, all.scenes, all.count, &options, err));
            assert_memory_equal(&again, &found, sizeof found);
        }
        free_pairs(&all);
    }
}

TEST(search_can_be_stopped)
{
    const hada_registration truth = {.size = sizeof(hada_registration), .magnification = 1.0};
    patience of = {.most = -1};
    const hada_monitor monitor = patience_monitor(&of);
    hada_registration found = {.size = sizeof found};
    hada_register_options options = search_all;
    pairs all = make_pairs(&truth, PAIRS, 1.0, 0.003, 0);
    options.most_rotation_deg = 3.0;
    options.monitor = &monitor;
    ASSERT_OK(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err));
    const int asked = of.asked;
    assert_true(asked > 100);
    for (int k = 0; k < 3; k++) { /* at once, in the scan, while refining */
        of = (patience){.most = k * (asked - 1) / 2};
        ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_CANCELLED, "");
        assert_int_equal(of.asked, of.most + 1);
    }
    free_pairs(&all);
}

/* Scenes of a second depth with another offset; the mask's PSF is 0.9 times as wide there. */
TEST(offsets)
{
    const hada_registration at = {.size = sizeof(hada_registration), .magnification = 1.0};
    const hada_registration moved = {
        .size = sizeof(hada_registration), .magnification = 1.0, .offset_row = 2.5, .offset_col = -4.0};
    pairs near = make_pairs(&at, PAIRS, 1.0, 0.003, 1), far = make_pairs(&moved, PAIRS, 0.9, 0.003, 2);
    hada_image psf, other;
    double pitch, scale, row, col, likeness;
    ASSERT_OK(hada_register_psf(&psf, &pitch, near.raws, near.scenes, PAIRS, &at, err));
    ASSERT_OK(hada_register_psf(&other, &pitch, far.raws, far.scenes, PAIRS, &at, err));
    ASSERT_OK(hada_register_offset(&psf, &other, pitch, &scale, &row, &col, &likeness, err));
    assert_true(fabs(scale - 0.9) < 0.01 && fabs(row - 2.5) < 0.25 && fabs(col + 4.0) < 0.25 && likeness > 0.5);
    hada_image_destroy(&other);
    /* with the offset known there is none left */
    ASSERT_OK(hada_register_psf(&other, &pitch, far.raws, far.scenes, PAIRS, &moved, err));
    ASSERT_OK(hada_register_offset(&psf, &other, pitch, &scale, &row, &col, &likeness, err));
    assert_true(fabs(row) < 0.25 && fabs(col) < 0.25);
    /* noise is like nothing */
    hada_random random;
    hada_random_seed(&random, 5, 0);
    for (size_t i = 0; i < hada_image_count(&other); i++)
        other.data[i] = (float)hada_random_normal(&random);
    ASSERT_OK(hada_register_offset(&psf, &other, pitch, &scale, &row, &col, &likeness, err));
    assert_true(likeness < 0.2);
    hada_image_destroy(&other);
    ASSERT_OK(hada_image_create(&other, 1, 9, 9, err));
    ASSERT_FAILS(hada_register_offset(&psf, &other, pitch, &scale, &row, &col, &likeness, err), HADA_ERROR_ARGUMENT,
                 "");
    hada_image_destroy(&psf);
    hada_image_destroy(&other);
    free_pairs(&near);
    free_pairs(&far);
}

TEST(refusals)
{
    const hada_registration truth = {.size = sizeof(hada_registration), .magnification = 1.0};
    pairs all = make_pairs(&truth, PAIRS, 1.0, 0.003, 9);
    hada_registration found = {.size = sizeof found};
    hada_register_options options = search_all;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, 0, &options, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, 1, &options, err), HADA_ERROR_DATASET,
                 "one pair does not show");
    options.most_rotation_deg = 50.0;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_ARGUMENT, "");
    options.most_rotation_deg = 3.0;
    options.least_magnification = 2.0;
    options.most_magnification = 1.0;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_ARGUMENT, "");
    /* outside the range; and scenes that belong to other frames */
    options.most_magnification = 2.2;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_DATASET,
                 "do not show");
    options.least_magnification = 0.7;
    options.most_magnification = 1.4;
    const hada_image first = all.scenes[0];
    for (int i = 0; i + 1 < PAIRS; i++)
        all.scenes[i] = all.scenes[i + 1];
    all.scenes[PAIRS - 1] = first;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_DATASET, "");
    /* scenes that are their own mirror images fit as well mirrored as not */
    hada_registration flip = {.size = sizeof(hada_registration), .magnification = 1.0, .mirrored = 1};
    for (int i = 0; i < PAIRS; i++) {
        SCOPED(hada_image) mirrored, stands;
        ASSERT_OK(hada_register_apply(&mirrored, &all.scenes[i], &flip, WINDOW_ROWS, WINDOW_COLS, err));
        for (size_t k = 0; k < hada_image_count(&mirrored); k++)
            all.scenes[i].data[k] = 0.5f * (all.scenes[i].data[k] + mirrored.data[k]);
        ASSERT_OK(hada_register_apply(&stands, &all.scenes[i], &truth, WINDOW_ROWS, WINDOW_COLS, err));
        memset(all.raws[i].data, 0, hada_image_count(&all.raws[i]) * sizeof(float));
        expose(&all.raws[i], &stands, mask_holes(), 1.0);
    }
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_DATASET,
                 "without symmetry");
    /* sizes, values, flat scenes */
    all.raws[1].rows--;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_SIZE, "pair 2");
    all.raws[1].rows++;
    all.raws[2].data[17] = NAN;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_NOT_FINITE, "");
    all.raws[2].data[17] = 0.0f;
    for (int i = 0; i < PAIRS; i++)
        for (size_t k = 0; k < hada_image_count(&all.scenes[i]); k++)
            all.scenes[i].data[k] = 0.7f;
    ASSERT_FAILS(hada_register_pairs(&found, all.raws, all.scenes, PAIRS, &options, err), HADA_ERROR_DATASET, "flat");
    free_pairs(&all);
}
