/* What a `__local` argument of a kernel holds at most. Compilers for FPGAs lay local memory out when they compile, so
 * that it is stated there (aoc: INTELFPGA_CL is defined); elsewhere each launch says how much it is. */
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
