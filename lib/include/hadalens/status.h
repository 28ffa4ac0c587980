/* Hadalens: status codes and error records.
 *
 * Every call that can fail returns a hada_status and takes, as its last argument, an optional
 * hada_error that the library fills with what happened and what to do. The record is the caller's:
 * the library keeps no hidden error state, so calls from several threads never mix their messages.
 * Numbers are stable: they are never reused for something else. */
#ifndef HADALENS_STATUS_H
#define HADALENS_STATUS_H

#include <hadalens/base.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_status {
    HADA_OK = 0,

    /* the call itself */
    HADA_ERROR_ARGUMENT = 1,    /* an argument is out of range or missing */
    HADA_ERROR_SIZE = 2,        /* sizes do not fit together */
    HADA_ERROR_STATE = 3,       /* the call came at the wrong time */
    HADA_ERROR_UNSUPPORTED = 4, /* valid, but not offered */
    HADA_ERROR_CANCELLED = 5,   /* stopped on request */

    /* memory */
    HADA_ERROR_MEMORY = 20,        /* host memory ran out */
    HADA_ERROR_DEVICE_MEMORY = 21, /* device memory ran out */

    /* files */
    HADA_ERROR_FILE_OPEN = 40,   /* missing or not readable */
    HADA_ERROR_FILE_READ = 41,   /* truncated or damaged */
    HADA_ERROR_FILE_FORMAT = 42, /* not the format expected, or a part of it not supported */
    HADA_ERROR_FILE_WRITE = 43,  /* could not be written; nothing was left behind */

    /* what the files hold */
    HADA_ERROR_NOT_FINITE = 60, /* NaN or infinite values */
    HADA_ERROR_DATASET = 61,    /* a data set is incomplete, or shows nothing */
    HADA_ERROR_MODEL = 62,      /* a model does not fit the frame or the request */

    /* devices */
    HADA_ERROR_NO_DEVICE = 80,     /* no OpenCL device on this machine */
    HADA_ERROR_DEVICE_CHOICE = 81, /* the device asked for is not there */
    HADA_ERROR_DEVICE = 82,        /* an OpenCL call failed */
    HADA_ERROR_BUILD = 83,         /* a kernel could not be built or loaded */
    HADA_ERROR_SELF_TEST = 84,     /* a device computes wrong results */

    /* numbers */
    HADA_ERROR_NUMERIC = 100 /* a computation broke down */
} hada_status;

/* What went wrong. `message` is one or two sentences for a person, with what to do next;
 * `detail` is longer material where there is any (the head of a build log). */
typedef struct hada_error {
    hada_status status;
    int cl_code; /* the OpenCL error code, 0 where none */
    char message[1024];
    char detail[4096];
} hada_error;

/* The name of a status, such as "HADA_ERROR_FILE_OPEN"; never NULL. */
HADA_API const char *hada_status_name(hada_status status);

#ifdef __cplusplus
}
#endif
#endif
