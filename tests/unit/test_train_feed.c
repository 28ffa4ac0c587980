/* Order, changes and reading ahead of the pairs for training. */
#include "testing.h"

#include <sched.h>
#include <stdatomic.h>
#include <time.h>

#include "core/base.h"
#include "train/feed.h"

enum { DEPTHS = 3, ROWS = 12, COLS = 10, WINDOW = 6 };
static const int counts[DEPTHS] = {5, 0, 8};
static const double distances[DEPTHS] = {100.0, 200.0, 300.0};
static const hada_model_info info = {.depths = DEPTHS,
                                     .channels = 2,
                                     .raw_rows = ROWS,
                                     .raw_cols = COLS,
                                     .window_rows = WINDOW,
                                     .window_cols = WINDOW,
                                     .boundary = HADA_BOUNDARY_CIRCULAR,
                                     .distances_mm = distances};

/* Pictures that say which they are. */
typedef struct source {
    int whole, broken; /* scenes of the frame's size; which pair of the third depth fails */
    atomic_int reads;
} source;

static void paint(hada_image *image, float base)
{
    for (size_t i = 0; i < hada_image_count(image); i++)
        image->data[i] = base + (float)i;
}

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    source *from = user;
    from->reads++;
    if (depth == 2 && pair == from->broken)
        return hada_fail(error, HADA_ERROR_FILE_READ, "the disk is gone");
    ASSERT_OK(hada_image_create(raw, 2, ROWS, COLS, err));
    ASSERT_OK(hada_image_create(scene, 2, from->whole ? ROWS : WINDOW, from->whole ? COLS : WINDOW, err));
    paint(raw, (float)(1000 * depth + pair));
    paint(scene, (float)(5000 + 1000 * depth + pair));
    return HADA_OK;
}

static hada_dataset *pairs_of(source *from)
{
    hada_dataset *pairs;
    ASSERT_OK(hada_dataset_create(&pairs, DEPTHS, distances, counts, read_pair, from, NULL, err));
    return pairs;
}

TEST(each_round_shows_every_pair_once)
{
    source from = {.broken = -1};
    SCOPED(hada_dataset) *pairs = pairs_of(&from);
    int same_place = 0, same_seed = 0, first[13] = {0};
    assert_int_equal(hada_pairs_total(pairs), 13);
    for (uint64_t round = 0; round < 50; round++) {
        int seen[DEPTHS][8] = {{0}}, depth, pair, other_depth, other_pair;
        for (uint64_t i = 0; i < 13; i++) {
            hada_order_pair(pairs, 7, 13 * round + i, &depth, &pair);
            assert_in_range(pair, 0, counts[depth] - 1);
            assert_int_equal(seen[depth][pair]++, 0);
            first[i] += depth == 0 && pair == 0;
            hada_order_pair(pairs, 7, i, &other_depth, &other_pair);
            same_place += depth == other_depth && pair == other_pair;
            hada_order_pair(pairs, 8, 13 * round + i, &other_depth, &other_pair);
            same_seed += depth == other_depth && pair == other_pair;
        }
    }
    /* other rounds and seeds agree in one place of 13 by chance (the first round agrees with itself) */
    assert_in_range(same_place - 13, 20, 85);
    assert_in_range(same_seed, 20, 85);
    for (int i = 0; i < 13; i++)
        assert_in_range(first[i], 0, 16); /* 50 / 13 each; no place is a pair's own */
}

static hada_image image_of(int rows, int cols, float base)
{
    hada_image image;
    ASSERT_OK(hada_image_create(&image, 2, rows, cols, err));
    paint(&image, base);
    return image;
}

static float at(const hada_image *image, int channel, int row, int col)
{
    return image->data[(channel * image->rows + row) * image->cols + col];
}

static void augmented(const hada_augment *augment, uint64_t place, int whole, hada_image *raw, hada_image *scene)
{
    *raw = image_of(ROWS, COLS, 1.0f);
    *scene = image_of(whole ? ROWS : WINDOW, whole ? COLS : WINDOW, 1.0f);
    ASSERT_OK(hada_augment_pair(augment, 0.0, 3, place, raw, scene, err));
}

static int find(const hada_image *image, float value)
{
    int i = 0;
    while (image->data[i] != value)
        i++;
    return i;
}

TEST(frames_and_scenes_move_together)
{
    const hada_augment augment = {.shift = 3};
    SCOPED(hada_image) still = image_of(ROWS, COLS, 1.0f), small = image_of(WINDOW, WINDOW, 1.0f);
    int seen[7][7] = {{0}}, moved = 0;
    for (uint64_t place = 0; place < 400; place++) {
        SCOPED(hada_image) raw, scene;
        const int whole = place % 2;
        augmented(&augment, place, whole, &raw, &scene);
        const int move = find(&raw, still.data[0]), dy = move / COLS - (move / COLS > 3) * ROWS,
                  dx = move % COLS - (move % COLS > 3) * COLS;
        seen[dy + 3][dx + 3]++;
        for (int c = 0; c < 2; c++)
            for (int row = 0; row < scene.rows; row++)
                for (int col = 0; col < scene.cols; col++) {
                    const int r = row - dy, k = col - dx, inside = r >= 0 && r < WINDOW && k >= 0 && k < WINDOW;
                    const float want = whole    ? at(&still, c, (r + ROWS) % ROWS, (k + COLS) % COLS)
                                       : inside ? at(&small, c, r, k)
                                                : 0.0f;
                    assert_true(at(&scene, c, row, col) == want);
                }
    }
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 7; j++)
            moved += seen[i][j] > 0;
    assert_true(moved > 40); /* of 49 */
}

TEST(flips_turn_both)
{
    for (int allowed = 1; allowed < 4; allowed++) {
        const hada_augment augment = {.flips = allowed};
        SCOPED(hada_image) still = image_of(ROWS, COLS, 1.0f), small = image_of(WINDOW, WINDOW, 1.0f);
        int seen[4] = {0};
        for (uint64_t place = 0; place < 64; place++) {
            SCOPED(hada_image) raw, scene;
            augmented(&augment, place, 0, &raw, &scene);
            const int sides = (at(&raw, 0, 0, 0) == at(&still, 0, 0, COLS - 1) ||
                               at(&raw, 0, 0, 0) == at(&still, 0, ROWS - 1, COLS - 1)) |
                              (at(&raw, 0, 0, 0) >= at(&still, 0, ROWS - 1, 0)) << 1;
            seen[sides]++;
            for (int row = 0; row < WINDOW; row++)
                for (int col = 0; col < WINDOW; col++)
                    assert_true(at(&scene, 1, row, col) == at(&small, 1, (sides & 2) ? WINDOW - 1 - row : row,
                                                              (sides & 1) ? WINDOW - 1 - col : col));
        }
        for (int sides = 0; sides < 4; sides++)
            assert_true((seen[sides] > 5) == !(sides & ~allowed));
    }
}

TEST(noise_and_exposure_are_as_asked)
{
    const hada_augment noisy = {.noise = 0.05}, brighter = {.exposure = 0.25};
    SCOPED(hada_image) still = image_of(ROWS, COLS, 1.0f);
    double sum = 0.0, square = 0.0, low = 9.0, high = 0.0;
    const double top = 2.0 * ROWS * COLS;
    for (uint64_t place = 0; place < 200; place++) {
        SCOPED(hada_image) raw, scene;
        augmented(&noisy, place, 0, &raw, &scene);
        for (size_t i = 0; i < hada_image_count(&raw); i++) {
            const double d = ((double)raw.data[i] - still.data[i]) / top;
            sum += d;
            square += d * d;
        }
        assert_true(scene.data[3] == 4.0f);
        hada_image_destroy(&raw);
        hada_image_destroy(&scene);
        augmented(&brighter, place, 0, &raw, &scene);
        const double factor = scene.data[9] / 10.0;
        assert_true(fabs(raw.data[9] / 10.0 - factor) < 1e-6);
        low = fmin(low, factor);
        high = fmax(high, factor);
    }
    const double n = 200.0 * top;
    assert_true(fabs(sum / n) < 4.0 * 0.05 / sqrt(n));
    assert_true(fabs(sqrt(square / n) / 0.05 - 1.0) < 0.02);
    assert_true(low > 0.75 && low < 0.77 && high < 1.25 && high > 1.23);
    /* the sensor's offset is not light */
    SCOPED(hada_image) raw = image_of(ROWS, COLS, 7.0f), scene = image_of(WINDOW, WINDOW, 1.0f);
    ASSERT_OK(hada_augment_pair(&brighter, 7.0, 3, 1, &raw, &scene, err));
    assert_true(raw.data[0] == 7.0f && raw.data[10] != 17.0f);
}

TEST(planes_flip_with_their_scenes)
{
    const hada_augment augment = {.plane_flips = 3};
    int changed = 0;
    for (uint64_t place = 0; place < 40; place++) {
        SCOPED(hada_image) plane = image_of(WINDOW, WINDOW, 1.0f), scene = image_of(WINDOW, WINDOW, 1.0f);
        hada_augment_plane(&augment, 3, place, &plane, &scene);
        assert_memory_equal(plane.data, scene.data, hada_image_count(&plane) * sizeof(float));
        changed += plane.data[0] != 1.0f;
    }
    assert_in_range(changed, 20, 38); /* three of four */
}

TEST(the_feed_keeps_its_order_and_its_bounds)
{
    source from = {.broken = -1, .whole = 1};
    SCOPED(hada_dataset) *pairs = pairs_of(&from);
    hada_feed_desc desc = {.pairs = pairs, .info = &info, .seed = 5, .ahead = 4, .augment = {.shift = 2, .noise = 0.1}};
    hada_feed *feed, *late;
    hada_fed *fed[4], *again[4];
    ASSERT_OK(hada_feed_create(&feed, &desc, err));
    while (from.reads < desc.ahead) /* it reads ahead by itself, */
        sched_yield();
    nanosleep(&(struct timespec){.tv_nsec = 50000000}, NULL);
    assert_int_equal(from.reads, desc.ahead); /* and no more than asked for are in memory */
    ASSERT_OK(hada_feed_take(feed, 3, fed, err));
    ASSERT_OK(hada_feed_take(feed, 2, fed, err));
    desc.first = 3; /* resumed */
    desc.ahead = 2;
    ASSERT_OK(hada_feed_create(&late, &desc, err));
    ASSERT_OK(hada_feed_take(late, 2, again, err));
    for (int i = 0; i < 2; i++) {
        int depth, pair;
        hada_order_pair(pairs, 5, 3 + (uint64_t)i, &depth, &pair);
        assert_int_equal(fed[i]->place, 3 + i);
        assert_int_equal(fed[i]->depth, depth);
        assert_int_equal(fed[i]->pair, pair);
        assert_int_equal(fed[i]->scene.rows, WINDOW);
        assert_memory_equal(fed[i]->raw.data, again[i]->raw.data, hada_image_count(&fed[i]->raw) * sizeof(float));
        assert_memory_equal(fed[i]->scene.data, again[i]->scene.data, hada_image_count(&fed[i]->scene) * sizeof(float));
    }
    hada_feed_destroy(&late);
    hada_feed_destroy(&feed);
    assert_null(feed);
}

TEST(a_bad_pair_is_named_when_its_turn_comes)
{
    source from = {.broken = 6};
    SCOPED(hada_dataset) *pairs = pairs_of(&from);
    const hada_feed_desc desc = {.pairs = pairs, .info = &info, .seed = 5, .ahead = 2};
    SCOPED(hada_feed) * feed;
    hada_fed *fed[1];
    hada_error error = {0};
    ASSERT_OK(hada_feed_create(&feed, &desc, err));
    int taken = 0, depth, pair;
    while (!hada_feed_take(feed, 1, fed, &error))
        taken++;
    hada_order_pair(pairs, 5, (uint64_t)taken, &depth, &pair);
    assert_int_equal(depth, 2);
    assert_int_equal(pair, 6);
    assert_int_equal(error.status, HADA_ERROR_FILE_READ);
    assert_string_equal(error.message, "pair 7 of the depth at 300 mm: the disk is gone");
    assert_int_equal(hada_feed_take(feed, 1, fed, &error), HADA_ERROR_FILE_READ);
}

static hada_status read_wrong(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    const int kind = *(int *)user;
    (void)depth;
    (void)pair;
    (void)error;
    ASSERT_OK(hada_image_create(raw, kind == 1 ? 1 : 2, ROWS, COLS, err));
    ASSERT_OK(hada_image_create(scene, 2, WINDOW, kind == 2 ? WINDOW + 1 : WINDOW, err));
    if (kind == 3)
        scene->data[4] = NAN;
    return HADA_OK;
}

TEST(pairs_that_do_not_fit_are_refused)
{
    static const char *const words[] = {"", "1 channel", "6 x 7", "1 pixels are NaN"};
    static const int one[DEPTHS] = {1, 0, 0};
    for (int kind = 1; kind <= 3; kind++) {
        hada_dataset *pairs;
        ASSERT_OK(hada_dataset_create(&pairs, DEPTHS, distances, one, read_wrong, &kind, NULL, err));
        hada_image raw, scene;
        hada_error error = {0};
        assert_int_not_equal(hada_pairs_read(pairs, &info, 0, 0, &raw, &scene, &error), HADA_OK);
        hada_dataset_destroy(&pairs);
        assert_non_null(strstr(error.message, words[kind]));
        assert_non_null(strstr(error.message, "pair 1 of the depth at 100 mm"));
        assert_null(raw.data);
        assert_null(scene.data);
    }
}

TEST(changes_that_make_no_sense_are_refused)
{
    hada_model_info padded = info, odd = info;
    padded.boundary = HADA_BOUNDARY_PADDED;
    odd.window_cols = 5;
    const struct {
        hada_augment augment;
        const hada_model_info *info;
        const char *words;
    } bad[] = {{{.shift = -1}, &info, "0 to 5"},          {{.shift = 6}, &info, "0 to 5"},
               {{.shift = 1}, &padded, "circular"},       {{.flips = 4}, &info, "flips are"},
               {{.plane_flips = -1}, &info, "flips are"}, {{.flips = 1}, &odd, "half pixels"},
               {{.noise = -0.1}, &info, "from 0 to 1"},   {{.exposure = 1.0}, &info, "from 0 to 1"},
               {{.exposure = NAN}, &info, "from 0 to 1"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        ASSERT_FAILS(hada_augment_check(&bad[i].augment, bad[i].info, err), HADA_ERROR_ARGUMENT, bad[i].words);
    }
    ASSERT_OK(hada_augment_check(&(hada_augment){.flips = 2, .shift = 4, .noise = 0.1}, &odd, err));
}

static int everything_known(void *user, int depth, int pair, int variant)
{
    (void)user;
    (void)variant;
    return depth == 2 || pair > 2;
}

TEST(what_is_known_is_not_read)
{
    source from = {.broken = 6};
    hada_dataset *pairs = pairs_of(&from);
    const hada_feed_desc desc = {.pairs = pairs, .info = &info, .ahead = 1, .known = everything_known};
    hada_feed *feed;
    hada_fed *fed[1];
    ASSERT_OK(hada_feed_create(&feed, &desc, err));
    for (int i = 0; i < 26; i++) {
        ASSERT_OK(hada_feed_take(feed, 1, fed, err));
        assert_int_equal(fed[0]->raw.data == NULL, everything_known(NULL, fed[0]->depth, fed[0]->pair, 0));
    }
    hada_feed_destroy(&feed);
    hada_dataset_destroy(&pairs);
    assert_in_range(from.reads, 6, 7);
}
