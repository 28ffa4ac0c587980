/* The search of depth pursuit. Internal to lib/refine. */
#ifndef HADA_REFINE_PURSUIT_SEARCH_H
#define HADA_REFINE_PURSUIT_SEARCH_H

#include "refine/pursuit_sets.h"

/* Searches the frame that the levels were given. On failure *result says nothing. */
hada_status hada_pursuit_search(hada_pursuit *pursuit, hada_pursuit_result *result, hada_error *err);

#endif
