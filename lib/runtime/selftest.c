#include "runtime/context.h"

#include "launch/selftest.h"
#include "runtime/buffer.h"

enum { GROUP = 64, GROUPS = 4, ITEMS = GROUP * GROUPS };

static hada_status wrong(const hada_context *context, const char *what, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_SELF_TEST,
                     "%s computes wrong results (%s); update its driver or choose another device with options.device",
                     context->info.name, what);
}

static hada_status test_sum(hada_slot *slot, hada_buffer *in, hada_buffer *out, hada_error *err)
{
    cl_int values[ITEMS], sums[GROUPS];
    size_t local = slot->context->info.max_work_group < GROUP ? slot->context->info.max_work_group : GROUP;
    while (GROUP % local)
        local--;
    /* a device with tiny groups: sum only the first ones */
    const size_t groups = ITEMS / local < GROUPS ? ITEMS / local : GROUPS;
    const hada_range range = hada_range_groups(groups, local, 1, 1);
    const hada_local part = {local * sizeof(cl_int)};
    for (int i = 0; i < ITEMS; i++)
        values[i] = (i * 7919) % 1009 - 300;
    HADA_TRY(hada_buffer_write(in, slot, 0, values, sizeof values, err));
    HADA_TRY(hada_launch_selftest_sum(slot, HADA_PROGRAM_SELFTEST_DEFAULT, &range, err, .in = in->ints,
                                      .out = out->ints, .part = part));
    HADA_TRY(hada_buffer_read(out, slot, 0, sums, groups * sizeof *sums, err));
    for (size_t g = 0; g < groups; g++) {
        cl_int expected = 0;
        for (size_t i = 0; i < local; i++)
            expected += values[g * local + i];
        if (sums[g] != expected)
            return wrong(slot->context, "sums in local memory with barriers", err);
    }
    return HADA_OK;
}

static hada_status test_product(hada_slot *slot, hada_buffer *in, hada_buffer *second, hada_buffer *out,
                                hada_error *err)
{
    float a[ITEMS], b[ITEMS], c[ITEMS];
    const hada_range range = hada_range_of(ITEMS / 8, 1, 1, 1);
    for (int i = 0; i < ITEMS; i++) {
        a[i] = (float)(i % 17 - 8);
        b[i] = (float)(i % 23 - 11);
    }
    HADA_TRY(hada_buffer_write(in, slot, 0, a, sizeof a, err));
    HADA_TRY(hada_buffer_write(second, slot, 0, b, sizeof b, err));
    HADA_TRY(hada_launch_selftest_product(slot, HADA_PROGRAM_SELFTEST_DEFAULT, &range, err, .a = in->mem,
                                          .b = second->mem, .out = out->mem));
    HADA_TRY(hada_buffer_read(out, slot, 0, c, sizeof c, err));
    for (int i = 0; i < ITEMS; i += 2)
        if (c[i] != a[i] * b[i] - a[i + 1] * b[i + 1] || c[i + 1] != a[i] * b[i + 1] + a[i + 1] * b[i])
            return wrong(slot->context, "complex products in vectors", err);
    return HADA_OK;
}

static hada_status test_half(hada_slot *slot, hada_buffer *in, hada_buffer *middle, hada_buffer *out, hada_error *err)
{
    /* values and what half keeps of them: exact, rounded to even, subnormal, largest */
    static const float values[8] = {0.0f, 1.0f, -2.5f, 2049.0f, 2051.0f, 65504.0f, 5.9604645e-8f, 0.333251953125f};
    static const float expected[8] = {0.0f, 1.0f, -2.5f, 2048.0f, 2052.0f, 65504.0f, 5.9604645e-8f, 0.333251953125f};
    float got[8];
    const hada_range range = hada_range_of(8, 1, 1, 1);
    HADA_TRY(hada_buffer_write(in, slot, 0, values, sizeof values, err));
    HADA_TRY(hada_launch_selftest_half(slot, HADA_PROGRAM_SELFTEST_DEFAULT, &range, err, .in = in->mem,
                                       .middle = middle->halves, .out = out->mem));
    HADA_TRY(hada_buffer_read(out, slot, 0, got, sizeof got, err));
    if (memcmp(got, expected, sizeof got))
        return wrong(slot->context, "half-precision storage", err);
    return HADA_OK;
}

hada_status hada_self_test(hada_context *context, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_buffer in = {0}, second = {0}, out = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&in, context, ITEMS * 4, "the self-test", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&second, context, ITEMS * 4, "the self-test", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&out, context, ITEMS * 4, "the self-test", err));
    HADA_TRY_OR_DONE(test_sum(slot, &in, &out, err));
    HADA_TRY_OR_DONE(test_product(slot, &in, &second, &out, err));
    HADA_TRY_OR_DONE(test_half(slot, &in, &second, &out, err));
done:
    hada_slot_destroy(&slot);
    HADA_DESTROY_BUFFERS(&in, &second, &out);
    return status;
}
