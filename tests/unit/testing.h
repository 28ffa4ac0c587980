/* What unit tests share: cmocka, a context for the tests, readable failures. */
#ifndef HADA_TESTS_TESTING_H
#define HADA_TESTS_TESTING_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
/* cmocka needs the four above first */
#include <cmocka.h>
#include <hadalens/device.h>
#include <stdio.h>

/* Fails the test with the library's own message when a call does not succeed. */
#define ASSERT_OK(call)                                                                                                \
    do {                                                                                                               \
        hada_error assert_ok_error = {0};                                                                              \
        hada_error *err = &assert_ok_error;                                                                            \
        hada_status assert_ok_status = (call);                                                                         \
        if (assert_ok_status)                                                                                          \
            fail_msg("%s: %s: %s", #call, hada_status_name(assert_ok_status), err->message);                           \
    } while (0)

#endif
