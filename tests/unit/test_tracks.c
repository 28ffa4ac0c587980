/* Emitters of successive frames joined to tracks: hada_tracker_add(); the assignment that it and evaluations use. */
#include <hadalens/emitters.h>
#include <hadalens/task_evaluate.h>

#include "emitters/assign.h"
#include "testing.h"

enum { MOST = 64 };

static double pick(unsigned *state)
{
    *state = *state * 1664525U + 1013904223U;
    return (double)(*state >> 8) / 0x1p24;
}

/* About normal. */
static double noise(unsigned *state)
{
    double sum = -6.0;
    for (int k = 0; k < 12; k++)
        sum += pick(state);
    return sum;
}

static void add(hada_tracker *tracker, const hada_emitter *list, int count, int *tracks)
{
    const hada_emitter *pointers[MOST];
    for (int i = 0; i < count; i++)
        pointers[i] = &list[i];
    ASSERT_OK(hada_tracker_add(tracker, pointers, count, tracks, err));
}

static hada_emitter at(double x, double y, double z)
{
    return (hada_emitter){.x = x, .y = y, .z = z, .amplitude = 1.0, .sd_x = 0.05, .sd_y = 0.05, .sd_z = 0.2};
}

/* Two emitters meet, as near as errors of places, and go on: as motion that keeps its direction tells. */
TEST(crossing_emitters_keep_their_tracks)
{
    hada_tracker *tracker;
    ASSERT_OK(hada_tracker_create(&tracker, 2.0, 1.0, 0, err));
    for (int frame = 0; frame < 20; frame++) {
        const hada_emitter both[] = {at(1.0 * frame, 10.0 + 0.02 * (frame % 2), 3.0), at(19.6 - frame, 10.0, 3.0)};
        int tracks[2];
        add(tracker, both, 2, tracks);
        assert_int_equal(tracks[0], 0);
        assert_int_equal(tracks[1], 1);
    }
    hada_tracker_destroy(&tracker);
    assert_null(tracker);
}

/* To and fro, nothing is predicted: the nearer place counts. */
TEST(random_motion_goes_by_places)
{
    SCOPED(hada_tracker) * tracker;
    unsigned seed = 5;
    int wrong = 0;
    hada_emitter list[9];
    ASSERT_OK(hada_tracker_create(&tracker, 2.0, 1.0, 0, err));
    for (int i = 0; i < 9; i++)
        list[i] = at(6.0 * (i % 3), 6.0 * (i / 3), 2.0);
    const hada_emitter home[9] = {list[0], list[1], list[2], list[3], list[4], list[5], list[6], list[7], list[8]};
    for (int frame = 0; frame < 200; frame++) {
        int tracks[9];
        add(tracker, list, 9, tracks);
        for (int i = 0; i < 9; i++) {
            wrong += tracks[i] != i;
            list[i].x = home[i].x + 0.3 * noise(&seed);
            list[i].y = home[i].y + 0.3 * noise(&seed);
        }
    }
    if (wrong)
        fail_msg("%d emitters in another track", wrong);
}

/* Missing for as many frames as are bridged, and for one more; another emitter beside it keeps its own track. */
TEST(gaps_are_bridged)
{
    for (int missing = 2; missing <= 3; missing++) {
        SCOPED(hada_tracker) * tracker;
        int tracks[2];
        ASSERT_OK(hada_tracker_create(&tracker, 1.0, 1.0, 2, err));
        for (int frame = 0; frame < 12; frame++) {
            const int off = frame >= 5 && frame < 5 + missing;
            const hada_emitter both[] = {at(7.0, 5.0, 1.0), at(5.0 + 0.2 * frame, 5.5, 1.0)};
            add(tracker, both, off ? 1 : 2, tracks);
            assert_int_equal(tracks[0], 0);
            if (!off)
                assert_int_equal(tracks[1], missing == 3 && frame > 5 ? 2 : 1);
        }
    }
}

/* One that ends and one that begins elsewhere are two; so are two that are farther apart than motion allows, along each
 * axis. Stated deviations widen the gate. */
TEST(what_appears_is_new)
{
    static const struct {
        double x, z, sd;
        int same;
    } cases[] = {{1.9, 0.0, 0.01, 1}, {2.2, 0.0, 0.01, 0}, {2.2, 0.0, 0.1, 1},
                 {0.0, 0.9, 0.01, 1}, {0.0, 1.2, 0.01, 0}, {30.0, 0.0, 0.1, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        SCOPED(hada_tracker) * tracker;
        int track;
        hada_emitter one = at(10.0, 10.0, 4.0);
        one.sd_x = one.sd_y = one.sd_z = cases[i].sd;
        ASSERT_OK(hada_tracker_create(&tracker, 2.0, 1.0, 3, err));
        add(tracker, &one, 1, &track);
        one.x += cases[i].x;
        one.z += cases[i].z;
        add(tracker, &one, 1, &track);
        if ((track == 0) != cases[i].same)
            fail_msg("case %zu: track %d", i, track);
        add(tracker, NULL, 0, NULL);
    }
}

/* At one end of a row an emitter is lost, at the other one appears: they do not all move on by one. */
TEST(one_that_is_lost_moves_no_others)
{
    SCOPED(hada_tracker) * tracker;
    int tracks[5];
    hada_emitter row[6];
    for (int i = 0; i < 6; i++)
        row[i] = at(1.8 * i, 0.0, 0.0);
    ASSERT_OK(hada_tracker_create(&tracker, 2.0, 1.0, 3, err));
    add(tracker, row, 5, tracks);
    add(tracker, row + 1, 5, tracks);
    for (int i = 0; i < 5; i++)
        assert_int_equal(tracks[i], i + 1);
}

TEST(refuses_wrong_numbers)
{
    SCOPED(hada_tracker) * tracker;
    const hada_emitter *none = NULL;
    int track;
    ASSERT_FAILS(hada_tracker_create(&tracker, -1.0, 1.0, 0, err), HADA_ERROR_ARGUMENT, "largest motion");
    ASSERT_FAILS(hada_tracker_create(&tracker, 1.0, NAN, 0, err), HADA_ERROR_ARGUMENT, "largest motion");
    ASSERT_FAILS(hada_tracker_create(&tracker, 1.0, 1.0, -1, err), HADA_ERROR_ARGUMENT, "track_gap");
    ASSERT_FAILS(hada_tracker_add(NULL, &none, 1, &track, err), HADA_ERROR_ARGUMENT, "");
    assert_null(tracker);
}

/* Assignments against trying them all. */

typedef struct costs {
    int cols;
    double values[36];
} costs;

static double cost_of(const void *user, int row, int col)
{
    const costs *all = user;
    return all->values[row * all->cols + col];
}

static double least(const hada_assignment *job, int row, unsigned taken)
{
    if (row == job->rows)
        return 0.0;
    double best = job->apart + least(job, row + 1, taken);
    for (int col = 0; col < job->cols; col++)
        if (!(taken & 1U << col) && job->cost(job->user, row, col) < job->apart)
            best = fmin(best, job->cost(job->user, row, col) + least(job, row + 1, taken | 1U << col));
    return best;
}

TEST(assignments_are_the_best)
{
    unsigned seed = 3;
    for (int trial = 0; trial < 400; trial++) {
        costs all = {.cols = (int)(6.0 * pick(&seed)) + 1};
        const int rows = (int)(6.0 * pick(&seed)) + 1;
        const double full = trial % 2 ? 1.0 : 0.4; /* of the pairs that are possible */
        for (int i = 0; i < rows * all.cols; i++)
            all.values[i] = pick(&seed) < full ? 10.0 * pick(&seed) : 1e6;
        const hada_assignment job = {
            .rows = rows, .cols = all.cols, .cost = cost_of, .user = &all, .apart = trial % 3 ? 6.0 : 1e6};
        int match[6];
        unsigned taken = 0;
        double sum = 0.0;
        ASSERT_OK(hada_assign(&job, match, err));
        for (int row = 0; row < rows; row++) {
            sum += match[row] < 0 ? job.apart : cost_of(&all, row, match[row]);
            assert_true(match[row] < 0 || !(taken & 1U << match[row]));
            taken |= match[row] < 0 ? 0U : 1U << match[row];
        }
        assert_true(fabs(sum - least(&job, 0, 0)) < 1e-6);
    }
}

/* By hand: the first true track is found in 5, missed, in 5 and in 7; the second in 7, 7, 8 and 5. */
TEST(switches_are_counted)
{
    char folder[] = "/tmp/hadalens-tracks-XXXXXX", found[64], truth[64];
    assert_non_null(mkdtemp(folder));
    snprintf(found, sizeof found, "%s/found.csv", folder);
    snprintf(truth, sizeof truth, "%s/truth.csv", folder);
    write_whole_text(found, "track,frame,x,y,z\n5,0,10,10,1\n5,2,10,10,1\n5,3,20,20,1\n7,0,20,20,1\n7,1,20,20,1\n"
                            "7,3,10,10,1\n8,2,20,20,1\n");
    write_whole_text(truth, "frame,track,x,y,z\n3,0,10,10,1\n3,1,20,20,1\n0,0,10,10,1\n0,1,20,20,1\n1,0,10,10,1\n"
                            "1,1,20,20,1\n2,0,10,10,1\n2,1,20,20,1\n");
    hada_evaluate_report *report;
    ASSERT_OK(hada_evaluate_run(&report, found, truth, NULL, err));
    const hada_evaluation *score = hada_evaluate_report_get(report, 0);
    assert_int_equal(score->tracks, 3);
    assert_int_equal(score->tracks_truth, 2);
    assert_true(score->switches == 3.0); /* 0: 5 to 7; 1: 7 to 8, 8 to 5 */
    assert_true(fabs(score->f1 - 14.0 / 15.0) < 1e-12);
    hada_evaluate_report_destroy(&report);
    write_whole_text(truth, "x,y,z\n1,2,3\n");
    ASSERT_OK(hada_evaluate_run(&report, found, truth, NULL, err));
    assert_true(isnan(hada_evaluate_report_get(report, 0)->switches));
    hada_evaluate_report_destroy(&report);
    remove(found);
    remove(truth);
    remove(folder);
}
