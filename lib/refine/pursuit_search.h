/* The pursuit's parts. Internal to lib/refine. */
#ifndef HADA_REFINE_PURSUIT_SEARCH_H
#define HADA_REFINE_PURSUIT_SEARCH_H

#include "refine/pursuit_level.h"

/* Ways to look, from the quickest to the dearest. */
typedef enum hada_pursuit_look {
    HADA_LOOK_ORDER = 0,   /* puts candidates in order */
    HADA_LOOK_JUDGE = 1,   /* decides what is clear */
    HADA_LOOK_PATIENT = 2, /* the same with more steps: larger sets take longer to settle */
    HADA_LOOK_CLOSER = 3,  /* finer */
    HADA_PURSUIT_LOOKS = 4
} hada_pursuit_look;

struct hada_pursuit {
    hada_slot *slot;
    hada_pursuit_options options; /* zeros replaced */
    hada_pursuit_level levels[HADA_PURSUIT_LEVELS];
    int count; /* of levels */
    struct {
        int level, steps;
    } looks[HADA_PURSUIT_LOOKS];
};

/* Searches the frame that the levels have taken. */
hada_status hada_pursuit_search(hada_pursuit *pursuit, hada_pursuit_result *result, hada_error *err);

#endif
