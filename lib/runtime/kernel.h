/* Kernel objects of a slot. Internal. */
#ifndef HADA_RUNTIME_KERNEL_H
#define HADA_RUNTIME_KERNEL_H

#include "runtime/slot.h"

/* A kernel object of this slot: `file` is the kernel file without path and suffix ("hadamard"), `options` the macros
 * ("-DBATCH=4") or "" for the defaults. Compiled or loaded at first use; owned by the slot. */
hada_status hada_slot_kernel(hada_slot *slot, const char *file, const char *kernel, const char *options, cl_kernel *out,
                             hada_error *err);

#endif
