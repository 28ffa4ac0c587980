/* Convolutions by tensor cores: whether they are used follows from a trial on the device. Here there are none, so the
 * trial of the true ones fails, and an emulation replaces them. */
#include "dry.h"
#include "net_fixture.h"

#include "net/conv_plan.h"

static char last[512];

static void keep(void *user, hada_log_level level, const char *message)
{
    (void)user;
    (void)level;
    snprintf(last, sizeof last, "%s", message);
}

static int open_groups(void **state)
{
    static net_device device;
    hada_error error = {0};
    DEFAULTS(hada_context_options, options);
    options.shape = HADA_SHAPE_GROUPS;
    options.log = keep;
    options.log_level = HADA_LOG_WARNING;
    if (hada_context_create(&device.context, &options, &error) ||
        hada_slot_create(&device.slot, device.context, &error)) {
        print_error("%s\n", error.message);
        return -1;
    }
    *state = &device;
    return 0;
}

static hada_conv_desc conv_of(int in_channels, int out_channels)
{
    return net_conv3(1, in_channels, out_channels, 20, 24);
}

static hada_conv_plan plan_of(const hada_context *context, int in_channels, int out_channels)
{
    const hada_conv_desc desc = conv_of(in_channels, out_channels);
    hada_conv_plan plan;
    ASSERT_OK(hada_conv_plan_make(&plan, context, &desc, err));
    return plan;
}

/* Near to the plain one, but not the same: products are added up in another order. */
TEST(the_emulation_is_near)
{
    net_device *device = *state;
    double apart;
    ASSERT_OK(hada_conv_tf32_apart(device->slot, &apart, err));
    assert_true(apart > 0 && apart <= HADA_CONV_TF32_MOST);
}

TEST(without_tensor_cores_nothing_is_tried)
{
    net_device *device = *state;
    if (device->context->tensor_cores)
        skip();
    ASSERT_OK(hada_conv_tf32_try(device->slot, err));
    assert_int_equal(atomic_load(&device->context->tf32), HADA_CONV_TF32_UNTRIED);
    assert_int_equal(plan_of(device->context, 32, 64).pass[0].method, HADA_CONV_DIRECT);
}

/* A device that says it has some, whose compiler does not take the instruction. */
TEST(what_fails_is_off)
{
    net_device *device = *state;
    hada_context *context = device->context;
    if (context->tensor_cores)
        skip();
    const unsigned floats = context->vector_floats;
    context->vector_floats = 1;
    context->tensor_cores = 1;
    ASSERT_OK(hada_conv_tf32_try(device->slot, err));
    assert_int_equal(atomic_load(&context->tf32), HADA_CONV_TF32_WRONG);
    assert_non_null(strstr(last, "without tensor cores"));
    assert_non_null(strstr(last, "conv_tf32"));
    assert_int_equal(plan_of(context, 32, 64).pass[0].method, HADA_CONV_DIRECT);
    last[0] = '\0';
    ASSERT_OK(hada_conv_tf32_try(device->slot, err)); /* once */
    assert_int_equal(last[0], '\0');
    context->vector_floats = floats;
    context->tensor_cores = 0;
}

/* Where the trial went well, layers with enough channels take them, and hold as many bytes as before. */
TEST(what_is_right_is_used)
{
    net_device *device = *state;
    hada_context *context = device->context;
    const int before = atomic_load(&context->tf32);
    const hada_conv_desc desc = conv_of(32, 64);
    atomic_store(&context->tf32, HADA_CONV_TF32_WRONG);
    uint64_t bytes;
    hada_status status;
    DRY_STATUS(status, bytes, context, hada_conv, hada_conv_create(&object, &dry.slot, &desc, NULL), hada_conv_destroy);
    assert_int_equal(status, HADA_OK);
    atomic_store(&context->tf32, HADA_CONV_TF32_RIGHT);
    ASSERT_DRY(bytes, context, hada_conv, hada_conv_create(&object, &dry.slot, &desc, NULL), hada_conv_destroy);
    const hada_conv_plan plan = plan_of(context, 32, 64);
    assert_int_equal(plan.pass[0].method, HADA_CONV_TF32);
    assert_true(plan.pass[0].program >= 0);
    assert_int_equal(plan_of(context, 3, 64).pass[0].method, HADA_CONV_DIRECT);
    assert_int_equal(plan_of(context, 32, 16).pass[0].method, HADA_CONV_DIRECT);
    atomic_store(&context->tf32, before);
}

FIXTURE(open_groups, net_device_close)
