/* Compiling, loading and taking binaries of programs. */
#include <errno.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "core/input.h"
#include "core/outfile.h"
#include "runtime/program.h"

/* A driver that compiles into a folder of its own fails where it cannot write there, and its build log does not say
 * so. Names that folder where a variable sets one that cannot be written to; NULL else. */
static const char *unwritable_cache(const char **variable)
{
    static const char *const variables[] = {"POCL_CACHE_DIR", "CUDA_CACHE_PATH", "NEO_CACHE_DIR", "XDG_CACHE_HOME"};
    for (size_t i = 0; i < sizeof variables / sizeof *variables; i++) {
        const char *folder = getenv(variables[i]);
        *variable = variables[i];
        if (folder && *folder && access(folder, W_OK | X_OK))
            return folder;
    }
    return NULL;
}

static hada_status build_program(hada_context *context, cl_program program, const char *file, const char *options,
                                 hada_error *err)
{
    char all[1024];
    int n = snprintf(all, sizeof all, "-cl-std=CL1.2 %s", options);
    if (n < 0 || (size_t)n >= sizeof all)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the macros of %s.cl are too long", file);
    cl_int code = clBuildProgram(program, 1, &context->device, all, NULL, NULL);
    if (code == CL_SUCCESS)
        return HADA_OK;
    const char *variable, *folder = unwritable_cache(&variable);
    if (folder)
        hada_fail(err, HADA_ERROR_BUILD,
                  "the kernel file %s.cl with macros '%s' does not build on %s (%s, %d): the driver may be missing its "
                  "cache, for %s=%s cannot be written to (%s); name a folder that can",
                  file, options, context->info.name, hada_cl_code_name(code), code, variable, folder, strerror(errno));
    else
        hada_fail(
            err, HADA_ERROR_BUILD,
            "the kernel file %s.cl with macros '%s' does not build on %s (%s, %d); please report the build log with "
            "the output of 'hadalens devices'",
            file, options, context->info.name, hada_cl_code_name(code), code);
    if (err) {
        err->cl_code = code;
        size_t size = 0;
        char *log = NULL;
        clGetProgramBuildInfo(program, context->device, CL_PROGRAM_BUILD_LOG, 0, NULL, &size);
        if (size && (log = calloc(size + 1, 1)) &&
            clGetProgramBuildInfo(program, context->device, CL_PROGRAM_BUILD_LOG, size, log, NULL) == CL_SUCCESS)
            snprintf(err->detail, sizeof err->detail, "%s", log);
        free(log);
    }
    return HADA_ERROR_BUILD;
}

/* Builds a program into *out, or gives it back. */
static hada_status build(hada_context *context, cl_program program, const char *file, const char *options,
                         cl_program *out, hada_error *err)
{
    const hada_status status = build_program(context, program, file, options, err);
    if (status)
        clReleaseProgram(program);
    else
        *out = program;
    return status;
}

hada_status hada_program_from_binary(hada_context *context, const char *file, const char *options,
                                     const unsigned char *binary, size_t bytes, cl_program *out, hada_error *err)
{
    cl_int code, binary_code = CL_SUCCESS;
    *out = NULL;
    cl_program program =
        clCreateProgramWithBinary(context->cl, 1, &context->device, &bytes, &binary, &binary_code, &code);
    if (code == CL_SUCCESS)
        code = binary_code;
    if (code != CL_SUCCESS) {
        if (program)
            clReleaseProgram(program);
        hada_status status = hada_fail_cl(err, code, "clCreateProgramWithBinary");
        hada_error_prefix(err, "the binary of %s.cl: ", file);
        return status;
    }
    return build(context, program, file, options, out, err);
}

hada_status hada_program_compile(hada_context *context, const char *file, const char *options, const char *text,
                                 cl_program *out, hada_error *err)
{
    cl_int code;
    *out = NULL;
    if (!context->info.has_compiler)
        return hada_fail(err, HADA_ERROR_BUILD,
                         "%s cannot compile kernels: give a folder of offline binaries (options.binaries or "
                         "HADALENS_BINARIES), made for it by 'hadalens devices --save-binaries FOLDER' where its "
                         "compiler is, or with the vendor's tools (docs/reference/devices.md)",
                         context->info.name);
    cl_program program = clCreateProgramWithSource(context->cl, 1, &text, NULL, &code);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clCreateProgramWithSource");
    return build(context, program, file, options, out, err);
}

hada_status hada_program_binary(cl_program program, unsigned char **out, size_t *bytes, hada_error *err)
{
    *out = NULL;
    *bytes = 0;
    cl_uint devices = 0;
    cl_int code = clGetProgramInfo(program, CL_PROGRAM_NUM_DEVICES, sizeof devices, &devices, NULL);
    if (code == CL_SUCCESS && devices != 1)
        return hada_fail(err, HADA_ERROR_STATE, "a program for %u devices has no single binary", devices);
    if (code == CL_SUCCESS)
        code = clGetProgramInfo(program, CL_PROGRAM_BINARY_SIZES, sizeof *bytes, bytes, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clGetProgramInfo");
    if (!*bytes)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "the driver gives no binary of this program");
    void *data;
    HADA_TRY(hada_allocated(data = hada_alloc(*bytes, 1, "a program binary", err)));
    unsigned char *pointer = data;
    code = clGetProgramInfo(program, CL_PROGRAM_BINARIES, sizeof pointer, &pointer, NULL);
    if (code != CL_SUCCESS) {
        free(data);
        return hada_fail_cl(err, code, "clGetProgramInfo");
    }
    *out = data;
    return HADA_OK;
}

/* Program binaries on disk: magic, checksum, payload. Whole or not there. */

typedef struct binary_header {
    char magic[8];
    uint64_t bytes, checksum;
} binary_header;

static const char magic[8] = {'H', 'A', 'D', 'A', 'B', 'I', 'N', '1'};

/* Far above any program of any device. */
#define MOST_BYTES ((size_t)1 << 30)

static int join(char *out, size_t size, const char *folder, const char *name)
{
    int n = snprintf(out, size, "%s/%s", folder, name);
    return n > 0 && (size_t)n < size;
}

hada_status hada_folder_make(const char *folder, unsigned mode, hada_error *err)
{
    return hada_folders_make(folder, mode)
               ? hada_fail(err, HADA_ERROR_FILE_WRITE, "the folder %s cannot be made: %s", folder, strerror(errno))
               : HADA_OK;
}

int hada_folder_is_ours(const char *folder)
{
    struct stat what;
    if (stat(folder, &what))
        return errno == ENOENT;
    return (what.st_uid == geteuid() || !what.st_uid) && !(what.st_mode & (S_IWGRP | S_IWOTH));
}

hada_status hada_binary_read(const char *folder, const char *name, unsigned char **out, size_t *bytes, hada_error *err)
{
    char path[4096];
    binary_header header;
    *out = NULL;
    *bytes = 0;
    if (!join(path, sizeof path, folder, name))
        return HADA_OK;
    char *text = NULL;
    size_t length = 0;
    const hada_status status = hada_input_read(&text, &length, path, MOST_BYTES, NULL, err);
    if (status == HADA_ERROR_MEMORY)
        return status;
    if (status)
        return HADA_OK;
    if (length > sizeof header)
        memcpy(&header, text, sizeof header);
    if (length > sizeof header && !memcmp(header.magic, magic, sizeof magic) &&
        header.bytes == length - sizeof header &&
        XXH3_64bits(text + sizeof header, length - sizeof header) == header.checksum) {
        *bytes = length - sizeof header;
        memmove(text, text + sizeof header, *bytes);
        *out = (unsigned char *)text;
        text = NULL;
    }
    free(text);
    return HADA_OK;
}

hada_status hada_binary_write(const char *folder, const char *name, const unsigned char *data, size_t bytes,
                              hada_error *err)
{
    char path[4096];
    hada_outfile file = {.fd = -1};
    binary_header header = {.bytes = bytes, .checksum = XXH3_64bits(data, bytes)};
    memcpy(header.magic, magic, sizeof magic);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_folder_make(folder, HADA_OURS_ALONE, err));
    if (!join(path, sizeof path, folder, name))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "the folder name %.80s... is too long", folder));
    HADA_TRY_OR_DONE(hada_outfile_open(&file, path, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&file, &header, sizeof header, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&file, data, bytes, err));
    return hada_outfile_commit(&file, err);
done:
    hada_outfile_abandon(&file);
    return status;
}

void hada_binary_drop(const char *folder, const char *name)
{
    char path[4096];
    if (join(path, sizeof path, folder, name))
        unlink(path);
}
