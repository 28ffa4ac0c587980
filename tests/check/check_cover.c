/* Which kernels the operations launched, seen where every launch passes: the linker sends clEnqueueNDRangeKernel here
 * (see CMakeLists.txt). And whether every kernel file stands by itself. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "runtime/program.h"
#include "runtime/store.h"

enum { MAX_LAUNCHED = 1024, NAME = 64 };

static struct {
    cl_kernel kernel;
    char name[NAME];
} launched[MAX_LAUNCHED];
static int launched_count;

cl_int __real_clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset,
                                     const size_t *global, const size_t *local, cl_uint waits, const cl_event *wait,
                                     cl_event *event);
cl_int __wrap_clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset,
                                     const size_t *global, const size_t *local, cl_uint waits, const cl_event *wait,
                                     cl_event *event);

cl_int __wrap_clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset,
                                     const size_t *global, const size_t *local, cl_uint waits, const cl_event *wait,
                                     cl_event *event)
{
    char name[NAME] = "";
    int i = 0;
    clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name - 1, name, NULL);
    while (i < launched_count && (launched[i].kernel != kernel || strcmp(launched[i].name, name)))
        i++;
    if (i == launched_count && i < MAX_LAUNCHED) {
        launched[i].kernel = kernel;
        memcpy(launched[i].name, name, sizeof name);
        launched_count++;
    }
    return __real_clEnqueueNDRangeKernel(queue, kernel, dimensions, offset, global, local, waits, wait, event);
}

/* The next kernel's name in a text of OpenCL C, or NULL. */
static const char *next_kernel(const char *text, char name[NAME])
{
    text = strstr(text, "__kernel");
    if (!text || !(text = strstr(text, "void")))
        return NULL;
    text += strlen("void");
    while (isspace((unsigned char)*text))
        text++;
    size_t n = 0;
    while (n < NAME - 1 && (isalnum((unsigned char)text[n]) || text[n] == '_')) {
        name[n] = text[n];
        n++;
    }
    name[n] = '\0';
    return text + n;
}

static int ran(const char *name)
{
    for (int i = 0; i < launched_count; i++)
        if (!strcmp(launched[i].name, name))
            return 1;
    return 0;
}

/* The self-test of a context runs in a slot of its own, whose programs can't be asked any more. */
static int program_ran(const hada_slot *slot, const char *file, const char *options)
{
    if (!strcmp(file, "selftest"))
        return ran("selftest_sum");
    for (const hada_slot_kernel_entry *entry = slot->kernels; entry; entry = entry->next)
        if (!strcmp(entry->file, file) && !strcmp(entry->options, options))
            for (int i = 0; i < launched_count; i++)
                if (launched[i].kernel == entry->kernel && !strcmp(launched[i].name, entry->name))
                    return 1;
    return 0;
}

/* Programs that operations asked for and the manifest lacks: offline devices would not have them. */
static int beyond_manifest(const hada_slot *slot, const char *word)
{
    int missing = 0;
    for (const hada_slot_kernel_entry *entry = slot->kernels; entry; entry = entry->next) {
        size_t i = 0;
        while (i < hada_manifest_count &&
               (strcmp(hada_manifest[i].file, entry->file) || strcmp(hada_manifest[i].options, entry->options)))
            i++;
        if (i == hada_manifest_count) {
            printf("%-7s kernels/manifest.txt lacks %s.cl with the macros \"%s\", of which %s was asked for\n", word,
                   entry->file, entry->options, entry->name);
            missing++;
        }
    }
    return missing;
}

int check_cover_report(const hada_slot *slot, int list, int partial)
{
    const char *word = partial ? "missing" : "FAILED";
    int missing = 0, kernels = 0;
    for (size_t f = 0; f < hada_kernel_source_count; f++) {
        const char *file = hada_kernel_sources[f].file;
        char *text = hada_kernel_text(file), name[NAME];
        for (const char *at = text; at && (at = next_kernel(at, name));) {
            kernels++;
            if (list)
                printf("%-8s %s.cl: %s\n", ran(name) ? "launched" : "never", file, name);
            if (!ran(name)) {
                printf("%-7s no operation launches the kernel %s of kernels/%s.cl: add a check_<op>.c\n", word, name,
                       file);
                missing++;
            }
        }
        free(text);
    }
    for (size_t i = 0; i < hada_manifest_count; i++) {
        const hada_manifest_row *row = &hada_manifest[i];
        if (!program_ran(slot, row->file, row->options)) {
            printf("%-7s no operation launches %s.cl with the macros \"%s\": add a shape that needs them\n", word,
                   row->file, row->options);
            missing++;
        }
    }
    missing += beyond_manifest(slot, word);
    printf("%d kernels, %zu programs of the manifest, %d not launched, or not in it\n", kernels, hada_manifest_count, missing);
    return partial ? 0 : missing;
}

static int in_manifest(const char *file)
{
    for (size_t i = 0; i < hada_manifest_count; i++)
        if (!strcmp(hada_manifest[i].file, file))
            return 1;
    return 0;
}

static int complete(hada_slot *slot, const char *file, char *note, size_t size)
{
    hada_error error;
    cl_program program;
    char name[NAME], *text = hada_kernel_text(file);
    int kernels = 0, good = 0;
    if (!text)
        snprintf(note, size, "no text");
    else if (!in_manifest(file))
        snprintf(note, size, "no row in kernels/manifest.txt");
    else if (hada_program_get(slot->context, file, "", &program, &error))
        snprintf(note, size, "%s", error.message);
    else
        good = 1;
    for (const char *at = text; good && at && (at = next_kernel(at, name)); kernels++) {
        cl_int code;
        cl_kernel kernel = clCreateKernel(program, name, &code);
        if (code == CL_SUCCESS) {
            clReleaseKernel(kernel);
        } else {
            snprintf(note, size, "its kernel %s cannot be made (%d)", name, (int)code);
            good = 0;
        }
    }
    if (good && !kernels)
        snprintf(note, size, "no kernel in it");
    else if (good)
        snprintf(note, size, "%d kernel(s)", kernels);
    free(text);
    return good && kernels;
}

int check_compile(hada_slot *slot)
{
    int failed = 0;
    for (size_t f = 0; f < hada_kernel_source_count; f++) {
        char note[2048];
        const int good = complete(slot, hada_kernel_sources[f].file, note, sizeof note);
        printf("%-7s %s.cl: %s\n", good ? "ok" : "FAILED", hada_kernel_sources[f].file, note);
        failed += !good;
    }
    for (size_t i = 0; i < hada_manifest_count; i++) {
        size_t f = 0;
        while (f < hada_kernel_source_count && strcmp(hada_kernel_sources[f].file, hada_manifest[i].file))
            f++;
        if (f == hada_kernel_source_count) {
            printf("FAILED  the manifest names %s, and there is no kernels/%s.cl\n", hada_manifest[i].file,
                   hada_manifest[i].file);
            failed++;
        }
    }
    return failed;
}
