/* Memory planned from lifetimes: pieces that live at the same time never overlap, and little is wasted. */
#include "testing.h"

#include "runtime/memory.h"

enum { MOST = 60, ALIGNMENT = 128 };

static int fill_random(hada_piece *pieces, hada_random *random)
{
    const int count = 1 + (int)hada_random_below(random, MOST), steps = 1 + (int)hada_random_below(random, 40);
    for (int i = 0; i < count; i++) {
        const int first = (int)hada_random_below(random, (uint32_t)steps);
        const int length = (int)hada_random_below(random, 1 + (uint32_t)(steps / (1 + hada_random_below(random, 8))));
        pieces[i] = (hada_piece){"a piece", hada_random_below(random, 100000), first, first + length, -1, 1};
    }
    return count;
}

/* The most bytes in use in any one step: no plan needs less. */
static size_t least_bytes(const hada_piece *pieces, int count)
{
    size_t floor = 0;
    /* the need only grows at a step where a piece begins */
    for (int i = 0; i < count; i++) {
        size_t together = 0;
        for (int k = 0; k < count; k++)
            if (pieces[k].first <= pieces[i].first && pieces[i].first <= pieces[k].last)
                together += pieces[k].bytes;
        if (together > floor)
            floor = together;
    }
    return floor;
}

static void check_plan(const hada_piece *pieces, int count, const hada_arenas *arenas, size_t largest)
{
    for (int i = 0; i < count; i++) {
        const hada_piece *a = &pieces[i];
        assert_in_range(a->arena, 0, arenas->count - 1);
        assert_int_equal(a->offset % ALIGNMENT, 0);
        assert_true(a->offset + a->bytes <= arenas->bytes[a->arena]);
        for (int k = 0; k < i; k++) {
            const hada_piece *b = &pieces[k];
            if (a->arena != b->arena || a->last < b->first || b->last < a->first)
                continue;
            assert_true(a->offset + a->bytes <= b->offset || b->offset + b->bytes <= a->offset);
        }
    }
    for (int i = 0; i < arenas->count; i++)
        assert_true(arenas->bytes[i] <= largest);
}

TEST(random_sets_never_overlap_and_stay_near_the_floor)
{
    hada_piece pieces[MOST];
    hada_random random;
    double ratio = 0.0;
    enum { SETS = 400 };
    hada_random_seed(&random, 1, 0);
    for (int set = 0; set < SETS; set++) {
        hada_arenas arenas;
        const int count = fill_random(pieces, &random);
        ASSERT_OK(hada_lifetimes_plan(pieces, count, ALIGNMENT, SIZE_MAX / 4, &arenas, err));
        check_plan(pieces, count, &arenas, SIZE_MAX / 4);
        assert_int_equal(arenas.count, 1);
        const size_t floor = least_bytes(pieces, count);
        assert_true(arenas.bytes[0] >= floor);
        assert_true(arenas.bytes[0] <= floor + floor / 2 + MOST * ALIGNMENT);
        ratio += floor ? (double)arenas.bytes[0] / (double)floor / SETS : 1.0 / SETS;
        hada_arenas_free(&arenas);
    }
    assert_true(ratio < 1.10);
}

TEST(no_buffer_is_larger_than_the_device_takes)
{
    hada_piece pieces[MOST];
    hada_random random;
    int split = 0;
    hada_random_seed(&random, 2, 0);
    for (int set = 0; set < 200; set++) {
        hada_arenas arenas;
        const int count = fill_random(pieces, &random);
        ASSERT_OK(hada_lifetimes_plan(pieces, count, ALIGNMENT, 150000, &arenas, err));
        check_plan(pieces, count, &arenas, 150000);
        split += arenas.count > 1;
        hada_arenas_free(&arenas);
    }
    assert_true(split > 50);
}

TEST(a_chain_needs_two_pieces_at_once)
{
    hada_piece pieces[20];
    hada_arenas arenas;
    for (int i = 0; i < 20; i++)
        pieces[i] = (hada_piece){.what = "an activation", .bytes = 1280, .first = i, .last = i + 1};
    ASSERT_OK(hada_lifetimes_plan(pieces, 20, ALIGNMENT, SIZE_MAX / 4, &arenas, err));
    assert_int_equal(arenas.count, 1);
    assert_int_equal(arenas.bytes[0], 2560);
    assert_int_equal(least_bytes(pieces, 20), 2560);
    hada_arenas_free(&arenas);
}

TEST(what_cannot_be_is_refused)
{
    hada_arenas arenas;
    hada_piece large = {.what = "the largest level", .bytes = 1000, .first = 0, .last = 3};
    ASSERT_FAILS(hada_lifetimes_plan(&large, 1, ALIGNMENT, 999, &arenas, err), HADA_ERROR_DEVICE_MEMORY,
                 "the largest level");
    assert_null(arenas.bytes);
    hada_piece backwards = {.what = "x", .bytes = 4, .first = 2, .last = 1};
    ASSERT_FAILS(hada_lifetimes_plan(&backwards, 1, ALIGNMENT, 999, &arenas, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_lifetimes_plan(&large, 1, 0, 9999, &arenas, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_OK(hada_lifetimes_plan(NULL, 0, ALIGNMENT, 999, &arenas, err));
    assert_int_equal(arenas.count, 0);
    hada_arenas_free(&arenas);
}
