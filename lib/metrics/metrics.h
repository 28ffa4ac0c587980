/* Measures of a pair of images: the check of the pair, and structural similarity with several peaks and masks at once.
 * Internal. */
#ifndef HADA_METRICS_METRICS_H
#define HADA_METRICS_METRICS_H

#include <hadalens/image.h>
#include <hadalens/lpips.h>
#include <hadalens/monitor.h>

#include "net/tensor.h"

/* The data range, in peaks, that the code of Tian and Yang 2022 reckons with. */
#define HADA_AUTHORS_RANGE 2.0

/* One way to judge: HADA_METRIC_SSIM describes it. */
typedef struct hada_similarity {
    double peak;
    const unsigned char *mask; /* NULL: all pixels */
    double mean;               /* found */
    size_t pixels;             /* of the mask, within the inner part; 0: the mean is not known */
} hada_similarity;

/* Fills in `count` of them. The local means, which take the time, are made once for all. */
hada_status hada_similarities(const hada_image *a, const hada_image *b, hada_similarity *list, int count,
                              hada_error *err);

/* out[pair][row][col], plain: the weighted squared distance of the features of images p and pairs + p of x, 2 * pairs
 * of them (enqueued). `weights`: one float per channel. The reference is hada_ref_lpips(). */
hada_status hada_lpips_distance(hada_slot *slot, const hada_tensor *x, hada_floats weights, hada_floats out,
                                hada_error *err);

/* From now on the monitor is asked within a comparison, which may take long. NULL: nobody is asked. */
void hada_lpips_watch(hada_lpips *lpips, const hada_monitor *monitor);

#endif
