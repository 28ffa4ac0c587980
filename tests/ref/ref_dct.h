/* Reference of the shrinkage of cosine transforms of overlapping blocks, in double precision. Internal. */
#ifndef HADA_REF_DCT_H
#define HADA_REF_DCT_H

#include "core/base.h"

/* An image [channel][rows][cols]: channels apart by an orthonormal DCT-II over them; blocks of 8 x 8 that begin at
 * every even row and column, the edge's pixels repeated beyond it; of each block's DCT-II every coefficient T but the
 * mean becomes T max(0, 1 - t^2 / T^2), t the threshold, times `colour` for all channels but the first; a pixel is the
 * mean of the blocks that hold it; back to channels, max(0, ...). (O. Guleryuz, IEEE TIP 16(12), 2007; H.-Y. Gao, JCGS
 * 7(4), 1998.) */
hada_status hada_ref_dct_shrink(const double *image, int channels, int rows, int cols, double threshold, double colour,
                                double *out, hada_error *err);

#endif
