/* Lists of layers: descriptions, parameters, sizes, files. */
#include "testing.h"

#include "netlist/net_list.h"

TEST(presets_have_the_values_they_should)
{
    hada_net *net;
    /* the paper's net: 3,745,057 values with the running statistics of three batch norms */
    ASSERT_OK(hada_net_create_preset(&net, "paper", 3, 1, err));
    const hada_net_info *info = hada_net_get_info(net);
    assert_int_equal(info->values, 3745057);
    assert_int_equal(info->trained, 3745057 - 3 * 2 * 64);
    assert_int_equal(info->channels, 3);
    assert_int_equal(info->out_channels, 3);
    assert_true(info->shared);
    assert_string_equal(net->parameters[hada_net_find(net, "norm.2.running_var") - net->parameters].name,
                        "norm.2.running_var");
    hada_net_destroy(&net);
    ASSERT_OK(hada_net_create_preset(&net, "compact", 3, 1, err));
    info = hada_net_get_info(net);
    size_t trained = 0;
    const int convs[][2] = {{3, 16},   {16, 16},   {16, 32},   {32, 32},   {32, 64},   {64, 64},
                            {64, 128}, {128, 128}, {128, 256}, {256, 256}, {384, 128}, {128, 128},
                            {192, 64}, {64, 64},   {96, 32},   {32, 32},   {48, 16},   {16, 16}};
    for (size_t i = 0; i < sizeof convs / sizeof *convs; i++)
        trained += (size_t)(9 * convs[i][0] + 1) * (size_t)convs[i][1];
    assert_int_equal(info->trained, trained + 16 * 3 + 3);
    assert_int_equal(info->values, info->trained);
    assert_false(info->shared);
    hada_net_destroy(&net);
    ASSERT_FAILS(hada_net_create_preset(&net, "huge", 3, 1, err), HADA_ERROR_ARGUMENT, "");
    assert_null(net);
}

TEST(vgg16_has_the_names_of_torchvision)
{
    SCOPED(hada_net) * net;
    static const int numbers[] = {0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28};
    ASSERT_OK(hada_vgg16_make(&net, err));
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        char name[40];
        snprintf(name, sizeof name, "features.%d.weight", numbers[i]);
        assert_non_null(hada_net_find(net, name));
        snprintf(name, sizeof name, "features.%d.bias", numbers[i]);
        assert_non_null(hada_net_find(net, name));
    }
    assert_int_equal(net->parameter_count, 28);
    assert_int_equal(net->trained, 14714688 + 12); /* torchvision's features, and the normalisation */
}

static void check_round_trip(hada_net *net)
{
    SCOPED(hada_net) * again;
    char *text, *other;
    ASSERT_OK(hada_net_describe(net, &text, err));
    ASSERT_OK(hada_net_create(&again, text, 0, err));
    ASSERT_OK(hada_net_describe(again, &other, err));
    assert_string_equal(text, other);
    assert_int_equal(again->count, net->count);
    for (int i = 0; i < net->count; i++)
        assert_memory_equal(&net->layers[i], &again->layers[i], sizeof(hada_layer));
    assert_int_equal(again->floats, net->floats);
    assert_int_equal(again->shares, net->shares);
    hada_memory_destroy(&text);
    hada_memory_destroy(&other);
    hada_net_destroy(&net);
}

TEST(descriptions_come_back_as_they_were)
{
    hada_net *net;
    ASSERT_OK(hada_net_create_preset(&net, "paper", 3, 1, err));
    check_round_trip(net);
    ASSERT_OK(hada_discriminator_make(&net, "paper", 3, err));
    check_round_trip(net);
    ASSERT_OK(hada_discriminator_make(&net, "patch", 1, err));
    check_round_trip(net);
    ASSERT_OK(hada_vgg16_make(&net, err));
    check_round_trip(net);
    DEFAULTS(hada_unet_options, options);
    options.up_by = HADA_UNET_TRANSPOSED;
    ASSERT_OK(hada_net_create_unet(&net, &options, 1, err));
    check_round_trip(net);
    ASSERT_OK(hada_net_create_unet(&net, &options, 1, err));
    net->shares = 1;
    hada_net *copy;
    ASSERT_OK(hada_net_copy(&copy, net, err));
    assert_int_equal(copy->shares, 1);
    check_round_trip(copy);
    check_round_trip(net);
}

TEST(any_unet_gives_the_size_it_takes)
{
    static const char *const shapes[][2] = {{"4", ""}, {"4,4|6", "5"}, {"3|4|5,5|6", "|7|"}};
    for (int up_by = HADA_UNET_LINEAR; up_by <= HADA_UNET_TRANSPOSED; up_by++)
        for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++)
            for (int rows = 8; rows < 20; rows++) {
                SCOPED(hada_net) * net;
                DEFAULTS(hada_unet_options, options);
                options.down = shapes[i][0];
                options.up = shapes[i][1];
                options.up_by = (hada_unet_up)up_by;
                ASSERT_OK(hada_net_create_unet(&net, &options, 1, err));
                SCOPED_MEMORY hada_size *sizes = calloc((size_t)net->count, sizeof *sizes);
                ASSERT_OK(hada_net_sizes(net, rows, 23, sizes, err));
                assert_int_equal(sizes[net->count - 1].rows, rows);
                assert_int_equal(sizes[net->count - 1].cols, 23);
            }
    SCOPED(hada_net) * net;
    hada_size sizes[64];
    ASSERT_OK(hada_net_create_preset(&net, "compact", 3, 1, err));
    ASSERT_FAILS(hada_net_sizes(net, 15, 64, sizes, err), HADA_ERROR_SIZE, "15 x 64");
}

TEST(wrong_unets_are_refused)
{
    static const char *const shapes[][2] = {{"4|5|6", ""}, {"4,|5", "4"}, {"4||5", "4|4"}, {"x", ""},
                                            {"0|4", "4"},  {"4", "4"},    {"-4|5", "4"},   {"4|5", "4|4"}};
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++) {
        hada_net *net;
        DEFAULTS(hada_unet_options, options);
        options.down = shapes[i][0];
        options.up = shapes[i][1];
        ASSERT_FAILS(hada_net_create_unet(&net, &options, 1, err), HADA_ERROR_ARGUMENT, "");
        assert_null(net);
    }
}

#define LIST(text) "{\"format\":\"hadalens-net-1\",\"layers\":[{\"layer\":\"input\",\"channels\":3}," text "]}"

TEST(damaged_descriptions_are_refused)
{
    static const struct {
        const char *text, *says;
    } cases[] = {
        {"{", "not JSON"},
        {"[]", "not the description"},
        {"{\"format\":\"hadalens-net-2\",\"layers\":[]}", "not the description"},
        {"{\"format\":\"hadalens-net-1\",\"layers\":[]}", "at least one more layer"},
        {"{\"format\":\"hadalens-net-1\",\"colours\":0,\"layers\":[]}", "1 to 64"},
        {LIST("7"), "no kind of layer"},
        {LIST("{\"layer\":\"convolution\"}"), "no kind of layer"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\"}"), "number of channels"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4,\"from\":1}"), "does not stand before"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4,\"from\":[]}"), "from"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4,\"colour\":1}"), "nothing that this kind"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4,\"p\":1}"), "nothing that this kind"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4.5}"), "whole number"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4,\"activation\":\"tanh\"}"), "none of the words"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4,\"output_pad\":1}"), "padding"},
        {LIST("{\"layer\":\"conv\",\"channels\":4}"), "a name of its own"},
        {LIST("{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4},"
              "{\"layer\":\"conv\",\"name\":\"a\",\"channels\":4}"),
         "a name of its own"},
        {LIST("{\"layer\":\"pool\",\"kernel\":0}"), "kernel or stride"},
        {LIST("{\"layer\":\"resize\"}"), "what size"},
        {LIST("{\"layer\":\"resize\",\"like\":1}"), "what size"},
        {LIST("{\"layer\":\"norm\",\"name\":\"n\",\"eps\":0}"), "eps"},
        {LIST("{\"layer\":\"dropout\",\"p\":1}"), "p from 0"},
        {LIST("{\"layer\":\"linear\",\"name\":\"f\",\"channels\":1}"), "how many values"},
        {LIST("{\"layer\":\"pool\"},{\"layer\":\"pool\",\"from\":0}"), "taken by no other layer"},
        {LIST("{\"layer\":\"input\",\"channels\":1}"), "layer 0 is the input"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        hada_net *net;
        hada_error error = {0};
        assert_int_not_equal(hada_net_create(&net, cases[i].text, 0, &error), HADA_OK);
        assert_null(net);
        if (!strstr(error.message, cases[i].says))
            fail_msg("%s: %s", cases[i].text, error.message);
    }
}

TEST(first_weights_follow_the_seed)
{
    SCOPED(hada_net) * one, *same, *other;
    ASSERT_OK(hada_net_create_preset(&one, "compact", 3, 7, err));
    ASSERT_OK(hada_net_create_preset(&same, "compact", 3, 7, err));
    ASSERT_OK(hada_net_create_preset(&other, "compact", 3, 8, err));
    assert_memory_equal(one->values, same->values, one->floats * sizeof(float));
    assert_memory_not_equal(one->values, other->values, one->floats * sizeof(float));
    const hada_parameter *weight = hada_net_find(one, "up.0.0.weight"), *bias = hada_net_find(one, "up.0.0.bias");
    double sum = 0;
    for (size_t i = 0; i < weight->count; i++)
        sum += (double)one->values[weight->offset + i] * (double)one->values[weight->offset + i];
    /* Kaiming: variance 2 / fan_in */
    assert_true(fabs(sum / (double)weight->count * (9 * 48) / 2 - 1) < 0.1);
    for (size_t i = 0; i < bias->count; i++)
        assert_true(one->values[bias->offset + i] == 0.0f);
}

TEST(files_come_back_and_others_are_refused)
{
    char path[] = "/tmp/hadalens-net-XXXXXX";
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    hada_net *net, *again, *wider;
    int variances = 0;
    DEFAULTS(hada_unet_options, options);
    options.down = "4|6";
    options.up = "5";
    options.shared = options.last_norm = 1;
    ASSERT_OK(hada_net_create_unet(&net, &options, 1, err));
    ASSERT_OK(hada_net_save(net, path, err));
    ASSERT_OK(hada_net_load(&again, path, err));
    assert_memory_equal(net->values, again->values, net->floats * sizeof(float));
    memset(again->values, 0, again->floats * sizeof(float));
    ASSERT_OK(hada_net_load_weights(again, path, "", err));
    assert_memory_equal(net->values, again->values, net->floats * sizeof(float));
    /* another shape, a prefix that is not there, no net at all: refused, and nothing changed */
    options.up = "7";
    ASSERT_OK(hada_net_create_unet(&wider, &options, 2, err));
    float *before = malloc(wider->floats * sizeof(float));
    memcpy(before, wider->values, wider->floats * sizeof(float));
    ASSERT_FAILS(hada_net_load_weights(wider, path, NULL, err), HADA_ERROR_MODEL, "up.0.0.weight has another shape");
    ASSERT_FAILS(hada_net_load_weights(wider, path, "other.", err), HADA_ERROR_MODEL, "other.down.0.0.weight");
    assert_memory_equal(before, wider->values, wider->floats * sizeof(float));
    for (int i = 0; i < again->parameter_count; i++) { /* a variance below 0 gives NaN */
        float *variance = again->values + again->parameters[i].offset, kept = *variance;
        if (!strstr(again->parameters[i].name, "running_var"))
            continue;
        *variance = -1.0f;
        ASSERT_OK(hada_net_save(again, path, err));
        ASSERT_FAILS(hada_net_load_weights(net, path, "", err), HADA_ERROR_NOT_FINITE, "negative variances");
        *variance = kept;
        variances++;
    }
    assert_true(variances > 0);
    again->values[3] = NAN;
    ASSERT_OK(hada_net_save(again, path, err));
    ASSERT_FAILS(hada_net_load_weights(net, path, "", err), HADA_ERROR_NOT_FINITE, "");
    hada_net_destroy(&again);
    ASSERT_FAILS(hada_net_load(&again, "/nowhere/net.safetensors", err), HADA_ERROR_FILE_OPEN, "");
    hada_net *none;
    hada_tensors_writer *writer;
    ASSERT_OK(hada_tensors_create(&writer, path, err));
    ASSERT_OK(hada_net_declare(net, writer, "part.", err));
    ASSERT_OK(hada_net_write(net, writer, err));
    ASSERT_OK(hada_tensors_finish(&writer, err));
    ASSERT_FAILS(hada_net_load(&none, path, err), HADA_ERROR_FILE_FORMAT, "");
    ASSERT_OK(hada_net_load_weights(net, path, "part.", err));
    free(before);
    hada_net_destroy(&net);
    hada_net_destroy(&wider);
    remove(path);
}

/* Transposed convolutions multiply sizes: what goes beyond integers is too large, not negative or small. */
TEST(sizes_beyond_integers_are_refused)
{
    char list[2000];
    hada_net *net;
    hada_size sizes[10];
    hada_error error = {0};
    for (int depth = 1; depth <= 8; depth++) {
        int used = snprintf(list, sizeof list,
                            "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 1}");
        for (int i = 0; i < depth; i++)
            used += snprintf(list + used, sizeof list - (size_t)used,
                             ", {\"layer\": \"conv\", \"name\": \"n%d\", \"channels\": 1, \"kernel\": 64, "
                             "\"stride\": 64, \"pad\": 0, \"transposed\": true}",
                             i);
        snprintf(list + used, sizeof list - (size_t)used, "]}");
        ASSERT_OK(hada_net_create(&net, list, 1, err));
        const hada_status status = hada_net_sizes(net, 30, 20, sizes, &error);
        if (status) {
            assert_int_equal(status, HADA_ERROR_SIZE);
            assert_true(depth >= 3 && strlen(error.message) > 20);
        } else {
            const hada_size last = sizes[depth];
            assert_true(depth <= 3 && last.rows > 0 && last.cols > 0 && last.rows / 30 == last.cols / 20);
        }
        hada_net_destroy(&net);
    }
}
