/* fuzz_replay TARGET FILE|FOLDER...: runs a target on files as they are, each within a time; what CTest does with the
 * corpora, under every compiler and sanitizer. FUZZ_MUTATIONS=N: also N changes of each by the target's mutator, the
 * same ones in every run. */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include "fuzz.h"

/* For an input; under sanitizers a hundred times slower than without. */
enum { SECONDS = 20 };
/* Address space, where no sanitizer reserves terabytes of it. */
#define MOST_BYTES ((rlim_t)2 << 30)

/* Of the processor: others may be at work meanwhile. SIGPROF ends the program; 0: no limit. */
static void limit_time(long seconds)
{
    setitimer(ITIMER_PROF, &(struct itimerval){.it_value.tv_sec = seconds}, NULL);
}

/* Changes nothing: what the mutators leave to libFuzzer. */
static size_t plain(uint8_t *data, size_t bytes, size_t room)
{
    (void)data;
    return bytes < room ? bytes : room;
}

static void run_changed(const fuzz_target *target, const uint8_t *data, size_t bytes)
{
    enum { ROOM = 8192 };
    const char *times = getenv("FUZZ_MUTATIONS");
    for (uint64_t i = times && target->mutate ? strtoull(times, NULL, 10) : 0; i; i--) {
        uint8_t *changed = calloc(ROOM, 1); /* of this size, so that sanitizers see what is written beyond */
        const size_t kept = bytes < ROOM ? bytes : ROOM;
        memcpy(changed, data, kept);
        const size_t left = target->mutate(changed, kept, ROOM, i * 0x9e3779b97f4a7c15u, plain);
        if (left > ROOM)
            abort();
        target->run(changed, left);
        free(changed);
    }
}

static int replay_file(const fuzz_target *target, const char *path)
{
    FILE *file = fopen(path, "rb");
    struct stat what;
    if (!file || fstat(fileno(file), &what) || !S_ISREG(what.st_mode)) {
        if (file)
            fclose(file);
        return 0;
    }
    uint8_t *data = malloc((size_t)what.st_size + 1);
    if (!data || fread(data, 1, (size_t)what.st_size, file) != (size_t)what.st_size)
        abort();
    fclose(file);
    fprintf(stderr, "%s\r", path); /* who it was, after a crash */
    limit_time(SECONDS);
    target->run(data, (size_t)what.st_size);
    run_changed(target, data, (size_t)what.st_size);
    limit_time(0);
    free(data);
    return 1;
}

/* Inputs of the corpora have no ending; of other files only those of the kind are read. */
static int is_of_kind(const fuzz_target *target, const char *name)
{
    const size_t length = strlen(name), end = strlen(target->ends);
    if (!strchr(name, '.'))
        return 1;
    return *name != '.' && length >= end && !strcmp(name + length - end, target->ends);
}

static int replay(const fuzz_target *target, const char *path)
{
    struct stat what;
    DIR *folder = !stat(path, &what) && S_ISDIR(what.st_mode) ? opendir(path) : NULL;
    int count = 0;
    if (!folder)
        return replay_file(target, path);
    for (const struct dirent *entry; (entry = readdir(folder));) {
        char inner[4096];
        if (!is_of_kind(target, entry->d_name))
            continue;
        snprintf(inner, sizeof inner, "%s/%s", path, entry->d_name);
        count += replay_file(target, inner);
    }
    closedir(folder);
    return count;
}

int main(int argc, char **argv)
{
    const fuzz_target *target = fuzz_find(argc > 1 ? argv[1] : NULL);
    int count = 0;
#ifndef HADALENS_SANITIZED
    const struct rlimit room = {MOST_BYTES, MOST_BYTES};
    setrlimit(RLIMIT_AS, &room);
#endif
    if (target->begin)
        target->begin();
    for (int i = 2; i < argc; i++)
        count += replay(target, argv[i]);
    printf("%d inputs of %s\n", count, target->name);
    return count ? 0 : 1;
}
