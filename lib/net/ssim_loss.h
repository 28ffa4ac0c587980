/* The loss HADA_LOSS_SSIM of net/loss.h, which takes four passes. Internal. */
#ifndef HADA_NET_SSIM_LOSS_H
#define HADA_NET_SSIM_LOSS_H

#include "net/loss.h"

size_t hada_ssim_loss_scratch(const hada_tensor *x);
hada_status hada_ssim_loss_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x,
                               const hada_tensor *target, hada_floats value, const hada_tensor *dx, int accumulate,
                               cl_mem scratch, hada_error *err);

#endif
