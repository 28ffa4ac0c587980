#include "core/input.h"

#include <errno.h>
#include <fcntl.h>
#include <hadalens/folder.h>
#include <pthread.h>
#include <unistd.h>
#include <xxhash.h>

static hada_status open_failed(int fd, int *code, int reason, hada_error *err)
{
    if (fd >= 0)
        close(fd);
    if (code)
        *code = reason;
    return reason ? hada_fail(err, HADA_ERROR_FILE_OPEN, "cannot be opened: %s", strerror(reason))
                  : hada_fail(err, HADA_ERROR_FILE_OPEN, "is not an ordinary file");
}

hada_status hada_input_open(int *out, size_t *bytes, const char *path, int *code, hada_error *err)
{
    struct stat what;
    *out = -1;
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (fd < 0 || fstat(fd, &what))
        return open_failed(fd, code, errno, err);
    if (!S_ISREG(what.st_mode))
        return open_failed(fd, code, 0, err);
    *out = fd;
    *bytes = (size_t)what.st_size;
    return HADA_OK;
}

int hada_read_at(int fd, void *out, size_t bytes, uint64_t offset)
{
    char *to = out;
    while (bytes) {
        ssize_t done = pread(fd, to, bytes < ((size_t)1 << 30) ? bytes : (size_t)1 << 30, (off_t)offset);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return -1;
        to += done;
        offset += (uint64_t)done;
        bytes -= (size_t)done;
    }
    return 0;
}

/* As much as there is, up to `room`; -1 on failure. */
static ssize_t read_up_to(int fd, char *to, size_t room)
{
    size_t have = 0;
    while (have < room) {
        const ssize_t got = read(fd, to + have, room - have);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return -1;
        if (!got)
            break;
        have += (size_t)got;
    }
    return (ssize_t)have;
}

hada_status hada_input_read(char **text, size_t *bytes, const char *path, size_t most, int *code, hada_error *err)
{
    int fd = -1;
    size_t size = 0;
    char *read_into = NULL;
    hada_status status = HADA_OK;
    *text = NULL;
    *bytes = 0;
    HADA_TRY_OR_DONE(hada_input_open(&fd, &size, path, code, err));
    if (size > most)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_FORMAT, "has %zu bytes; at most %zu are read here", size, most));
    HADA_TRY_OR_DONE(HADA_NEW(read_into, size + 1, "a file", err));
    const ssize_t got = read_up_to(fd, read_into, size);
    if (got < 0)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "cannot be read: %s", strerror(errno)));
    *bytes = (size_t)got;
    *text = read_into;
    read_into = NULL;
done:
    if (status && code && fd >= 0)
        *code = 0;
    if (fd >= 0)
        close(fd);
    free(read_into);
    return status;
}

hada_status hada_file_hash(uint64_t *hash, const char *path, hada_error *err)
{
    enum { PIECE = 1 << 20, END = 64 << 20 };
    XXH3_state_t *state = NULL;
    char *piece = NULL;
    int fd = -1, code = 0;
    size_t bytes, each;
    hada_error error = {0};
    *hash = 0;
    hada_status status = hada_input_open(&fd, &bytes, path, &code, &error);
    if (status && (!code || code == ENOENT || code == ENOTDIR)) /* none, or no ordinary file */
        return HADA_OK;
    if (status)
        return hada_fail(err, status, "%s", error.message);
    HADA_TRY_OR_DONE(HADA_NEW_RAW(piece, PIECE, "a piece of a file", err));
    state = XXH3_createState();
    if (!state)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for the hash of a file"));
    XXH3_64bits_reset(state);
    XXH3_64bits_update(state, &bytes, sizeof bytes);
    for (size_t done = 0; done < bytes; done += each) {
        if (bytes > 2 * (size_t)END && done == END)
            done = bytes - END;
        each = bytes - done < PIECE ? bytes - done : PIECE;
        if (hada_read_at(fd, piece, each, done))
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "cannot be read whole; get it again"));
        XXH3_64bits_update(state, piece, each);
    }
    *hash = XXH3_64bits_digest(state);
done:
    close(fd);
    free(piece);
    XXH3_freeState(state);
    return status;
}

typedef struct identity {
    dev_t device;
    ino_t inode;
} identity;

struct hada_inputs {
    hada_inputs *next;
    size_t count;
    identity files[]; /* sorted */
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static hada_inputs *in_use;

static int by_identity(const void *a, const void *b)
{
    const identity *one = a, *two = b;
    if (one->device != two->device)
        return one->device < two->device ? -1 : 1;
    return (one->inode > two->inode) - (one->inode < two->inode);
}

hada_status hada_inputs_protect(hada_inputs **out, const char *const *paths, size_t count, hada_error *err)
{
    HADA_NEED(out && (paths || !count), err);
    struct stat what;
    hada_inputs *inputs = NULL;
    *out = NULL;
    HADA_TRY(hada_allocated(
        inputs = hada_alloc(1, sizeof *inputs + count * sizeof *inputs->files, "the names of a command's files", err)));
    for (size_t i = 0; i < count; i++)
        if (paths[i] && !stat(paths[i], &what) && S_ISREG(what.st_mode))
            inputs->files[inputs->count++] = (identity){what.st_dev, what.st_ino};
    qsort(inputs->files, inputs->count, sizeof *inputs->files, by_identity);
    pthread_mutex_lock(&lock);
    inputs->next = in_use;
    in_use = inputs;
    pthread_mutex_unlock(&lock);
    *out = inputs;
    return HADA_OK;
}

void hada_inputs_release(hada_inputs **inputs)
{
    hada_inputs *mine = hada_taken(inputs);
    if (!mine)
        return;
    pthread_mutex_lock(&lock);
    for (hada_inputs **at = &in_use; *at; at = &(*at)->next)
        if (*at == mine) {
            *at = mine->next;
            break;
        }
    pthread_mutex_unlock(&lock);
    free(mine);
}

int hada_input_is_in_use(const struct stat *file)
{
    const identity key = {file->st_dev, file->st_ino};
    int found = 0;
    pthread_mutex_lock(&lock);
    for (const hada_inputs *at = in_use; at && !found; at = at->next)
        found = bsearch(&key, at->files, at->count, sizeof key, by_identity) != NULL;
    pthread_mutex_unlock(&lock);
    return found;
}

/* What jansson takes for a list or an object and for another value, about; times the bytes of the text. Of headers of
 * safetensors the densest (names of one letter, eight dimensions of one digit) come to 22. */
enum { LIST_COST = 200, VALUE_COST = 80, MOST_TIMES = 24, SHORT_TEXT = 4096 };

int hada_json_is_bloated(const char *text, size_t bytes)
{
    size_t cost = 0;
    for (size_t i = 0; i < bytes; i++)
        cost += text[i] == '[' || text[i] == '{' ? LIST_COST : text[i] == ',' ? VALUE_COST : 0;
    return bytes > SHORT_TEXT && cost / MOST_TIMES > bytes;
}
