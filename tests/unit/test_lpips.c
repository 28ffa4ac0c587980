/* LPIPS against PyTorch (golden numbers made by tests/golden/make_lpips_golden.py) and what it refuses. */
#include "testing.h"

#include "io/safetensors.h"
#include "io_testing.h"
#include "metrics/metrics.h"
#include "patience.h"

static hada_context *context;

/* The numbers of torch_lpips.py's hashed(). */
static float hashed(uint32_t seed, uint32_t i)
{
    uint32_t h = i * 0x9E3779B1u + seed * 0x85EBCA77u;
    h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
    h = (h ^ (h >> 12)) * 0x297A2D39u;
    h ^= h >> 15;
    return (float)((h >> 8) / 16777216.0 - 0.5);
}

typedef struct layer {
    int number, in, out, kernel;
} layer;

static const layer vgg[] = {{0, 3, 64, 3},     {2, 64, 64, 3},
                            {5, 64, 128, 3},   {7, 128, 128, 3},
                            {10, 128, 256, 3}, {12, 256, 256, 3},
                            {14, 256, 256, 3}, {17, 256, 512, 3},
                            {19, 512, 512, 3}, {21, 512, 512, 3},
                            {24, 512, 512, 3}, {26, 512, 512, 3},
                            {28, 512, 512, 3}, {0}};
static const layer alex[] = {{0, 3, 64, 11},   {3, 64, 192, 5},   {6, 192, 384, 3},
                             {8, 384, 256, 3}, {10, 256, 256, 3}, {0}};
static const int vgg_heads[] = {64, 128, 256, 512, 512}, alex_heads[] = {64, 192, 384, 256, 256};

/* Appends a tensor of hashed numbers times `scale` plus `shift`. */
static void put(hada_tensors_writer *writer, uint32_t seed, size_t count, float scale, float shift)
{
    float part[4096];
    for (size_t first = 0; first < count; first += 4096) {
        const size_t n = count - first < 4096 ? count - first : 4096;
        for (size_t i = 0; i < n; i++)
            part[i] = hashed(seed, (uint32_t)(first + i)) * scale + shift;
        ASSERT_OK(hada_tensors_write(writer, part, n * sizeof *part, err));
    }
}

/* Which of the two kinds of weights a file gets. */
enum { BACKBONE = 1, HEADS = 2 };

static void write_weights(const char *path, int is_alex, int what)
{
    const layer *layers = is_alex ? alex : vgg;
    const int *heads = is_alex ? alex_heads : vgg_heads;
    hada_tensors_writer *writer;
    char name[64];
    ASSERT_OK(hada_tensors_create(&writer, path, err));
    for (int i = 0; what & BACKBONE && layers[i].in; i++) {
        const int64_t shape[4] = {layers[i].out, layers[i].in, layers[i].kernel, layers[i].kernel};
        snprintf(name, sizeof name, "features.%d.weight", layers[i].number);
        ASSERT_OK(hada_tensors_declare(writer, name, HADA_F32, 4, shape, err));
        snprintf(name, sizeof name, "features.%d.bias", layers[i].number);
        ASSERT_OK(hada_tensors_declare(writer, name, HADA_F32, 1, shape, err));
    }
    for (int k = 0; what & HEADS && k < 5; k++) {
        const int64_t shape[4] = {1, heads[k], 1, 1};
        snprintf(name, sizeof name, "lin%d.model.1.weight", k);
        ASSERT_OK(hada_tensors_declare(writer, name, HADA_F32, 4, shape, err));
    }
    for (uint32_t i = 0; what & BACKBONE && layers[i].in; i++) {
        const size_t fan = (size_t)layers[i].in * (size_t)(layers[i].kernel * layers[i].kernel);
        put(writer, 2 * i + 1, (size_t)layers[i].out * fan, (float)sqrt(24.0 / (double)fan), 0.0f);
        put(writer, 2 * i + 2, (size_t)layers[i].out, 0.25f, 0.0f);
    }
    for (uint32_t k = 0; what & HEADS && k < 5; k++)
        put(writer, 101 + k, (size_t)heads[k], 1.0f, 0.5f);
    ASSERT_OK(hada_tensors_finish(&writer, err));
}

static hada_lpips *open_net(int is_alex)
{
    hada_lpips *lpips;
    write_weights(io_path("net.safetensors"), is_alex, BACKBONE | HEADS);
    ASSERT_OK(hada_lpips_create(&lpips, context, HADA_LPIPS_AUTO, io_path("net.safetensors"), NULL, err));
    assert_int_equal(hada_lpips_get_net(lpips), is_alex ? HADA_LPIPS_ALEX : HADA_LPIPS_VGG);
    return lpips;
}

static void make_pair(hada_image *a, hada_image *b, int channels, int rows, int cols)
{
    ASSERT_OK(hada_image_create(a, channels, rows, cols, err));
    ASSERT_OK(hada_image_create(b, channels, rows, cols, err));
    for (uint32_t i = 0; i < hada_image_count(a); i++) {
        a->data[i] = hashed(201, i) + 0.5f;
        b->data[i] = 0.75f * a->data[i] + 0.25f * (hashed(202, i) + 0.5f);
    }
}

static void close_to(double value, double expected, double tolerance)
{
    if (!(fabs(value - expected) <= tolerance * expected))
        fail_msg("%.12g is not within a share of %g of %.12g", value, tolerance, expected);
}

/* Single precision against double: some 1e-6 of the value, more where two images' features are alike. */
static void check_case(hada_lpips *lpips, int channels, int rows, int cols, const double expected[3])
{
    SCOPED(hada_image) a, b, map = {0};
    double value, again, grey;
    make_pair(&a, &b, channels, rows, cols);
    SCOPED_MEMORY unsigned char *mask = calloc((size_t)rows, (size_t)cols);
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            mask[r * cols + c] = (r + 2 * c) % 5 < 2;
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 1.0, NULL, &value, err));
    close_to(value, expected[0], 5e-6);
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 1.0, mask, &again, err));
    close_to(again, expected[1], 5e-6);
    ASSERT_OK(hada_lpips_map(lpips, &a, &b, 1.0, &map, err));
    float largest = 0.0f;
    for (size_t i = 0; i < hada_image_count(&map); i++)
        largest = map.data[i] > largest ? map.data[i] : largest;
    close_to(largest, expected[2], 1e-5);
    /* the same bits again; 0 for equal images; the peak is a scale */
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 1.0, NULL, &again, err));
    assert_true(again == value);
    ASSERT_OK(hada_lpips_run(lpips, &a, &a, 1.0, NULL, &again, err));
    assert_true(again == 0.0);
    for (size_t i = 0; i < hada_image_count(&a); i++) {
        a.data[i] *= 4.0f;
        b.data[i] *= 4.0f;
    }
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 4.0, NULL, &grey, err));
    assert_true(grey == value);
}

static void golden(int is_alex)
{
    hada_lpips *lpips = open_net(is_alex);
    FILE *file = fopen(io_golden("lpips.txt"), "r");
    char line[256], net[8];
    int channels, rows, cols, cases = 0;
    double expected[3];
    assert_non_null(file);
    while (fgets(line, sizeof line, file)) {
        if (line[0] == '#')
            continue;
        assert_int_equal(sscanf(line, "%7s %d %d %d %lf %lf %lf", net, &channels, &rows, &cols, &expected[0],
                                &expected[1], &expected[2]),
                         7);
        if (!strcmp(net, is_alex ? "alex" : "vgg")) {
            check_case(lpips, channels, rows, cols, expected);
            cases++;
        }
    }
    fclose(file);
    assert_true(cases >= 3);
    hada_lpips_destroy(&lpips);
    assert_null(lpips);
    assert_int_equal(hada_context_bytes(context), 0);
}

TEST(golden_vgg)
{
    golden(0);
}

TEST(golden_alex)
{
    golden(1);
}

/* What is stated is what is held. */
TEST(bytes)
{
    SCOPED(hada_lpips) *lpips = open_net(1);
    SCOPED(hada_image) a, b;
    uint64_t stated;
    double value;
    make_pair(&a, &b, 1, 40, 45);
    ASSERT_OK(hada_lpips_bytes(lpips, 40, 45, &stated, err));
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 1.0, NULL, &value, err));
    assert_int_equal(hada_context_bytes(context), stated);
}

/* Two files, and files that do not do. */
TEST(files)
{
    hada_lpips *lpips;
    char body[300], heads[300];
    snprintf(body, sizeof body, "%s", io_path("body.safetensors"));
    snprintf(heads, sizeof heads, "%s", io_path("heads.safetensors"));
    write_weights(body, 1, BACKBONE);
    write_weights(heads, 1, HEADS);
    ASSERT_OK(hada_lpips_create(&lpips, context, HADA_LPIPS_ALEX, body, heads, err));
    hada_lpips_destroy(&lpips);
    ASSERT_FAILS(hada_lpips_create(&lpips, context, HADA_LPIPS_ALEX, body, NULL, err), HADA_ERROR_MODEL,
                 "lin0.model.1.weight");
    assert_null(lpips);
    ASSERT_FAILS(hada_lpips_create(&lpips, context, HADA_LPIPS_AUTO, heads, NULL, err), HADA_ERROR_MODEL,
                 "features.0.weight");
    ASSERT_FAILS(hada_lpips_create(&lpips, context, HADA_LPIPS_VGG, body, heads, err), HADA_ERROR_MODEL, "VGG-16");
    write_weights(heads, 0, HEADS);
    ASSERT_FAILS(hada_lpips_create(&lpips, context, HADA_LPIPS_ALEX, body, heads, err), HADA_ERROR_MODEL, "");
    ASSERT_FAILS(hada_lpips_create(&lpips, context, HADA_LPIPS_ALEX, "/nowhere", NULL, err), HADA_ERROR_FILE_OPEN, "");
    assert_int_equal(hada_context_bytes(context), 0);
}

TEST(images)
{
    SCOPED(hada_lpips) *lpips = open_net(1);
    hada_image map = {0};
    SCOPED(hada_image) a, b, small, other, two;
    double value;
    unsigned char none[32 * 33] = {0};
    make_pair(&a, &b, 1, 32, 33);
    make_pair(&small, &other, 1, 30, 33);
    ASSERT_FAILS(hada_lpips_run(lpips, &small, &other, 1.0, NULL, &value, err), HADA_ERROR_SIZE, "31 x 31");
    ASSERT_FAILS(hada_lpips_run(lpips, &a, &small, 1.0, NULL, &value, err), HADA_ERROR_SIZE, "");
    ASSERT_FAILS(hada_lpips_run(lpips, &a, &b, 0.0, NULL, &value, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_lpips_run(lpips, &a, &b, 1.0, none, &value, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_OK(hada_image_create(&two, 2, 32, 33, err));
    ASSERT_FAILS(hada_lpips_map(lpips, &two, &two, 1.0, &map, err), HADA_ERROR_SIZE, "");
    b.data[7] = NAN;
    ASSERT_FAILS(hada_lpips_map(lpips, &a, &b, 1.0, &map, err), HADA_ERROR_NOT_FINITE, "");
    assert_null(map.data);
}

/* The wish to stop is met within one comparison, and leaves nothing for the next one. */
TEST(stops_within_a_comparison)
{
    patience none = {0};
    const hada_monitor monitor = patience_monitor(&none);
    SCOPED(hada_lpips) *lpips = open_net(0);
    SCOPED(hada_image) a = {0}, b = {0};
    double before, after;
    make_pair(&a, &b, 3, 64, 72);
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 1.0, NULL, &before, err));
    hada_lpips_watch(lpips, &monitor);
    ASSERT_FAILS(hada_lpips_run(lpips, &a, &b, 1.0, NULL, &after, err), HADA_ERROR_CANCELLED, "stopped");
    hada_lpips_watch(lpips, NULL);
    ASSERT_OK(hada_lpips_run(lpips, &a, &b, 1.0, NULL, &after, err));
    assert_true(before == after);
}

static int open_all(void **state)
{
    hada_error error = {0};
    if (io_setup(state) || hada_context_create(&context, NULL, &error)) {
        print_error("%s\n", error.message);
        return -1;
    }
    return 0;
}

static int close_all(void **state)
{
    hada_context_destroy(&context);
    return io_teardown(state);
}

FIXTURE(open_all, close_all)
