/* Before a fit: whether the pairs show anything at all. */
#include "fit/fitter.h"

/* NaN is no constant: it is refused with its number where the pair is taken. */
static int is_constant(const hada_image *image)
{
    const size_t area = (size_t)image->rows * (size_t)image->cols;
    for (int c = 0; c < image->channels; c++) {
        const float *at = image->data + (size_t)c * area;
        for (size_t i = 1; i < area; i++)
            if (at[i] != at[0])
                return 0;
    }
    return 1;
}

hada_status hada_fit_check_content(const hada_dataset *pairs, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    for (int z = 0; z < info->depths; z++) {
        int frames = 0, scenes = 0; /* that are not constant */
        for (int i = 0; i < info->counts[z] && !(frames && scenes); i++) {
            hada_pair pair;
            HADA_TRY(hada_pair_take(&pair, pairs, z, i, err));
            frames += !is_constant(pair.raw);
            scenes += !is_constant(pair.scene);
            hada_pair_return(&pair);
        }
        if (info->counts[z] && !(frames && scenes))
            return hada_fail(err, HADA_ERROR_DATASET,
                             "all %s at %.6g mm are black or of one brightness, so nothing can be learned from them; "
                             "check the %s, or leave the depth out",
                             frames ? "scenes" : "raw frames", info->distances_mm[z],
                             frames ? "pictures" : "light, the exposure and the lens cap");
    }
    return HADA_OK;
}
