/* Assignment at the least cost, by shortest augmenting paths (R. Jonker and A. Volgenant, Computing 38, 325 (1987)),
 * for each set of rows and columns that possible pairs link. */
#include "emitters/assign.h"

static const char what[] = "an assignment";

/* What all steps share. */
typedef struct memory {
    unsigned char *seen; /* rows, then columns */
    int *lists, *links;
    double *numbers;
} memory;

/* Rows `here` and columns `there`, fewer or more. Columns are assigned to rows where those are more. */
static void assign(const hada_assignment *job, const int *here, int rows, const int *there, int cols,
                   const memory *room, int *match)
{
    const int turned = rows > cols, n = turned ? cols : rows, more = turned ? rows : cols;
    double *u = room->numbers, *v = u + n + 1, *least = v + more + 1;
    int *partner = room->links, *way = partner + more + 1, *used = way + more + 1;
    memset(u, 0, (size_t)(n + 1) * sizeof *u);
    memset(v, 0, (size_t)(more + 1) * sizeof *v);
    memset(partner, 0, (size_t)(more + 1) * sizeof *partner);
    for (int i = 1; i <= n; i++) {
        int at = 0;
        partner[0] = i;
        for (int j = 0; j <= more; j++) {
            least[j] = INFINITY;
            used[j] = 0;
        }
        do {
            int next = 0;
            double smallest = INFINITY;
            used[at] = 1;
            for (int j = 1; j <= more; j++) {
                const int a = partner[at] - 1, b = j - 1;
                if (used[j])
                    continue;
                const double cost =
                    turned ? job->cost(job->user, here[b], there[a]) : job->cost(job->user, here[a], there[b]);
                const double now = fmin(cost, job->apart) - u[partner[at]] - v[j];
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
                    u[partner[j]] += smallest;
                    v[j] -= smallest;
                } else {
                    least[j] -= smallest;
                }
            at = next;
        } while (partner[at]);
        for (; at; at = way[at])
            partner[at] = partner[way[at]];
    }
    for (int j = 1; j <= more; j++) {
        if (!partner[j])
            continue;
        const int row = turned ? here[j - 1] : here[partner[j] - 1],
                  col = turned ? there[partner[j] - 1] : there[j - 1];
        if (job->cost(job->user, row, col) < job->apart)
            match[row] = col;
    }
}

/* The set that `here`'s first row is in; returns its rows, and its columns in *cols. */
static int gather(const hada_assignment *job, const memory *room, int *here, int *there, int *cols)
{
    unsigned char *seen = room->seen, *seen_cols = seen + job->rows;
    int rows = 1;
    *cols = 0;
    for (int a = 0, b = 0; a < rows || b < *cols;) {
        if (a < rows) {
            for (int col = 0; col < job->cols; col++)
                if (!seen_cols[col] && job->cost(job->user, here[a], col) < job->apart) {
                    seen_cols[col] = 1;
                    there[(*cols)++] = col;
                }
            a++;
        } else {
            for (int row = 0; row < job->rows; row++)
                if (!seen[row] && job->cost(job->user, row, there[b]) < job->apart) {
                    seen[row] = 1;
                    here[rows++] = row;
                }
            b++;
        }
    }
    return rows;
}

hada_status hada_assign(const hada_assignment *job, int *match, hada_error *err)
{
    const size_t both = (size_t)job->rows + (size_t)job->cols;
    memory room = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(room.seen, both + 1, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(room.lists, both + 1, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(room.links, 3 * (both + 1), what, err));
    HADA_TRY_OR_DONE(HADA_NEW(room.numbers, 3 * (both + 1), what, err));
    int *here = room.lists, *there = here + job->rows, cols;
    for (int row = 0; row < job->rows; row++)
        match[row] = -1;
    for (int first = 0; first < job->rows; first++) {
        if (room.seen[first])
            continue;
        room.seen[first] = 1;
        here[0] = first;
        const int rows = gather(job, &room, here, there, &cols);
        if (cols)
            assign(job, here, rows, there, cols, &room, match);
    }
done:
    HADA_FREE(room.seen, room.lists, room.links, room.numbers);
    return status;
}
