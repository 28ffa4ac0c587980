/* A plan: what is known of a model and its options, and who works on its frames. Internal. */
#ifndef HADA_DISPATCH_PLAN_H
#define HADA_DISPATCH_PLAN_H

#include "dispatch/dispatcher.h"
#include "dispatch/frame_cache.h"

struct hada_plan {
    hada_setup setup;
    hada_frame_cache cache;
    hada_constants **constants; /* one a context */
    int contexts;
    hada_dispatcher *dispatcher;
};

#endif
