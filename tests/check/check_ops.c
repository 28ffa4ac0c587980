/* The list of operations that the check tool knows. */
#include "check.h"

extern const check_op check_fft_forward, check_fft_inverse, check_focus, check_optics, check_refine;

const check_op *const check_ops[] = {&check_fft_forward, &check_fft_inverse, &check_focus, &check_optics,
                                     &check_refine};
const size_t check_op_count = HADA_COUNT(check_ops);
