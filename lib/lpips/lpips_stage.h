/* The parts of LPIPS: nets cut at the features that are compared, and the distance of features. Internal. */
#ifndef HADA_LPIPS_LPIPS_STAGE_H
#define HADA_LPIPS_LPIPS_STAGE_H

#include <hadalens/lpips.h>

#include "net/layers.h"
#include "net/weights_file.h"

enum { HADA_LPIPS_STAGES = 5 };

/* The net of a stage as a list, with a file's weights; its output is what is compared, and what the next stage takes.
 * The first one also brings 0 ... 1 to what the backbone was trained with. */
hada_status hada_lpips_stage_make(hada_net **out, hada_lpips_net net, int stage, const hada_tensors *file,
                                  hada_error *err);

/* Channels that a stage gives; its smallest image. */
int hada_lpips_stage_channels(hada_lpips_net net, int stage);
int hada_lpips_least_size(hada_lpips_net net);

/* out[pair][row][col], plain: the weighted squared distance of the features of images p and pairs + p of x, 2 * pairs
 * of them (enqueued). `weights`: one float per channel. The reference is hada_ref_lpips(). */
hada_status hada_lpips_distance(hada_slot *slot, const hada_tensor *x, hada_floats weights, hada_floats out,
                                hada_error *err);

#endif
