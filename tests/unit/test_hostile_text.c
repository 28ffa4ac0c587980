/* Texts and pictures that are made to cost: each is read in a process of its own, which ends within four seconds of
 * processor time and 256 MiB, whatever the file says. */
#include <sys/resource.h>
#include <sys/wait.h>
#include <tiffio.h>

#include "io/safetensors.h"
#include "io_testing.h"
#include "runtime/tuning.h"

#ifdef HADALENS_SANITIZED
enum { MOST_MS = 40000, MOST_KIB = 1 << 30 }; /* shadow memory is not ours */
#else
enum { MOST_MS = 4000, MOST_KIB = 256 << 10 };
#endif

/* Reads the file at the path, and frees what it read. */
typedef hada_status (*attempt)(const char *path, hada_error *err);

enum { REFUSED = 1, READ = 0, ANY = -1 };

/* Returns 0 where it took too long, which is the end of the test where it is the last try. */
static int ends_soon(const char *what, attempt look, const char *path, int wanted, int last)
{
    struct rusage usage;
    int code = -1, pipes[2];
    char message[600] = "";
    assert_int_equal(pipe(pipes), 0);
    fflush(NULL);
    const pid_t child = fork();
    if (!child) {
        hada_error err = {0};
        const hada_status status = look(path, &err);
        if (write(pipes[1], err.message, status ? strlen(err.message) : 0) < 0)
            _exit(3);
        _exit(status != HADA_OK);
    }
    close(pipes[1]);
    assert_true(child > 0 && wait4(child, &code, 0, &usage) == child);
    assert_true(read(pipes[0], message, sizeof message - 1) >= 0); /* shorter than what a pipe holds */
    close(pipes[0]);
    const long ms = usage.ru_utime.tv_sec * 1000 + usage.ru_utime.tv_usec / 1000 + usage.ru_stime.tv_sec * 1000 +
                    usage.ru_stime.tv_usec / 1000;
    if (getenv("HOSTILE_SHOW"))
        print_message("%-28s %5ld ms %7ld KiB  %s\n", what, ms, usage.ru_maxrss, message);
    if (!WIFEXITED(code) || WEXITSTATUS(code) > 1 || (wanted != ANY && WEXITSTATUS(code) != wanted))
        fail_msg("%s: ended with %d: %s", what, code, message);
    if (WEXITSTATUS(code) && strlen(message) < 20)
        fail_msg("%s: no message", what);
    if ((ms > MOST_MS && last) || usage.ru_maxrss > MOST_KIB)
        fail_msg("%s: %ld ms, %ld KiB: %s", what, ms, usage.ru_maxrss, message);
    return ms <= MOST_MS;
}

/* Whoever shares caches and units of a core lengthens the processor's time as well: once in three tries. */
static void expect(const char *what, attempt look, const char *path, int wanted)
{
    enum { TRIES = 3 };
    for (int i = 1; i <= TRIES && !ends_soon(what, look, path, wanted, i == TRIES); i++)
        ;
}

static hada_status read_tensors(const char *path, hada_error *err)
{
    hada_tensors *tensors;
    const hada_status status = hada_tensors_open(&tensors, path, err);
    hada_tensors_close(&tensors);
    return status;
}

static hada_status read_net(const char *path, hada_error *err)
{
    SCOPED(hada_net) * net;
    size_t bytes;
    SCOPED_MEMORY char *text = (char *)io_read_bytes(path, &bytes);
    text[bytes] = '\0';
    return hada_net_create(&net, text, 1, err);
}

static hada_status read_camera(const char *path, hada_error *err)
{
    hada_camera camera = {.size = sizeof camera};
    return hada_camera_load(&camera, path, err);
}

static hada_status read_tuning(const char *path, hada_error *err)
{
    SCOPED(hada_tuning) * tuning;
    return hada_tuning_read(&tuning, path, err);
}

static hada_status read_picture(const char *path, hada_error *err)
{
    SCOPED(hada_image) image;
    return hada_tiff_load(path, 0, &image, err);
}

/* `head`, `part` so often that `bytes` are filled, `tail`; %d in a part: its number. */
static void write_text(const char *head, const char *part, const char *tail, size_t bytes, int framed)
{
    SCOPED_MEMORY char *text = malloc(bytes + 400);
    char *at = text + 8;
    at += sprintf(at, "%s", head);
    for (int i = 0; (size_t)(at - text) + strlen(part) + 20 + strlen(tail) < bytes; i++) {
        const char *number = strstr(part, "%d");
        at += i ? sprintf(at, ",") : 0;
        at += number ? sprintf(at, "%.*s%d%s", (int)(number - part), part, i, number + 2) : sprintf(at, "%s", part);
    }
    at += sprintf(at, "%s", tail);
    const size_t length = (size_t)(at - text) - 8;
    for (int i = 0; i < 8; i++)
        text[i] = (char)(length >> 8 * i);
    io_write_bytes(io_path("text"), framed ? text : text + 8, framed ? length + 8 : length);
}

static const char *const parts[] = {"[]",           "{}",   "1",         "\"\"",       "null",
                                    "[[[[[[]]]]]]", "1e99", "[1,2,3,4]", "{\"a\":{}}", "\"\\u0041\""};
#define PARTS (sizeof parts / sizeof *parts)

/* As long as the limits allow, of what is shortest in bytes and longest in memory. */
TEST(headers_of_tensors)
{
    enum { LONGEST = 8388600 };
    for (size_t i = 0; i < PARTS; i++) {
        write_text("{\"a\":[", parts[i], "]}", LONGEST, 1);
        expect(parts[i], read_tensors, io_path("text"), REFUSED);
    }
    write_text("{", "\"%d\":0", "}", LONGEST, 1);
    expect("names", read_tensors, io_path("text"), REFUSED);
    write_text("{\"__metadata__\":{", "\"%d\":\"\"", "}}", LONGEST, 1);
    expect("metadata", read_tensors, io_path("text"), ANY);
    write_text("{", "\"%d\":{\"dtype\":\"U8\",\"shape\":[],\"data_offsets\":[0,0]}", "}", LONGEST, 1);
    expect("tensors", read_tensors, io_path("text"), REFUSED);
    write_text("{", "\"%d\":{\"dtype\":\"U8\",\"shape\":[0],\"data_offsets\":[0,0]}", "}", LONGEST, 1);
    expect("tensors of nothing", read_tensors, io_path("text"), ANY);
    write_text("", "[[[[[[[[", "", LONGEST, 1);
    expect("deep", read_tensors, io_path("text"), REFUSED);
}

TEST(lists_of_layers)
{
    enum { LONGEST = 8388000 };
    static const char head[] = "{\"format\":\"hadalens-net-1\",\"layers\":[{\"layer\":\"input\",\"channels\":1},";
    for (size_t i = 0; i < PARTS; i++) {
        write_text(head, parts[i], "]}", LONGEST, 0);
        expect(parts[i], read_net, io_path("text"), REFUSED);
    }
    static const char *const layers[] = {
        "{\"layer\":\"relu\"}", "{\"layer\":\"conv\",\"name\":\"c%d\",\"channels\":3,\"kernel\":3}",
        "{\"layer\":\"concat\",\"from\":[0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0]}", "{\"layer\":\"add\",\"from\":[0,%d]}"};
    for (size_t i = 0; i < 4; i++) {
        write_text(head, layers[i], "]}", LONGEST, 0);
        expect(layers[i], read_net, io_path("text"), REFUSED);
        write_text(head, layers[i], "]}", 22000, 0);
        expect(layers[i], read_net, io_path("text"), ANY);
    }
    /* 49 million weights, just below what is allowed without their values */
    write_text(head, "{\"layer\":\"conv\",\"name\":\"c\",\"channels\":65536,\"kernel\":27}", "]}", 190, 0);
    expect("many weights", read_net, io_path("text"), ANY);
}

TEST(small_text_files)
{
    for (size_t i = 0; i < PARTS; i++) {
        write_text("{\"format\":\"hadalens-camera-1\",\"distances_mm\":[", parts[i], "]}", 1000000, 0);
        expect(parts[i], read_camera, io_path("text"), REFUSED);
    }
    SCOPED_MEMORY char *rows = malloc(4 << 20);
    char *at = rows;
    while (at - rows < (4 << 20) - 40)
        at += sprintf(at, "fft cpu %dx%d own\n", 1 + (int)(at - rows) % 999, 1 + (int)(at - rows) / 999);
    io_write_bytes(io_path("text"), rows, (size_t)(at - rows));
    expect("tuning", read_tuning, io_path("text"), ANY);
    memset(rows, '\n', 4 << 20);
    io_write_bytes(io_path("text"), rows, 4 << 20);
    expect("empty lines", read_tuning, io_path("text"), ANY);
    memset(rows, 'a', 4 << 20);
    io_write_bytes(io_path("text"), rows, 4 << 20);
    expect("one word", read_tuning, io_path("text"), REFUSED);
}

/* A picture of zeros, compressed: as large as a file may claim, of numbers as wide as there are. */
static void write_zeros(uint32_t rows, uint32_t cols, uint16_t bits, uint16_t samples, uint32_t strip, int tiled)
{
    TIFF *tif = TIFFOpen(io_path("zeros.tif"), "w");
    assert_non_null(tif);
    TIFFSetField(tif, TIFFTAG_IMAGEWIDTH, cols);
    TIFFSetField(tif, TIFFTAG_IMAGELENGTH, rows);
    TIFFSetField(tif, TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(tif, TIFFTAG_SAMPLESPERPIXEL, samples);
    TIFFSetField(tif, TIFFTAG_SAMPLEFORMAT, bits >= 32 ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    TIFFSetField(tif, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tif, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tif, TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE);
    if (tiled) {
        TIFFSetField(tif, TIFFTAG_TILEWIDTH, strip);
        TIFFSetField(tif, TIFFTAG_TILELENGTH, strip);
    } else {
        TIFFSetField(tif, TIFFTAG_ROWSPERSTRIP, strip);
    }
    const tmsize_t size = tiled ? TIFFTileSize(tif) : TIFFStripSize(tif);
    void *zeros = calloc(1, (size_t)size);
    const uint32_t pieces = tiled ? TIFFNumberOfTiles(tif) : TIFFNumberOfStrips(tif);
    for (uint32_t i = 0; i < pieces; i++)
        assert_true((tiled ? TIFFWriteEncodedTile(tif, i, zeros, size) : TIFFWriteEncodedStrip(tif, i, zeros, size)) >
                    0);
    free(zeros);
    TIFFClose(tif);
}

TEST(pictures_of_nothing)
{
    static const struct {
        uint32_t rows, cols;
        uint16_t bits, samples;
        uint32_t strip;
        int tiled;
    } cases[] = {
        /* just below the limit */
        {1830, 1830, 8, 1, 1830, 0},
        {1448, 1448, 32, 1, 1448, 0},
        {1182, 1182, 64, 1, 1182, 0},
        {2030, 2030, 64, 1, 16, 0},
        {2016, 2016, 1, 1, 2016, 0},
        {1430, 1430, 64, 2, 16, 0},
        {1168, 1168, 64, 1, 1168, 1},
        /* above it */
        {5792, 5792, 8, 1, 5792, 0},
        {5792, 5792, 32, 1, 5792, 0},
        {5792, 5792, 64, 1, 5792, 0},
        {4090, 4090, 64, 2, 4090, 0},
        {1448, 1448, 64, 16, 1448, 0},
        {16, 16, 64, 1, 5792, 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char what[100];
        write_zeros(cases[i].rows, cases[i].cols, cases[i].bits, cases[i].samples, cases[i].strip, cases[i].tiled);
        snprintf(what, sizeof what, "%ux%ux%u, %u bits, pieces of %u", cases[i].rows, cases[i].cols, cases[i].samples,
                 cases[i].bits, cases[i].strip);
        expect(what, read_picture, io_path("zeros.tif"), ANY);
    }
}

/* Strips and tags that a directory of some hundred bytes claims. */
TEST(directories_that_claim)
{
    static const struct {
        const char *what;
        uint32_t rows, cols, bits, samples, planar, strip, compression, offsets, counts;
    } cases[] = {
        {"a strip a row", 1 << 24, 1, 1, 1, 1, 1, 8, 1, 1},
        {"a strip a row, no sizes", 1 << 24, 1, 1, 1, 1, 1, 8, 1, 0},
        {"strips of strips", 1 << 24, 1, 1, 1, 1, 1, 8, 1 << 24, 1 << 24},
        {"a plane a sample", 8000, 1, 1, 4096, 2, 1, 8, 1, 1},
        {"a plane a sample, none", 8000, 1, 1, 4096, 2, 1, 1, 1, 0},
        {"one strip, plain", 1 << 24, 1, 1, 1, 1, 1 << 24, 1, 1, 1},
        {"one strip, plain, none", 1 << 24, 2, 1, 1, 1, 1 << 24, 1, 1, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        unsigned char file[4096] = "II*\0\10\0\0\0", *at = file + 8;
        const uint32_t entries[][4] = {{256, 4, 1, cases[i].cols},
                                       {257, 4, 1, cases[i].rows},
                                       {258, 3, 1, cases[i].bits},
                                       {259, 3, 1, cases[i].compression},
                                       {262, 3, 1, 1},
                                       {273, 4, cases[i].offsets, 200},
                                       {277, 3, 1, cases[i].samples},
                                       {278, 4, 1, cases[i].strip},
                                       {279, 4, cases[i].counts, 1000},
                                       {284, 3, 1, cases[i].planar}};
        at = io_put(at, cases[i].counts ? 10 : 9, 2);
        for (size_t k = 0; k < 10; k++)
            if (k != 8 || cases[i].counts)
                at = io_put(io_put(io_put(io_put(at, entries[k][0], 2), entries[k][1], 2), entries[k][2], 4),
                            entries[k][3], 4);
        io_write_bytes(io_path("claims.tif"), file, sizeof file);
        expect(cases[i].what, read_picture, io_path("claims.tif"), ANY);
    }
}

FIXTURE(io_setup, io_teardown)
