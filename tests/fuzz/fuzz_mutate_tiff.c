/* TIFF: entries of its directories, and pictures that libtiff writes. */
#include <string.h>
#include <sys/mman.h>
#include <tiffio.h>
#include <unistd.h>

#include "fuzz_mutate.h"

#define COUNT(list) (sizeof(list) / sizeof(list)[0])
#define PICK(list)  (list)[fuzz_below(luck, COUNT(list))]

typedef struct tiff {
    uint8_t *data;
    size_t bytes, room;
    int big, little;
    size_t step, wide, head; /* bytes of an entry, of a count or place, of a directory's number of entries */
} tiff;

/* A directory: where its number of entries stands, and how many there are within the file. */
typedef struct directory {
    size_t at, count;
} directory;

static uint64_t get(const tiff *file, uint64_t at, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes && at <= file->bytes && bytes <= file->bytes - at; i++)
        value = value << 8 | file->data[at + (file->little ? bytes - 1 - i : i)];
    return value;
}

static void put(const tiff *file, uint64_t at, size_t bytes, uint64_t value)
{
    for (size_t i = 0; i < bytes && at <= file->bytes && bytes <= file->bytes - at; i++)
        file->data[at + (file->little ? i : bytes - 1 - i)] = (uint8_t)(value >> 8 * i);
}

static int parse(tiff *file, uint8_t *data, size_t bytes, size_t room)
{
    *file = (tiff){.data = data, .bytes = bytes, .room = room};
    if (bytes < 16 || data[0] != data[1] || (data[0] != 'I' && data[0] != 'M'))
        return 0;
    file->little = data[0] == 'I';
    file->big = get(file, 2, 2) == 43;
    file->wide = file->big ? 8 : 4;
    file->head = file->big ? 8 : 2;
    file->step = 4 + 2 * file->wide;
    return file->big || get(file, 2, 2) == 42;
}

/* One of the first directories of the chain; 0: there is none. */
static int find_directory(const tiff *file, fuzz_luck *luck, directory *found)
{
    size_t wanted = fuzz_below(luck, 4);
    uint64_t at = get(file, file->wide, file->wide);
    *found = (directory){0};
    do {
        if (at < 8 || at + file->head > file->bytes)
            break;
        const uint64_t count = get(file, at, file->head), most = (file->bytes - at - file->head) / file->step;
        *found = (directory){(size_t)at, (size_t)(count < most ? count : most)};
        at = get(file, at + file->head + found->count * file->step, file->wide);
    } while (wanted--);
    return found->count > 0;
}

static size_t entry(const tiff *file, const directory *in, size_t number)
{
    return in->at + file->head + number * file->step;
}

/* Copies `bytes` bytes to the end of the file, at an even place; where, or 0 without room. */
static size_t append(tiff *file, size_t from, size_t bytes)
{
    const size_t at = file->bytes + (file->bytes & 1);
    if (at + bytes > file->room || from + bytes > file->bytes)
        return 0;
    file->data[at - 1] = at > file->bytes ? 0 : file->data[at - 1];
    memmove(file->data + at, file->data + from, bytes);
    file->bytes = at + bytes;
    return at;
}

static const uint16_t tags[] = {254, 255, 256, 257, 258, 259, 262,   266,   270,   271,   273,  274, 277,
                                278, 279, 280, 281, 282, 283, 284,   296,   317,   318,   320,  322, 323,
                                324, 325, 330, 338, 339, 340, 341,   347,   512,   513,   514,  519, 520,
                                521, 529, 530, 531, 532, 700, 33421, 33422, 34665, 50706, 65000};

/* A value that means something to this tag, or lies at an edge. */
static uint64_t value_of(unsigned tag, fuzz_luck *luck)
{
    static const uint16_t codecs[] = {1,     2,     3,     4,     5,     6,     7,     8,    32773,
                                      32946, 34661, 34676, 34887, 34925, 50000, 50001, 50002},
                          bits[] = {1, 2, 4, 7, 8, 9, 12, 15, 16, 24, 32, 64},
                          photometric[] = {0, 1, 2, 3, 4, 5, 6, 8, 32803, 32844},
                          sides[] = {1, 2, 3, 5, 7, 8, 15, 16, 17, 64, 255, 256, 4096, 65535};
    static const uint64_t edges[] = {0,     1,        2,         3,          255,       256,       65535,
                                     65536, 1u << 24, INT32_MAX, UINT32_MAX, INT64_MAX, UINT64_MAX};
    switch (fuzz_below(luck, 6) ? tag : 0) {
    case 256:
    case 257:
    case 278:
    case 322:
    case 323: return PICK(sides);
    case 258: return PICK(bits);
    case 259: return PICK(codecs);
    case 262: return PICK(photometric);
    case 254:
    case 255:
    case 266:
    case 277:
    case 284:
    case 296:
    case 317:
    case 338:
    case 339: return fuzz_below(luck, 7);
    default: return PICK(edges);
    }
}

static void change_entry(const tiff *file, const directory *in, fuzz_luck *luck)
{
    static const uint8_t sizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
    const size_t at = entry(file, in, fuzz_below(luck, in->count)), value_at = at + 4 + file->wide;
    const unsigned tag = (unsigned)get(file, at, 2), type = (unsigned)get(file, at + 2, 2);
    const uint64_t count = get(file, at + 4, file->wide), place = get(file, value_at, file->wide);
    const size_t size = type < sizeof sizes && sizes[type] ? sizes[type] : 1;
    const int inside = count * size <= file->wide;
    switch (fuzz_below(luck, 8)) {
    case 0: put(file, at, 2, PICK(tags)); break;
    case 1: put(file, at + 2, 2, fuzz_below(luck, 20)); break;
    case 2:
        put(file, at + 4, file->wide, fuzz_below(luck, 2) ? count + fuzz_below(luck, 3) - 1 : value_of(0, luck));
        break;
    case 3: /* where its values, or a strip, are said to be */
        put(file, value_at, file->wide,
            fuzz_below(luck, 2) ? place + fuzz_below(luck, 9) - 4 : fuzz_below(luck, file->bytes + 2));
        break;
    case 4: /* one of a list, such as strips and their bytes */
        put(file, (inside ? value_at : place) + size * fuzz_below(luck, count < 64 ? (size_t)count : 64), size,
            fuzz_below(luck, 2) ? fuzz_below(luck, file->bytes + 2) : value_of(tag, luck));
        break;
    default: put(file, value_at, inside ? size : file->wide, value_of(tag, luck)); break;
    }
}

/* A copy of the directory at the end, with or without a tag more or less, which takes its place or follows it. */
static void copy_directory(tiff *file, const directory *in, fuzz_luck *luck)
{
    const size_t link = in->at + file->head + in->count * file->step, rest = link + file->wide - in->at;
    const int more = (int)fuzz_below(luck, 3) - 1; /* a tag more, or less */
    const size_t at = append(file, in->at, rest), place = fuzz_below(luck, in->count);
    if (!at)
        return;
    const directory copy = {at, in->count};
    const size_t there = entry(file, &copy, place);
    if (more > 0 && file->bytes + file->step <= file->room) {
        memmove(file->data + there + file->step, file->data + there, file->bytes - there);
        file->bytes += file->step;
        put(file, there, 2, get(file, there, 2) + fuzz_below(luck, 2) * (1 + fuzz_below(luck, 3)));
        put(file, there + 2, 2, 3 + fuzz_below(luck, 2));
        put(file, there + 4, file->wide, 1);
        put(file, there + 4 + file->wide, file->wide, value_of((unsigned)get(file, there, 2), luck));
        put(file, at, file->head, in->count + 1);
    } else if (more < 0) {
        memmove(file->data + there, file->data + there + file->step, file->bytes - there - file->step);
        file->bytes -= file->step;
        put(file, at, file->head, in->count - 1);
    }
    put(file, fuzz_below(luck, 2) ? file->wide : link, file->wide, at); /* the first one, or the next */
}

static void set_picture(TIFF *out, uint32_t cols, uint32_t rows, fuzz_luck *luck)
{
    static const uint16_t codecs[] = {1, 1, 2, 3, 4, 5, 7, 8, 32773, 32946, 34887, 34925, 50000, 50001},
                          bits[] = {1, 4, 8, 8, 8, 10, 12, 16, 16, 32, 64}, colours[] = {0, 1, 1, 2, 2, 3, 6};
    static const char *const texts[] = {"ImageJ=1.53\nimages=2\nchannels=2\n",
                                        "ImageJ=1.53\nimages=2\nslices=2\nspacing=2\nunit=um\n",
                                        "distances_mm: 1,2\nencoding: srgb\n", "{\"shape\": [2, 3]}"};
    const uint16_t codec = PICK(codecs), fax = codec >= 2 && codec <= 4,
                   colour = fax ? (uint16_t)fuzz_below(luck, 2) : PICK(colours);
    const uint16_t samples = fax || colour == 3           ? 1
                             : colour == 2 || colour == 6 ? (uint16_t)(3 + fuzz_below(luck, 2))
                                                          : (uint16_t)(1 + fuzz_below(luck, 3));
    TIFFSetField(out, TIFFTAG_IMAGEWIDTH, cols);
    TIFFSetField(out, TIFFTAG_IMAGELENGTH, rows);
    TIFFSetField(out, TIFFTAG_SAMPLESPERPIXEL, samples);
    TIFFSetField(out, TIFFTAG_BITSPERSAMPLE, fax ? 1 : codec == 7 || colour == 3 ? 8 : PICK(bits));
    TIFFSetField(out, TIFFTAG_SAMPLEFORMAT, fax || fuzz_below(luck, 3) ? 1 : (int)(1 + fuzz_below(luck, 3)));
    TIFFSetField(out, TIFFTAG_PHOTOMETRIC, colour);
    TIFFSetField(out, TIFFTAG_PLANARCONFIG, (int)(1 + !fuzz_below(luck, 3)));
    TIFFSetField(out, TIFFTAG_COMPRESSION, codec);
    TIFFSetField(out, TIFFTAG_FILLORDER, (int)(1 + !fuzz_below(luck, 4)));
    if ((codec == 5 || codec == 8 || codec == 50000) && fuzz_below(luck, 2))
        TIFFSetField(out, TIFFTAG_PREDICTOR, (int)(1 + fuzz_below(luck, 3)));
    if (codec == 7 && colour == 6)
        TIFFSetField(out, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    if (fuzz_below(luck, 3)) {
        TIFFSetField(out, TIFFTAG_ROWSPERSTRIP, (uint32_t)(1 + fuzz_below(luck, rows)) * (codec == 7 ? 16 : 1));
    } else {
        TIFFSetField(out, TIFFTAG_TILEWIDTH, (uint32_t)(16 + 16 * fuzz_below(luck, 3)));
        TIFFSetField(out, TIFFTAG_TILELENGTH, (uint32_t)(16 + 16 * fuzz_below(luck, 2)));
    }
    if (colour == 3) {
        static uint16_t map[256];
        TIFFSetField(out, TIFFTAG_COLORMAP, map, map, map);
    }
    if (!fuzz_below(luck, 3))
        TIFFSetField(out, TIFFTAG_IMAGEDESCRIPTION, PICK(texts));
}

static int write_page(TIFF *out, fuzz_luck *luck)
{
    static uint8_t piece[1 << 16];
    set_picture(out, (uint32_t)(1 + fuzz_below(luck, 24)), (uint32_t)(1 + fuzz_below(luck, 18)), luck);
    const int tiled = TIFFIsTiled(out), smooth = (int)fuzz_below(luck, 3);
    const tmsize_t size = tiled ? TIFFTileSize(out) : TIFFStripSize(out);
    const uint32_t pieces = tiled ? TIFFNumberOfTiles(out) : TIFFNumberOfStrips(out);
    if (size <= 0 || size > (tmsize_t)sizeof piece || pieces > 64)
        return 0;
    for (tmsize_t k = 0; k < size; k++) /* a repeating noise, or slopes */
        piece[k] = (uint8_t)(smooth ? k >> smooth : k < 251 ? (tmsize_t)fuzz_below(luck, 256) : piece[k - 251]);
    for (uint32_t i = 0; i < pieces; i++)
        if ((tiled ? TIFFWriteEncodedTile(out, i, piece, size) : TIFFWriteEncodedStrip(out, i, piece, size)) < 0)
            return 0;
    return TIFFWriteDirectory(out);
}

/* A new file by libtiff; 0: this kind cannot be written, or is too long. */
static size_t write_file(uint8_t *data, size_t room, fuzz_luck *luck)
{
    static const char *const modes[] = {"wl", "wb", "w8l", "w8b"};
    const int fd = memfd_create("picture", MFD_CLOEXEC);
    TIFFSetErrorHandler(NULL);
    TIFFSetWarningHandler(NULL);
    TIFF *out = fd < 0 ? NULL : TIFFFdOpen(dup(fd), "picture", PICK(modes));
    int pages = 1 + (int)fuzz_below(luck, 3), good = out != NULL;
    while (good && pages--)
        good = write_page(out, luck);
    if (out)
        TIFFClose(out);
    const off_t bytes = good ? lseek(fd, 0, SEEK_END) : 0;
    good = bytes > 0 && (size_t)bytes <= room && pread(fd, data, (size_t)bytes, 0) == bytes;
    if (fd >= 0)
        close(fd);
    return good ? (size_t)bytes : 0;
}

size_t fuzz_mutate_tiff(uint8_t *data, size_t bytes, size_t room, uint64_t seed, fuzz_plain *plain)
{
    fuzz_luck luck = {seed};
    tiff file;
    const size_t way = fuzz_below(&luck, 64);
    if (way == 0) {
        const size_t made = write_file(data, room, &luck);
        return made ? made : plain(data, bytes, room);
    }
    if (way < 20 || !parse(&file, data, bytes, room))
        return plain(data, bytes, room);
    for (size_t times = 1 + fuzz_below(&luck, 3); times; times--) {
        directory in;
        if (!find_directory(&file, &luck, &in))
            return plain(data, bytes, room);
        if (fuzz_below(&luck, 5))
            change_entry(&file, &in, &luck);
        else
            copy_directory(&file, &in, &luck);
    }
    return file.bytes;
}
