/* A context for the tests of a file, which gives all its memory back. */
#ifndef HADA_TESTS_DEVICE_FIXTURE_H
#define HADA_TESTS_DEVICE_FIXTURE_H

#include "testing.h"

static hada_context *context;

static inline int open_device(void **state)
{
    (void)state;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    return 0;
}

static inline int close_device(void **state)
{
    (void)state;
    close_context(&context);
    return 0;
}

#endif
