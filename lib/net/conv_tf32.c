/* Convolutions by tensor cores are tried before they serve: the instruction stands in the kernel as text for one
 * vendor's compiler, and nothing else says whether a driver takes it and what it computes. */
#include "net/conv_tf32.h"

#include "net/conv_compare.h"

/* Channels that fill no block, several tiles of pixels and several steps, by both sizes of tiles: 20 x 21 pixels are
 * two of 256 and four of 128. */
static hada_conv_desc trial(int out_channels)
{
    return (hada_conv_desc){.images = 1,
                            .in_channels = 21,
                            .out_channels = out_channels,
                            .in_rows = 20,
                            .in_cols = 21,
                            .kernel_rows = 3,
                            .kernel_cols = 3,
                            .stride = 1,
                            .pad_rows = 1,
                            .pad_cols = 1,
                            .method = HADA_CONV_TF32};
}

hada_status hada_conv_tf32_apart(hada_slot *slot, double *apart, hada_error *err)
{
    static const int out_channels[] = {27, 59};
    hada_status status = HADA_OK;
    hada_conv_compare compare = {0};
    hada_conv *conv = NULL;
    *apart = 0;
    for (size_t i = 0; i < HADA_COUNT(out_channels); i++) {
        const hada_conv_desc desc = trial(out_channels[i]);
        HADA_TRY_OR_DONE(hada_conv_compare_begin(&compare, slot, &desc, err));
        HADA_TRY_OR_DONE(hada_conv_create(&conv, slot, &desc, err));
        HADA_TRY_OR_DONE(hada_conv_compare_values(&compare, conv, compare.got, err));
        const double one = hada_conv_compare_apart(&compare);
        *apart = one > *apart || one != one ? one : *apart; /* what is no number stays */
        hada_conv_destroy(&conv);
        hada_conv_compare_end(&compare);
        compare = (hada_conv_compare){0};
        if (!(one <= HADA_CONV_COMPARE_MOST))
            break;
    }
done:
    hada_conv_destroy(&conv);
    hada_conv_compare_end(&compare);
    return status;
}

hada_status hada_conv_tf32_try(hada_slot *slot, hada_error *err)
{
    hada_context *context = slot->context;
    hada_error reason = {0};
    double apart = 0;
    if (!context->tensor_cores || context->shape != HADA_SHAPE_GROUPS ||
        atomic_load(&context->tf32) != HADA_CONV_TF32_UNTRIED)
        return HADA_OK;
    /* two slots may try at the same time: they come to the same */
    const hada_status status = hada_conv_tf32_apart(slot, &apart, &reason);
    if (status == HADA_ERROR_MEMORY) { /* which says nothing of tensor cores */
        if (err)
            *err = reason;
        return status;
    }
    const int right = !status && apart <= HADA_CONV_COMPARE_MOST;
    if (status)
        hada_log(context, HADA_LOG_WARNING, "%s: convolutions go without tensor cores: %s", context->info.name,
                 reason.message);
    else if (!right)
        hada_log(context, HADA_LOG_WARNING,
                 "%s: convolutions go without tensor cores, whose results differ by %.1e (%.1e is rounding)",
                 context->info.name, apart, HADA_CONV_COMPARE_MOST);
    atomic_store(&context->tf32, right ? HADA_CONV_TF32_RIGHT : HADA_CONV_TF32_WRONG);
    return HADA_OK;
}
