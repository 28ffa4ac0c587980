/* Ranks that are threads: each adds up its slice of the arrays of all, in rank order. */
#include <pthread.h>

#include "core/callers.h"

typedef struct member {
    hada_team *team;
    int rank;
    void *values; /* that it brings to an exchange */
    size_t count;
} member;

struct hada_team {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    member *members;
    int count, arrived, aborted;
    unsigned long meeting; /* grows when all have arrived */
};

hada_status hada_team_create(hada_team **out, int count, hada_error *err)
{
    hada_team *team = NULL;
    hada_status status = HADA_OK;
    if (!out || count < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a team has at least one rank");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(team, 1, "a team", err));
    team->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    team->changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    team->count = count;
    HADA_TRY_OR_DONE(HADA_NEW(team->members, (size_t)count, "a team", err));
    for (int i = 0; i < count; i++)
        team->members[i] = (member){.team = team, .rank = i};
done:
    if (status)
        hada_team_destroy(&team);
    *out = team;
    return status;
}

void hada_team_destroy(hada_team **pointer)
{
    hada_team *team = hada_taken(pointer);
    if (!team)
        return;
    pthread_cond_destroy(&team->changed);
    pthread_mutex_destroy(&team->lock);
    HADA_FREE(team->members, team);
}

void hada_team_abort(hada_team *team)
{
    if (!team)
        return;
    pthread_mutex_lock(&team->lock);
    team->aborted = 1;
    pthread_cond_broadcast(&team->changed);
    pthread_mutex_unlock(&team->lock);
}

/* Waits until all ranks have come. */
static hada_status meet(hada_team *team, hada_error *err)
{
    pthread_mutex_lock(&team->lock);
    const unsigned long now = team->meeting;
    if (++team->arrived == team->count) {
        team->arrived = 0;
        team->meeting++;
        pthread_cond_broadcast(&team->changed);
    }
    while (team->meeting == now && !team->aborted)
        pthread_cond_wait(&team->changed, &team->lock);
    const int failed = team->meeting == now;
    pthread_mutex_unlock(&team->lock);
    return failed ? hada_fail(err, HADA_ERROR_STATE, "another rank has failed") : HADA_OK;
}

/* Brings an array, for the others to look at. All ranks must bring as much. */
static hada_status bring(member *own, void *values, size_t count, hada_error *err)
{
    const hada_team *team = own->team;
    own->values = values;
    own->count = count;
    HADA_TRY(meet(own->team, err));
    for (int i = 0; i < team->count; i++)
        if (team->members[i].count != count)
            HADA_TRY(hada_fail(err, HADA_ERROR_STATE, "rank %d brought %zu values to an exchange of %zu", i,
                               team->members[i].count, count));
    return HADA_OK;
}

typedef struct slice {
    size_t begin, end;
} slice;

static slice slice_of(const member *own, size_t count)
{
    const size_t ranks = (size_t)own->team->count, rank = (size_t)own->rank, each = count / ranks, more = count % ranks;
    const size_t begin = rank * each + (rank < more ? rank : more);
    return (slice){begin, begin + each + (rank < more)};
}

static double value_at(const member *own, int floats, size_t i)
{
    return floats ? ((const float *)own->values)[i] : ((const double *)own->values)[i];
}

static void set_value(const member *own, int floats, size_t i, double value)
{
    if (floats)
        ((float *)own->values)[i] = (float)value;
    else
        ((double *)own->values)[i] = value;
}

/* Nobody else touches the slice, in any array. */
static hada_status add_up(member *own, void *values, int floats, size_t count, hada_error *err)
{
    const member *all = own->team->members;
    const slice part = slice_of(own, count);
    HADA_TRY(bring(own, values, count, err));
    for (size_t i = part.begin; i < part.end; i++) {
        double sum = value_at(&all[0], floats, i);
        for (int r = 1; r < own->team->count; r++)
            sum += value_at(&all[r], floats, i);
        for (int r = 0; r < own->team->count; r++)
            set_value(&all[r], floats, i, sum);
    }
    return meet(own->team, err);
}

static hada_status reduce(void *user, double *values, size_t count, hada_error *err)
{
    return add_up(user, values, 0, count, err);
}

static hada_status reduce_floats(void *user, float *values, size_t count, hada_error *err)
{
    return add_up(user, values, 1, count, err);
}

static hada_status broadcast(void *user, int root, void *bytes, size_t count, hada_error *err)
{
    member *own = user;
    if (root < 0 || root >= own->team->count)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no rank %d of %d", root, own->team->count);
    HADA_TRY(bring(own, bytes, count, err));
    if (own->rank != root)
        memcpy(bytes, own->team->members[root].values, count);
    return meet(own->team, err);
}

hada_status hada_team_communicator(hada_team *team, int rank, hada_communicator *out, hada_error *err)
{
    hada_communicator own = {.size = sizeof own, .rank = rank};
    if (!team || !out || rank < 0 || rank >= team->count)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_team_communicator: a team, one of its ranks and out are needed");
    HADA_TRY(HADA_REPORT_CHECK(out, hada_communicator, err));
    own.count = team->count;
    own.user = &team->members[rank];
    own.reduce = reduce;
    own.reduce_floats = reduce_floats;
    own.broadcast = broadcast;
    HADA_REPORT_GIVE(out, &own);
    return HADA_OK;
}
