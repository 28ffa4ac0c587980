/* The list of operations that the check tool knows. */
#include "check.h"

extern const check_op check_fft_forward, check_fft_inverse, check_plain_pad, check_plain_crop, check_plain_product,
    check_dark, check_unpack, check_gather, check_hadamard, check_clip, check_filter_blend, check_focus, check_optics,
    check_hold_out, check_refine, check_explain, check_score, check_refine_window, check_refine_part, check_refine_move,
    check_crop, check_crosstalk, check_dct, check_ridge, check_fit_sums, check_fit_solve, check_fit_score,
    check_peak_copy, check_peak_flops, check_tiles;
extern const check_op check_fit_cropped, check_fit_nonnegative, check_fit_window;
extern const check_op check_train_filter, check_train_error;
extern const check_op check_hide, check_sensor;
extern const check_op check_wave_pupil, check_wave_spots, check_wave_mask, check_wave_travel, check_wave_sensor;
extern const check_op check_classic, check_classic_field;
extern const check_op check_tensor, check_conv_forward, check_conv_data, check_conv_weights;
extern const check_op check_net_activation, check_net_blend, check_net_dropout, check_net_pool, check_net_resize,
    check_net_place, check_net_batch_norm, check_net_linear;
extern const check_op check_surface_magnify, check_volume;
extern const check_op check_net_loss, check_net_optimizer, check_net_squares, check_net_content, check_net_part,
    check_net_beside, check_net_share, check_net_planes, check_lpips;

const check_op *const check_ops[] = {
    &check_fft_forward,    &check_fft_inverse,     &check_plain_pad,
    &check_plain_crop,     &check_plain_product,   &check_dark,
    &check_unpack,         &check_hadamard,        &check_clip,
    &check_focus,          &check_optics,          &check_refine,
    &check_explain,        &check_score,           &check_refine_window,
    &check_refine_part,    &check_refine_move,     &check_crop,
    &check_fit_sums,       &check_fit_nonnegative, &check_fit_window,
    &check_fit_cropped,    &check_fit_solve,       &check_fit_score,
    &check_peak_copy,      &check_peak_flops,      &check_tiles,
    &check_train_filter,   &check_train_error,     &check_hide,
    &check_sensor,         &check_wave_pupil,      &check_wave_spots,
    &check_wave_mask,      &check_wave_travel,     &check_wave_sensor,
    &check_classic,        &check_classic_field,   &check_tensor,
    &check_conv_forward,   &check_conv_data,       &check_conv_weights,
    &check_net_activation, &check_net_blend,       &check_net_dropout,
    &check_net_pool,       &check_net_resize,      &check_net_place,
    &check_net_batch_norm, &check_net_linear,      &check_net_loss,
    &check_net_optimizer,  &check_net_squares,     &check_net_content,
    &check_net_part,       &check_net_beside,      &check_net_share,
    &check_lpips,          &check_surface_magnify, &check_volume,
    &check_filter_blend,   &check_hold_out,        &check_dct,
    &check_ridge,          &check_crosstalk,       &check_net_planes,
    &check_gather,
};
const size_t check_op_count = HADA_COUNT(check_ops);
