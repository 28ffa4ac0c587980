/* Tables of emitters against the truth: which belong together, and how far they are off. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/input.h"
#include "io/text.h"
#include "tasks/evaluate.h"

static const char what[] = "a table of emitters";
enum { MOST_BYTES = 1 << 30 };
/* What two emitters cost that are too far apart; pairs within the gate cost 2 at most. */
#define APART 1e6

typedef struct row {
    double frame, at[3]; /* x, y, z */
} row;

typedef struct rows {
    row *list;
    int count;
} rows;

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
    static const char *const names[] = {"frame", "x", "y", "z"};
    int columns[HADA_COUNT(names)], lines = 0;
    for (size_t k = 0; k < HADA_COUNT(names); k++) {
        columns[k] = find_column(text, names[k]);
        if (k && columns[k] < 0)
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
        for (int k = 0; k < 3; k++)
            good = good && read_field(line, columns[k + 1], &one->at[k]);
        if (!good)
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: line %d has no numbers for its columns", path, number);
        out->count++;
    }
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
    const row *found, *truth;
    double pixels, depths; /* the gate */
    int pairs;
    double lateral, axial; /* sums of squares */
} matching;

static double cost(const matching *m, int found, int truth)
{
    const row *a = &m->found[found], *b = &m->truth[truth];
    const double lateral = hypot(a->at[0] - b->at[0], a->at[1] - b->at[1]) / m->pixels,
                 axial = fabs(a->at[2] - b->at[2]) / m->depths;
    return a->frame == b->frame && lateral <= 1.0 && axial <= 1.0 ? lateral * lateral + axial * axial : APART;
}

/* What all steps share, for so many found and true ones. */
typedef struct memory {
    unsigned char *seen; /* found ones, then true ones */
    int *lists, *links;
    double *numbers;
} memory;

/* Some found ones and the true ones that belong to them, fewer or more: the assignment of least cost by shortest
 * augmenting paths (R. Jonker and A. Volgenant, Computing 38, 325 (1987)). */
static void assign(matching *m, const int *found, int founds, const int *truth, int truths, const memory *room)
{
    const int turned = founds > truths, n = turned ? truths : founds, more = turned ? founds : truths;
    double *u = room->numbers, *v = u + n + 1, *least = v + more + 1;
    int *match = room->links, *way = match + more + 1, *used = way + more + 1;
    memset(u, 0, (size_t)(n + 1) * sizeof *u);
    memset(v, 0, (size_t)(more + 1) * sizeof *v);
    memset(match, 0, (size_t)(more + 1) * sizeof *match);
    for (int i = 1; i <= n; i++) {
        int at = 0;
        match[0] = i;
        for (int j = 0; j <= more; j++) {
            least[j] = INFINITY;
            used[j] = 0;
        }
        do {
            int next = 0;
            double smallest = INFINITY;
            used[at] = 1;
            for (int j = 1; j <= more; j++) {
                const int a = match[at] - 1, b = j - 1;
                if (used[j])
                    continue;
                const double now =
                    (turned ? cost(m, found[b], truth[a]) : cost(m, found[a], truth[b])) - u[match[at]] - v[j];
                if (now < least[j]) {
                    least[j] = now;
                    way[j] = at;
                }
                if (least[j] < smallest) {
                    smallest = least[j];
                    next = j;
                }
            }
            for (int j = 0; j <= more; j++)
                if (used[j]) {
                    u[match[j]] += smallest;
                    v[j] -= smallest;
                } else {
                    least[j] -= smallest;
                }
            at = next;
        } while (match[at]);
        for (; at; at = way[at])
            match[at] = match[way[at]];
    }
    for (int j = 1; j <= more; j++) {
        if (!match[j])
            continue;
        const int a = turned ? found[j - 1] : found[match[j] - 1], b = turned ? truth[match[j] - 1] : truth[j - 1];
        if (cost(m, a, b) >= APART)
            continue;
        for (int k = 0; k < 2; k++)
            m->lateral += (m->found[a].at[k] - m->truth[b].at[k]) * (m->found[a].at[k] - m->truth[b].at[k]);
        m->axial += (m->found[a].at[2] - m->truth[b].at[2]) * (m->found[a].at[2] - m->truth[b].at[2]);
        m->pairs++;
    }
}

/* Those that are linked by pairs within the gate are assigned together. */
static void assign_all(matching *m, const rows *found, const rows *truth, const memory *room)
{
    unsigned char *seen = room->seen, *seen_truth = seen + found->count;
    int *here = room->lists, *there = here + found->count;
    for (int first = 0; first < found->count; first++) {
        int founds = 1, truths = 0;
        if (seen[first])
            continue;
        here[0] = first;
        seen[first] = 1;
        for (int a = 0, b = 0; a < founds || b < truths;) {
            if (a < founds) {
                for (int t = 0; t < truth->count; t++)
                    if (!seen_truth[t] && cost(m, here[a], t) < APART) {
                        seen_truth[t] = 1;
                        there[truths++] = t;
                    }
                a++;
            } else {
                for (int f = 0; f < found->count; f++)
                    if (!seen[f] && cost(m, f, there[b]) < APART) {
                        seen[f] = 1;
                        here[founds++] = f;
                    }
                b++;
            }
        }
        if (truths)
            assign(m, here, founds, there, truths, room);
    }
}

hada_status hada_evaluate_emitters(hada_evaluation *one, const hada_evaluate_task *by, hada_error *err)
{
    rows found = {0}, truth = {0};
    memory room = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(read_table(&found, one->result, err));
    HADA_TRY_OR_DONE(read_table(&truth, one->truth, err));
    const size_t both = (size_t)found.count + (size_t)truth.count;
    HADA_TRY_OR_DONE(HADA_NEW(room.seen, both + 1, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(room.lists, both + 1, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(room.links, 3 * (both + 1), what, err));
    HADA_TRY_OR_DONE(HADA_NEW(room.numbers, 3 * (both + 1), what, err));
    matching m = {.found = found.list, .truth = truth.list, .pixels = by->gate_pixels, .depths = by->gate_depths};
    assign_all(&m, &found, &truth, &room);
    one->emitters = found.count;
    one->emitters_truth = truth.count;
    one->recall = truth.count ? (double)m.pairs / truth.count : NAN;
    one->precision = found.count ? (double)m.pairs / found.count : NAN;
    one->f1 = both ? 2.0 * m.pairs / (double)both : NAN;
    one->jaccard = both ? m.pairs / ((double)both - m.pairs) : NAN;
    one->lateral_rmse = m.pairs ? sqrt(m.lateral / m.pairs) : NAN;
    one->axial_rmse = m.pairs ? sqrt(m.axial / m.pairs) : NAN;
done:
    HADA_FREE(found.list, truth.list, room.seen, room.lists, room.links, room.numbers);
    return status;
}
