/* Where the values of an axis stand on another one: exact fractions (net_resize.cl tells the rules). */
#ifndef INC_RESIZE_H
#define INC_RESIZE_H

#include "shared_net.h"

#ifndef NET_INLINE
#define NET_INLINE static inline __attribute__((always_inline))
#endif

/* index + rest / whole */
typedef struct net_at {
    int index, rest, whole;
} net_at;

NET_INLINE net_at net_at_of(int i, int in, int out, int rule)
{
    net_at at;
    int number;
    if (rule == HADA_RESIZE_ALIGNED) {
        number = i * (in - 1);
        at.whole = max(out - 1, 1);
    } else if (rule == HADA_RESIZE_FLOOR) {
        number = i * in;
        at.whole = out;
    } else {
        number = (2 * i + 1) * in - out;
        at.whole = 2 * out;
    }
    at.index = number < 0 ? -1 : number / at.whole; /* above -1 always */
    at.rest = number - at.index * at.whole;
    return at;
}

/* What `steps` values further along the output adds. */
NET_INLINE net_at net_step_of(int steps, int in, int out, int rule)
{
    net_at step;
    const int number = steps * (rule == HADA_RESIZE_ALIGNED ? in - 1 : rule == HADA_RESIZE_FLOOR ? in : 2 * in);
    step.whole = rule == HADA_RESIZE_ALIGNED ? max(out - 1, 1) : rule == HADA_RESIZE_FLOOR ? out : 2 * out;
    step.index = number / step.whole;
    step.rest = number - step.index * step.whole;
    return step;
}

NET_INLINE net_at net_walk(net_at at, net_at step)
{
    at.rest += step.rest;
    const int carry = at.rest >= at.whole;
    at.index += step.index + carry;
    at.rest -= carry ? at.whole : 0;
    return at;
}

#endif
