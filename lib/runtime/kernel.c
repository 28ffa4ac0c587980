#include "runtime/kernel.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "runtime/program.h"

hada_status hada_slot_kernel(hada_slot *slot, const char *file, const char *kernel, const char *options, cl_kernel *out,
                             hada_error *err)
{
    for (hada_slot_kernel_entry *entry = slot->kernels; entry; entry = entry->next)
        if (!strcmp(entry->name, kernel) && !strcmp(entry->options, options) && !strcmp(entry->file, file)) {
            *out = entry->kernel;
            return HADA_OK;
        }
    cl_program program;
    hada_slot_kernel_entry *entry;
    *out = NULL;
    hada_status status = hada_program_get(slot->context, file, options, &program, err);
    if (status)
        return status;
    status = hada_alloc((void **)&entry, 1, sizeof *entry, "a kernel object", err);
    if (status)
        return status;
    entry->next = slot->kernels;
    slot->kernels = entry;
    entry->file = hada_string_copy(file);
    entry->name = hada_string_copy(kernel);
    entry->options = hada_string_copy(options);
    cl_int code = CL_OUT_OF_HOST_MEMORY;
    if (entry->file && entry->name && entry->options)
        entry->kernel = clCreateKernel(program, kernel, &code);
    if (code != CL_SUCCESS) {
        slot->kernels = entry->next;
        free(entry->file);
        free(entry->name);
        free(entry->options);
        free(entry);
        status = hada_fail_cl(err, code, "clCreateKernel");
        hada_error_prefix(err, "kernel %s of %s.cl: ", kernel, file);
        return status;
    }
    *out = entry->kernel;
    return HADA_OK;
}
