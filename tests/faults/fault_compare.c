/* Registration and LPIPS. */
#include "core/base.h"
#include "fault_job.h"
#include "register/register_inside.h"

hada_status fault_stage_register(fault_job *job, hada_error *err)
{
    const hada_image *raws = job->frame[0], *scenes = job->scene[0];
    hada_registration found = {.size = sizeof found};
    const hada_register_options options = {.least_magnification = 0.95, .most_magnification = 1.05};
    SCOPED(hada_image) psf = {0}, out = {0};
    double pitch, where[4];
    hada_status status = hada_register_pairs(&found, raws, scenes, JOB_PAIRS, &options, err);
    if (status == HADA_ERROR_DATASET && strstr(err->message, "do not show"))
        status = HADA_OK; /* two pairs of a small camera need not suffice */
    if (!status)
        status = hada_register_psf(&psf, &pitch, raws, scenes, JOB_PAIRS, &found, err);
    if (!status)
        status = hada_register_offset(&psf, &psf, pitch, &where[0], &where[1], &where[2], &where[3], err);
    if (!status)
        status = hada_register_apply(&out, &scenes[0], &found, JOB_WINDOW, JOB_WINDOW, err);
    if (!status) {
        fault_add(job, &found, sizeof found);
        fault_add(job, where, sizeof where);
        fault_add(job, out.data, hada_image_count(&out) * sizeof *out.data);
    }
    return status;
}

/* A net whose file holds what LPIPS by AlexNet looks for. */
static hada_status save_weights(const char *path, hada_error *err)
{
    static const int numbers[] = {0, 3, 6, 8, 10}, widths[] = {64, 192, 384, 256, 256}, kernels[] = {11, 5, 3, 3, 3};
    char list[2000];
    int used = snprintf(list, sizeof list,
                        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 3}");
    for (int i = 0; i < 5; i++)
        used += snprintf(list + used, sizeof list - (size_t)used,
                         ", {\"layer\": \"conv\", \"name\": \"features.%d\", \"channels\": %d, \"kernel\": %d}",
                         numbers[i], widths[i], kernels[i]);
    for (int i = 0; i < 5; i++)
        used += snprintf(list + used, sizeof list - (size_t)used,
                         ", {\"layer\": \"conv\", \"name\": \"lin%d.model.1\", \"from\": %d, \"channels\": 1, "
                         "\"kernel\": 1, \"pad\": 0}",
                         i, i + 1);
    snprintf(list + used, sizeof list - (size_t)used, ", {\"layer\": \"concat\", \"from\": [6, 7, 8, 9, 10]}]}");
    SCOPED(hada_net) *net = NULL;
    HADA_TRY(hada_net_create(&net, list, 1, err));
    return hada_net_save(net, path, err);
}

hada_status fault_stage_lpips(fault_job *job, hada_error *err)
{
    char path[200];
    SCOPED(hada_lpips) *lpips = NULL;
    SCOPED(hada_image) map = {0};
    double value = 0.0;
    snprintf(path, sizeof path, "%s/lpips.model", job->folder);
    HADA_TRY(save_weights(path, err));
    HADA_TRY(hada_lpips_create(&lpips, job->context, HADA_LPIPS_AUTO, path, NULL, err));
    HADA_TRY(hada_lpips_run(lpips, &job->frame[0][0], &job->frame[0][1], 1.0, NULL, &value, err));
    HADA_TRY(hada_lpips_map(lpips, &job->frame[0][0], &job->frame[1][0], 1.0, &map, err));
    fault_add(job, &value, sizeof value);
    fault_add(job, map.data, hada_image_count(&map) * sizeof *map.data);
    return HADA_OK;
}
