/* Targets of fuzzing: each reads bytes that anyone may have written, as the library does, and whatever they are there
 * must be a status, with a message. One program holds all; FUZZ_TARGET chooses. */
#ifndef HADA_TESTS_FUZZ_H
#define HADA_TESTS_FUZZ_H

#include <hadalens/status.h>
#include <stddef.h>
#include <stdint.h>

#include "fuzz_mutate.h"

typedef struct fuzz_target {
    const char *name;
    void (*begin)(void); /* once, before the first input; may be NULL */
    void (*run)(const uint8_t *data, size_t bytes);
    const char *ends;     /* names of files of this kind, for what is taken from elsewhere; "" where there are none */
    fuzz_mutator *mutate; /* NULL: files of this kind have no structure that a mutator knows */
} fuzz_target;

extern const fuzz_target fuzz_targets[]; /* ended by a row without name */
const fuzz_target *fuzz_find(const char *name);

/* A path that leads to these bytes, in memory; the next call changes what it leads to. */
const char *fuzz_path(const uint8_t *data, size_t bytes);
/* An empty folder, in memory where the system has such a place; the next call empties it. */
const char *fuzz_folder(void);
/* The bytes as a text, to be freed. */
char *fuzz_text(const uint8_t *data, size_t bytes);
/* Ends the program where a failure has no message, or a success has one that is left to read. */
void fuzz_check(hada_status status, const hada_error *err);
/* The same of a reader of files: whatever a file holds is no fault of the call. */
void fuzz_check_file(hada_status status, const hada_error *err);

void fuzz_tiff(const uint8_t *data, size_t bytes);
void fuzz_headerless(const uint8_t *data, size_t bytes);
void fuzz_tiff_text(const uint8_t *data, size_t bytes);
void fuzz_safetensors(const uint8_t *data, size_t bytes);
void fuzz_model(const uint8_t *data, size_t bytes);
void fuzz_sums(const uint8_t *data, size_t bytes);
void fuzz_checkpoint_begin(void);
void fuzz_checkpoint(const uint8_t *data, size_t bytes);
void fuzz_net(const uint8_t *data, size_t bytes);
void fuzz_list(const uint8_t *data, size_t bytes);
void fuzz_camera(const uint8_t *data, size_t bytes);
void fuzz_tuning(const uint8_t *data, size_t bytes);
void fuzz_binary(const uint8_t *data, size_t bytes);
void fuzz_dataset(const uint8_t *data, size_t bytes);
void fuzz_positions(const uint8_t *data, size_t bytes);
void fuzz_log(const uint8_t *data, size_t bytes);
void fuzz_words(const uint8_t *data, size_t bytes);
void fuzz_options(const uint8_t *data, size_t bytes);

#endif
