/* Launches of kernels, arguments named and checked by the compiler. Internal.
 *
 * cmake/kernels.py makes launch/FILE.h from the declarations in kernels/FILE.cl and from kernels/manifest.txt. There
 *     HADA_TRY(hada_launch_KERNEL(slot, program, &range, err, .planes = planes, .rows = rows, .step = 0.5f));
 * enqueues a kernel. Every parameter is given once, by its own name and type: what is left out, named twice, unknown or
 * of another type does not compile. A buffer's type says what its elements are: cl_mem floats (a vector of floats too,
 * or a kernel's `void`, whose elements a macro chooses), hada_ints, hada_bytes, hada_halves, NAME_array for a shared
 * struct NAME. A buffer that a kernel does not use in this launch is NULL. `program` is a row of the manifest,
 * HADA_PROGRAM_FILE_NAME. */
#ifndef HADA_RUNTIME_LAUNCH_H
#define HADA_RUNTIME_LAUNCH_H

#include "runtime/buffer.h"
#include "runtime/program.h"
#include "runtime/slot.h"

/* The work-items of a launch. */
typedef struct hada_range {
    size_t global[3], local[3];
    int divisible; /* d + 1: the kernel asks for nothing but get_global_id(d) of dimension d, so that a launch that
                      takes seconds may become several while a monitor is asked (hada_slot_watch()); 0: none */
} hada_range;

/* items x rows x planes work-items, the items rounded up to whole groups of `local`; a group has one row of one plane.
 * Give few, fixed local sizes: PoCL compiles once for each. */
static inline hada_range hada_range_of(size_t items, size_t local, size_t rows, size_t planes)
{
    return (hada_range){{hada_round_up(items, local), rows, planes}, {local, 1, 1}, 0};
}

static inline hada_range hada_range_divisible(hada_range range, int dimension)
{
    range.divisible = dimension + 1;
    return range;
}

/* groups x rows x planes work-groups of `local` work-items. */
static inline hada_range hada_range_groups(size_t groups, size_t local, size_t rows, size_t planes)
{
    return (hada_range){{groups * local, rows, planes}, {local, 1, 1}, 0};
}

/* An argument in local memory. */
typedef struct hada_local {
    size_t bytes;
} hada_local;

/* An argument whose address space a macro of the program chooses: a buffer, or local memory where there is none. */
typedef struct hada_either {
    cl_mem buffer;
    size_t bytes;
} hada_either;

typedef enum hada_kernel_parameter_kind {
    HADA_KERNEL_PARAMETER_VALUE,
    HADA_KERNEL_PARAMETER_BUFFER,
    HADA_KERNEL_PARAMETER_LOCAL,
    HADA_KERNEL_PARAMETER_EITHER
} hada_kernel_parameter_kind;

/* A member of the struct of a kernel's arguments. */
typedef struct hada_kernel_parameter {
    size_t offset, size;
    hada_kernel_parameter_kind kind;
} hada_kernel_parameter;

struct hada_kernel {
    const char *name;
    const hada_kernel_file *file;
    const hada_kernel_parameter *parameters;
    int parameter_count;
    int index; /* in its file */
};

/* Makes a program of a file, compiled or loaded, where that was not done: so that a failure shows before the work. */
hada_status hada_program_prepare(hada_slot *slot, const hada_kernel_file *file, int program, hada_error *err);

/* The program of a file whose macros have these values, in the order of the file's table; negative: there is none. */
int hada_program_find(const hada_kernel_file *file, const int *values);

/* Sets the arguments that are not those of the object's last launch and enqueues; launch/FILE.h calls it. `args` is the
 * kernel's own struct. A range without work-items is no error. */
hada_status hada_launch(hada_slot *slot, const hada_kernel *kernel, int program, const hada_range *range,
                        const void *args, hada_error *err);

/* A kernel object with the arguments that it was given last. */
struct hada_kernel_object {
    cl_kernel cl;           /* NULL until first launched */
    char *args;             /* the kernel's struct; NULL: not known */
    unsigned long releases; /* of the context, before they were set */
};

/* From now on kernels that have this buffer as an argument are given it again: it is released, or the caller's, who may
 * have released it; a driver may give another buffer the same handle. */
void hada_arguments_forget(hada_context *context, cl_mem mem);

/* Structs that are only ever filled by name. */
#if defined(__GNUC__) && !defined(__clang__)
#define HADA_BY_NAME __attribute__((designated_init))
#else
#define HADA_BY_NAME
#endif

/* Refuses at compile time what does not have `wanted` initialisers. A struct is given as a variable: the commas of a
 * compound literal would count. */
#define HADA_ALL_NAMED(wanted, ...)                                                                                    \
    (void)sizeof(struct {                                                                                              \
        int unused;                                                                                                    \
        _Static_assert(HADA_INITIALISERS(__VA_ARGS__) == (wanted), "every argument is given once, by its name");       \
    })
#define HADA_INITIALISERS(...)                                                                                         \
    HADA_FORTIETH(__VA_ARGS__, 40, 39, 38, 37, 36, 35, 34, 33, 32, 31, 30, 29, 28, 27, 26, 25, 24, 23, 22, 21, 20, 19, \
                  18, 17, 16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0)
#define HADA_FORTIETH(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, v, w, x, y, z, A, B, C, D, E, F,  \
                      G, H, I, J, K, L, M, N, count, ...)                                                              \
    count

#endif
