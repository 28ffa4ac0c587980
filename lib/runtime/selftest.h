/* Known answers before the first work on a device. Internal. */
#ifndef HADA_RUNTIME_SELFTEST_H
#define HADA_RUNTIME_SELFTEST_H

#include "runtime/context.h"

/* Integer sums through local memory and barriers, complex products in vector lanes, half as storage: all exact.
 * HADA_ERROR_SELF_TEST names what came out wrong. */
hada_status hada_self_test(hada_context *context, hada_error *err);

#endif
