/* Tracks: emitters of successive frames that are the same one. Each track predicts where its emitter is next, and the
 * frame's emitters are assigned to the predictions together, at the least sum of squared distances in units of what is
 * expected (D. B. Reid, IEEE Trans. Autom. Control 24(6), 843 (1979), with one hypothesis; the assignment of K. Jaqaman
 * et al., Nature Methods 5, 695 (2008)). */
#include "emitters/assign.h"
#include "emitters/emitters.h"

static const char what[] = "tracks";
enum { AXES = 3 };
/* The largest motion is so many standard deviations of a motion, and the error of a place goes as far. */
#define LARGEST 3.0
/* What a track without its emitter costs, in squared deviations: a pair at the edge of both gates costs less. */
#define APART (2.0 * LARGEST * LARGEST + 6.0)
/* Frames over which motion is averaged. */
#define LASTS 4.0
/* Deviations of places, in pixels and depths, below which two are the same. */
#define LEAST_DEVIATION 1e-3

typedef struct track {
    int number, frame; /* frame: the last one with its emitter */
    double at[AXES], variance[AXES];
    double motion[AXES];  /* a frame */
    int motions;          /* that it is the mean of */
    double goes_on, size; /* sums over frames: motion times the mean before, and the latter's square */
} track;

struct hada_tracker {
    double largest[AXES]; /* motion from frame to frame */
    int gap;
    int frame, count, live;
    track *tracks;
};

static double square(double value)
{
    return value * value;
}

/* What is not known adds nothing. */
static void place_of(const hada_emitter *from, double *at, double *variance)
{
    const double places[AXES] = {from->x, from->y, from->z}, sd[AXES] = {from->sd_x, from->sd_y, from->sd_z};
    for (int k = 0; k < AXES; k++) {
        at[k] = places[k];
        variance[k] = isfinite(sd[k]) ? square(sd[k]) : 0.0;
    }
}

/* The share of its mean motion with which a track goes on: none where it moves to and fro, all where it moves straight.
 * That of least squares, with one frame's motion in favour of none. */
static double persistence(const track *one)
{
    return fmin(fmax(one->goes_on / (one->size + 1.0 / square(LARGEST)), 0.0), 1.0);
}

typedef struct look {
    const hada_tracker *tracker;
    const hada_emitter *const *emitters;
} look;

/* The gate is around the track's last place: so far it may have moved, and the places' errors allow. */
static double cost(const void *user, int row, int col)
{
    const look *by = user;
    const track *one = &by->tracker->tracks[row];
    const double *largest = by->tracker->largest, share = persistence(one);
    const int frames = by->tracker->frame - one->frame;
    double at[AXES], variance[AXES], off[AXES], allowed[AXES], sum = 0.0;
    place_of(by->emitters[col], at, variance);
    for (int k = 0; k < AXES; k++) {
        const double places = one->variance[k] + variance[k] + square(LEAST_DEVIATION),
                     expected = places + frames * square(largest[k] / LARGEST);
        off[k] = at[k] - one->at[k];
        allowed[k] = frames * largest[k] + LARGEST * sqrt(places);
        sum += square(off[k] - share * frames * one->motion[k]) / expected +
               log(expected / (places + square(largest[k] / LARGEST)));
    }
    const double lateral = hypot(off[0], off[1]) - fmax(allowed[0], allowed[1]), axial = fabs(off[2]) - allowed[2];
    return lateral <= 0.0 && axial <= 0.0 ? sum : APART;
}

static void go_on(const hada_tracker *own, track *one, const double *at, const double *variance)
{
    const int frames = own->frame - one->frame;
    one->motions++;
    for (int k = 0; k < AXES; k++) {
        const double motion = (at[k] - one->at[k]) / frames;
        if (own->largest[k] > 0.0) {
            one->goes_on += motion * one->motion[k] / square(own->largest[k]);
            one->size += square(one->motion[k] / own->largest[k]);
        }
        one->motion[k] += (motion - one->motion[k]) / fmin(one->motions, LASTS);
        one->at[k] = at[k];
        one->variance[k] = variance[k];
    }
    one->frame = own->frame;
}

hada_status hada_tracker_create(hada_tracker **out, double pixels, double depths, int gap, hada_error *err)
{
    HADA_NEED(out, err);
    *out = NULL;
    if (!(pixels >= 0.0 && pixels < INFINITY && depths >= 0.0 && depths < INFINITY))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.track_pixels, options.track_depths: the largest motion is 0 or more, not %g and %g",
                         pixels, depths);
    if (gap < 0)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.track_gap: frames without an emitter are 0 or more, not %d",
                         gap);
    HADA_TRY(HADA_NEW(*out, 1, what, err));
    **out = (hada_tracker){.largest = {pixels, pixels, depths}, .gap = gap};
    return HADA_OK;
}

/* Forgets the tracks that have ended, and has room for those that may begin. */
static hada_status prepare(hada_tracker *own, int more, hada_error *err)
{
    int live = 0;
    for (int i = 0; i < own->live; i++)
        if (own->frame - own->tracks[i].frame <= own->gap + 1)
            own->tracks[live++] = own->tracks[i];
    own->live = live;
    if (more > INT32_MAX - own->count || live > INT32_MAX - more)
        return hada_fail(err, HADA_ERROR_SIZE, "there are more tracks than can be numbered");
    return HADA_GROW(own->tracks, (size_t)live, (size_t)more, what, err);
}

hada_status hada_tracker_add(hada_tracker *own, const hada_emitter *const *emitters, int count, int *tracks,
                             hada_error *err)
{
    int *match = NULL;
    HADA_NEED(own && (!count || (emitters && tracks)) && count >= 0, err);
    HADA_TRY(prepare(own, count, err));
    HADA_TRY(HADA_NEW(match, (size_t)own->live + 1, what, err));
    const look by = {own, emitters};
    const hada_assignment job = {.rows = own->live, .cols = count, .cost = cost, .user = &by, .apart = APART};
    const hada_status status = hada_assign(&job, match, err);
    for (int i = 0; !status && i < count; i++)
        tracks[i] = -1;
    for (int row = 0; !status && row < job.rows; row++) {
        double at[AXES], variance[AXES];
        if (match[row] < 0)
            continue;
        place_of(emitters[match[row]], at, variance);
        go_on(own, &own->tracks[row], at, variance);
        tracks[match[row]] = own->tracks[row].number;
    }
    for (int i = 0; !status && i < count; i++) {
        if (tracks[i] >= 0)
            continue;
        track *one = &own->tracks[own->live++];
        *one = (track){.number = tracks[i] = own->count++, .frame = own->frame};
        place_of(emitters[i], one->at, one->variance);
    }
    own->frame += !status;
    free(match);
    return status;
}

void hada_tracker_destroy(hada_tracker **tracker)
{
    hada_tracker *own = hada_taken(tracker);
    if (own)
        HADA_FREE(own->tracks, own);
}
