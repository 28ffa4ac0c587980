/* Hadalens: how values stand for light. A raw frame is linear in light; photographs that served as scenes are mostly
 * encoded for a display, and a camera is learned, and its frames are explained, in linear light.
 *
 * A response is one number: HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, or a power p, for light = value^p, from
 * HADA_RESPONSE_LEAST to HADA_RESPONSE_MOST; a power of 1 is linear. In options HADA_AUTO has it chosen. By name it is
 * `linear`, `srgb`, a number, or `auto`.
 *
 * Every curve maps 0 to 0 and 1 to 1 and goes on above 1. There is no light below 0 and no encoding of it, so values
 * below 0 become 0, but where nothing is converted; NaN stays.
 *
 * Threads: these functions have no state. Source: IEC 61966-2-1:1999 (sRGB). */
#ifndef HADALENS_RESPONSE_H
#define HADALENS_RESPONSE_H

#include <hadalens/status.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HADA_RESPONSE_LINEAR 1.0
#define HADA_RESPONSE_SRGB   (-2.0)
/* Powers that may be given: what lies beyond is no picture's. */
#define HADA_RESPONSE_LEAST 0.2
#define HADA_RESPONSE_MOST  5.0

/* 1: it is one of the responses above, HADA_AUTO not among them. */
HADA_API int hada_response_is_known(double response);

/* `count` values in one encoding to another, in place. Both must be known. */
HADA_API void hada_response_convert(float *values, size_t count, double from, double to);

/* Room for the name of a response. */
#define HADA_RESPONSE_NAME 32
/* `linear`, `srgb`, `auto`, or the power as a number with a decimal point. */
HADA_API void hada_response_name(char name[HADA_RESPONSE_NAME], double response);
/* From such a name, whatever the locale; HADA_ERROR_ARGUMENT says which there are. */
HADA_API hada_status hada_response_from_name(double *response, const char *name, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
