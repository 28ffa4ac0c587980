/* Hadalens: what every header stands on: the version, the export macro, the word for "default", sized structs.
 *
 * Options. Structs of options begin with their size, as the caller's compiler knows it; hada_..._init() sets it, and
 * every option to its default. A library that is newer than the caller gives the options that the caller does not know
 * their defaults; one that is older takes a larger struct as long as what it does not know is as the init left it
 * (HADA_ERROR_UNSUPPORTED otherwise). So start from the init, set what differs, and do not copy members across by
 * hand. Where a call takes NULL for its options, that stands for the defaults.
 *
 * Reports. Structs that the library fills in the caller's memory begin with their size as well, which the caller sets
 * before the call (hada_step_report report = {.size = sizeof report}; in C++ report.size = sizeof report); as much is
 * filled as both sides know. Structs that the library hands out by a const pointer are its own: later versions may
 * append to them. Plain structs without a size (hada_image, hada_error, hada_result, hada_plane) and the rows
 * of arrays stay as they are.
 *
 * What the library makes is given back by a ..._destroy(), which clears the pointer; most of it is made by ..._create()
 * and read by ..._get(). Files are opened and closed. Nothing is given to free().
 *
 * Defaults. A number that the library is to choose is HADA_AUTO, in integers and in floating point alike, and each
 * option that can be left open says so; of an enumeration it is the member ..._AUTO. Pointers that are left open are
 * NULL, and a size of 0 x 0 is none of its own.
 *
 * Threads: these functions have no state. Source: Semantic Versioning 2.0.0 (semver.org); CONTRIBUTING.md says what
 * each part of the version and the soname mean here. */
#ifndef HADALENS_BASE_H
#define HADALENS_BASE_H

#include <stddef.h>
#include <stdint.h>

/* The version of these headers. */
#define HADALENS_VERSION_MAJOR 0
#define HADALENS_VERSION_MINOR 1
#define HADALENS_VERSION_PATCH 0
#define HADALENS_VERSION       "0.1.0"

/* For the preprocessor: #if HADALENS_VERSION_NUMBER >= HADALENS_VERSION_OF(0, 2, 0) */
#define HADALENS_VERSION_OF(major, minor, patch) ((major)*10000 + (minor)*100 + (patch))
#define HADALENS_VERSION_NUMBER                                                                                        \
    HADALENS_VERSION_OF(HADALENS_VERSION_MAJOR, HADALENS_VERSION_MINOR, HADALENS_VERSION_PATCH)

/* Exported. HADALENS_BUILDING is defined while the library is built, HADALENS_STATIC by users of a static one. */
#if defined(HADALENS_STATIC)
#define HADA_API
#elif defined(_WIN32) || defined(__CYGWIN__)
#if defined(HADALENS_BUILDING)
#define HADA_API __declspec(dllexport)
#else
#define HADA_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define HADA_API __attribute__((visibility("default")))
#else
#define HADA_API
#endif

/* "The library chooses", for every option that may be left open. */
#define HADA_AUTO (-1)

#ifdef __cplusplus
extern "C" {
#endif

/* The version of the library that runs, such as "0.1.0". Never NULL. */
HADA_API const char *hada_version(void);

/* Frees a text that the library made and clears the pointer; NULL is fine. */
HADA_API void hada_text_destroy(char **text);

#ifdef __cplusplus
}
#endif
#endif
