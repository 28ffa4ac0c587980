/* Tables of emitters against the truth: which belong together, and how far they are off. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "core/input.h"
#include "emitters/assign.h"
#include "io/text.h"
#include "tasks/evaluate.h"

static const char what[] = "a table of emitters";
enum { MOST_BYTES = 1 << 30, FIRST = 2 }; /* FIRST: column that a table must have */
/* What two emitters cost that are too far apart; pairs within the gate cost 2 at most. */
#define APART 1e6

typedef struct row {
    double frame, track, at[3]; /* x, y, z */
    int line;
} row;

typedef struct rows {
    row *list;
    int count, has_tracks;
} rows;

static int by_frame(const void *a, const void *b)
{
    const row *one = a, *other = b;
    const int order = (one->frame > other->frame) - (one->frame < other->frame);
    return order ? order : (one->line > other->line) - (one->line < other->line);
}

/* The number of the column of this name in a header, -1: there is none. */
static int find_column(const char *header, const char *name)
{
    const size_t length = strlen(name);
    int column = 0;
    for (const char *at = header;; column++) {
        const size_t field = strcspn(at, ",\r\n");
        if (field == length && !strncmp(at, name, length))
            return column;
        if (at[field] != ',')
            return -1;
        at += field + 1;
    }
}

/* The number in a column of a line. */
static int read_field(const char *line, int column, double *value)
{
    const char *end;
    for (; column; column--) {
        line += strcspn(line, ",\r\n");
        if (*line++ != ',')
            return 0;
    }
    *value = hada_text_number(line, &end);
    return end > line && isfinite(*value);
}

static hada_status parse(rows *out, const char *text, const char *path, hada_error *err)
{
    static const char *const names[] = {"frame", "track", "x", "y", "z"};
    int columns[HADA_COUNT(names)], lines = 0;
    for (size_t k = 0; k < HADA_COUNT(names); k++) {
        columns[k] = find_column(text, names[k]);
        if (k >= FIRST && columns[k] < 0)
            return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                             "%s has no column '%s' in its first line: a table of emitters has x, y and z, separated "
                             "by commas",
                             path, names[k]);
    }
    for (const char *at = text; (at = strchr(at, '\n')); at++)
        lines++;
    HADA_TRY(HADA_NEW(out->list, (size_t)lines + 1, what, err));
    int number = 1;
    for (const char *line = strchr(text, '\n'); line; line = strchr(line, '\n')) {
        row *one = &out->list[out->count];
        line++;
        number++;
        if (!line[strspn(line, " \r\n")])
            break;
        int good = columns[0] < 0 || read_field(line, columns[0], &one->frame);
        good = good && (columns[1] < 0 || read_field(line, columns[1], &one->track));
        for (int k = 0; k < 3; k++)
            good = good && read_field(line, columns[FIRST + k], &one->at[k]);
        if (!good)
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: line %d has no numbers for its columns", path, number);
        one->line = out->count++;
    }
    out->has_tracks = columns[1] >= 0;
    if (out->count)
        qsort(out->list, (size_t)out->count, sizeof *out->list, by_frame);
    return HADA_OK;
}

static hada_status read_table(rows *out, const char *path, hada_error *err)
{
    char *text = NULL;
    size_t bytes;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_input_read(&text, &bytes, path, MOST_BYTES, NULL, err));
    HADA_TRY_OR_DONE(parse(out, text, path, err));
done:
    free(text);
    return status;
}

typedef struct matching {
    const row *found, *truth; /* of a frame */
    double pixels, depths;    /* the gate */
    int pairs;
    double lateral, axial; /* sums of squares */
} matching;

static double cost(const void *user, int found, int truth)
{
    const matching *m = user;
    const row *a = &m->found[found], *b = &m->truth[truth];
    const double lateral = hypot(a->at[0] - b->at[0], a->at[1] - b->at[1]) / m->pixels,
                 axial = fabs(a->at[2] - b->at[2]) / m->depths;
    return lateral <= 1.0 && axial <= 1.0 ? lateral * lateral + axial * axial : APART;
}

/* Numbers of tracks, each once, ascending; returns how many. */
static int tracks_of(const rows *all, double *numbers)
{
    int count = 0;
    for (int i = 0; i < all->count; i++)
        numbers[i] = all->list[i].track;
    if (all->count)
        qsort(numbers, (size_t)all->count, sizeof *numbers, hada_ascending);
    for (int i = 0; i < all->count; i++)
        if (!count || numbers[i] != numbers[count - 1])
            numbers[count++] = numbers[i];
    return count;
}

/* The true tracks, and the found one that each was in when it was last found. */
typedef struct identities {
    double *numbers, *found;
    int count, switches;
} identities;

static void follow(identities *ids, const row *found, const row *truth)
{
    const double *at = bsearch(&truth->track, ids->numbers, (size_t)ids->count, sizeof *at, hada_ascending);
    double *last = &ids->found[at - ids->numbers];
    ids->switches += !isnan(*last) && *last != found->track;
    *last = found->track;
}

/* The rows of the frame that row `first` is of. */
static int rows_of_frame(const rows *all, int first)
{
    int count = 0;
    while (first + count < all->count && all->list[first + count].frame == all->list[first].frame)
        count++;
    return count;
}

/* Frame by frame; ids: NULL where there are no tracks. */
static hada_status assign_all(matching *m, const rows *found, const rows *truth, int *match, identities *ids,
                              hada_error *err)
{
    for (int f = 0, t = 0; f < found->count && t < truth->count;) {
        const int founds = rows_of_frame(found, f), truths = rows_of_frame(truth, t);
        m->found = &found->list[f];
        m->truth = &truth->list[t];
        const hada_assignment job = {.rows = founds, .cols = truths, .cost = cost, .user = m, .apart = APART};
        const double frame = m->found->frame, other = m->truth->frame;
        if (frame == other)
            HADA_TRY(hada_assign(&job, match, err));
        for (int i = 0; frame == other && i < founds; i++) {
            if (match[i] < 0)
                continue;
            const row *a = &m->found[i], *b = &m->truth[match[i]];
            for (int k = 0; k < 2; k++)
                m->lateral += (a->at[k] - b->at[k]) * (a->at[k] - b->at[k]);
            m->axial += (a->at[2] - b->at[2]) * (a->at[2] - b->at[2]);
            m->pairs++;
            if (ids)
                follow(ids, a, b);
        }
        f += frame <= other ? founds : 0;
        t += frame >= other ? truths : 0;
    }
    return HADA_OK;
}

/* Tracks that have lines, where both tables have a column of them. */
static hada_status prepare(identities *ids, hada_evaluation *one, const rows *found, const rows *truth, hada_error *err)
{
    HADA_TRY(HADA_NEW(ids->numbers, (size_t)truth->count + 1, what, err));
    HADA_TRY(HADA_NEW(ids->found, (size_t)(found->count > truth->count ? found->count : truth->count) + 1, what, err));
    one->tracks = tracks_of(found, ids->found);
    one->tracks_truth = ids->count = tracks_of(truth, ids->numbers);
    for (int i = 0; i < ids->count; i++)
        ids->found[i] = NAN;
    return HADA_OK;
}

hada_status hada_evaluate_emitters(hada_evaluation *one, const hada_evaluate_task *by, hada_error *err)
{
    rows found = {0}, truth = {0};
    identities ids = {0};
    int *match = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(read_table(&found, one->result, err));
    HADA_TRY_OR_DONE(read_table(&truth, one->truth, err));
    const size_t both = (size_t)found.count + (size_t)truth.count;
    HADA_TRY_OR_DONE(HADA_NEW(match, (size_t)found.count + 1, what, err));
    matching m = {.pixels = by->gate_pixels, .depths = by->gate_depths};
    const int tracks = found.has_tracks && truth.has_tracks;
    if (tracks)
        HADA_TRY_OR_DONE(prepare(&ids, one, &found, &truth, err));
    HADA_TRY_OR_DONE(assign_all(&m, &found, &truth, match, tracks ? &ids : NULL, err));
    one->emitters = found.count;
    one->emitters_truth = truth.count;
    one->recall = truth.count ? (double)m.pairs / truth.count : NAN;
    one->precision = found.count ? (double)m.pairs / found.count : NAN;
    one->f1 = both ? 2.0 * m.pairs / (double)both : NAN;
    one->jaccard = both ? m.pairs / ((double)both - m.pairs) : NAN;
    one->lateral_rmse = m.pairs ? sqrt(m.lateral / m.pairs) : NAN;
    one->axial_rmse = m.pairs ? sqrt(m.axial / m.pairs) : NAN;
    one->switches = tracks ? (double)ids.switches : (double)NAN;
done:
    HADA_FREE(found.list, truth.list, match, ids.numbers, ids.found);
    return status;
}
