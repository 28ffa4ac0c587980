/* The plane of a known depth as reconstruction gives it: refined where the model refines, else linear. Internal.
 *
 * For training a net behind filters that stay as they are. A maker belongs to a slot. `composes`: 1 where frames become
 * those of scenes of several depths on their way; the model has transfer functions then. others: 1 where the net sees
 * beside a plane what the other planes of its scene hold (net/enhance.h). */
#ifndef HADA_TRAIN_PLANES_H
#define HADA_TRAIN_PLANES_H

#include <hadalens/model.h>

#include "runtime/slot.h"
#include "train/compose.h"

typedef struct hada_planes hada_planes;
hada_status hada_planes_bytes(const hada_context *context, const hada_model *model, int composes, size_t *bytes,
                              hada_error *err);
hada_status hada_planes_create(hada_planes **out, hada_slot *slot, const hada_model *model, int composes, int others,
                               hada_error *err);
void hada_planes_destroy(hada_planes **planes);

/* `raw` has the model's raw size; its dark level is taken off here as the model says. composed (count 0: the frame is
 * as it was captured) is put into it first; refinement then knows its depths. *out is created by the call where it is
 * empty: channels x window, twice as many with the others beside. */
hada_status hada_planes_make(hada_planes *planes, int depth, hada_image *raw, const hada_composed *composed,
                             hada_image *out, hada_error *err);

#endif
