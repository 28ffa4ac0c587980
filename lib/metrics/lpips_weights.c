/* What the files of weights hold. */
#include <math.h>

#include "metrics/lpips_stage.h"

/* VGG-16 begins with kernels of 3 x 3, AlexNet with 11 x 11. */
hada_status hada_lpips_find_net(const hada_tensors *file, hada_lpips_net *net, hada_error *err)
{
    const hada_stored_tensor *first = hada_tensors_find(file, "features.0.weight");
    if (!first)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the file holds no tensor features.0.weight; LPIPS takes the weights of VGG-16 or AlexNet by "
                         "torchvision's names");
    const hada_lpips_net found = first->dims == 4 && first->shape[3] == 3    ? HADA_LPIPS_VGG
                                 : first->dims == 4 && first->shape[3] == 11 ? HADA_LPIPS_ALEX
                                                                             : HADA_LPIPS_AUTO;
    if (!found || (*net && *net != found))
        return hada_fail(err, HADA_ERROR_MODEL, "the tensor features.0.weight has another shape than that of %s",
                         *net == HADA_LPIPS_VGG    ? "VGG-16"
                         : *net == HADA_LPIPS_ALEX ? "AlexNet"
                                                   : "VGG-16 and AlexNet");
    *net = found;
    return HADA_OK;
}

static hada_status read_head(const hada_tensors *file, hada_lpips_net net, int stage, float *out, hada_error *err)
{
    const int channels = hada_lpips_stage_channels(net, stage);
    char name[] = "lin0.model.1.weight";
    name[3] = (char)('0' + stage);
    const hada_stored_tensor *head = hada_tensors_find(file, name);
    int64_t values = head ? 1 : 0;
    for (int d = 0; head && d < head->dims; d++)
        values *= head->shape[d];
    if (values != channels)
        return hada_fail(err, HADA_ERROR_MODEL, "%s %s of %d values; the heads of LPIPS for %s are needed",
                         head ? "the file holds another tensor" : "the file holds no tensor", name, channels,
                         net == HADA_LPIPS_ALEX ? "AlexNet" : "VGG-16");
    HADA_TRY(hada_tensor_copy_f32(head, 0, (size_t)channels, out, err));
    for (int i = 0; i < channels; i++)
        if (!isfinite(out[i]))
            HADA_TRY(hada_fail(err, HADA_ERROR_NOT_FINITE, "the tensor %s holds values that are not finite", name));
    return HADA_OK;
}

hada_status hada_lpips_read_heads(const char *path, hada_lpips_net net, float weights[HADA_LPIPS_CHANNELS],
                                  size_t first[HADA_LPIPS_STAGES], hada_error *err)
{
    hada_tensors *file = NULL;
    size_t count = 0;
    hada_status status = hada_tensors_open(&file, path, err);
    if (status)
        return status;
    for (int i = 0; i < HADA_LPIPS_CHANNELS; i++)
        weights[i] = 0.0f;
    for (int k = 0; k < HADA_LPIPS_STAGES; k++) {
        first[k] = count;
        HADA_TRY_OR_DONE(read_head(file, net, k, weights + count, err));
        count += (size_t)hada_lpips_stage_channels(net, k);
    }
done:
    if (status)
        hada_error_prefix(err, "%s: ", path);
    hada_tensors_close(&file);
    return status;
}
