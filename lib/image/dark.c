#include "image/dark.h"

#include <string.h>

#include "image/rank.h"

double hada_dark_estimate(const float *pixels, size_t count, float *room)
{
    memcpy(room, pixels, count * sizeof *room);
    return hada_select_rank(room, count, (count - 1) / 100);
}
