/* Kernel text and the keys of binaries. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "runtime/store.h"

static const hada_kernel_file *find(const char *file)
{
    for (int i = 0; i < hada_kernel_file_count; i++)
        if (!strcmp(hada_kernel_files[i]->name, file))
            return hada_kernel_files[i];
    return NULL;
}

char *hada_kernel_text(const char *file)
{
    const hada_kernel_file *source = find(file);
    if (!source)
        return NULL;
    size_t bytes = 1;
    for (size_t i = 0; i < source->piece_count; i++)
        bytes += strlen(source->pieces[i]);
    char *text = malloc(bytes), *end = text;
    for (size_t i = 0; text && i < source->piece_count; i++) {
        size_t n = strlen(source->pieces[i]);
        memcpy(end, source->pieces[i], n);
        end += n;
    }
    if (text)
        *end = '\0';
    return text;
}

hada_status hada_kernel_text_missing(const char *file, hada_error *err)
{
    return find(file) ? hada_fail(err, HADA_ERROR_MEMORY, "no memory for the text of %s.cl", file)
                      : hada_fail(err, HADA_ERROR_BUILD, "there is no kernel file %s.cl in this build", file);
}

hada_status hada_program_key(const hada_context *context, const char *file, const char *options, const char *text,
                             char *out, size_t size, hada_error *err)
{
    const char *parts[] = {HADALENS_VERSION,
                           text,
                           options,
                           context->quirks.build_options,
                           context->info.name,
                           context->info.vendor,
                           context->info.driver,
                           context->info.version,
                           context->info.platform};
    XXH3_state_t *state = XXH3_createState();
    if (!state || XXH3_128bits_reset(state) != XXH_OK) {
        XXH3_freeState(state);
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the key of a program");
    }
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        XXH3_128bits_update(state, parts[i], strlen(parts[i]) + 1);
    const XXH128_hash_t hash = XXH3_128bits_digest(state);
    XXH3_freeState(state);
    snprintf(out, size, "%s-%016" PRIx64 "%016" PRIx64 ".bin", file, hash.high64, hash.low64);
    return HADA_OK;
}
