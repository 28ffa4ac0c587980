/* Constants of a camera, from its transfer functions. */
#include <math.h>
#include <stdlib.h>

#include "classic/classic.h"
#include "core/alloc.h"
#include "model/model.h"

/* One channel: *mean takes the sum over depths of the mean |H|^2. */
static double look(const hada_model *model, const int *depths, int count, int channel, double *mean)
{
    const hada_model_info *info = &model->info;
    const size_t cols = (size_t)info->grid_cols / 2 + 1, plane = hada_model_plane(model);
    double largest = 0.0, sum = 0.0;
    for (size_t f = 0; f < plane; f++) {
        const size_t kx = f % cols;
        double square = 0.0;
        for (int i = 0; i < count; i++) {
            const size_t image = (size_t)depths[i] * (size_t)info->channels + (size_t)channel;
            const float *h = model->otf + 2 * (image * plane + f);
            square += (double)h[0] * h[0] + (double)h[1] * h[1];
        }
        largest = fmax(largest, square);
        sum += (kx == 0 || 2 * kx == (size_t)info->grid_cols ? 1.0 : 2.0) * square;
    }
    *mean = sum / ((double)info->grid_rows * info->grid_cols);
    return largest;
}

hada_status hada_classic_camera_of(hada_classic_camera *camera, const hada_model *model, const int *depths, int count,
                                   hada_error *err)
{
    const int channels = model->info.channels;
    hada_status status = hada_alloc((void **)&camera->largest, (size_t)channels, sizeof(double), "a plan", err);
    if (status)
        return status;
    camera->gain = hada_model_gain(model);
    camera->mean_square = 0.0;
    for (int c = 0; c < channels; c++) {
        double mean;
        camera->largest[c] = look(model, depths, count, c, &mean);
        camera->mean_square += mean / channels / count;
        if (!(camera->largest[c] > 0.0) && !status)
            status = hada_fail(err, HADA_ERROR_MODEL, "the model's transfer functions are 0 in channel %d", c + 1);
    }
    hada_model_forget(model);
    return status;
}

void hada_classic_camera_free(hada_classic_camera *camera)
{
    free(camera->largest);
    camera->largest = NULL;
}
