/* Scenes of several depths, made of pairs of one: light adds up, nothing is counted twice, and seeds alone decide. */
#include "testing.h"

#include "core/base.h"
#include "train/feed.h"

enum { DEPTHS = 7, ROWS = 40, COLS = 48, HIGH = 24, WIDE = 32, OWN = 3, PAIRS = 2 };
static const int counts[DEPTHS] = {PAIRS, PAIRS, 0, PAIRS, PAIRS, PAIRS, PAIRS};
static const double distances[DEPTHS] = {100, 110, 125, 150, 200, 300, 600};
static const hada_model_info info = {.depths = DEPTHS,
                                     .channels = 2,
                                     .raw_rows = ROWS,
                                     .raw_cols = COLS,
                                     .window_rows = HIGH,
                                     .window_cols = WIDE,
                                     .distances_mm = distances};

/* Every pair's scene says which it is: 1 + its number over all depths, everywhere. */
static float shade(int depth, int pair)
{
    return (float)(1 + PAIRS * depth + pair);
}

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    const int *broken = user;
    if (broken && depth != OWN)
        return hada_fail(error, HADA_ERROR_FILE_READ, "the disk is gone");
    ASSERT_OK(hada_image_create(raw, 2, ROWS, COLS, err));
    ASSERT_OK(hada_image_create(scene, 2, HIGH, WIDE, err));
    for (size_t i = 0; i < hada_image_count(scene); i++)
        scene->data[i] = shade(depth, pair);
    return HADA_OK;
}

static hada_dataset *pairs_of(int *broken)
{
    hada_dataset *pairs;
    ASSERT_OK(hada_dataset_create(&pairs, DEPTHS, distances, counts, read_pair, broken, NULL, err));
    return pairs;
}

static hada_image own_scene(int pair)
{
    hada_image raw, scene;
    ASSERT_OK(read_pair(NULL, OWN, pair, &raw, &scene, err));
    hada_image_destroy(&raw);
    return scene;
}

typedef struct seen {
    int whole, others, between, dark, told_too_many, planes[HADA_COMPOSED_DEPTHS + 1];
} seen;

/* A pixel after the change: the light of one depth, or of two neighbours that share it. */
static void check_pixel(const hada_composed *composed, size_t i, float truth, seen *all, int *lit)
{
    float total = 0.0f;
    int count = 0, last = -1;
    for (int k = 0; k < composed->count; k++) {
        const hada_image *light = &composed->light[k];
        float value = (light->data ? light->data[i] : 0.0f) + (composed->depth[k] == OWN ? shade(OWN, 1) : 0.0f);
        assert_true(value > -1e-5f);
        value = value < 1e-5f ? 0.0f : value; /* what was taken away leaves its rounding */
        assert_true(value <= 0.0f || last < 0 || composed->depth[k] == last + 1);
        last = value > 0.0f ? composed->depth[k] : last;
        count += value > 0.0f;
        lit[k] |= value > 0.0f;
        total += value;
        if (composed->depth[k] == OWN && !composed->whole)
            assert_true(fabsf(value - truth) < 1e-5f);
    }
    assert_in_range(count, 0, 2);
    assert_true(count < 2 || fabsf(total - shade(OWN, 1)) < 1e-5f); /* one picture lies between depths */
    assert_true(!composed->whole || fabsf(total - truth) < 1e-5f);
    all->others |= count == 1 && fabsf(total - shade(OWN, 1)) > 0.5f;
    all->between |= count == 2;
    all->dark |= !count;
}

static void check_scene(int variant, int planes_only, uint64_t seed, seen *all)
{
    SCOPED(hada_dataset) *pairs = pairs_of(NULL);
    SCOPED(hada_image) scene = own_scene(1), again = own_scene(1);
    hada_composed composed, same;
    int own = 0, lit[HADA_COMPOSED_DEPTHS] = {0}, dark = 0;
    ASSERT_OK(hada_compose(&composed, pairs, &info, seed, OWN, 1, variant, planes_only, &scene, err));
    ASSERT_OK(hada_compose(&same, pairs, &info, seed, OWN, 1, variant, planes_only, &again, err));
    assert_in_range(composed.count, 1, HADA_COMPOSED_DEPTHS);
    assert_int_equal(composed.count, same.count);
    assert_memory_equal(composed.depth, same.depth, sizeof composed.depth);
    assert_memory_equal(scene.data, again.data, hada_image_count(&scene) * sizeof(float));
    for (int k = 0; k < composed.count; k++) {
        assert_in_range(composed.depth[k], k ? composed.depth[k - 1] + 1 : 0, DEPTHS - 1);
        own += composed.depth[k] == OWN;
        assert_true(!composed.light[k].data == !same.light[k].data);
    }
    assert_int_equal(own, 1);
    for (size_t i = 0; i < hada_image_count(&scene); i++)
        check_pixel(&composed, i, scene.data[i], all, lit);
    for (int k = 0; k < composed.count; k++)
        dark += !composed.light[k].data;
    assert_in_range(dark, 0, 1);
    all->told_too_many += dark;
    all->whole += composed.whole;
    all->planes[composed.count]++;
    hada_composed_free(&composed);
    hada_composed_free(&same);
}

TEST(light_is_moved_and_not_made)
{
    seen all = {0};
    for (uint64_t seed = 0; seed < 40; seed++)
        for (int variant = 1; variant <= HADA_COMPOSED_VARIANTS; variant++)
            check_scene(variant, 0, seed, &all);
    /* everything that is to be met comes up in 320 scenes */
    assert_in_range(all.whole, 60, 140);
    assert_in_range(all.told_too_many, 5, 80);
    assert_true(all.others && all.between && all.dark);
    for (int count = 1; count <= HADA_COMPOSED_DEPTHS; count++)
        assert_true(all.planes[count] > 0);
}

/* A net that shares light out is never shown the sum. */
TEST(the_sum_may_be_left_out)
{
    seen all = {0};
    for (uint64_t seed = 0; seed < 20; seed++)
        for (int variant = 1; variant <= HADA_COMPOSED_VARIANTS; variant++)
            check_scene(variant, 1, seed, &all);
    assert_int_equal(all.whole, 0);
    assert_true(all.others && all.between && all.dark);
}

TEST(variants_are_a_share_and_change_by_round)
{
    SCOPED(hada_dataset) *pairs = pairs_of(NULL);
    const uint64_t total = hada_pairs_total(pairs);
    int composed = 0, kinds[HADA_COMPOSED_VARIANTS + 1] = {0}, differ = 0;
    for (uint64_t place = 0; place < 4000; place++) {
        const int variant = hada_compose_variant(pairs, 3, place, 0.25);
        assert_int_equal(hada_compose_variant(pairs, 3, place, 0.0), 0);
        assert_int_equal(hada_compose_variant(pairs, 3, place, 1.0), 1 + place / total % HADA_COMPOSED_VARIANTS);
        assert_in_range(variant, 0, HADA_COMPOSED_VARIANTS);
        kinds[variant]++;
        composed += variant > 0;
        differ += variant != hada_compose_variant(pairs, 4, place, 0.25);
    }
    assert_in_range(composed, 900, 1100);
    assert_true(differ > 1000);
    for (int variant = 1; variant <= HADA_COMPOSED_VARIANTS; variant++)
        assert_true(kinds[variant] > 60);
}

TEST(a_pair_that_cannot_be_read_is_named)
{
    int broken = 1, failed = 0;
    SCOPED(hada_dataset) *pairs = pairs_of(&broken);
    for (uint64_t seed = 0; seed < 20; seed++) {
        SCOPED(hada_image) scene = own_scene(0);
        hada_composed composed;
        hada_error error = {0};
        const hada_status status = hada_compose(&composed, pairs, &info, seed, OWN, 0, 1, 0, &scene, &error);
        if (status) {
            failed++;
            assert_int_equal(status, HADA_ERROR_FILE_READ);
            assert_non_null(strstr(error.message, "pair "));
            assert_int_equal(composed.count, 0);
        }
        hada_composed_free(&composed);
    }
    assert_in_range(failed, 1, 19); /* others' scenes are read now and then */
}

static hada_status read_point(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    (void)user;
    (void)depth;
    (void)pair;
    (void)error;
    ASSERT_OK(hada_image_create(raw, 2, ROWS, COLS, err));
    ASSERT_OK(hada_image_create(scene, 2, 1, 1, err));
    return HADA_OK;
}

/* Two depths are the fewest, and a window may be a single pixel. */
TEST(small_cameras_work)
{
    static const int few[2] = {1, 0};
    SCOPED(hada_dataset) * pairs;
    ASSERT_OK(hada_dataset_create(&pairs, 2, distances, few, read_point, NULL, NULL, err));
    hada_model_info two = info;
    two.depths = 2;
    two.window_rows = two.window_cols = 1;
    for (uint64_t seed = 0; seed < 50; seed++) {
        SCOPED(hada_image) scene;
        hada_composed composed;
        ASSERT_OK(hada_image_create(&scene, 2, 1, 1, err));
        scene.data[0] = scene.data[1] = 1.0f;
        ASSERT_OK(hada_compose(&composed, pairs, &two, seed, 0, 0, 1, 0, &scene, err));
        assert_in_range(composed.count, 1, 2);
        hada_composed_free(&composed);
    }
}
