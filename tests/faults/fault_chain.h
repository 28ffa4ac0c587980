/* Which calls are worth failing: one of each chain of callers, or so many that every call on the way to one has failed
 * once. Faster than failing every one, and misses little: what differs between two calls of one place is data. */
#ifndef HADA_TESTS_FAULT_CHAIN_H
#define HADA_TESTS_FAULT_CHAIN_H

#include <stdint.h>

enum { FAULT_MOST_CHAINS = 1 << 14 };

typedef enum fault_choice {
    FAULT_SPREAD = 0, /* so many, evenly spread; or all */
    FAULT_CHAINS,
    FAULT_SITES
} fault_choice;

/* The numbers of the calls that were chosen, in ascending order. */
typedef struct fault_chains {
    int count, known;
    long first[FAULT_MOST_CHAINS];
    uint64_t seen[2 * FAULT_MOST_CHAINS]; /* open addressing; 0 is free */
} fault_chains;

/* What FAULT_RUNS says. */
fault_choice fault_choice_asked(void);

/* Calls that are counted from now on are noted in an empty list; NULL: no more. */
void fault_chains_listen(fault_chains *to, fault_choice choice);

#endif
