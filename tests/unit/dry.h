/* What an object says that it will hold: it is made dry. */
#ifndef HADA_TEST_DRY_H
#define HADA_TEST_DRY_H

#include "runtime/memory.h"

/* The bytes of device memory of an object of this type for the device of context `of`, or the status of a failure.
 * create: a call with &object and &dry.slot; destroy: the function that ends it. */
#define DRY_STATUS(status, bytes, of, type, create, destroy)                                                           \
    do {                                                                                                               \
        hada_dry dry;                                                                                                  \
        type *object = NULL;                                                                                           \
        hada_dry_begin(&dry, (of));                                                                                    \
        (status) = (create);                                                                                           \
        (bytes) = hada_context_bytes(&dry.context);                                                                    \
        destroy(&object);                                                                                              \
        assert_int_equal(hada_context_bytes(&dry.context), 0);                                                         \
        hada_dry_end(&dry);                                                                                            \
    } while (0)

/* The object's create makes as many bytes as `held`. */
#define ASSERT_DRY(held, of, type, create, destroy)                                                                    \
    do {                                                                                                               \
        uint64_t dry_bytes_;                                                                                           \
        hada_status dry_status_;                                                                                       \
        DRY_STATUS(dry_status_, dry_bytes_, of, type, create, destroy);                                                \
        assert_int_equal(dry_status_, HADA_OK);                                                                        \
        assert_int_equal((held), dry_bytes_);                                                                          \
    } while (0)

#endif
