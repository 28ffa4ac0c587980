/* Shorthand of tests of all kinds. */
#ifndef HADA_TESTS_HELPERS_H
#define HADA_TESTS_HELPERS_H

#include <stdlib.h>
#include <hadalens/hadalens.h>

/* Declares a struct of options that has its defaults. */
#define DEFAULTS(type, name)                                                                                           \
    type name;                                                                                                         \
    type##_init(&name)

/* Before a declaration: destroys the variables with type_destroy() where their scope ends, the last one first. They
 * need a value by then; a jump out of the scope before they have one is no good. */
#define SCOPED(type) __attribute__((cleanup(type##_destroy))) type

/* The same for pointers to what malloc() gave. */
#define SCOPED_MEMORY __attribute__((cleanup(helpers_free)))

static inline void helpers_free(void *pointer)
{
    free(*(void **)pointer);
}

#endif
