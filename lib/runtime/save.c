/* Building every program of the manifest to binaries, for devices that cannot compile. */
#include <stdlib.h>
#include <string.h>

#include "runtime/store.h"

static int serves(const hada_context *context, const hada_manifest_row *row)
{
    return !strcmp(row->shapes, "all") ||
           !strcmp(row->shapes, context->shape == HADA_SHAPE_GROUPS ? "groups" : "lanes");
}

hada_status hada_programs_save(hada_context *context, const char *folder, hada_error *err)
{
    if (!context || !folder || !*folder)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_programs_save: a context and a folder are needed");
    hada_status status = hada_folder_make(folder, err);
    for (size_t i = 0; !status && i < hada_manifest_count; i++) {
        const hada_manifest_row *row = &hada_manifest[i];
        char name[256];
        cl_program program;
        unsigned char *binary;
        size_t bytes;
        if (!serves(context, row))
            continue;
        status = hada_program_get(context, row->file, row->options, &program, err);
        if (status)
            break;
        status = hada_program_binary(program, &binary, &bytes, err);
        if (status)
            break;
        char *text = hada_kernel_text(row->file);
        status = text ? HADA_OK : hada_kernel_text_missing(row->file, err);
        if (!status)
            status = hada_program_key(context, row->file, row->options, text, name, sizeof name, err);
        if (!status)
            status = hada_binary_write(folder, name, binary, bytes, err);
        free(text);
        free(binary);
    }
    return status;
}
