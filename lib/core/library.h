/* Libraries that are loaded when they are first needed, by files that few people have. Linking them would cost every
 * start of every program milliseconds. Internal. */
#ifndef HADA_CORE_LIBRARY_H
#define HADA_CORE_LIBRARY_H

#include "core/base.h"

typedef struct hada_symbol {
    const char *name;
    void *place; /* of the pointer to the function */
    size_t size; /* of that pointer */
} hada_symbol;

typedef struct hada_library {
    const char *file;    /* its soname */
    const char *purpose; /* what cannot be done without it: "PNG files cannot be read" */
    const char *package; /* of Debian, that holds it */
    const hada_symbol *symbols;
    size_t count;
    int loaded;
} hada_library;

/* A row of hada_library.symbols. */
#define HADA_SYMBOL(pointer, name)                                                                                     \
    {                                                                                                                  \
        name, &(pointer), sizeof(pointer)                                                                              \
    }

/* Loads it, unless it is loaded, and finds its functions. It is never closed. HADA_ERROR_UNSUPPORTED names the package.
 * Thread-safe. */
hada_status hada_library_load(hada_library *library, hada_error *err);

#endif
