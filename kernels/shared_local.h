/* The largest size of a kernel's `__local` argument. Compilers for FPGAs lay local memory out when they compile and
 * need this size (aoc: INTELFPGA_CL is defined); elsewhere each launch gives its own. */
#ifndef SHARED_LOCAL_H
#define SHARED_LOCAL_H

/* Bytes, a power of two: eight transforms of 1024 points side by side. */
#define HADA_STATED_LOCAL 65536

#ifdef INTELFPGA_CL
#define STATED_SIZE __attribute__((local_mem_size(HADA_STATED_LOCAL)))
#else
#define STATED_SIZE
#endif

#endif
