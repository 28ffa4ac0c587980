#include "io/decode.h"

#include <hadalens/headerless.h>
#include <limits.h>
#include <pthread.h>

/* Beyond it, a size is a mistake. */
enum { MOST_OF_A_SIDE = 1 << 24 };

static const unsigned alignments[] = {1, 16, 32, 64};

static const struct {
    char name[6];
    int bits, channels;
    hada_packing packing;
} kinds[] = {{"u8", 8, 1, HADA_PACKING_NONE},   {"u10", 10, 1, HADA_PACKING_NONE},
             {"u12", 12, 1, HADA_PACKING_NONE}, {"u14", 14, 1, HADA_PACKING_NONE},
             {"u16", 16, 1, HADA_PACKING_NONE}, {"csi10", 10, 1, HADA_PACKING_CSI10},
             {"rgb8", 8, 3, HADA_PACKING_NONE}, {"csi12", 12, 1, HADA_PACKING_CSI12}};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static hada_headerless chosen; /* rows 0: none */

/* Bytes of the samples of a row. */
static uint64_t row_bytes(const hada_headerless *frames)
{
    const uint64_t samples = (uint64_t)frames->cols * (uint64_t)frames->channels;
    return frames->packing == HADA_PACKING_CSI10   ? (samples + 3) / 4 * 5
           : frames->packing == HADA_PACKING_CSI12 ? (samples + 1) / 2 * 3
           : frames->bits > 8                      ? 2 * samples
                                                   : samples;
}

/* A whole number above 0, of digits alone. */
static int read_whole(const char **text, uint64_t most, uint64_t *value)
{
    *value = 0;
    for (; **text >= '0' && **text <= '9' && *value <= most; ++*text)
        *value = *value * 10 + (uint64_t)(**text - '0');
    return *value > 0 && *value <= most;
}

static int read_kind(const char **text, hada_headerless *frames)
{
    for (size_t i = 0; i < HADA_COUNT(kinds); i++) {
        const size_t length = strlen(kinds[i].name);
        if (strncmp(*text, kinds[i].name, length) || ((*text)[length] && (*text)[length] != ':'))
            continue;
        frames->bits = kinds[i].bits;
        frames->channels = kinds[i].channels;
        frames->packing = kinds[i].packing;
        *text += length;
        return 1;
    }
    return 0;
}

static int parse(hada_headerless *frames, const char *text)
{
    uint64_t rows, cols;
    if (!read_whole(&text, MOST_OF_A_SIDE, &rows) || *text++ != 'x' || !read_whole(&text, MOST_OF_A_SIDE, &cols) ||
        *text++ != ':' || !read_kind(&text, frames))
        return 0;
    frames->rows = (int)rows;
    frames->cols = (int)cols;
    return !*text || (*text++ == ':' && read_whole(&text, UINT64_C(1) << 32, &frames->row_bytes) && !*text);
}

hada_status hada_headerless_set(const char *text, hada_error *err)
{
    hada_headerless frames = {0};
    if (text && !parse(&frames, text))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.headerless: '%.60s' is not understood; write HEIGHTxWIDTH:PIXELS, such as "
                         "1520x2028:csi12, where PIXELS is u8, u10, u12, u14, u16, csi10, csi12 or rgb8",
                         text);
    if (text && frames.row_bytes && frames.row_bytes < row_bytes(&frames))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.headerless: a row of '%.60s' has at least %llu bytes", text,
                         (unsigned long long)row_bytes(&frames));
    pthread_mutex_lock(&lock);
    chosen = frames;
    pthread_mutex_unlock(&lock);
    return HADA_OK;
}

int hada_headerless_get(hada_headerless *frames)
{
    pthread_mutex_lock(&lock);
    *frames = chosen;
    pthread_mutex_unlock(&lock);
    return frames->rows > 0;
}

uint64_t hada_headerless_bytes(const hada_headerless *frames, unsigned alignment)
{
    const uint64_t row = hada_round_up(row_bytes(frames), alignment);
    return (frames->row_bytes ? frames->row_bytes : row) * (uint64_t)frames->rows;
}

hada_status hada_headerless_fit(hada_headerless *frames, uint64_t bytes, int *count, hada_error *err)
{
    for (size_t i = 0; i < HADA_COUNT(alignments); i++) {
        const uint64_t frame = hada_headerless_bytes(frames, alignments[i]);
        if (bytes < frame || bytes % frame || bytes / frame > INT_MAX)
            continue;
        frames->row_bytes = frame / (uint64_t)frames->rows;
        *count = (int)(bytes / frame);
        return HADA_OK;
    }
    return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                     "of no known format, and its %llu bytes are no whole frames of %d x %d (%llu bytes each) as "
                     "options.headerless says; give the bytes of a row as well, such as HxW:PIXELS:3072",
                     (unsigned long long)bytes, frames->rows, frames->cols,
                     (unsigned long long)hada_headerless_bytes(frames, 1));
}

/* Sample `i` of a packed row. */
static unsigned sample(hada_packing packing, const unsigned char *row, size_t i)
{
    if (packing == HADA_PACKING_CSI10) {
        const unsigned char *group = row + i / 4 * 5;
        return (unsigned)group[i % 4] << 2 | (group[4] >> 2 * (i % 4) & 3u);
    }
    const unsigned char *group = row + i / 2 * 3;
    return (unsigned)group[i % 2] << 4 | (group[2] >> 4 * (i % 2) & 15u);
}

void hada_headerless_unpack(const hada_headerless *frames, const unsigned char *from, void *to)
{
    const size_t count = (size_t)frames->cols * (size_t)frames->channels;
    const uint64_t step = frames->row_bytes ? frames->row_bytes : row_bytes(frames);
    for (int row = 0; row < frames->rows; row++, from += step) {
        uint16_t *words = (uint16_t *)to + (size_t)row * count;
        if (frames->bits <= 8)
            memcpy((unsigned char *)to + (size_t)row * count, from, count);
        for (size_t i = 0; frames->bits > 8 && i < count; i++)
            words[i] = (uint16_t)(frames->packing ? sample(frames->packing, from, i)
                                                  : (unsigned)from[2 * i] | (unsigned)from[2 * i + 1] << 8);
    }
}
