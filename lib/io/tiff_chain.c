#include "io/tiff_chain.h"

#include <errno.h>
#include <hadalens/limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { TAG_SUBFILE = 254, TAG_OLD_SUBFILE = 255 };

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

/* An unsigned number of `bytes` bytes in the file's order. */
static uint64_t number(const hada_tiff_chain *chain, const unsigned char *from, int bytes)
{
    const uint16_t one = 1;
    int little_machine = *(const unsigned char *)&one, little = chain->swapped ? !little_machine : little_machine;
    uint64_t value = 0;
    for (int i = 0; i < bytes; i++)
        value = value << 8 | from[little ? bytes - 1 - i : i];
    return value;
}

static hada_status cut_off(hada_error *err, size_t page)
{
    return hada_fail(err, HADA_ERROR_FILE_READ,
                     "the file ends before the directory of page %zu: it is cut off or damaged; get it again",
                     page + 1);
}

/* Reads the entries of the directory at `offset` into *entries (allocated). */
static hada_status read_directory(const hada_tiff_chain *chain, int fd, uint64_t offset, size_t page,
                                  unsigned char **entries, uint64_t *count, uint64_t *next, hada_error *err)
{
    unsigned char head[8];
    int count_bytes = chain->big ? 8 : 2, entry_bytes = chain->big ? 20 : 12, next_bytes = chain->big ? 8 : 4;
    *entries = NULL;
    if (offset > chain->bytes || chain->bytes - offset < (uint64_t)count_bytes ||
        hada_read_at(fd, head, (size_t)count_bytes, offset))
        return cut_off(err, page);
    *count = number(chain, head, count_bytes);
    if (*count > 65535 || chain->bytes - offset - (uint64_t)count_bytes < *count * (uint64_t)entry_bytes)
        return cut_off(err, page);
    size_t bytes = (size_t)*count * (size_t)entry_bytes;
    *entries = malloc(bytes + (size_t)next_bytes);
    if (!*entries)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for a TIFF directory");
    if (hada_read_at(fd, *entries, bytes, offset + (uint64_t)count_bytes))
        return cut_off(err, page);
    /* Some writers leave out the link after the last directory when it is the end of the file. */
    uint64_t link = offset + (uint64_t)count_bytes + bytes;
    *next = 0;
    if (link + (uint64_t)next_bytes > chain->bytes)
        return HADA_OK;
    if (hada_read_at(fd, *entries + bytes, (size_t)next_bytes, link))
        return cut_off(err, page);
    *next = number(chain, *entries + bytes, next_bytes);
    return HADA_OK;
}

/* Thumbnails (reduced resolution) and masks are not frames. */
static int is_frame(const hada_tiff_chain *chain, const unsigned char *entries, uint64_t count)
{
    int step = chain->big ? 20 : 12, at = chain->big ? 12 : 8;
    for (uint64_t i = 0; i < count; i++) {
        const unsigned char *entry = entries + i * (uint64_t)step;
        unsigned tag = (unsigned)number(chain, entry, 2), type = (unsigned)number(chain, entry + 2, 2);
        uint64_t value = number(chain, entry + at, type == 3 ? 2 : 4);
        if (tag == TAG_SUBFILE)
            return !(value & 5u);
        if (tag == TAG_OLD_SUBFILE)
            return value != 2;
        if (tag > TAG_OLD_SUBFILE)
            break;
    }
    return 1;
}

static hada_status append(hada_tiff_chain *chain, uint64_t offset, size_t *room, hada_error *err)
{
    if (chain->count == *room) {
        *room = *room ? *room * 2 : 16;
        uint64_t *grown = realloc(chain->pages, *room * sizeof *grown);
        if (!grown)
            return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the list of pages");
        chain->pages = grown;
    }
    chain->pages[chain->count++] = offset;
    return HADA_OK;
}

static hada_status read_header(hada_tiff_chain *chain, int fd, uint64_t *first, hada_error *err)
{
    struct stat info;
    if (fstat(fd, &info) || !S_ISREG(info.st_mode))
        return hada_fail(err, HADA_ERROR_FILE_OPEN, "not an ordinary file");
    chain->bytes = (uint64_t)info.st_size;
    if (!chain->bytes)
        return hada_fail(err, HADA_ERROR_FILE_READ, "the file is empty");
    unsigned char head[16] = {0};
    if (hada_read_at(fd, head, chain->bytes < 16 ? (size_t)chain->bytes : 16, 0))
        return hada_fail(err, HADA_ERROR_FILE_READ, "the file cannot be read: %s", strerror(errno));
    const uint16_t one = 1;
    int little_machine = *(const unsigned char *)&one, little = head[0] == 'I';
    chain->swapped = little != little_machine;
    uint64_t version = number(chain, head + 2, 2);
    if (chain->bytes < 8 || head[0] != head[1] || (head[0] != 'I' && head[0] != 'M') ||
        (version != 42 && version != 43))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "not a TIFF file; convert it to TIFF first");
    chain->big = version == 43;
    if (chain->big && (chain->bytes < 16 || number(chain, head + 4, 2) != 8))
        return hada_fail(err, HADA_ERROR_FILE_READ, "the BigTIFF header is cut off or damaged; get the file again");
    *first = chain->big ? number(chain, head + 8, 8) : number(chain, head + 4, 4);
    return HADA_OK;
}

hada_status hada_tiff_chain_read(hada_tiff_chain *chain, int fd, hada_error *err)
{
    hada_status status = HADA_OK;
    unsigned char *entries = NULL;
    uint64_t offset = 0;
    *chain = (hada_tiff_chain){0};
    HADA_TRY_OR_DONE(read_header(chain, fd, &offset, err));
    /* A ring of directories is found by Brent's method: compare with a mark that moves on at powers of two. */
    uint64_t mark = 0, seen = 0;
    size_t room = 0;
    hada_limits limits = {.size = sizeof limits};
    HADA_TRY_OR_DONE(hada_limits_get(&limits, err));
    for (size_t step = 0, power = 1; offset; step++) {
        if (offset == mark)
            HADA_TRY_OR_DONE(
                hada_fail(err, HADA_ERROR_FILE_READ, "the pages of the file form a ring: it is damaged; get it again"));
        if (step == power) {
            mark = offset;
            power *= 2;
        }
        uint64_t count, next = 0;
        if (step == limits.pages)
            HADA_TRY_OR_DONE(
                hada_fail(err, HADA_ERROR_FILE_FORMAT,
                          "the file has more than %llu pages, more than the limits allow (options.limits pages=N)",
                          (unsigned long long)limits.pages));
        HADA_TRY_OR_DONE(read_directory(chain, fd, offset, step, &entries, &count, &next, err));
        /* those of a sound file do not overlap */
        seen += count * (chain->big ? 20u : 12u);
        if (seen > chain->bytes)
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ,
                                       "the directories of the pages overlap: the file is damaged; get it again"));
        if (is_frame(chain, entries, count))
            HADA_TRY_OR_DONE(append(chain, offset, &room, err));
        free(entries);
        entries = NULL;
        offset = next;
    }
    if (!chain->count)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "the TIFF file holds no image; get it again"));
done:
    free(entries);
    if (status)
        hada_tiff_chain_free(chain);
    return status;
}

void hada_tiff_chain_free(hada_tiff_chain *chain)
{
    free(chain->pages);
    *chain = (hada_tiff_chain){0};
}

uint64_t hada_tiff_chain_find(const hada_tiff_chain *chain, int fd, uint64_t directory, unsigned tag, uint64_t *bytes)
{
    static const unsigned char sizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
    unsigned char *entries;
    uint64_t count, next, found = 0;
    const int step = chain->big ? 20 : 12, wide = chain->big ? 8 : 4;
    if (read_directory(chain, fd, directory, 0, &entries, &count, &next, NULL))
        count = 0; /* one that cannot be read has no entries */
    for (uint64_t i = 0; i < count && !found; i++) {
        const unsigned char *entry = entries + i * (uint64_t)step;
        unsigned type = (unsigned)number(chain, entry + 2, 2);
        if (number(chain, entry, 2) != tag || type >= sizeof sizes)
            continue;
        uint64_t values = number(chain, entry + 4, wide);
        if (values > chain->bytes)
            continue;
        *bytes = values * sizes[type];
        found = *bytes <= (uint64_t)wide ? directory + (chain->big ? 8u : 2u) + i * (uint64_t)step + 4 + (uint64_t)wide
                                         : number(chain, entry + 4 + wide, wide);
        if (found > chain->bytes || *bytes > chain->bytes - found)
            found = 0;
    }
    free(entries);
    return found;
}
