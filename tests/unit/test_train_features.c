/* Features of scenes that are kept: the same bits with them and without, and VGG-16 runs once a step instead of twice.
 */
#include "train_run.h"

#include "runtime/profile.h"
#include "train/step.h"

TEST(a_store_keeps_what_fits)
{
    hada_features store;
    ASSERT_OK(hada_features_create(&store, 3, 10, 85, err));
    float *first = hada_features_room(&store, 1), *last = hada_features_room(&store, 3);
    assert_true(first && last && store.bytes == 80);
    assert_null(hada_features_room(&store, 1)); /* it is there */
    assert_null(hada_features_room(&store, 2)); /* no room */
    assert_null(hada_features_room(&store, 0));
    assert_null(hada_features_room(&store, 4));
    assert_true(hada_features_find(&store, 1) == first && hada_features_find(&store, 3) == last);
    assert_true(!hada_features_find(&store, 0) && !hada_features_find(&store, 2) && !hada_features_find(&store, 4));
    hada_features_drop(&store, 1);
    assert_true(!hada_features_find(&store, 1) && store.bytes == 40 && hada_features_room(&store, 2));
    hada_features_free(&store);
    ASSERT_OK(hada_features_create(&store, 0, 10, 85, err));
    assert_true(!hada_features_find(&store, 1) && !hada_features_room(&store, 1));
    hada_features_free(&store);
}

/* Launches of the perceptual term since the last time. */
static int launches(hada_slot *slot)
{
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    int sum = 0;
    ASSERT_OK(hada_slot_times(slot, &rows, &count, err));
    for (size_t i = 0; i < count; i++)
        if (!strcmp(rows[i].stage, "perceptual") && !rows[i].transfer)
            sum += (int)rows[i].launches;
    free(rows);
    ASSERT_OK(hada_slot_profile(slot, 1, err));
    return sum;
}

enum { CALLS = 6, WAYS = 3 }; /* nothing is kept; everything; two of three scenes */

typedef struct seen {
    double term[CALLS];
    float *gradient[CALLS];
    int launches[CALLS];
    size_t count, kept;
} seen;

/* The pairs twice, two of them, with a scene that has changed and says so, in another order, two that are kept. */
static void watch(const net_device *device, replica_run *run, int way, seen *out)
{
    static const struct {
        int count, pair[TRAIN_PAIRS];
    } calls[CALLS] = {{3, {0, 1, 2}}, {3, {0, 1, 2}}, {2, {1, 0}}, {3, {0, 1, 2}}, {3, {2, 0, 1}}, {2, {0, 1}}};
    run->desc.scenes = way ? 8 : 0;
    run->desc.feature_bytes = (size_t)1 << 20;
    SCOPED(hada_replica) *replica = train_replica(device, &run->desc);
    hada_features *features = hada_replica_features(replica);
    if (way == 2)
        features->most = 2 * features->floats * sizeof(float);
    out->count = hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
    ASSERT_OK(hada_slot_profile(device->slot, 1, err));
    for (int i = 0; i < CALLS; i++) {
        hada_sample samples[TRAIN_PAIRS];
        hada_terms terms;
        for (int k = 0; k < calls[i].count; k++) {
            samples[k] = run->pairs.samples[calls[i].pair[k]];
            samples[k].scene_number = 3 + (size_t)calls[i].pair[k];
        }
        hada_image *changing = &run->pairs.scene[1];
        if (i == 3) {
            samples[1].scene_number = 0;
            changing->data[0] += 0.5f;
        }
        hada_parameters_clear(hada_replica_parameters(replica));
        ASSERT_OK(hada_replica_backward(replica, samples, calls[i].count, 1.0 / 3, 1, 0, &terms, NULL, err));
        if (i == 3)
            changing->data[0] -= 0.5f;
        out->term[i] = terms.perceptual;
        out->gradient[i] = train_read(replica, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
        out->launches[i] = launches(device->slot);
    }
    ASSERT_OK(hada_slot_profile(device->slot, 0, err));
    out->kept = features->bytes / sizeof(float) / features->floats;
    assert_true(features->bytes <= features->most);
}

TEST(steps_have_the_same_bits)
{
    static const char *const names[] = {"grey, perceptual", "another size, perceptual"};
    for (size_t c = 0; c < HADA_COUNT(train_cases); c++) {
        seen ways[WAYS];
        if (strcmp(train_cases[c].name, names[0]) && strcmp(train_cases[c].name, names[1]))
            continue;
        for (int way = 0; way < WAYS; way++) {
            replica_run run;
            run_make(&run, &train_cases[c]);
            watch(*state, &run, way, &ways[way]);
            run_free(&run);
        }
        assert_true(ways[0].kept == 0 && ways[1].kept == 3 && ways[2].kept == 2);
        assert_true(ways[0].term[0] == ways[0].term[1] && ways[0].term[0] != ways[0].term[3]);
        for (int i = 0; i < CALLS; i++) {
            for (int way = 1; way < WAYS; way++) {
                /* by way 2 scenes 1 and 2 are kept, the third never is; call 3 shows one that changes */
                const int once = way == 1 ? i && i != 3 : i == 2 || i == 5;
                assert_true(ways[way].term[i] == ways[0].term[i]);
                assert_memory_equal(ways[way].gradient[i], ways[0].gradient[i], ways[0].count * sizeof(float));
                assert_true(once ? ways[way].launches[i] < ways[0].launches[i]
                                 : ways[way].launches[i] == ways[0].launches[i]);
            }
            for (int way = 0; way < WAYS; way++)
                free(ways[way].gradient[i]);
        }
    }
}

FIXTURE(net_device_open, net_device_close)
