/* Building every program of the manifest to binaries, for devices that cannot compile. */
#include <stdlib.h>
#include <string.h>

#include "core/monitor.h"
#include "runtime/store.h"

int hada_program_serves(const hada_context *context, const hada_program_row *row)
{
    if (!strcmp(row->shapes, "tensor_cores"))
        return context->tensor_cores && context->shape == HADA_SHAPE_GROUPS;
    return !strcmp(row->shapes, "all") || !strcmp(row->shapes, hada_kernel_shape_name(context->shape));
}

static hada_status save(hada_context *context, const char *folder, const char *file, const char *macros,
                        hada_error *err)
{
    char name[256], *text = NULL;
    cl_program program;
    unsigned char *binary = NULL;
    size_t bytes;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_program_get(context, file, macros, &program, err));
    HADA_TRY_OR_DONE(hada_program_binary(program, &binary, &bytes, err));
    text = hada_kernel_text(file);
    HADA_TRY_OR_DONE(text ? HADA_OK : hada_kernel_text_missing(file, err));
    HADA_TRY_OR_DONE(hada_program_key(context, file, macros, text, name, sizeof name, err));
    HADA_TRY_OR_DONE(hada_binary_write(folder, name, binary, bytes, err));
done:
    free(text);
    free(binary);
    return status;
}

/* Goes through the programs that serve the context; saves them, or only counts them (folder NULL). */
static hada_status each_program(hada_context *context, const char *folder, hada_progress *progress, hada_error *err)
{
    for (int f = 0; f < hada_kernel_file_count; f++)
        for (int i = 0; i < hada_kernel_files[f]->program_count; i++) {
            const hada_program_row *row = &hada_kernel_files[f]->programs[i];
            if (!hada_program_serves(context, row))
                continue;
            if (!folder) {
                progress->total++;
                continue;
            }
            HADA_TRY(save(context, folder, hada_kernel_files[f]->name, row->macros, err));
            HADA_TRY(hada_progress_step(progress, hada_kernel_files[f]->name, err));
        }
    return HADA_OK;
}

hada_status hada_programs_save(hada_context *context, const char *folder, hada_error *err)
{
    return hada_programs_save_with(context, folder, NULL, err);
}

hada_status hada_programs_save_with(hada_context *context, const char *folder, const hada_monitor *monitor,
                                    hada_error *err)
{
    hada_progress all = {.total = 0}, progress = {0};
    hada_status status = HADA_OK;
    if (!context || !folder || !*folder)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_programs_save: a context and a folder are needed");
    HADA_TRY_OR_DONE(hada_folder_make(folder, 0777, err));
    HADA_TRY_OR_DONE(each_program(context, NULL, &all, err));
    HADA_TRY_OR_DONE(hada_monitor_check(monitor, err));
    progress = hada_progress_begin(monitor, "programs", all.total);
    HADA_TRY_OR_DONE(each_program(context, folder, &progress, err));
done:
    if (progress.what)
        hada_progress_end(&progress);
    return status;
}
