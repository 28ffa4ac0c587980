/* A net's list of layers in double precision, forward: definitions as loops, one layer after the other, nothing shared
 * and nothing done at once. Internal, for tests; what the gradients of a whole net are held against by differences.
 *
 * Sources: torch.nn.functional conv2d, conv_transpose2d, max_pool2d, avg_pool2d, interpolate (nearest; bilinear and
 * bicubic with a = -0.75), batch_norm, linear. Dropout lets everything through. */
#ifndef HADA_REF_NET_H
#define HADA_REF_NET_H

#include "netlist/net_list.h"

/* x [images][channels][rows][cols] of the caller's channels (colours times the net's), y likewise; values as
 * net->values, where running statistics are read (training 0) or left alone (training 1: batch norms take the batch's
 * mean and variance). */
hada_status hada_ref_net_forward(const hada_net *net, const double *values, int training, int images, int rows,
                                 int cols, const double *x, double *y, hada_error *err);

#endif
