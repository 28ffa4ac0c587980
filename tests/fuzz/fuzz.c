#include "fuzz.h"

#include <hadalens/folder.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

const fuzz_target fuzz_targets[] = {
    {"tiff", NULL, fuzz_tiff, ".tif", fuzz_mutate_tiff},
    {"headerless", NULL, fuzz_headerless, "", NULL},
    {"tiff_text", NULL, fuzz_tiff_text, "", NULL},
    {"safetensors", NULL, fuzz_safetensors, ".safetensors", fuzz_mutate_safetensors},
    {"model", NULL, fuzz_model, "", fuzz_mutate_safetensors},
    {"sums", NULL, fuzz_sums, "", fuzz_mutate_safetensors},
    {"checkpoint", fuzz_checkpoint_begin, fuzz_checkpoint, "", fuzz_mutate_safetensors},
    {"net", NULL, fuzz_net, "", fuzz_mutate_safetensors},
    {"list", NULL, fuzz_list, "", NULL},
    {"camera", NULL, fuzz_camera, "", NULL},
    {"tuning", NULL, fuzz_tuning, "", NULL},
    {"binary", NULL, fuzz_binary, "", NULL},
    {"dataset", NULL, fuzz_dataset, "", NULL},
    {"positions", NULL, fuzz_positions, "", NULL},
    {"log", NULL, fuzz_log, "", NULL},
    {"words", NULL, fuzz_words, "", NULL},
    {"options", NULL, fuzz_options, "", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

const fuzz_target *fuzz_find(const char *name)
{
    for (const fuzz_target *target = fuzz_targets; name && target->name; target++)
        if (!strcmp(target->name, name))
            return target;
    fprintf(stderr, "FUZZ_TARGET names the target, one of:");
    for (const fuzz_target *target = fuzz_targets; target->name; target++)
        fprintf(stderr, " %s", target->name);
    fprintf(stderr, "\n");
    exit(2);
}

const char *fuzz_path(const uint8_t *data, size_t bytes)
{
    static int fd = -1;
    static char path[40];
    if (fd < 0) {
        fd = memfd_create("fuzz", MFD_CLOEXEC);
        snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    }
    if (fd < 0 || ftruncate(fd, 0) || pwrite(fd, data, bytes, 0) != (ssize_t)bytes)
        abort();
    return path;
}

static char folder[64];

static void remove_folder(void)
{
    hada_folder_remove(folder);
}

/* A name of its own: one that a crash left behind may have been that of a process with the same number. */
const char *fuzz_folder(void)
{
    if (*folder) {
        remove_folder();
        if (mkdir(folder, 0700))
            abort();
        return folder;
    }
    snprintf(folder, sizeof folder, "%s/hadalens-fuzz-XXXXXX", access("/dev/shm", W_OK) ? "/tmp" : "/dev/shm");
    if (!mkdtemp(folder) || atexit(remove_folder))
        abort();
    return folder;
}

char *fuzz_text(const uint8_t *data, size_t bytes)
{
    char *text = malloc(bytes + 1);
    if (!text)
        abort();
    if (bytes)
        memcpy(text, data, bytes);
    text[bytes] = '\0';
    return text;
}

void fuzz_check(hada_status status, const hada_error *err)
{
    if (status && (err->status != status || strlen(err->message) < 8)) {
        fprintf(stderr, "status %d, in the record %d: '%s'\n", (int)status, (int)err->status, err->message);
        abort();
    }
}

void fuzz_check_file(hada_status status, const hada_error *err)
{
    fuzz_check(status, err);
    if (status == HADA_ERROR_UNSUPPORTED && (strstr(err->message, "this build") || strstr(err->message, "install it")))
        return; /* a library for files of this kind is missing */
    if (status == HADA_ERROR_ARGUMENT || status == HADA_ERROR_STATE || status == HADA_ERROR_UNSUPPORTED) {
        fprintf(stderr, "a file is said to be a wrong call (status %d): '%s'\n", (int)status, err->message);
        abort();
    }
}
