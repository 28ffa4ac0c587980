/* The learned ridge regulariser: its size, and a step as kernels take it (refine_ridge.cl, lib/refine/proximal.h). */
#ifndef SHARED_RIDGE_H
#define SHARED_RIDGE_H

#include "shared_types.h"

#if defined(__OPENCL_VERSION__) || defined(__OPENCL_C_VERSION__)
#define HADA_SHARED_TABLE __constant
#else
#define HADA_SHARED_TABLE static const
#endif

/* Steps, each with filters of its own; filters of a step, those that follow each other in a table, pixels of a side. */
#define HADA_RIDGE_STEPS   4
#define HADA_RIDGE_FILTERS 24
#define HADA_RIDGE_SOME    4
#define HADA_RIDGE_SIZE    5
typedef struct hada_ridge_step {
    hada_ulong x_at, before_at, next_at; /* where the images begin, in numbers */
    int rows, cols;
    int number; /* of the step, from 0 */
    int last;   /* 1: negative pixels become 0 */
    float length, momentum;
    float in[HADA_RIDGE_FILTERS], out[HADA_RIDGE_FILTERS]; /* of each filter: a_k and m_k / a_k of refine_ridge.cl */
} hada_ridge_step;
HADA_SHARED_SIZE(hada_ridge_step, 240)

#endif
