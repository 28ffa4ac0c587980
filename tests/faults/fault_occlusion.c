/* Opaque planes, through lenses and through patches of a diffuser. */
#include "fault_job.h"

static hada_status camera_make(hada_camera *camera, hada_mask mask, hada_error *err)
{
    camera->size = sizeof *camera;
    hada_status status = hada_camera_preset(camera, "sim300", err);
    if (!status)
        status = hada_camera_resize(camera, 24, 24, 10, 10, err);
    if (!status)
        status = hada_camera_set_depths(camera, 100.0, 300.0, 2, err);
    camera->lenses = 3;
    return status || mask == HADA_MASK_MLA ? status : hada_camera_set_mask(camera, mask, err);
}

static hada_status render(fault_job *job, hada_mask mask, const hada_image *scene, const hada_image *opacity,
                          hada_error *err)
{
    hada_camera camera;
    SCOPED(hada_simulator) *simulator = NULL;
    SCOPED(hada_image) raw = {0};
    const hada_plane planes[] = {{0, scene}, {1, scene}};
    const hada_image *const opacities[] = {opacity, NULL};
    HADA_TRY(camera_make(&camera, mask, err));
    HADA_TRY(hada_simulator_create(&simulator, job->context, &camera, NULL, err));
    HADA_TRY(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, err));
    fault_add_image(job, &raw);
    return HADA_OK;
}

hada_status fault_stage_occlusion(fault_job *job, hada_error *err)
{
    SCOPED(hada_image) scene = {0}, opacity = {0};
    HADA_TRY(hada_scene_procedural(&scene, 1, 1, 10, 10, err));
    HADA_TRY(hada_image_create(&opacity, 1, 10, 10, err));
    for (int i = 0; i < 30; i++)
        opacity.data[i] = 1.0f;
    HADA_TRY(render(job, HADA_MASK_MLA, &scene, &opacity, err));
    return render(job, HADA_MASK_DIFFUSER, &scene, &opacity, err);
}
