/* Enhancing planes: the same as the net alone, in tiles bit for bit, nothing where nothing is. */
#include "dry.h"
#include "net/enhance.h"
#include "net_fixture.h"
#include "ref/ref_net.h"
#include "runtime/profile.h"

static hada_net *unet_of(const char *down, const char *up, int channels, hada_unet_up up_by, int shared)
{
    hada_net *net;
    DEFAULTS(hada_unet_options, options);
    options.channels = options.out_channels = channels;
    options.down = down;
    options.up = up;
    options.up_by = up_by;
    options.shared = options.last_norm = shared;
    ASSERT_OK(hada_net_create_unet(&net, &options, 5, err));
    const hada_parameter *bias = hada_net_find(net, "last.bias");
    for (size_t i = 0; i < bias->count; i++) /* so that not all comes out below zero */
        net->values[bias->offset + i] = 1.0f;
    return net;
}

static float *planes_of(const hada_enhance_desc *desc, int count)
{
    const size_t values = (size_t)count * (size_t)desc->channels * (size_t)desc->rows * (size_t)desc->cols;
    float *out = calloc(values, sizeof *out);
    net_fill(out, values, 7);
    for (size_t i = 0; i < values; i++)
        out[i] = fabsf(out[i]);
    return out;
}

static hada_status bytes_of(const hada_context *context, const hada_enhance_desc *desc, uint64_t *bytes,
                            hada_error *error)
{
    hada_status status;
    DRY_STATUS(status, *bytes, context, hada_enhance, hada_enhance_create(&object, &dry.slot, desc, error),
               hada_enhance_destroy);
    return status;
}

/* Enhances `count` planes in place, which stand behind one other float in a part of a buffer; bytes are as stated. */
static void run_as(net_device *device, const hada_enhance_desc *desc, float *planes, int count, int together,
                   int *computed, int *left_out)
{
    SCOPED(hada_enhance) * enhance;
    SCOPED(hada_buffer) buffer;
    uint64_t stated;
    const size_t values = (size_t)count * (size_t)desc->channels * (size_t)desc->rows * (size_t)desc->cols;
    const uint64_t before = hada_context_bytes(device->context);
    ASSERT_OK(bytes_of(device->context, desc, &stated, err));
    ASSERT_OK(hada_enhance_create(&enhance, device->slot, desc, err));
    assert_int_equal(hada_context_bytes(device->context) - before, stated);
    enum { OFFSET = 4096 };
    const size_t bytes = (values + 1) * sizeof(float);
    hada_buffer part;
    ASSERT_OK(hada_buffer_create(&buffer, device->context, OFFSET + bytes, "planes", err));
    ASSERT_OK(hada_buffer_write(&buffer, device->slot, OFFSET + sizeof(float), planes, values * sizeof(float), err));
    ASSERT_OK(hada_buffer_part(&part, &buffer, OFFSET, bytes, "a part", err));
    ASSERT_OK(hada_enhance_run(enhance, part.mem, 1, count, together, err));
    ASSERT_OK(hada_buffer_read(&buffer, device->slot, OFFSET + sizeof(float), planes, values * sizeof(float), err));
    hada_enhance_counts(enhance, computed, left_out);
    hada_buffer_destroy(&part);
}

static void run(net_device *device, const hada_enhance_desc *desc, float *planes, int count, int *computed,
                int *left_out)
{
    run_as(device, desc, planes, count, 1, computed, left_out);
}

/* Without resizing: what a runner gives, zero where that is negative. */
TEST(a_plane_at_once_is_the_net)
{
    net_device *device = *state;
    for (int shared = 0; shared < 2; shared++) {
        SCOPED(hada_net) *net = unet_of("6|10", "7", 3, HADA_UNET_LINEAR, shared);
        SCOPED(hada_net_runner) * runner;
        SCOPED(hada_image) in, out = {0};
        const hada_enhance_desc desc = {.net = net, .channels = 3, .rows = 21, .cols = 34};
        SCOPED_MEMORY float *planes = planes_of(&desc, 2);
        const size_t plane = 3 * 21 * 34;
        int computed, left_out;
        SCOPED_MEMORY float *before = malloc(2 * plane * sizeof(float));
        memcpy(before, planes, 2 * plane * sizeof(float));
        run(device, &desc, planes, 2, &computed, &left_out);
        assert_int_equal(computed, 2);
        assert_int_equal(left_out, 0);
        ASSERT_OK(hada_net_runner_create(&runner, device->context, net, 21, 34, err));
        ASSERT_OK(hada_image_create(&in, 3, 21, 34, err));
        for (int i = 0; i < 2; i++) {
            memcpy(in.data, before + (size_t)i * plane, plane * sizeof(float));
            ASSERT_OK(hada_net_run(runner, &in, &out, err));
            int positive = 0;
            for (size_t k = 0; k < plane; k++) {
                assert_true(planes[(size_t)i * plane + k] == fmaxf(out.data[k], 0.0f));
                positive += out.data[k] > 0;
            }
            assert_true(positive > 100);
        }
    }
}

/* Whatever number of planes goes through the net at once, with dark ones among them, which are left out, and at another
 * size than the window's. */
TEST(planes_at_once_hold_the_bits_of_one_by_one)
{
    enum { COUNT = 5, DARK = 2, ROWS = 21, COLS = 34, PLANE = 3 * ROWS * COLS };
    net_device *device = *state;
    for (int way = 0; way < 4; way++) {
        const int resized = way & 1, shared = way >> 1;
        SCOPED(hada_net) *net = unet_of("6|10", "7", 3, HADA_UNET_LINEAR, shared);
        hada_enhance_desc desc = {.net = net, .channels = 3, .rows = ROWS, .cols = COLS};
        desc.net_rows = resized ? 28 : 0;
        desc.net_cols = resized ? 24 : 0;
        SCOPED_MEMORY float *expected = planes_of(&desc, COUNT);
        memset(expected + (size_t)DARK * PLANE, 0, PLANE * sizeof *expected);
        SCOPED_MEMORY float *before = malloc((size_t)COUNT * PLANE * sizeof *before);
        memcpy(before, expected, (size_t)COUNT * PLANE * sizeof *before);
        for (int at_once = 0; at_once <= COUNT; at_once++) {
            SCOPED_MEMORY float *planes = malloc((size_t)COUNT * PLANE * sizeof *planes);
            int computed, left_out;
            memcpy(planes, before, (size_t)COUNT * PLANE * sizeof *planes);
            desc.planes = at_once;
            run(device, &desc, planes, COUNT, &computed, &left_out);
            assert_int_equal(computed, COUNT - 1);
            assert_int_equal(left_out, 1);
            if (!at_once)
                memcpy(expected, planes, (size_t)COUNT * PLANE * sizeof *planes);
            assert_memory_equal(planes, expected, (size_t)COUNT * PLANE * sizeof *planes);
        }
        assert_true(memcmp(before, expected, PLANE * sizeof *before));
    }
}

/* A plane and what all others hold beside it, as they were before any was enhanced; 0 where planes do not belong
 * together. Those that do are shares of their sum, which is enhanced by itself unless the net only shares; that net
 * leaves others as they are. What no plane claims all hold alike. In tiles the same. */
TEST(a_net_may_see_the_other_planes)
{
    enum { COUNT = 3, ROWS = 32, COLS = 48, CHANNELS = 2, PLANE = CHANNELS * ROWS * COLS };
    net_device *device = *state;
    SCOPED(hada_net) * net;
    SCOPED(hada_net_runner) * runner;
    SCOPED(hada_image) in, out = {0};
    DEFAULTS(hada_unet_options, options);
    options.channels = 2 * CHANNELS;
    options.out_channels = CHANNELS;
    options.down = "8|12";
    options.up = "9";
    ASSERT_OK(hada_net_create_unet(&net, &options, 5, err));
    hada_enhance_desc desc = {.net = net, .channels = CHANNELS, .rows = ROWS, .cols = COLS, .method = HADA_CONV_DIRECT};
    SCOPED_MEMORY float *before = planes_of(&desc, COUNT);
    int nobodys = 0;
    ASSERT_OK(hada_net_runner_create(&runner, device->context, net, ROWS, COLS, err));
    ASSERT_OK(hada_image_create(&in, 2 * CHANNELS, ROWS, COLS, err));
    for (int way = 0; way < 8; way++) {
        const int together = way & 1, tiled = way >> 1 & 1;
        SCOPED_MEMORY float *planes = planes_of(&desc, COUNT);
        int computed, left_out;
        desc.tile_rows = desc.tile_cols = 1 + tiled;
        net->shares = way >> 2;
        run_as(device, &desc, planes, COUNT, together, &computed, &left_out);
        if (net->shares && !together) {
            assert_int_equal(computed + left_out, 0);
            assert_memory_equal(planes, before, COUNT * PLANE * sizeof *planes);
            continue;
        }
        assert_int_equal(computed, (COUNT + (together && !net->shares)) * (tiled ? 4 : 1));
        float *expected = calloc((COUNT + 1) * PLANE, sizeof *expected); /* of the planes, and of their sum */
        for (int own = 0; own <= COUNT; own++) {
            for (int k = 0; k < PLANE; k++) {
                const float sum = before[k] + before[PLANE + k] + before[2 * PLANE + k];
                in.data[k] = own < COUNT ? before[own * PLANE + k] : sum;
                in.data[PLANE + k] = together ? sum - in.data[k] : 0.0f;
            }
            ASSERT_OK(hada_net_run(runner, &in, &out, err));
            for (int k = 0; k < PLANE; k++)
                expected[own * PLANE + k] = fmaxf(out.data[k], 0.0f);
        }
        for (int k = 0; k < COUNT * PLANE; k++) {
            const float *shares = expected + k % PLANE;
            const double total = (double)shares[0] + shares[PLANE] + shares[2 * PLANE];
            const double own = !together ? 1.0 : total > 0.0 ? expected[k] / total : 1.0 / COUNT;
            const float *held = before + k % PLANE;
            const double sum = (double)held[0] + held[PLANE] + held[2 * PLANE];
            const double whole = !together ? expected[k] : net->shares ? sum : shares[COUNT * PLANE];
            nobodys += total <= 0.0;
            assert_true(fabs(planes[k] - own * whole) < 1e-4);
        }
        free(expected);
    }
    assert_true(nobodys > 0);
    desc.net_rows = desc.net_cols = 16; /* it has no other size */
    hada_enhance *enhance;
    ASSERT_FAILS(hada_enhance_create(&enhance, device->slot, &desc, err), HADA_ERROR_MODEL, "at the window's size");
}

/* A net between two resizings, as one list. */
static const char *const between = "{\"format\":\"hadalens-net-1\",\"layers\":["
                                   "{\"layer\":\"input\",\"channels\":2},"
                                   "{\"layer\":\"resize\",\"resize\":\"linear\",\"rows\":16,\"cols\":24},"
                                   "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":9,\"activation\":\"relu\"},"
                                   "{\"layer\":\"conv\",\"name\":\"b\",\"channels\":2,\"activation\":\"relu\"},"
                                   "{\"layer\":\"resize\",\"resize\":\"linear\",\"like\":0}]}";
static const char *const alone = "{\"format\":\"hadalens-net-1\",\"layers\":["
                                 "{\"layer\":\"input\",\"channels\":2},"
                                 "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":9,\"activation\":\"relu\"},"
                                 "{\"layer\":\"conv\",\"name\":\"b\",\"channels\":2,\"activation\":\"relu\"}]}";

TEST(a_window_of_another_size_goes_there_and_back)
{
    SCOPED(hada_net) * list, *net;
    ASSERT_OK(hada_net_create(&list, between, 6, err));
    ASSERT_OK(hada_net_create(&net, alone, 6, err));
    for (int tiles = 1; tiles < 3; tiles++) {
        const hada_enhance_desc desc = {.net = net,
                                        .channels = 2,
                                        .rows = 25,
                                        .cols = 31,
                                        .net_rows = 16,
                                        .net_cols = 24,
                                        .tile_rows = tiles,
                                        .tile_cols = tiles};
        const size_t values = 2 * 25 * 31;
        SCOPED_MEMORY float *planes = planes_of(&desc, 1);
        SCOPED_MEMORY double *x = calloc(values, sizeof *x), *y = calloc(values, sizeof *y);
        SCOPED_MEMORY double *weights = calloc(list->floats, sizeof *weights);
        for (size_t i = 0; i < values; i++)
            x[i] = planes[i];
        for (size_t i = 0; i < list->floats; i++)
            weights[i] = list->values[i];
        ASSERT_OK(hada_ref_net_forward(list, weights, 0, 1, 25, 31, x, y, err));
        int computed, left_out;
        run(*state, &desc, planes, 1, &computed, &left_out);
        assert_int_equal(computed, tiles * tiles);
        assert_true(relative_error(planes, y, values) < 2e-6);
    }
}

TEST(tiles_hold_the_bits_of_the_whole)
{
    static const struct {
        const char *down, *up;
        hada_unet_up up_by;
        int shared, rows, cols, tile_rows, tile_cols;
    } cases[] = {{"8|12", "9", HADA_UNET_LINEAR, 0, 64, 96, 2, 3},
                 {"8|12", "9", HADA_UNET_NEAREST, 0, 64, 50, 3, 1},
                 {"16|16", "16", HADA_UNET_TRANSPOSED, 0, 48, 64, 1, 4},
                 {"5|6,6|8", "7|6", HADA_UNET_LINEAR, 1, 92, 136, 2, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        SCOPED(hada_net) *net = unet_of(cases[i].down, cases[i].up, 2, cases[i].up_by, cases[i].shared);
        hada_enhance_desc desc = {
            .net = net, .channels = 2, .rows = cases[i].rows, .cols = cases[i].cols, .method = HADA_CONV_DIRECT};
        SCOPED_MEMORY float *whole = planes_of(&desc, 2), *tiled = planes_of(&desc, 2);
        const size_t values = 2 * 2 * (size_t)desc.rows * (size_t)desc.cols;
        int computed, left_out;
        run(*state, &desc, whole, 2, &computed, &left_out);
        assert_int_equal(computed, 2);
        desc.tile_rows = cases[i].tile_rows;
        desc.tile_cols = cases[i].tile_cols;
        run(*state, &desc, tiled, 2, &computed, &left_out);
        assert_int_equal(computed, 2 * desc.tile_rows * desc.tile_cols);
        assert_memory_equal(whole, tiled, values * sizeof(float));
    }
}

TEST(tiles_without_content_are_left_out)
{
    SCOPED(hada_net) *net = unet_of("8|12", "9", 1, HADA_UNET_LINEAR, 0);
    for (int i = 0; i < net->parameter_count; i++) /* so that black does not stay black */
        if (net->parameters[i].dims == 1)
            for (size_t k = 0; k < net->parameters[i].count; k++)
                net->values[net->parameters[i].offset + k] = 0.1f;
    hada_enhance_desc desc = {.net = net, .channels = 1, .rows = 96, .cols = 256, .method = HADA_CONV_DIRECT};
    const size_t plane = 96 * 256;
    SCOPED_MEMORY float *whole = calloc(2 * plane, sizeof *whole), *tiled = calloc(2 * plane, sizeof *tiled);
    whole[10 * 256 + 20] = tiled[10 * 256 + 20] = 1.0f;
    int computed, left_out;
    run(*state, &desc, whole, 2, &computed, &left_out);
    assert_int_equal(computed, 1); /* the second plane is black and stays so */
    assert_int_equal(left_out, 1);
    desc.tile_rows = 2;
    desc.tile_cols = 4;
    run(*state, &desc, tiled, 2, &computed, &left_out);
    assert_int_equal(computed, 1);
    assert_int_equal(left_out, 15);
    for (int row = 0; row < 96; row++)
        for (int col = 0; col < 256; col++) {
            const size_t at = (size_t)row * 256 + (size_t)col;
            assert_true(tiled[at] == (row < 48 && col < 64 ? whole[at] : 0.0f));
        }
    for (size_t i = plane; i < 2 * plane; i++)
        assert_true(whole[i] == 0.0f && tiled[i] == 0.0f);
    /* what is not above the limit is no content */
    desc.content = 2.0f;
    tiled[10 * 256 + 20] = 1.5f;
    run(*state, &desc, tiled, 1, &computed, &left_out);
    assert_int_equal(computed, 0);
    assert_true(tiled[10 * 256 + 20] == 1.5f);
}

TEST(short_memory_makes_tiles)
{
    net_device *device = *state;
    uint64_t whole, tiled;
    int computed, left_out;
    SCOPED(hada_net) *net = unet_of("8|12", "9", 1, HADA_UNET_LINEAR, 0);
    hada_enhance_desc desc = {.net = net, .channels = 1, .rows = 400, .cols = 300};
    ASSERT_OK(bytes_of(device->context, &desc, &whole, err));
    desc.memory = (size_t)(whole / 3);
    ASSERT_OK(bytes_of(device->context, &desc, &tiled, err));
    assert_true(tiled < whole / 3 + 3 * 400 * 300 * 4 + 100000);
    SCOPED_MEMORY float *planes = planes_of(&desc, 1);
    run(device, &desc, planes, 1, &computed, &left_out);
    assert_true(computed > 2);
    desc.memory = 1000;
    ASSERT_FAILS(bytes_of(device->context, &desc, &tiled, err), HADA_ERROR_DEVICE_MEMORY, "options.enhance 0");
}

TEST(nets_that_do_not_fit_are_refused)
{
    net_device *device = *state;
    hada_enhance *enhance;
    SCOPED(hada_net) *net = unet_of("8|12", "9", 1, HADA_UNET_LINEAR, 0);
    const hada_enhance_desc desc = {.net = net, .channels = 3, .rows = 40, .cols = 30};
    ASSERT_FAILS(hada_enhance_create(&enhance, device->slot, &desc, err), HADA_ERROR_MODEL, "");
    assert_null(enhance);
    hada_net_destroy(&net);
    ASSERT_OK(hada_net_create(&net,
                              "{\"format\":\"hadalens-net-1\",\"layers\":[{\"layer\":\"input\",\"channels\":1},"
                              "{\"layer\":\"pool\"}]}",
                              0, err));
    const hada_enhance_desc half = {.net = net, .channels = 1, .rows = 40, .cols = 30};
    ASSERT_FAILS(hada_enhance_create(&enhance, device->slot, &half, err), HADA_ERROR_MODEL, "");
}

TEST(fields_are_what_layers_reach)
{
    hada_receptive_field field;
    SCOPED(hada_net) *net = unet_of("8|12", "9", 1, HADA_UNET_LINEAR, 0);
    ASSERT_OK(hada_net_receptive_field(net, &field, err));
    /* last 0, up 1, resize 1 + 1 coarse, conv 1 coarse, pool 6 fine, conv 1 */
    assert_true(field.tiles);
    assert_int_equal(field.multiple, 2);
    assert_int_equal(field.halo, 8);
    hada_net_destroy(&net);
    ASSERT_OK(hada_net_create_preset(&net, "paper", 3, 1, err));
    ASSERT_OK(hada_net_receptive_field(net, &field, err));
    assert_true(field.tiles);
    assert_int_equal(field.multiple, 32);
    hada_net_destroy(&net);
    ASSERT_OK(hada_net_create(&net,
                              "{\"format\":\"hadalens-net-1\",\"layers\":[{\"layer\":\"input\",\"channels\":1},"
                              "{\"layer\":\"resize\",\"rows\":8,\"cols\":8},{\"layer\":\"resize\",\"like\":0}]}",
                              0, err));
    ASSERT_OK(hada_net_receptive_field(net, &field, err));
    assert_false(field.tiles);
}

/* Launches of kernels but those that take planes to the net and back. */
static uint64_t launches_of(net_device *device, const hada_enhance_desc *desc, int count)
{
    SCOPED_MEMORY hada_kernel_time *rows = NULL;
    size_t row_count = 0;
    uint64_t launches = 0;
    int computed, left_out;
    SCOPED_MEMORY float *planes = planes_of(desc, count);
    ASSERT_OK(hada_slot_profile(device->slot, 1, err));
    run(device, desc, planes, count, &computed, &left_out);
    assert_int_equal(computed, count);
    ASSERT_OK(hada_slot_times(device->slot, &rows, &row_count, err));
    ASSERT_OK(hada_slot_profile(device->slot, 0, err));
    for (size_t i = 0; i < row_count; i++)
        if (!rows[i].transfer && strcmp(rows[i].name, "net_tensor_load") != 0 &&
            strcmp(rows[i].name, "net_tensor_store") != 0)
            launches += rows[i].launches;
    return launches;
}

/* As many launches as one plane takes. */
TEST(planes_of_a_frame_go_in_one_batch)
{
    enum { DEPTHS = 6 };
    net_device *device = *state;
    SCOPED(hada_net) *net = unet_of("6,6|10", "7", 3, HADA_UNET_LINEAR, 0);
    hada_enhance_desc desc = {.net = net, .channels = 3, .rows = 20, .cols = 24, .planes = DEPTHS};
    const hada_kernel_shape own = device->context->shape;
    device->context->shape = HADA_SHAPE_GROUPS;
    const uint64_t one = launches_of(device, &desc, 1), all = launches_of(device, &desc, DEPTHS);
    assert_true(one >= 5);
    assert_int_equal(all, one);
    desc.planes = 1;
    assert_true(launches_of(device, &desc, DEPTHS) > 2 * one);
    device->context->shape = own;
}

FIXTURE(net_device_open, net_device_close)
