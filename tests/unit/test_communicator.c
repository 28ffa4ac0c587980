/* Ranks that are threads: sums in rank order, the same bits everywhere; ranks that fail. */
#include <pthread.h>

#include "core/callers.h"
#include "testing.h"

enum { MOST = 5, COUNT = 1003 };

typedef struct rank {
    hada_communicator communicator;
    double doubles[COUNT];
    float floats[COUNT];
    unsigned char bytes[COUNT];
    hada_team *team;
    hada_status status;
    pthread_t thread;
} rank;

static rank ranks[MOST];
static hada_error refusal;

/* Numbers whose sum depends on the order of adding. */
static double value_of(int r, int i)
{
    return ldexp(1.0 + (double)((i * 7 + r * 13) % 97) / 97.0, (i * 5 + r * 11) % 60 - 30) * ((i + r) % 3 ? 1.0 : -1.0);
}

static void *exchange(void *user)
{
    rank *own = user;
    const hada_communicator *all = &own->communicator;
    for (int i = 0; i < COUNT; i++) {
        own->doubles[i] = value_of(all->rank, i);
        own->floats[i] = (float)value_of(all->rank, i);
        own->bytes[i] = (unsigned char)(all->rank + i);
    }
    own->status = hada_reduce(all, own->doubles, COUNT, NULL);
    own->status = own->status ? own->status : hada_reduce_floats(all, own->floats, COUNT, NULL);
    own->status = own->status ? own->status : hada_broadcast(all, all->count - 1, own->bytes, COUNT, NULL);
    return NULL;
}

static void run_all(hada_team *team, int count, void *(*work)(void *user))
{
    for (int r = 0; r < count; r++) {
        ranks[r] = (rank){.team = team};
        hada_communicator_init(&ranks[r].communicator);
        ASSERT_OK(hada_team_communicator(team, r, &ranks[r].communicator, err));
        assert_int_equal(ranks[r].communicator.rank, r);
        assert_int_equal(ranks[r].communicator.count, count);
    }
    for (int r = 0; r < count; r++)
        assert_int_equal(pthread_create(&ranks[r].thread, NULL, work, &ranks[r]), 0);
    for (int r = 0; r < count; r++)
        pthread_join(ranks[r].thread, NULL);
}

TEST(sums_are_in_rank_order)
{
    for (int count = 1; count <= MOST; count++) {
        hada_team *team;
        ASSERT_OK(hada_team_create(&team, count, err));
        run_all(team, count, exchange);
        for (int i = 0; i < COUNT; i++) {
            double sum = value_of(0, i), of_floats = (float)value_of(0, i);
            for (int r = 1; r < count; r++) {
                sum += value_of(r, i);
                of_floats += (float)value_of(r, i);
            }
            for (int r = 0; r < count; r++) {
                assert_true(ranks[r].status == HADA_OK);
                assert_true(ranks[r].doubles[i] == sum);
                assert_true(ranks[r].floats[i] == (float)of_floats);
                assert_int_equal(ranks[r].bytes[i], (unsigned char)(count - 1 + i));
            }
        }
        hada_team_destroy(&team);
        assert_null(team);
    }
}

static void *fail_or_wait(void *user)
{
    rank *own = user;
    if (own->communicator.rank == 1)
        hada_team_abort(own->team);
    else
        own->status = hada_reduce(&own->communicator, own->doubles, COUNT, NULL);
    return NULL;
}

static void *of_other_sizes(void *user)
{
    rank *own = user;
    own->status = hada_reduce(&own->communicator, own->doubles, own->communicator.rank ? COUNT : 3, NULL);
    return NULL;
}

TEST(ranks_that_fail_end_the_others)
{
    SCOPED(hada_team) * team;
    ASSERT_OK(hada_team_create(&team, 3, err));
    run_all(team, 3, of_other_sizes);
    for (int r = 0; r < 3; r++)
        assert_int_equal(ranks[r].status, HADA_ERROR_STATE);
    run_all(team, 3, fail_or_wait);
    assert_int_equal(ranks[0].status, HADA_ERROR_STATE);
    assert_int_equal(ranks[2].status, HADA_ERROR_STATE);
}

TEST(wrong_calls_are_refused)
{
    SCOPED(hada_team) *team = NULL;
    DEFAULTS(hada_communicator, one);
    assert_int_equal(one.count, 1);
    assert_int_equal(hada_communicator_check(&one, &refusal), HADA_OK);
    assert_int_equal(hada_communicator_check(NULL, &refusal), HADA_OK);
    one.count = 2;
    assert_int_equal(hada_communicator_check(&one, &refusal), HADA_ERROR_ARGUMENT);
    one.rank = 2;
    assert_int_equal(hada_communicator_check(&one, &refusal), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_team_create(&team, 0, &refusal), HADA_ERROR_ARGUMENT);
    ASSERT_OK(hada_team_create(&team, 2, err));
    assert_int_equal(hada_team_communicator(team, 2, &one, &refusal), HADA_ERROR_ARGUMENT);
    ASSERT_OK(hada_team_communicator(team, 1, &one, err));
    assert_int_equal(one.broadcast(one.user, 2, &one, 1, &refusal), HADA_ERROR_ARGUMENT);
    hada_team_destroy(&team);
}

TEST(shares_are_whole)
{
    DEFAULTS(hada_communicator, of);
    for (of.count = 1; of.count < 7; of.count++)
        for (long pieces = 0; pieces < 20; pieces++) {
            long shared = 0, dealt = 0;
            for (of.rank = 0; of.rank < of.count; of.rank++) {
                shared += hada_share_begin(&of, pieces, of.rank + 1) - hada_share_begin(&of, pieces, of.rank);
                for (long n = 0; n < pieces; n++) {
                    dealt += hada_is_mine(&of, n);
                    assert_int_equal(hada_is_mine(&of, n), hada_owner(&of, n) == of.rank);
                }
            }
            assert_int_equal(shared, pieces);
            assert_int_equal(dealt, pieces);
        }
}
