/* Faults on purpose: the linker sends the library's calls for memory, OpenCL and files through fault_*.c (--wrap),
 * which make the n-th of a kind fail and keep books of what is alive. Only calls from the library's own objects pass
 * here, so drivers and other libraries work undisturbed. */
#ifndef HADA_TESTS_FAULT_H
#define HADA_TESTS_FAULT_H

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/base.h"
#include "helpers.h"

/* FAULT_MAP: memory of a device that becomes the host's for a while; few calls, so they are counted by themselves. */
typedef enum fault_kind { FAULT_NONE = 0, FAULT_MEMORY, FAULT_OPENCL, FAULT_MAP, FAULT_FILE, FAULT_KINDS } fault_kind;

/* From now on calls are counted, and the n-th of a kind fails (n = 0: none does). Books start empty. */
void fault_arm(fault_kind kind, long n);
/* Back to normal; returns how many calls of that kind there were. */
long fault_disarm(void);

/* The name of the function that failed, NULL where the run had fewer calls than n. */
const char *fault_struck(void);

/* What was made since fault_arm() and still lives. */
long fault_memory_alive(void);
long fault_objects_alive(void);
/* Pieces of memory that stay alive: a driver may give a buffer's memory back from a thread of its own, a moment after
 * the last command that used it. Looks at which no other thread had anything to do are counted, so that one that waits
 * for its turn has all the time it needs. */
long fault_memory_left(void);
extern int fault_looks; /* so many of them, 5 ms apart */

/* What a device pretends to be, whether armed or not. Zero: the truth. */
typedef struct fault_device {
    int no_platform, no_device; /* nothing is installed; a platform without devices */
    int no_compiler;
    uint64_t max_allocation_bytes;
} fault_device;
extern fault_device fault_pretend;

/* A device that fails: of the commands to queues of an OpenCL context, and of the calls that make buffers in it, the
 * n-th and the `count` - 1 after it return `code` (n = 0: none; count 0: all from there on). */
typedef struct fault_device_loss {
    void *context; /* a cl_context */
    long n, count;
    int code;
} fault_device_loss;
void fault_lose(const fault_device_loss *loss); /* NULL: no more; two contexts at once: one call for each */
/* For the wrappers: the code to return for a command to a context, 0: none. */
int fault_lost(void *context);

/* Where not NULL: called for every call of the armed kind, with its number, from 1 on. */
extern void (*fault_counted)(long n);

/* For the wrappers: whether this call is the one to fail. */
int fault_here(fault_kind kind, const char *name);
/* Books of OpenCL objects: +1, -1. */
void fault_object(int change);

#endif
