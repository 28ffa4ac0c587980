/* Filling error records. Internal. */
#ifndef HADA_CORE_ERROR_H
#define HADA_CORE_ERROR_H

#include <hadalens/status.h>

#if defined(__GNUC__)
#define HADA_PRINTF(f, a) __attribute__((format(printf, f, a)))
#else
#define HADA_PRINTF(f, a)
#endif

/* Fills *err (when not NULL) and returns `status`, so that a function can end with
 * `return hada_fail(err, HADA_ERROR_SIZE, "...", ...)`. Messages say what to do. */
hada_status hada_fail(hada_error *err, hada_status status, const char *format, ...) HADA_PRINTF(3, 4);

/* As hada_fail, for a failed OpenCL call: `call` names it, `code` is what it returned. Out-of-memory
 * codes become HADA_ERROR_DEVICE_MEMORY. */
hada_status hada_fail_cl(hada_error *err, int code, const char *call);

/* The one way that errors travel: a function that makes several calls that can fail declares
 * `hada_status status = HADA_OK;`, writes HADA_TRY(call) for each, and ends with one exit, `done:`, that frees what it
 * holds and returns `status`. What the exit frees is declared, empty, before the first HADA_TRY. */
#define HADA_TRY(call)                                                                                                 \
    do {                                                                                                               \
        status = (call);                                                                                               \
        if (status)                                                                                                    \
            goto done;                                                                                                 \
    } while (0)

/* Puts context before the message of a record that a callee filled: "reading x.tif: <message>". */
void hada_error_prefix(hada_error *err, const char *format, ...) HADA_PRINTF(2, 3);

/* The name of an OpenCL error code, such as "CL_OUT_OF_RESOURCES". */
const char *hada_cl_code_name(int code);

#endif
