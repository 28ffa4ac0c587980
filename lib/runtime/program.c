/* The program store: memory, then offline binaries or the disk cache, then the compiler; and how programs are compiled,
 * loaded, and kept on disk. */
#include "runtime/program.h"

#include <errno.h>
#include <inttypes.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "core/callers.h"
#include "core/input.h"
#include "core/outfile.h"

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

static hada_status from_binary(hada_context *context, const char *file, const char *options,
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

/* Whether only this user (or root) can put files into a folder; true for a folder that does not exist yet. */
static int is_ours(const char *folder)
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

/* Removes a binary that does not load, so that the next one can take its place. */
static void drop(const char *folder, const char *name)
{
    char path[4096];
    if (join(path, sizeof path, folder, name))
        unlink(path);
}

/* The store. */

struct hada_program_entry {
    char *file, *options;
    cl_program program;
    struct hada_program_entry *next;
};

static char *cache_folder(const hada_context *context, const hada_context_options *options)
{
    const char *folder = options->cache ? options->cache : getenv("HADALENS_CACHE");
    const char *root;
    char path[4096];
    /* an explicit folder is used even where the driver has a cache of its own */
    if (folder)
        return *folder && strcmp(folder, "off") ? hada_string_copy(folder) : NULL;
    if (context->quirks.own_disk_cache)
        return NULL;
    if ((root = getenv("XDG_CACHE_HOME")) && *root)
        snprintf(path, sizeof path, "%s/hadalens", root);
    else if ((root = getenv("HOME")) && *root)
        snprintf(path, sizeof path, "%s/.cache/hadalens", root);
    else
        return NULL;
    return hada_string_copy(path);
}

hada_status hada_program_store_create(hada_context *context, const hada_context_options *options, hada_error *err)
{
    hada_program_store *store;
    HADA_TRY(HADA_NEW(store, 1, "the program store", err));
    store->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    context->programs = store;
    const char *binaries = options->binaries ? options->binaries : getenv("HADALENS_BINARIES");
    if (binaries && *binaries) {
        store->binaries = hada_string_copy(binaries);
        if (!store->binaries)
            return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the program store");
    } else {
        store->cache = cache_folder(context, options);
        if (store->cache && !is_ours(store->cache)) {
            hada_log(context, HADA_LOG_INFO,
                     "the program cache %s is left aside, since others can write into it: chmod 700 it, or name "
                     "another (HADALENS_CACHE)",
                     store->cache);
            free(store->cache);
            store->cache = NULL;
        }
    }
    return HADA_OK;
}

/* Saves what PoCL has compiled by now: only after the first runs is the binary the final one. */
static void save_to_cache(hada_context *context, const hada_program_store *store)
{
    for (const hada_program_entry *entry = store->entries; entry; entry = entry->next) {
        char name[256];
        unsigned char *binary, *old;
        size_t bytes, old_bytes;
        char *text;
        if (hada_kernel_text(&text, entry->file, NULL))
            continue;
        const hada_status keyed = hada_program_key(context, entry->file, entry->options, text, name, sizeof name, NULL);
        free(text);
        if (keyed || hada_program_binary(entry->program, &binary, &bytes, NULL))
            continue;
        /* a program that ran at new work-group sizes has grown; an unchanged one is left alone */
        if (!hada_binary_read(store->cache, name, &old, &old_bytes, NULL)) {
            if (old_bytes < bytes && hada_binary_write(store->cache, name, binary, bytes, NULL))
                hada_log(context, HADA_LOG_INFO, "the program cache %s cannot be written", store->cache);
            free(old);
        }
        free(binary);
    }
}

void hada_program_store_destroy(hada_context *context)
{
    hada_program_store *store = context->programs;
    if (!store)
        return;
    if (store->cache)
        save_to_cache(context, store);
    while (store->entries) {
        hada_program_entry *entry = store->entries;
        store->entries = entry->next;
        if (entry->program)
            clReleaseProgram(entry->program);
        HADA_FREE(entry->file, entry->options, entry);
    }
    pthread_mutex_destroy(&store->lock);
    HADA_FREE(store->binaries, store->cache, store);
    context->programs = NULL;
}

static hada_status make(hada_context *context, hada_program_store *store, const char *file, const char *options,
                        cl_program *out, hada_error *err)
{
    char name[256], *text;
    unsigned char *binary = NULL;
    size_t bytes = 0;
    const char *folder = store->binaries ? store->binaries : store->cache;
    hada_status status = HADA_OK;
    HADA_TRY(hada_kernel_text(&text, file, err));
    HADA_TRY_OR_DONE(hada_program_key(context, file, options, text, name, sizeof name, err));
    if (folder)
        HADA_TRY_OR_DONE(hada_binary_read(folder, name, &binary, &bytes, err));
    if (store->binaries && !bytes)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_BUILD,
                      "the folder %s holds no binary of %s.cl with macros '%s' for %s that can be read; make it with "
                      "'hadalens devices --save-binaries FOLDER' on the same device, driver and version",
                      store->binaries, file, options, context->info.name));
    if (bytes) {
        status = from_binary(context, file, options, binary, bytes, out, err);
        store->loaded += status == HADA_OK;
        if (status == HADA_OK || store->binaries)
            goto done;
        drop(store->cache, name); /* a cache entry that does not load is only a slower start */
    }
    HADA_TRY_OR_DONE(hada_program_compile(context, file, options, text, out, err));
    store->compiled++;
    hada_log(context, HADA_LOG_TRACE, "compiled %s.cl '%s'", file, options);
done:
    HADA_FREE(binary, text);
    return status;
}

static hada_status get_locked(hada_context *context, const char *file, const char *options, cl_program *out,
                              hada_error *err)
{
    hada_program_store *store = context->programs;
    for (hada_program_entry *entry = store->entries; entry; entry = entry->next)
        if (!strcmp(entry->file, file) && !strcmp(entry->options, options)) {
            *out = entry->program;
            return HADA_OK;
        }
    hada_program_entry *entry;
    hada_status status = HADA_OK;
    HADA_TRY(HADA_NEW(entry, 1, "a program", err));
    entry->file = hada_string_copy(file);
    entry->options = hada_string_copy(options);
    if (!entry->file || !entry->options)
        status = hada_fail(err, HADA_ERROR_MEMORY, "no memory for a program");
    else
        status = make(context, store, file, options, &entry->program, err);
    if (status) {
        HADA_FREE(entry->file, entry->options, entry);
        return status;
    }
    entry->next = store->entries;
    store->entries = entry;
    *out = entry->program;
    return HADA_OK;
}

hada_status hada_program_get(hada_context *context, const char *file, const char *options, cl_program *out,
                             hada_error *err)
{
    *out = NULL;
    pthread_mutex_lock(&context->programs->lock);
    hada_status status = get_locked(context, file, options, out, err);
    pthread_mutex_unlock(&context->programs->lock);
    return status;
}

int hada_program_can_compile(const hada_context *context)
{
    return context->info.has_compiler && !(context->programs && context->programs->binaries);
}

/* Kernel text and the keys of binaries. */

static const hada_kernel_file *find(const char *file)
{
    for (int i = 0; i < hada_kernel_file_count; i++)
        if (!strcmp(hada_kernel_files[i]->name, file))
            return hada_kernel_files[i];
    return NULL;
}

hada_status hada_kernel_text(char **out, const char *file, hada_error *err)
{
    const hada_kernel_file *source = find(file);
    size_t bytes = 1;
    *out = NULL;
    if (!source)
        return hada_fail(err, HADA_ERROR_BUILD, "there is no kernel file %s.cl in this build", file);
    for (size_t i = 0; i < source->piece_count; i++)
        bytes += strlen(source->pieces[i]);
    HADA_TRY(HADA_NEW(*out, bytes, "the text of a kernel file", err));
    char *end = *out;
    for (size_t i = 0; i < source->piece_count; i++)
        end = stpcpy(end, source->pieces[i]);
    return HADA_OK;
}

hada_status hada_program_key(const hada_context *context, const char *file, const char *options, const char *text,
                             char *out, size_t size, hada_error *err)
{
    const char *parts[] = {HADALENS_VERSION,
                           text,
                           options,
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

/* Building every program of the manifest to binaries, for devices that cannot compile. */

int hada_program_serves(const hada_context *context, const hada_program_row *row)
{
    if (!strcmp(row->shapes, "tensor_cores"))
        return context->tensor_cores && context->shape == HADA_SHAPE_GROUPS;
    return !strcmp(row->shapes, "all") ||
           !strcmp(row->shapes, hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)context->shape));
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
    HADA_TRY_OR_DONE(hada_kernel_text(&text, file, err));
    HADA_TRY_OR_DONE(hada_program_key(context, file, macros, text, name, sizeof name, err));
    HADA_TRY_OR_DONE(hada_binary_write(folder, name, binary, bytes, err));
done:
    HADA_FREE(text, binary);
    return status;
}

/* Saves the programs that the context needs, or only counts them (folder NULL). */
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

hada_status hada_programs_save(hada_context *context, const char *folder, const hada_monitor *monitor, hada_error *err)
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

hada_status hada_context_get_info(const hada_context *context, hada_context_info *info, hada_error *err)
{
    HADA_NEED(context && info, err);
    HADA_TRY(HADA_REPORT_CHECK(info, hada_context_info, err));
    hada_program_store *store = context->programs;
    pthread_mutex_lock(&store->lock);
    const hada_context_info own = {.size = sizeof own,
                                   .shape = context->shape,
                                   .programs_compiled = store->compiled,
                                   .programs_loaded = store->loaded,
                                   .bytes = hada_context_bytes(context),
                                   .peak_bytes = hada_context_peak_bytes(context)};
    pthread_mutex_unlock(&store->lock);
    HADA_REPORT_GIVE(info, &own);
    return HADA_OK;
}
