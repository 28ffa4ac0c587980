/* What a replica takes of a pair, made once and kept while there is room. Internal. */
#ifndef HADA_TRAIN_EXAMPLES_H
#define HADA_TRAIN_EXAMPLES_H

#include <pthread.h>

#include "train/planes.h"
#include "train/train_pairs.h"

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

/* Examples of the pairs of a list in their variants (train/compose.h). Any thread may ask and add. */
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
