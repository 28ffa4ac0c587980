/* Which kernels the operations launched, seen where every launch passes: the linker sends clEnqueueNDRangeKernel here
 * (see CMakeLists.txt). And whether every kernel file compiles alone. */
#include <sys/stat.h>

#include "check.h"
#include "runtime/launch.h"

enum { MAX_LAUNCHED = 1024, NAME = 64 };

static struct {
    cl_kernel kernel;
    char name[NAME];
} launched[MAX_LAUNCHED];
static int launched_count;

/* What the runs of single operations left in files: lines of "kernel NAME" and "program FILE MACROS". */
enum { LINE = 512 };
static char (*noted)[LINE];
static size_t noted_count;

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

static int was_noted(const char *kind, const char *first, const char *second)
{
    char line[LINE];
    snprintf(line, sizeof line, "%s %s %s", kind, first, second);
    for (size_t i = 0; i < noted_count; i++)
        if (!strcmp(noted[i], line))
            return 1;
    return 0;
}

static int ran(const char *name)
{
    for (int i = 0; i < launched_count; i++)
        if (!strcmp(launched[i].name, name))
            return 1;
    return was_noted("kernel", name, "");
}

static int launched_object(cl_kernel object)
{
    for (int i = 0; object && i < launched_count; i++)
        if (launched[i].kernel == object)
            return 1;
    return 0;
}

/* The self-test of a context runs in a slot of its own, whose programs can't be asked any more. */
static int program_ran(const hada_slot *slot, const hada_kernel_file *file, int program)
{
    if (!strcmp(file->name, "selftest"))
        return ran("selftest_sum");
    for (int k = 0; k < file->kernel_count; k++)
        if (launched_object(slot->kernels[file->first_object + program * file->kernel_count + k].cl))
            return 1;
    return was_noted("program", file->name, file->programs[program].macros);
}

int check_cover_save(const hada_slot *slot, const char *folder, const char *op, int partial)
{
    char path[1024];
    snprintf(path, sizeof path, "%s/%s.txt", folder, op);
    FILE *out = fopen(path, "w");
    if (out) {
        if (partial)
            fputs("partial\n", out);
        for (int i = 0; i < launched_count; i++)
            fprintf(out, "kernel %s \n", launched[i].name);
        for (int f = 0; f < hada_kernel_file_count; f++)
            for (int i = 0; i < hada_kernel_files[f]->program_count; i++)
                if (program_ran(slot, hada_kernel_files[f], i))
                    fprintf(out, "program %s %s\n", hada_kernel_files[f]->name,
                            hada_kernel_files[f]->programs[i].macros);
    }
    if (!out || fclose(out)) {
        printf("FAILED  %s cannot be written\n", path);
        return 1;
    }
    return 0;
}

static int read_lines(FILE *file, int *partial)
{
    char line[LINE] = "";
    while (fgets(line, sizeof line, file)) {
        line[strcspn(line, "\n")] = '\0';
        *partial |= !strcmp(line, "partial");
        void *more = realloc(noted, (noted_count + 1) * sizeof *noted);
        if (!more)
            return 1;
        noted = more;
        memcpy(noted[noted_count++], line, sizeof line);
    }
    return 0;
}

int check_cover_load(const char *folder, const char *program, int *partial)
{
    struct stat built = {0}, left;
    int missing = stat(program, &built) != 0;
    for (size_t o = 0; o < check_op_count; o++) {
        char path[1024];
        snprintf(path, sizeof path, "%s/%s.txt", folder, check_ops[o]->name);
        FILE *file = fopen(path, "r");
        if (!file || fstat(fileno(file), &left) || left.st_mtime < built.st_mtime || read_lines(file, partial)) {
            printf("%s has not run since this program was built\n", check_ops[o]->name);
            missing++;
        }
        if (file)
            fclose(file);
    }
    return missing;
}

void check_cover_forget(void)
{
    free(noted);
    noted = NULL;
    noted_count = 0;
}

/* Whether runs are to launch a program. */
static int wanted(const hada_slot *slot, const hada_program_row *program)
{
    return (check_both_shapes(slot->context) && strcmp(program->shapes, "tensor_cores")) ||
           hada_program_serves(slot->context, program);
}

/* Whether runs are to launch a kernel: programs of that shape have it. Macros may leave kernels out, so that a
 * program must be asked. */
static int kernel_wanted(const hada_slot *slot, const hada_kernel_file *file, const char *name)
{
    int found = 0;
    for (int i = 0; !found && i < file->program_count; i++) {
        hada_error error;
        cl_program program;
        cl_int code;
        if (!wanted(slot, &file->programs[i]))
            continue;
        if (hada_program_get(slot->context, file->name, file->programs[i].macros, &program, &error))
            return 1;
        cl_kernel kernel = clCreateKernel(program, name, &code);
        found = code != CL_INVALID_KERNEL_NAME;
        if (code == CL_SUCCESS)
            clReleaseKernel(kernel);
    }
    return found;
}

int check_cover_report(const hada_slot *slot, int list, int partial)
{
    const char *word = partial ? "missing" : "FAILED";
    int missing = 0, kernels = 0, programs = 0;
    for (int f = 0; f < hada_kernel_file_count; f++) {
        const hada_kernel_file *file = hada_kernel_files[f];
        for (int k = 0; k < file->kernel_count; k++, kernels++) {
            const char *name = file->kernels[k]->name;
            if (list)
                printf("%-8s %s.cl: %s\n", ran(name) ? "launched" : "never", file->name, name);
            if (!ran(name) && kernel_wanted(slot, file, name)) {
                printf("%-7s no operation launches the kernel %s of kernels/%s.cl: add a check_<op>.c\n", word, name,
                       file->name);
                missing++;
            }
        }
        for (int i = 0; i < file->program_count; i++, programs++)
            if (!program_ran(slot, file, i) && wanted(slot, &file->programs[i])) {
                printf("%-7s no operation launches %s.cl with the macros \"%s\": add a shape that needs them\n", word,
                       file->name, file->programs[i].macros);
                missing++;
            }
    }
    printf("%d kernels, %d programs of the manifest, %d not launched\n", kernels, programs, missing);
    return partial ? 0 : missing;
}

/* What the launches were made of holds for what the device compiled: each program of the manifest has the kernels of
 * its file, with as many parameters. Macros may leave kernels out, but the file without macros has them all. */
static int complete(hada_slot *slot, const hada_kernel_file *file, int row, char *note, size_t size)
{
    hada_error error;
    cl_program program;
    int count = 0;
    if (hada_program_get(slot->context, file->name, row < 0 ? "" : file->programs[row].macros, &program, &error)) {
        snprintf(note, size, "%s", error.message);
        return 0;
    }
    for (int k = 0; k < file->kernel_count; k++) {
        const hada_kernel *wanted = file->kernels[k];
        cl_int code;
        cl_uint parameters = 0;
        cl_kernel kernel = clCreateKernel(program, wanted->name, &code);
        if (code == CL_SUCCESS) {
            code = clGetKernelInfo(kernel, CL_KERNEL_NUM_ARGS, sizeof parameters, &parameters, NULL);
            clReleaseKernel(kernel);
        } else if (code == CL_INVALID_KERNEL_NAME && row >= 0 && *file->programs[row].macros) {
            continue;
        }
        if (code != CL_SUCCESS || (int)parameters != wanted->parameter_count) {
            snprintf(note, size, "its kernel %s cannot be made (%d), or takes %u parameters where launches have %d",
                     wanted->name, (int)code, parameters, wanted->parameter_count);
            return 0;
        }
        count++;
    }
    snprintf(note, size, "%d kernel(s)", count);
    return count > 0;
}

int check_compile(hada_slot *slot)
{
    int failed = 0;
    for (int f = 0; f < hada_kernel_file_count; f++)
        for (int row = -1; row < hada_kernel_files[f]->program_count; row++) {
            const hada_kernel_file *file = hada_kernel_files[f];
            char note[2048];
            /* inline assembly of a vendor's: tests/budget compiles it everywhere */
            if (row >= 0 && !strcmp(file->programs[row].shapes, "tensor_cores") &&
                !hada_program_serves(slot->context, &file->programs[row]))
                continue;
            const int good = complete(slot, file, row, note, sizeof note);
            printf("%-7s %s.cl %s: %s\n", good ? "ok" : "FAILED", file->name,
                   row < 0 ? "without macros" : file->programs[row].name, note);
            failed += !good;
        }
    return failed;
}
