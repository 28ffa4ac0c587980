/* Safetensors: the header as JSON, also that within its texts, and offsets that fit it again. */
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz_mutate.h"

enum { LENGTH = 8, DEEPEST = 12 };
#define COUNT(list) (sizeof(list) / sizeof(list)[0])
#define PICK(list)  (list)[fuzz_below(luck, COUNT(list))]

static const char *const types[] = {"F32", "F64", "F16", "BF16", "I8",  "U8",   "I16",
                                    "U16", "I32", "U32", "I64",  "U64", "BOOL", "F8"};
static const uint8_t sizes[] = {4, 8, 2, 2, 1, 1, 2, 2, 4, 4, 8, 8, 1, 1};

static json_t *some_value(const json_t *old, fuzz_luck *luck)
{
    static const json_int_t numbers[] = {0,   1,     2,  3,         4,          8,         64,
                                         255, 65535, -1, INT32_MAX, UINT32_MAX, INT64_MAX, INT64_MIN};
    static const double reals[] = {0.0, 0.5, 1.0, -1.0, 1e-300, 1e300, 1e30};
    switch (fuzz_below(luck, 8)) {
    case 0: return json_null();
    case 1: return json_true();
    case 2: return json_array();
    case 3: return json_object();
    case 4: return json_real(PICK(reals));
    case 5: return json_string("");
    case 6: return json_integer((json_int_t)((uint64_t)json_integer_value(old) + fuzz_below(luck, 9) - 4));
    default: return json_integer(PICK(numbers));
    }
}

static json_t *changed(json_t *node, int depth, fuzz_luck *luck);

/* Texts of the metadata are numbers, words or JSON. */
static json_t *changed_text(const json_t *node, int depth, fuzz_luck *luck)
{
    static const char *const words[] = {
        "",     "0",         "1",     "-1",     "nan",      "1e308", "4294967296",  "18446744073709551615",
        "srgb", "gamma:2.2", "split", "padded", "circular", "1,2",   "\xc3\xb6\x01"};
    json_t *inner = json_loads(json_string_value(node), JSON_DECODE_ANY, NULL);
    if (!inner || fuzz_below(luck, 4) == 0) {
        json_decref(inner);
        return json_string(fuzz_below(luck, 3) ? PICK(words) : PICK(types));
    }
    inner = changed(inner, depth + 1, luck);
    char *text = json_dumps(inner, JSON_COMPACT | JSON_ENCODE_ANY);
    json_t *made = json_string(text ? text : "");
    free(text);
    json_decref(inner);
    return made;
}

/* A member replaced, removed, doubled or changed within. */
static void change_member(json_t *node, const char *key, int depth, fuzz_luck *luck)
{
    json_t *member = json_object_get(node, key);
    char other[64];
    switch (fuzz_below(luck, 12)) {
    case 0: json_object_del(node, key); break;
    case 1:
        snprintf(other, sizeof other, "%.40s%u", key, (unsigned)fuzz_below(luck, 10));
        json_object_set_new(node, other, json_deep_copy(member));
        break;
    case 2: json_object_set_new(node, key, some_value(member, luck)); break;
    default: json_object_set_new(node, key, changed(json_incref(member), depth + 1, luck)); break;
    }
}

static void change_item(json_t *node, size_t index, int depth, fuzz_luck *luck)
{
    json_t *item = json_array_get(node, index);
    switch (fuzz_below(luck, 8)) {
    case 0: json_array_remove(node, index); break;
    case 1: json_array_insert_new(node, index, json_deep_copy(item)); break;
    case 2: json_array_append_new(node, some_value(item, luck)); break;
    default: json_array_set_new(node, index, changed(json_incref(item), depth + 1, luck)); break;
    }
}

/* Takes over `node`; what stands in its place. */
static json_t *changed(json_t *node, int depth, fuzz_luck *luck)
{
    const size_t members = json_object_size(node), items = json_array_size(node);
    json_t *made = node;
    if (depth < DEEPEST && members) {
        size_t number = fuzz_below(luck, members);
        void *at = json_object_iter(node);
        while (number--)
            at = json_object_iter_next(node, at);
        char *key = strdup(json_object_iter_key(at));
        change_member(node, key, depth, luck);
        free(key);
    } else if (depth < DEEPEST && items) {
        change_item(node, fuzz_below(luck, items), depth, luck);
    } else {
        made = json_is_string(node) && depth < DEEPEST ? changed_text(node, depth, luck) : some_value(node, luck);
        json_decref(node);
    }
    return made;
}

static size_t type_of(const json_t *entry)
{
    const char *name = json_string_value(json_object_get(entry, "dtype"));
    size_t i = 0;
    while (name && i < COUNT(types) && strcmp(types[i], name))
        i++;
    return name && i < COUNT(types) ? i : COUNT(types);
}

/* Another type or shape of one tensor. */
static void change_tensor(json_t *header, fuzz_luck *luck)
{
    static const json_int_t extents[] = {0, 1, 1, 2, 3, 4, 8, 64};
    size_t number = fuzz_below(luck, json_object_size(header));
    const char *name;
    json_t *entry;
    json_object_foreach(header, name, entry)
    {
        json_t *shape = json_object_get(entry, "shape");
        const size_t dims = json_array_size(shape);
        if (number--)
            continue;
        switch (json_is_object(entry) ? fuzz_below(luck, 4) : 4) {
        case 0: json_object_set_new(entry, "dtype", json_string(PICK(types))); break;
        case 1: json_array_append_new(shape, json_integer(PICK(extents))); break;
        case 2: json_array_remove(shape, fuzz_below(luck, dims)); break;
        case 3: json_array_set_new(shape, fuzz_below(luck, dims), json_integer(PICK(extents))); break;
        default: break;
        }
        break;
    }
}

/* Offsets that follow from types and shapes, without gaps; the bytes of all. */
static size_t lay_out(json_t *header)
{
    uint64_t at = 0;
    const char *name;
    json_t *entry, *extent;
    size_t i;
    json_object_foreach(header, name, entry)
    {
        const size_t type = type_of(entry);
        uint64_t bytes = type < COUNT(types) ? sizes[type] : 0;
        if (!strcmp(name, "__metadata__") || !json_is_object(entry))
            continue;
        json_array_foreach(json_object_get(entry, "shape"), i, extent) bytes =
            bytes < 1u << 20 ? bytes * ((uint64_t)json_integer_value(extent) & 0xfffff) : 0;
        json_object_set_new(entry, "data_offsets", json_pack("[I, I]", (json_int_t)at, (json_int_t)(at + bytes)));
        at += bytes;
    }
    return (size_t)at;
}

/* Numbers of the data that no step leads to. */
static void change_data(uint8_t *data, size_t bytes, fuzz_luck *luck)
{
    static const float values[] = {0.0f, -1.0f, 1.0f, NAN, INFINITY, -INFINITY, 1e38f, 1e-40f, 3e-5f};
    const float value = PICK(values);
    size_t times = fuzz_below(luck, 8) ? 1 : bytes / sizeof value;
    for (size_t at = 4 * fuzz_below(luck, bytes / 4); times && at + sizeof value <= bytes; at += sizeof value, times--)
        memcpy(data + at, &value, sizeof value);
}

/* The header and its length in place of the old ones, and as many bytes of data as are asked for; 0: no room. */
static size_t assemble(uint8_t *data, size_t bytes, size_t room, size_t old_head, const json_t *header, size_t wanted,
                       fuzz_luck *luck)
{
    char *text = json_dumps(header, JSON_COMPACT);
    const size_t length = text ? strlen(text) : 0, padded = (length + 7) / 8 * 8, kept = bytes - old_head;
    const size_t all = LENGTH + padded + wanted,
                 told = fuzz_below(luck, 24) ? padded : padded + fuzz_below(luck, 17) - 8;
    const int fits = length && wanted <= room && all <= room;
    if (fits) {
        memmove(data + LENGTH + padded, data + old_head, kept < wanted ? kept : wanted);
        if (wanted > kept)
            memset(data + LENGTH + padded + kept, 0, wanted - kept);
        memset(data + LENGTH, ' ', padded);
        memcpy(data + LENGTH, text, length);
        for (size_t i = 0; i < LENGTH; i++)
            data[i] = (uint8_t)((uint64_t)told >> 8 * i);
    }
    free(text);
    return fits ? all : 0;
}

size_t fuzz_mutate_safetensors(uint8_t *data, size_t bytes, size_t room, uint64_t seed, fuzz_plain *plain)
{
    fuzz_luck luck = {seed};
    uint64_t length = 0;
    const size_t way = fuzz_below(&luck, 16);
    for (size_t i = LENGTH; i-- > 0 && bytes > LENGTH;)
        length = length << 8 | data[i];
    json_t *header = way > 3 && bytes > LENGTH && length <= bytes - LENGTH
                         ? json_loadb((const char *)data + LENGTH, (size_t)length, 0, NULL)
                         : NULL;
    const size_t head = LENGTH + (size_t)length;
    if (!json_object_size(header)) {
        json_decref(header);
        return plain(data, bytes, room);
    }
    if (way == 4)
        change_data(data + head, bytes - head, &luck);
    else if (way < 9)
        change_tensor(header, &luck);
    else
        header = changed(header, 0, &luck);
    size_t made = 0, wanted = bytes - head;
    if (fuzz_below(&luck, 5)) /* else offsets as they are, or as they were changed */
        wanted = lay_out(header);
    if (json_is_object(header))
        made = assemble(data, bytes, room, head, header, wanted, &luck);
    json_decref(header);
    return made ? made : plain(data, bytes, room);
}
