#include "io/isolate.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/clock.h"
#include "core/input.h"
#include "io/decode.h"

/* Open files of ours for the process, above the numbers that they get there. */
enum { ABOVE = 16, LARGEST_SIDE = 1 << 24 };

struct hada_isolated {
    pid_t process;
    int control, data;
    size_t bytes; /* of the file */
    hada_limits limits;
    char *path, *description;
    double *distances_mm;
};

static const char *program(void)
{
    const char *named = secure_getenv("HADALENS_READER");
    return named && *named ? named : HADALENS_READER_PATH;
}

static int lifted(int fd)
{
    const int copy = fd < 0 ? -1 : fcntl(fd, F_DUPFD_CLOEXEC, ABOVE);
    if (fd >= 0)
        close(fd);
    return copy;
}

/* The process gets the name for its messages, and the limits. */
static int spawn(hada_isolated *isolated, int fd, int theirs)
{
    char pixels[32], pages[32], text[32], name[] = "hadalens-reader";
    posix_spawn_file_actions_t files;
    posix_spawnattr_t how;
    sigset_t none, usual;
    char *words[] = {name, isolated->path, pixels, pages, text, NULL};
    snprintf(pixels, sizeof pixels, "%llu", (unsigned long long)isolated->limits.pixels);
    snprintf(pages, sizeof pages, "%llu", (unsigned long long)isolated->limits.pages);
    snprintf(text, sizeof text, "%llu", (unsigned long long)isolated->limits.text);
    sigemptyset(&none);
    sigfillset(&usual);
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, fd, HADA_READER_FILE);
    posix_spawn_file_actions_adddup2(&files, theirs, HADA_READER_CONTROL);
    posix_spawn_file_actions_adddup2(&files, isolated->data, HADA_READER_DATA);
    posix_spawnattr_init(&how);
    /* in a group of its own: a key that interrupts the command lets it finish the frame */
    posix_spawnattr_setflags(&how, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    posix_spawnattr_setpgroup(&how, 0);
    posix_spawnattr_setsigmask(&how, &none);
    posix_spawnattr_setsigdefault(&how, &usual);
    const int code = posix_spawn(&isolated->process, program(), &files, &how, words, environ);
    posix_spawnattr_destroy(&how);
    posix_spawn_file_actions_destroy(&files);
    return code;
}

static hada_status start(hada_isolated *isolated, int fd, hada_error *err)
{
    int pair[2] = {-1, -1};
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair))
        return hada_fail(err, HADA_ERROR_MEMORY, "no socket for the reader's process: %s", strerror(errno));
    isolated->control = lifted(pair[0]);
    const int theirs = lifted(pair[1]), file = fcntl(fd, F_DUPFD_CLOEXEC, ABOVE);
    isolated->data = lifted(memfd_create("hadalens-reader", MFD_CLOEXEC));
    const int ready = isolated->control >= 0 && theirs >= 0 && file >= 0 && isolated->data >= 0 &&
                      !access(program(), X_OK), /* which emulators do not tell when they spawn */
        code = ready ? spawn(isolated, file, theirs) : errno;
    if (theirs >= 0)
        close(theirs);
    if (file >= 0)
        close(file);
    if (!code)
        return HADA_OK;
    isolated->process = 0;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "no process of its own can be started to decode this file (%s: %s); name the program "
                     "hadalens-reader in HADALENS_READER",
                     program(), strerror(code));
}

/* Ends the process, which may be busy; the signal that had ended it, or 0. */
static int end_process(hada_isolated *isolated)
{
    int how = 0;
    if (!isolated->process)
        return 0;
    kill(isolated->process, SIGKILL);
    while (waitpid(isolated->process, &how, 0) < 0)
        if (errno != EINTR) /* somebody else has waited for it */
            how = 0;
        else
            continue;
    isolated->process = 0;
    return WIFSIGNALED(how) ? WTERMSIG(how) : 0;
}

/* 1: there is something to read; 0: not in time. */
static int wait_for(int fd, uint64_t seconds)
{
    const double end = hada_seconds() + (double)seconds;
    for (double left = (double)seconds; left > 0; left = end - hada_seconds()) {
        struct pollfd one = {.fd = fd, .events = POLLIN};
        const int got = poll(&one, 1, left < 60 ? (int)(1000 * left) + 1 : 60000);
        if (got > 0)
            return 1;
        if (got < 0 && errno != EINTR)
            return 1; /* reading says why */
    }
    return 0;
}

static hada_status ended(hada_isolated *isolated, hada_error *err)
{
    int how = 0;
    pid_t process = 0;
    /* it has closed its socket, so it ends by itself now */
    for (int i = 0; i < 1000 && isolated->process && !process; i++) {
        process = waitpid(isolated->process, &how, WNOHANG);
        if (!process)
            poll(NULL, 0, 1);
    }
    if (process)
        isolated->process = 0;
    end_process(isolated);
    return hada_fail(err, HADA_ERROR_FILE_READ,
                     "the process that decoded it ended by %s %d: the file is damaged, or needs more memory than such "
                     "files do; get it again",
                     WIFSIGNALED(how) ? "signal" : "exit code", WIFSIGNALED(how) ? WTERMSIG(how) : WEXITSTATUS(how));
}

/* Only what a reader of files may say. */
static hada_status told(const hada_isolated *isolated, hada_reader_reply *reply, hada_error *err)
{
    reply->message[sizeof reply->message - 1] = '\0';
    switch (reply->status) {
    case HADA_OK: return HADA_OK;
    case HADA_ERROR_MEMORY:
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "a file of %zu bytes needs more memory than its process may take; where it is to be trusted, "
                         "allow it (options.limits pixels=N)",
                         isolated->bytes);
    case HADA_ERROR_ARGUMENT:
    case HADA_ERROR_UNSUPPORTED:
    case HADA_ERROR_FILE_OPEN:
    case HADA_ERROR_FILE_FORMAT: return hada_fail(err, (hada_status)reply->status, "%s", reply->message);
    default: return hada_fail(err, HADA_ERROR_FILE_READ, "%s", reply->message);
    }
}

static hada_status ask(hada_isolated *isolated, int frame, int stored, hada_reader_reply *reply, hada_error *err)
{
    const uint64_t seconds = isolated->limits.seconds;
    const hada_reader_request request = {frame, stored, seconds < INT32_MAX ? (int)seconds : INT32_MAX};
    ssize_t got = -1;
    if (!isolated->process)
        return hada_fail(err, HADA_ERROR_FILE_READ, "the process that decoded it has ended");
    while (send(isolated->control, &request, sizeof request, MSG_NOSIGNAL) < 0 && errno == EINTR)
        ;
    if (!wait_for(isolated->control, seconds)) {
        end_process(isolated);
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "a file of %zu bytes takes more than %llu s to decode; where it is to be trusted, allow it "
                         "(options.limits seconds=N)",
                         isolated->bytes, (unsigned long long)seconds);
    }
    while ((got = recv(isolated->control, reply, sizeof *reply, 0)) < 0 && errno == EINTR)
        ;
    return got == (ssize_t)sizeof *reply ? HADA_OK : ended(isolated, err);
}

static int is_size(int value, int most)
{
    return value >= 1 && value <= most;
}

static hada_status lies(hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_READ, "the process that decoded it says what cannot be: the file is damaged");
}

/* What a process says that a file may have taken over: sizes are possible, texts as long as they may be. */
static hada_status take_info(hada_isolated *isolated, const hada_reader_reply *reply, hada_tiff_info *info,
                             hada_error *err)
{
    const hada_tiff_info *said = &reply->info;
    const uint64_t most = isolated->limits.text, count = (uint64_t)said->distances;
    if (!is_size(said->frames, INT32_MAX) || !is_size(said->channels, 4096) || !is_size(said->rows, LARGEST_SIDE) ||
        !is_size(said->cols, LARGEST_SIDE) || !is_size(said->bits, 64) || !is_size(said->slices, said->frames) ||
        !is_size(said->times, said->frames) || !(said->scale > 0) || !isfinite(said->scale) ||
        !isfinite(said->encoding) || said->distances < 0 || count > most || reply->text_bytes > most ||
        said->mosaic < HADA_MOSAIC_NONE || said->mosaic > HADA_MOSAIC_GBRG)
        return lies(err);
    HADA_TRY(HADA_NEW(isolated->distances_mm, (size_t)count + 1, "the distances", err));
    HADA_TRY(HADA_NEW(isolated->description, (size_t)reply->text_bytes + 1, "the description", err));
    if (hada_read_at(isolated->data, isolated->distances_mm, (size_t)count * sizeof(double), 0) ||
        hada_read_at(isolated->data, isolated->description, (size_t)reply->text_bytes, count * sizeof(double)))
        return lies(err);
    *info = *said;
    info->is_float = said->is_float != 0;
    info->is_signed = said->is_signed != 0;
    info->description = isolated->description;
    info->distances_mm = count ? isolated->distances_mm : NULL;
    return HADA_OK;
}

static hada_status open_isolated(hada_isolated *isolated, int fd, hada_tiff_info *info, int *sealed, hada_error *err)
{
    hada_reader_reply reply = {0};
    HADA_TRY(start(isolated, fd, err));
    HADA_TRY(ask(isolated, -1, 0, &reply, err));
    *sealed = reply.sealed;
    HADA_TRY(told(isolated, &reply, err));
    return take_info(isolated, &reply, info, err);
}

hada_status hada_isolated_open(hada_isolated **out, int fd, size_t bytes, const char *path, hada_tiff_info *info,
                               hada_error *err)
{
    hada_limits limits = {.size = sizeof limits};
    hada_isolated *isolated = NULL;
    hada_headerless numbers;
    int sealed = 0;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY(hada_limits_get(&limits, err));
    if (limits.isolate == HADA_ISOLATE_NONE ||
        (limits.isolate == HADA_ISOLATE_SOME && !hada_decode_is_suspect(fd, bytes)) ||
        hada_decode_is_headerless(fd, bytes, &numbers)) /* which nothing decodes */
        return HADA_OK;
    HADA_TRY(HADA_NEW(isolated, 1, "the reader's process", err));
    *isolated = (hada_isolated){.control = -1, .data = -1, .bytes = bytes, .limits = limits};
    isolated->path = hada_string_copy(path);
    HADA_TRY_OR_DONE(hada_allocated(isolated->path));
    HADA_TRY_OR_DONE(open_isolated(isolated, fd, info, &sealed, err));
    *out = isolated;
    isolated = NULL;
done:
    /* where it was not asked for, what cannot be isolated is read as ever */
    if (status == HADA_ERROR_UNSUPPORTED && !sealed && limits.isolate == HADA_ISOLATE_SOME)
        status = HADA_OK;
    hada_isolated_close(&isolated);
    return status;
}

hada_status hada_isolated_read(hada_isolated *isolated, int frame, int stored, hada_pixels *pixels, hada_error *err)
{
    hada_reader_reply reply = {0};
    void *data = NULL;
    hada_status status = HADA_OK;
    hada_pixels_init(pixels);
    HADA_TRY_OR_DONE(ask(isolated, frame, stored, &reply, err));
    status = told(isolated, &reply, err);
    if (status) /* it names the file */
        return status;
    if (!is_size(reply.channels, 4096) || !is_size(reply.rows, LARGEST_SIDE) || !is_size(reply.cols, LARGEST_SIDE) ||
        reply.type < HADA_PIXEL_U8 || reply.type > HADA_PIXEL_F32 || (!stored && reply.type != HADA_PIXEL_F32) ||
        (reply.type != HADA_PIXEL_F32 && !(reply.full_scale > 0 && isfinite(reply.full_scale))))
        HADA_TRY_OR_DONE(lies(err));
    const size_t each = reply.type == HADA_PIXEL_U8    ? 1
                        : reply.type == HADA_PIXEL_U16 ? 2
                                                       : 4,
                 count = (size_t)reply.channels * (size_t)reply.rows * (size_t)reply.cols;
    HADA_TRY_OR_DONE(hada_tiff_budget(count, 0, isolated->bytes, err));
    HADA_TRY_OR_DONE(hada_allocated(data = hada_alloc_raw(count, each, "an image", err)));
    if (hada_read_at(isolated->data, data, hada_size_product(count, each), 0))
        HADA_TRY_OR_DONE(lies(err));
    hada_pixels_planar(pixels, data, (hada_pixel_type)reply.type, reply.channels, reply.rows, reply.cols);
    if (reply.type != HADA_PIXEL_F32)
        pixels->full_scale = reply.full_scale;
    return HADA_OK;
done:
    free(data);
    hada_error_prefix(err, "%s: ", isolated->path);
    return status;
}

void hada_isolated_close(hada_isolated **isolated)
{
    hada_isolated *i = hada_taken(isolated);
    if (!i)
        return;
    end_process(i);
    if (i->control >= 0)
        close(i->control);
    if (i->data >= 0)
        close(i->data);
    HADA_FREE(i->path, i->description, i->distances_mm, i);
}
