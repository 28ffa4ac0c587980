/* Safetensors: a file by the Python package, files of ours, damaged ones; halves. */
#include "io/safetensors.h"
#include "io_testing.h"

TEST(test_golden)
{
    hada_error error = {0};
    hada_tensors *tensors;
    if (hada_tensors_open(&tensors, io_golden("tensors.safetensors"), &error))
        fail_msg("%s", error.message);
    assert_int_equal(hada_tensors_count(tensors), 4);
    assert_string_equal(hada_tensors_meta(tensors, "note"), "gr\xc3\xb6\xc3\x9f"
                                                            "e \xe2\x9c\x93");
    assert_null(hada_tensors_meta(tensors, "absent"));
    assert_null(hada_tensors_find(tensors, "absent"));
    float values[70];
    const hada_stored_tensor *weight = hada_tensors_find(tensors, "weight");
    assert_int_equal(weight->dims, 3);
    assert_int_equal(weight->shape[0], 2);
    assert_int_equal(weight->shape[2], 5);
    ASSERT_OK(hada_tensor_copy_f32(weight, 0, 70, values, err));
    for (int i = 0; i < 70; i++)
        assert_true(values[i] == (float)(i % 35 + 1 + 40 * (i / 35)));
    const char *names[] = {"half", "wide"};
    for (int k = 0; k < 2; k++) {
        ASSERT_OK(hada_tensor_copy_f32(hada_tensors_find(tensors, names[k]), 5, 30, values, err));
        for (int i = 0; i < 30; i++)
            assert_true(values[i] == (float)(i + 6) / 64);
    }
    ASSERT_FAILS(hada_tensor_copy_f32(weight, 69, 2, values, err), HADA_ERROR_SIZE, "70 values");
    ASSERT_FAILS(hada_tensor_copy_f32(hada_tensors_find(tensors, "count"), 0, 1, values, err), HADA_ERROR_FILE_FORMAT,
                 "");
    hada_tensors_close(&tensors);
    assert_null(tensors);
}

/* What was opened stays as it was, whatever happens to the file. */
TEST(test_shrinking)
{
    hada_error err = {0};
    hada_tensors *tensors;
    size_t bytes;
    float values[70];
    unsigned char *data = io_read_bytes(io_golden("tensors.safetensors"), &bytes);
    io_write_bytes(io_path("shrinks"), data, bytes);
    free(data);
    assert_int_equal(hada_tensors_open(&tensors, io_path("shrinks"), &err), HADA_OK);
    assert_int_equal(truncate(io_path("shrinks"), 0), 0);
    const hada_stored_tensor *weight = hada_tensors_find(tensors, "weight");
    assert_int_equal(hada_tensor_copy_f32(weight, 0, 70, values, &err), HADA_OK);
    assert_true(values[69] == (float)(69 % 35 + 1 + 40));
    hada_tensors_close(&tensors);
}

TEST(test_round_trip)
{
    hada_tensors_writer *writer;
    const int64_t shape[] = {3, 5}, few[] = {3};
    float data[15];
    for (int i = 0; i < 15; i++)
        data[i] = (float)i * 0.1f - 0.7f;
    ASSERT_OK(hada_tensors_create(&writer, io_path("trip.safetensors"), err));
    ASSERT_OK(hada_tensors_put_meta(writer, "a \"key\"", "line\nline", err));
    ASSERT_FAILS(hada_tensors_put_meta(writer, "bad", "\xff\xfe", err), HADA_ERROR_ARGUMENT, "");
    ASSERT_OK(hada_tensors_declare(writer, "one", HADA_F32, 2, shape, err));
    ASSERT_FAILS(hada_tensors_declare(writer, "one", HADA_F32, 2, shape, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_OK(hada_tensors_declare(writer, "bytes", HADA_U8, 1, few, err));
    ASSERT_OK(hada_tensors_declare(writer, "odd", HADA_F32, 0, NULL, err));
    /* In pieces that do not respect the tensors. */
    ASSERT_OK(hada_tensors_write(writer, data, 7, err));
    ASSERT_FAILS(hada_tensors_declare(writer, "late", HADA_U8, 1, few, err), HADA_ERROR_STATE, "");
    ASSERT_OK(hada_tensors_write(writer, (char *)data + 7, 53, err));
    ASSERT_OK(hada_tensors_write(writer, "abc", 3, err));
    ASSERT_OK(hada_tensors_write(writer, data, 4, err));
    ASSERT_FAILS(hada_tensors_write(writer, data, 1, err), HADA_ERROR_SIZE, "");
    assert_false(io_exists(io_path("trip.safetensors")));
    ASSERT_OK(hada_tensors_finish(&writer, err));
    hada_tensors *tensors;
    ASSERT_OK(hada_tensors_open(&tensors, io_path("trip.safetensors"), err));
    assert_int_equal((uintptr_t)hada_tensors_at(tensors, 0)->data % 8, 0);
    assert_memory_equal(hada_tensors_find(tensors, "one")->data, data, sizeof data);
    assert_memory_equal(hada_tensors_find(tensors, "bytes")->data, "abc", 3);
    float odd; /* at no multiple of 4 */
    ASSERT_OK(hada_tensor_copy_f32(hada_tensors_find(tensors, "odd"), 0, 1, &odd, err));
    assert_true(odd == data[0]);
    assert_string_equal(hada_tensors_meta(tensors, "a \"key\""), "line\nline");
    hada_tensors_close(&tensors);
    ASSERT_OK(hada_tensors_create(&writer, io_path("short.safetensors"), err));
    ASSERT_OK(hada_tensors_declare(writer, "one", HADA_F32, 2, shape, err));
    ASSERT_OK(hada_tensors_write(writer, data, 8, err));
    ASSERT_FAILS(hada_tensors_finish(&writer, err), HADA_ERROR_STATE, "8 of 60");
    assert_false(io_exists(io_path("short.safetensors")));
}

/* A file of that header and so many bytes of data. */
static hada_status open_made(const char *header, size_t data_bytes, hada_error *err)
{
    unsigned char file[1024] = {0};
    size_t length = strlen(header);
    file[0] = (unsigned char)length;
    file[1] = (unsigned char)(length >> 8);
    memcpy(file + 8, header, length);
    io_write_bytes(io_path("made.safetensors"), file, 8 + length + data_bytes);
    hada_tensors *tensors;
    hada_status status = hada_tensors_open(&tensors, io_path("made.safetensors"), err);
    hada_tensors_close(&tensors);
    return status;
}

TEST(test_damaged)
{
    const struct {
        const char *header;
        size_t bytes;
        hada_status status;
        const char *word;
    } files[] = {
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", 8, HADA_OK, ""},
        {"{}", 0, HADA_OK, ""},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[0,7],\"data_offsets\":[0,0]}}   ", 0, HADA_OK, ""},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", 7, HADA_ERROR_FILE_READ, "cut off"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", 9, HADA_ERROR_FILE_FORMAT,
         "after its last"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[3],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT,
         "shape and type"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[-2],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT,
         "list of sizes"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2.5],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT,
         "list of sizes"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[4611686018427387904,4],\"data_offsets\":[0,0]}}", 0,
         HADA_ERROR_FILE_FORMAT, "large"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[8,0]}}", 8, HADA_ERROR_FILE_FORMAT, "ascending"},
        {"{\"a\":{\"dtype\":\"Q7\",\"shape\":[2],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT, "Q7"},
        {"{\"a\":{\"dtype\":\"F32\",\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT, "lacks"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1,1,1,1,1,1,1,1,2],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT,
         "9 dimensions"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]},\"b\":{\"dtype\":\"F32\",\"shape\":[2],"
         "\"data_offsets\":[4,12]}}",
         12, HADA_ERROR_FILE_FORMAT, "overlaps"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]},\"b\":{\"dtype\":\"F32\",\"shape\":[2],"
         "\"data_offsets\":[12,20]}}",
         20, HADA_ERROR_FILE_FORMAT, "without a gap"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]},\"a\":{\"dtype\":\"F32\",\"shape\":[2],"
         "\"data_offsets\":[0,8]}}",
         8, HADA_ERROR_FILE_FORMAT, "duplicate"},
        {"{\"a\xff\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT, "damaged"},
        {"{\"a\":7}", 0, HADA_ERROR_FILE_FORMAT, "lacks"},
        {"{\"__metadata__\":{\"a\":7}}", 0, HADA_ERROR_FILE_FORMAT, "not a text"},
        {"{\"a\":", 0, HADA_ERROR_FILE_FORMAT, "damaged"},
        {"{\"a\":{\"dtype\":7,\"shape\":[2],\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT, "lacks"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":2,\"data_offsets\":[0,8]}}", 8, HADA_ERROR_FILE_FORMAT, "lacks"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":8}}", 8, HADA_ERROR_FILE_FORMAT, "lacks"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,4,8]}}", 8, HADA_ERROR_FILE_FORMAT, "lacks"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0.5,8]}}", 8, HADA_ERROR_FILE_FORMAT, "ascending"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,\"8\"]}}", 8, HADA_ERROR_FILE_FORMAT,
         "ascending"},
        {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[-8,0]}}", 8, HADA_ERROR_FILE_FORMAT, "ascending"},
        {"{\"__metadata__\":7}", 0, HADA_ERROR_FILE_FORMAT, "not an object"},
        {"[1,2,3]", 0, HADA_ERROR_FILE_FORMAT, "not a safetensors"},
    };
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        hada_error err = {0};
        hada_status status = open_made(files[i].header, files[i].bytes, &err);
        if (status != files[i].status || !strstr(err.message, files[i].word) ||
            (status && !strstr(err.message, "made.safetensors")))
            fail_msg("%s: status %d, \"%s\"; expected %d, \"%s\"", files[i].header, status, err.message,
                     files[i].status, files[i].word);
    }
}

/* Every type has its name and size; floats of each kind become ours, other numbers are refused by name. */
TEST(test_types)
{
    static const struct {
        const char *name;
        int bytes, is_float;
        unsigned char one[8]; /* little-endian */
    } types[] = {{"F32", 4, 1, {0, 0, 0x80, 0x3f}},
                 {"F64", 8, 1, {0, 0, 0, 0, 0, 0, 0xf0, 0x3f}},
                 {"F16", 2, 1, {0, 0x3c}},
                 {"BF16", 2, 1, {0x80, 0x3f}},
                 {"I8", 1, 0, {1}},
                 {"U8", 1, 0, {1}},
                 {"I16", 2, 0, {1}},
                 {"U16", 2, 0, {1}},
                 {"I32", 4, 0, {1}},
                 {"U32", 4, 0, {1}},
                 {"I64", 8, 0, {1}},
                 {"U64", 8, 0, {1}},
                 {"BOOL", 1, 0, {1}}};
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        const hada_dtype type = hada_dtype_find(types[i].name);
        assert_int_equal(hada_dtype_bytes(type), types[i].bytes);
        assert_string_equal(hada_dtype_name(type), types[i].name);
        const hada_stored_tensor tensor = {
            .name = "t", .type = type, .data = types[i].one, .bytes = (size_t)types[i].bytes};
        hada_error err = {0};
        float value = 7.0f;
        const hada_status status = hada_tensor_copy_f32(&tensor, 0, 1, &value, &err);
        assert_int_equal(status, types[i].is_float ? HADA_OK : HADA_ERROR_FILE_FORMAT);
        if (types[i].is_float)
            assert_true(value == 1.0f);
        else
            assert_non_null(strstr(err.message, types[i].name));
        assert_int_equal(hada_tensor_copy_f32(&tensor, 2, 0, &value, &err), HADA_ERROR_SIZE);
    }
    assert_int_equal(hada_dtype_find("F8"), 0);
    assert_int_equal(hada_dtype_bytes((hada_dtype)0), 0);
    assert_null(hada_dtype_name((hada_dtype)0));
    const hada_stored_tensor none = {.name = "t"};
    float value;
    assert_int_equal(hada_tensor_copy_f32(&none, 0, 1, &value, NULL), HADA_ERROR_SIZE);
}

/* Tensors without values share a place; what was declared cannot be more than a file holds. */
TEST(test_places)
{
    static const char header[] = "{\"b\":{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]},"
                                 "\"a\":{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]},"
                                 "\"c\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4]}}";
    ASSERT_OK(open_made(header, 4, err));
    hada_tensors *tensors;
    ASSERT_OK(hada_tensors_open(&tensors, io_path("made.safetensors"), err));
    static const char *const order[] = {"a", "b", "c"};
    for (size_t i = 0; i < 3; i++)
        assert_string_equal(hada_tensors_at(tensors, i)->name, order[i]);
    assert_null(hada_tensors_at(tensors, 3));
    assert_int_equal(hada_tensors_bytes(tensors), 8 + strlen(header) + 4);
    hada_tensors_close(&tensors);
    hada_tensors_close(&tensors);
    hada_tensors_close(NULL);
    DEFAULTS(hada_limits, limits);
    limits.text = 100;
    ASSERT_OK(hada_limits_set(&limits, err));
    ASSERT_FAILS(open_made(header, 4, err), HADA_ERROR_FILE_FORMAT, "options.limits text=N");
    ASSERT_OK(hada_limits_set(NULL, err));
    hada_tensors_writer *writer;
    const int64_t huge[] = {INT64_MAX / 2}, negative[] = {-1}, over[] = {INT64_MAX / 2, 3};
    ASSERT_OK(hada_tensors_create(&writer, io_path("huge.safetensors"), err));
    ASSERT_FAILS(hada_tensors_declare(writer, "n", HADA_U8, 1, negative, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_tensors_declare(writer, "o", HADA_U8, 2, over, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_tensors_declare(writer, "d", HADA_U8, HADA_TENSOR_DIMS + 1, huge, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_tensors_declare(writer, "d", HADA_U8, -1, huge, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_tensors_declare(writer, "t", (hada_dtype)0, 1, huge, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_tensors_declare(writer, "\xff", HADA_U8, 1, huge, err), HADA_ERROR_ARGUMENT, "");
    for (int i = 0; i < 2; i++)
        ASSERT_OK(hada_tensors_declare(writer, i ? "b" : "a", HADA_U8, 1, huge, err));
    ASSERT_FAILS(hada_tensors_declare(writer, "c", HADA_U8, 1, huge, err), HADA_ERROR_ARGUMENT, "impossible size");
    hada_tensors_abandon(&writer);
    hada_tensors_abandon(&writer);
    hada_tensors_abandon(NULL);
    /* without tensors and words: a file all the same */
    ASSERT_OK(hada_tensors_create(&writer, io_path("none.safetensors"), err));
    ASSERT_OK(hada_tensors_finish(&writer, err));
    ASSERT_OK(hada_tensors_open(&tensors, io_path("none.safetensors"), err));
    assert_int_equal(hada_tensors_count(tensors), 0);
    hada_tensors_close(&tensors);
}

static void expect_bytes(const void *data, size_t bytes, hada_status status, const char *word)
{
    hada_error err = {0};
    hada_tensors *tensors;
    io_write_bytes(io_path("raw.safetensors"), data, bytes);
    assert_int_equal(hada_tensors_open(&tensors, io_path("raw.safetensors"), &err), status);
    assert_null(tensors);
    assert_non_null(strstr(err.message, word));
}

TEST(test_no_header)
{
    expect_bytes("", 0, HADA_ERROR_FILE_READ, "empty");
    expect_bytes("\2\0\0\0", 4, HADA_ERROR_FILE_READ, "fewer");
    expect_bytes("\377\377\377\377\377\377\377\377{}", 10, HADA_ERROR_FILE_FORMAT, "plausible");
    expect_bytes("\0\2\0\0\0\0\0\0{}", 10, HADA_ERROR_FILE_READ, "cut off");
    hada_error err = {0};
    hada_tensors *tensors;
    assert_int_equal(hada_tensors_open(&tensors, io_path("absent"), &err), HADA_ERROR_FILE_OPEN);
    assert_int_equal(hada_tensors_open(&tensors, io_folder, &err), HADA_ERROR_FILE_OPEN);
}

TEST(test_cut_and_flipped)
{
    size_t bytes;
    SCOPED_MEMORY unsigned char *data = io_read_bytes(io_golden("tensors.safetensors"), &bytes);
    SCOPED_MEMORY unsigned char *copy = malloc(bytes);
    uint64_t random = 3;
    for (size_t round = 0; round < bytes + 1500; round++) {
        memcpy(copy, data, bytes);
        size_t length = round < bytes ? round : bytes;
        for (int k = 0; round >= bytes && k < 3; k++)
            copy[io_random(&random) % 420] = (unsigned char)io_random(&random);
        io_write_bytes(io_path("cut.safetensors"), copy, length);
        hada_tensors *tensors;
        hada_error err = {0};
        if (hada_tensors_open(&tensors, io_path("cut.safetensors"), &err)) {
            assert_true(*err.message);
            continue;
        }
        assert_true(length == bytes);
        for (size_t i = 0; i < hada_tensors_count(tensors); i++) {
            float values[70];
            const hada_stored_tensor *tensor = hada_tensors_at(tensors, i);
            size_t count = tensor->bytes / hada_dtype_bytes(tensor->type);
            hada_tensor_copy_f32(tensor, 0, count < 70 ? count : 70, values, NULL);
        }
        hada_tensors_close(&tensors);
    }
}

TEST(test_halves)
{
    for (uint32_t half = 0; half < 65536; half++) {
        float value = hada_float_from_half((uint16_t)half);
        uint16_t back = hada_half_from_float(value);
        if (isnan(value))
            assert_true((back & 0x7c00) == 0x7c00 && (back & 0x3ff));
        else
            assert_int_equal(back, half);
    }
    /* Between neighbours: the nearest, and the even one from the middle. */
    for (uint32_t half = 0; half < 0x7bff; half++) {
        double low = (double)hada_float_from_half((uint16_t)half),
               high = (double)hada_float_from_half((uint16_t)(half + 1));
        float middle = (float)((low + high) / 2);
        assert_int_equal(hada_half_from_float(middle), half + (half & 1));
        assert_int_equal(hada_half_from_float(nextafterf(middle, 0)), half);
        assert_int_equal(hada_half_from_float(-nextafterf(middle, INFINITY)), (half + 1) | 0x8000);
    }
    assert_int_equal(hada_half_from_float(65519.996f), 0x7bff);
    assert_int_equal(hada_half_from_float(65520.0f), 0x7c00);
    assert_int_equal(hada_half_from_float(1e30f), 0x7c00);
    assert_int_equal(hada_half_from_float(1e-30f), 0);
}

FIXTURE(io_setup, io_teardown)
