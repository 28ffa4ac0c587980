/* hadalens-reader NAME PIXELS PAGES TEXT: decodes the file that is open as number 3, for the library that has started
 * it (lib/io/isolate.h), and for as long as that holds the other end of its socket. NAME is for messages. */
#include <errno.h>
#include <hadalens/response.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "io/decode.h"
#include "io/isolate.h"
#include "misbehave.h"
#include "reader.h"

/* Address space beyond what the file and a frame take: libraries, and what they need. */
#define ROOM ((uint64_t)512 << 20)
enum { MOST_FILES = 65536 };

static struct {
    hada_tiff_reader *reader;
    hada_limits limits;
    size_t bytes;
    int sealed;
} state;

static int write_all(const void *data, size_t bytes, off_t at)
{
    for (const char *from = data; bytes;) {
        const ssize_t done = pwrite(HADA_READER_DATA, from, bytes < (1u << 30) ? bytes : 1u << 30, at);
        if (done <= 0)
            return -1;
        from += done;
        at += done;
        bytes -= (size_t)done;
    }
    return 0;
}

static void limit(int what, uint64_t most)
{
    const struct rlimit room = {most, most};
    setrlimit(what, &room);
}

/* Sixteen numbers for each byte of the file, which holds most of what codecs keep, and for each pixel. */
static void bound(void)
{
    const uint64_t most = state.limits.pixels < UINT64_MAX >> 10 ? state.limits.pixels : UINT64_MAX >> 10,
                   all = ROOM + 16 * (uint64_t)state.bytes + 64 * most;
    limit(RLIMIT_AS, all);
    limit(RLIMIT_FSIZE, all);
    limit(RLIMIT_CORE, 0);
    limit(RLIMIT_NPROC, 0);
}

/* Where the library that has started this one ends meanwhile, nobody else does. */
static void limit_time(int seconds)
{
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    const struct rlimit time = {(rlim_t)used.ru_utime.tv_sec + (rlim_t)used.ru_stime.tv_sec + (rlim_t)seconds + 1,
                                RLIM_INFINITY};
    setrlimit(RLIMIT_CPU, &time);
}

static hada_status open_file(hada_reader_reply *reply, const char *name, hada_error *err)
{
    struct stat what;
    int reopens = 0;
    if (fstat(HADA_READER_FILE, &what))
        return hada_fail(err, HADA_ERROR_FILE_OPEN, "cannot be opened: %s", strerror(errno));
    state.bytes = (size_t)what.st_size;
    bound();
    HADA_TRY(hada_decode_load(HADA_READER_FILE, state.bytes, &reopens, err));
    state.sealed = !hada_seal(HADA_READER_FILE, reopens);
    if (!state.sealed)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "this kernel cannot take rights away from the process that decodes files (seccomp, Landlock)");
    hada_misbehave(HADA_READER_FILE);
    HADA_TRY(hada_tiff_open_here(&state.reader, HADA_READER_FILE, state.bytes, name, err));
    reply->info = *hada_tiff_get_info(state.reader);
    reply->text_bytes = strlen(reply->info.description);
    const size_t bytes = (size_t)reply->info.distances * sizeof(double);
    if (write_all(reply->info.distances_mm, bytes, 0) ||
        write_all(reply->info.description, reply->text_bytes, (off_t)bytes))
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the texts of a file");
    return HADA_OK;
}

static hada_status read_frame(hada_reader_reply *reply, const hada_reader_request *request, hada_error *err)
{
    hada_pixels pixels;
    hada_image image;
    if (request->stored) {
        HADA_TRY(hada_tiff_read_stored(state.reader, request->frame, HADA_RESPONSE_LINEAR, &pixels, err));
    } else {
        HADA_TRY(hada_tiff_read(state.reader, request->frame, &image, err));
        hada_pixels_of_image(&pixels, &image);
    }
    reply->type = (int)pixels.type;
    reply->channels = pixels.channels;
    reply->rows = pixels.rows;
    reply->cols = pixels.cols;
    reply->full_scale = pixels.full_scale;
    const size_t each = pixels.type == HADA_PIXEL_U8 ? 1 : pixels.type == HADA_PIXEL_U16 ? 2 : 4;
    const int failed =
        write_all(pixels.data, (size_t)pixels.channels * (size_t)pixels.rows * (size_t)pixels.cols * each, 0);
    free((void *)pixels.data);
    return failed ? hada_fail(err, HADA_ERROR_MEMORY, "no memory for a frame") : HADA_OK;
}

int main(int argc, char **argv)
{
    static hada_reader_request request;
    static hada_reader_reply reply;
    static hada_error err;
    if (argc != 5)
        return 2;
    if (syscall(SYS_close_range, HADA_READER_DATA + 1, ~0u, 0)) /* before Linux 5.9 */
        for (int i = HADA_READER_DATA + 1; i < MOST_FILES; i++)
            close(i);
    setenv("OMP_NUM_THREADS", "1", 1); /* codecs start no threads */
    hada_limits_init(&state.limits);
    state.limits.pixels = strtoull(argv[2], NULL, 10);
    state.limits.pages = strtoull(argv[3], NULL, 10);
    state.limits.text = strtoull(argv[4], NULL, 10);
    state.limits.isolate = HADA_ISOLATE_NONE;
    if (hada_limits_set(&state.limits, NULL))
        return 2;
    while (read(HADA_READER_CONTROL, &request, sizeof request) == (ssize_t)sizeof request) {
        memset(&err, 0, sizeof err);
        memset(&reply, 0, sizeof reply);
        limit_time(request.seconds);
        reply.status = (int)(!state.reader ? open_file(&reply, argv[1], &err) : read_frame(&reply, &request, &err));
        reply.sealed = state.sealed;
        memcpy(reply.message, err.message, sizeof reply.message);
        if (write(HADA_READER_CONTROL, &reply, sizeof reply) != (ssize_t)sizeof reply)
            return 1;
    }
    return 0;
}
