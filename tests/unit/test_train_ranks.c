/* Ranks train together: the gradient of one process, and the same bits on every rank, however they exchange. */
#include "testing.h"

#include <pthread.h>

#include "trainer_fixture.h"

enum { RANKS = 2, STEPS = 3 };

typedef struct rank {
    hada_team *team;
    hada_communicator communicator;
    hada_train_options options;
    hada_trainer *trainer;
    double norms[STEPS];
    hada_status status;
    hada_error error;
    pthread_t thread;
} rank;

static void *train(void *user)
{
    rank *own = user;
    hada_step_report report = {.size = sizeof report};
    own->options.communicator = &own->communicator;
    own->status = hada_trainer_create(&own->trainer, &f.part[own->communicator.rank], 1, f.model, pairs, held,
                                      &own->options, &own->error);
    for (int i = 0; i < STEPS && !own->status; i++) {
        own->status = hada_trainer_step(own->trainer, &report, &own->error);
        own->norms[i] = report.norm;
    }
    if (own->status)
        hada_team_abort(own->team);
    return NULL;
}

/* Trains on ranks, and saves what two of them hold: the first in one file; the second, which has to be the same, in the
 * other. */
static void train_together(const hada_train_options *options, int network, double norms[STEPS])
{
    SCOPED(hada_team) * team;
    rank ranks[RANKS];
    ASSERT_OK(hada_team_create(&team, RANKS, err));
    for (int r = 0; r < RANKS; r++) {
        ranks[r] = (rank){.team = team, .options = *options};
        hada_communicator_init(&ranks[r].communicator);
        ASSERT_OK(hada_team_communicator(team, r, &ranks[r].communicator, err));
        assert_int_equal(ranks[r].communicator.network, 0);
        ranks[r].communicator.network = network;
    }
    for (int r = 0; r < RANKS; r++)
        assert_int_equal(pthread_create(&ranks[r].thread, NULL, train, &ranks[r]), 0);
    for (int r = 0; r < RANKS; r++)
        pthread_join(ranks[r].thread, NULL);
    for (int r = 0; r < RANKS; r++) {
        if (ranks[r].status)
            fail_msg("rank %d: %s", r, ranks[r].error.message);
        /* on a CPU buckets are for networks: what comes through memory is exchanged in its place */
        const int cpu = hada_context_device(f.part[r])->kind == HADA_DEVICE_CPU;
        assert_int_equal(ranks[r].trainer->workers.buckets.values != NULL,
                         options->stage != HADA_STAGE_FILTERS && (network || !cpu));
        save(ranks[r].trainer, r);
    }
    assert_true(same_files());
    memcpy(norms, ranks[0].norms, sizeof ranks[0].norms);
    for (int r = 0; r < RANKS; r++)
        hada_trainer_destroy(&ranks[r].trainer);
}

TEST(ranks_train_as_one)
{
    static const hada_stage stages[] = {HADA_STAGE_ENHANCE, HADA_STAGE_FILTERS};
    for (size_t i = 0; i < sizeof stages / sizeof *stages; i++) {
        const hada_train_options options = options_of(stages[i]);
        hada_step_report report = {.size = sizeof report};
        double near[STEPS], far[STEPS];
        hada_trainer *one = make(&options, 1);
        ASSERT_OK(hada_trainer_step(one, &report, err));
        hada_trainer_destroy(&one);
        train_together(&options, 0, near);
        train_together(&options, 1, far);
        assert_memory_equal(near, far, sizeof near);
        /* sums in single precision, in another order */
        assert_true(fabs(near[0] / report.norm - 1.0) < 1e-6);
    }
}

FIXTURE(setup, teardown)
