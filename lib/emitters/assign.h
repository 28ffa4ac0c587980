/* Which of some rows and which of some columns belong together, at the least cost. Internal. */
#ifndef HADA_EMITTERS_ASSIGN_H
#define HADA_EMITTERS_ASSIGN_H

#include "core/base.h"

typedef struct hada_assignment {
    int rows, cols;
    double (*cost)(const void *user, int row, int col);
    const void *user;
    double apart; /* pairs that cost so much or more are none; what the lack of a pair costs: more than all pairs
                     together makes as many pairs as possible */
} hada_assignment;

/* match[row]: its column, -1 where it has none. The sum of the costs of pairs, and of `apart` for each row without one,
 * is the least. The same bits whatever runs beside it. */
hada_status hada_assign(const hada_assignment *job, int *match, hada_error *err);

#endif
