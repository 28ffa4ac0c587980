/* The steps of a frame on a lane, and the memory that each needs: buffers whose steps do not meet stand in one place.
 */
#include "engine/pipeline.h"

/* What a lane does with a frame, in this order. The linear path computes and focuses batch by batch, so that these two
 * are one step; the refined path looks for the occupied depths, refines them, and then focuses. */
enum {
    UPLOAD, /* raw frame -> spectrum */
    PURSUE, /* refined: spectrum -> occupied depths, a step for each grid that it looks at */
    COMPUTE = PURSUE + HADA_PURSUIT_LEVELS, /* spectrum -> planes */
    FOCUS,                                  /* planes -> running best -> pictures */
    DOWNLOAD                                /* planes and pictures -> result */
};

size_t hada_lane_planes_bytes(const hada_model_info *info, const hada_plan_shape *shape, int batch)
{
    return shape->refined ? 0 : hada_plane_values(info) * (size_t)batch * sizeof(float);
}

size_t hada_lane_pictures_bytes(const hada_model_info *info)
{
    const size_t pixels = (size_t)info->window_rows * (size_t)info->window_cols;
    return (hada_plane_values(info) + pixels) * sizeof(float);
}

/* In the order in which hada_lane_ready() makes them. */
static hada_status note(hada_room *room, const hada_context *context, const hada_model *model,
                        const hada_plan_shape *shape, int batch, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_focus_desc focus = hada_plan_focus_of(info, shape);
    /* where the sensor crops, refinement compares with the frame itself; some classic methods do in any case */
    const int raw_last =
        shape->classic || (shape->refined && info->boundary == HADA_BOUNDARY_PADDED) ? COMPUTE : UPLOAD;
    hada_status status = hada_hadamard_note(context, info, batch, room, UPLOAD, raw_last, COMPUTE, err);
    hada_room_steps(room, FOCUS, DOWNLOAD);
    if (!status)
        status = hada_room_note(room, hada_lane_pictures_bytes(info), "the pictures", err);
    hada_room_steps(room, shape->refined ? FOCUS : COMPUTE, FOCUS);
    if (!status)
        status = hada_focus_note(context, &focus, room, err);
    if (!status && shape->classic)
        status = hada_classic_note(context, &shape->method, room, COMPUTE, COMPUTE, DOWNLOAD, err);
    if (!status && shape->refined && !shape->classic) {
        const hada_refine_shape refine = hada_plan_refine_of(model, shape);
        status = hada_refiner_note(context, &refine, room, COMPUTE, COMPUTE, DOWNLOAD, err);
    }
    if (!status && shape->pursuit) {
        const hada_pursuit_options pursuit = hada_plan_pursuit_of(model, shape);
        status = hada_pursuit_note(context, &pursuit, room, PURSUE, err);
    }
    hada_room_steps(room, COMPUTE, DOWNLOAD);
    if (!status && !shape->refined)
        status = hada_room_note(room, hada_lane_planes_bytes(info, shape, batch), "the refocused planes", err);
    return status;
}

hada_status hada_lane_plan_memory(hada_room *room, const hada_context *context, const hada_model *model,
                                  const hada_plan_shape *shape, int batch, hada_error *err)
{
    hada_status status = note(room, context, model, shape, batch, err);
    return status ? status : hada_room_plan(room, context, err);
}

/* What the parts of a lane would hold apart. */
static uint64_t bytes_apart(const hada_context *context, const hada_model *model, const hada_plan_shape *shape,
                            int batch)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_focus_desc focus = hada_plan_focus_of(info, shape);
    const uint64_t frame = 4 * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * (uint64_t)info->channels;
    uint64_t bytes = hada_hadamard_bytes(context, info, batch) + hada_focus_bytes(context, &focus) +
                     hada_lane_planes_bytes(info, shape, batch) + hada_lane_pictures_bytes(info) +
                     (shape->dark ? frame : 0) + hada_lane_skip_bytes(context, info, shape, batch) +
                     hada_lane_enhance_bytes(context, model, shape);
    if (shape->classic)
        bytes += hada_classic_bytes(context, &shape->method);
    if (shape->refined && !shape->classic) {
        const hada_refine_shape refine = hada_plan_refine_of(model, shape);
        bytes += hada_refiner_bytes(context, &refine);
    }
    if (shape->pursuit) {
        const hada_pursuit_options pursuit = hada_plan_pursuit_of(model, shape);
        bytes += hada_pursuit_bytes(context, &pursuit);
    }
    return bytes;
}

hada_status hada_lane_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape,
                            int batch, uint64_t *bytes, uint64_t *apart, hada_error *err)
{
    hada_room room = {0};
    hada_status status = hada_lane_plan_memory(&room, context, model, shape, batch, err);
    *apart = bytes_apart(context, model, shape, batch);
    *bytes = *apart - hada_room_noted(&room) + hada_room_bytes(&room);
    hada_room_free(&room);
    return status;
}

int hada_lane_batch(const hada_context *context, const hada_model *model, const hada_plan_shape *shape, int queues)
{
    const uint64_t room = context->info.memory_bytes / 4 * 3, share = hada_share_bytes(context, model, shape);
    int batch = shape->batch;
    for (; batch > 1; batch = (batch + 1) / 2) {
        uint64_t lane, apart;
        if (!hada_lane_bytes(context, model, shape, batch, &lane, &apart, NULL) &&
            share + (uint64_t)queues * lane <= room)
            break;
    }
    return batch;
}
