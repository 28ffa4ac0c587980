/* The plane of a known depth as reconstruction gives it: refined where the model refines, else linear. Internal.
 *
 * For training a net behind filters that stay as they are. A maker belongs to a slot. */
#ifndef HADA_TRAIN_PLANES_H
#define HADA_TRAIN_PLANES_H

#include <hadalens/model.h>

#include "runtime/slot.h"

typedef struct hada_planes hada_planes;
hada_status hada_planes_bytes(const hada_context *context, const hada_model *model, size_t *bytes, hada_error *err);
hada_status hada_planes_create(hada_planes **out, hada_slot *slot, const hada_model *model, hada_error *err);
void hada_planes_destroy(hada_planes **planes);

/* `raw` has the model's raw size; its dark level is taken off here as the model says. *out is created by the call where
 * it is empty: channels x window. */
hada_status hada_planes_make(hada_planes *planes, int depth, const hada_image *raw, hada_image *out, hada_error *err);

#endif
