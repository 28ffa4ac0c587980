/* What a replica takes of a pair, made once and kept while there is room. Internal. */
#ifndef HADA_TRAIN_EXAMPLES_H
#define HADA_TRAIN_EXAMPLES_H

#include <hadalens/model.h>
#include <pthread.h>

#include "runtime/slot.h"
#include "train/feed.h"
#include "train/train_pairs.h"

/* The plane of a known depth as reconstruction gives it: refined where the model refines, else linear.
 *
 * For training a net behind filters that stay as they are. A maker belongs to a slot. `composes`: 1 where frames become
 * those of scenes of several depths on their way; the model has transfer functions then. others: 1 where the net sees
 * beside a plane what the other planes of its scene hold (net/enhance.h). */

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

/* input: what hada_sample (train/replica_shape.h) says; scene: the window. */
typedef struct hada_example {
    hada_image input, scene;
} hada_example;

void hada_example_free(hada_example *example);
hada_status hada_example_copy(hada_example *out, const hada_example *example, hada_error *err);

/* Takes the scene over, and the raw frame where the stage needs it. planes: of the worker, NULL where the stage needs
 * none; composed: what becomes of the frame (it is changed then), for planes. */
hada_status hada_example_make(hada_example *out, hada_stage stage, const hada_model_info *info, hada_planes *planes,
                              int depth, hada_image *raw, const hada_composed *composed, hada_image *scene,
                              hada_error *err);

/* Examples of the pairs of a list in their variants (train/feed.h). Any thread may ask and add. */
typedef struct hada_examples {
    pthread_mutex_t lock;
    const hada_dataset *pairs;
    hada_example *kept; /* of every pair and variant; empty: not kept */
    size_t bytes, most;
} hada_examples;

/* `most` bytes are kept at most; 0: nothing. */
hada_status hada_examples_create(hada_examples *examples, const hada_dataset *pairs, size_t most, hada_error *err);
void hada_examples_free(hada_examples *examples);

/* NULL: not kept. What is found stays until the end. */
const hada_example *hada_examples_find(hada_examples *examples, int depth, int pair, int variant);

/* Takes the example over where there is room (it is empty then), and returns the kept one; NULL: no room. */
const hada_example *hada_examples_add(hada_examples *examples, int depth, int pair, int variant, hada_example *example);

#endif
