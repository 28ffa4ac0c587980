/* Groups of parameters: first values, norms, updates, ways to and from the host. */
#include <stdlib.h>

#include "core/alloc.h"
#include "filter/layout.h"
#include "train/engine_parts.h"

static hada_status make(hada_engine *engine, hada_buffer *buffer, size_t floats, hada_error *err)
{
    hada_status status =
        hada_buffer_create(buffer, engine->slot->context, floats * sizeof(float), "the parameters", err);
    return status ? status : hada_buffer_clear(buffer, engine->slot, 0, floats * sizeof(float), err);
}

static hada_status first_values(hada_engine *engine, const hada_engine_desc *desc, int group, hada_error *err)
{
    engine_group *it = &engine->groups[group];
    const size_t bytes = it->floats * sizeof(float);
    const hada_net *net = group == HADA_GROUP_NET ? engine->net : engine->critic;
    float *values;
    if (group < HADA_GROUP_FILTERS)
        return hada_buffer_write(&it->values, engine->slot, 0, net->values, bytes, err);
    hada_status status = hada_alloc((void **)&values, it->floats, sizeof *values, "a depth's filters", err);
    if (!status)
        status = hada_engine_first_filters(engine, desc, group - HADA_GROUP_FILTERS, values, err);
    if (!status)
        status = hada_buffer_write(&it->values, engine->slot, 0, values, bytes, err);
    free(values);
    return status;
}

hada_status hada_engine_groups_make(hada_engine *engine, const hada_engine_desc *desc, hada_error *err)
{
    const engine_shape *shape = &engine->shape;
    hada_status status =
        hada_alloc((void **)&engine->groups, (size_t)shape->groups, sizeof *engine->groups, "the parameters", err);
    for (int group = 0; !status && group < shape->groups; group++) {
        engine_group *it = &engine->groups[group];
        it->rule = hada_engine_rule(&engine->options, group);
        hada_engine_group_sizes(shape, desc, group, &it->floats, &it->trained);
        it->part = hada_engine_part_of(desc, group, it->trained);
        if (!it->trained)
            continue;
        status = make(engine, &it->values, it->floats, err);
        if (!status)
            status = make(engine, &it->gradient, it->trained, err);
        if (!status && it->part.count)
            status = make(engine, &it->state, hada_optimizer_state_floats(&it->rule, it->part.count), err);
        if (!status)
            status = first_values(engine, desc, group, err);
    }
    return status;
}

void hada_engine_groups_free(hada_engine *engine)
{
    for (int group = 0; engine->groups && group < engine->shape.groups; group++) {
        hada_buffer_destroy(&engine->groups[group].values);
        hada_buffer_destroy(&engine->groups[group].gradient);
        hada_buffer_destroy(&engine->groups[group].state);
    }
    free(engine->groups);
}

int hada_engine_groups(const hada_engine *engine)
{
    return engine->shape.groups;
}

static int has_group(const hada_engine *engine, int group)
{
    return group >= 0 && group < engine->shape.groups && engine->groups[group].trained;
}

static hada_status no_group(int group, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_ARGUMENT, "training: there is no group %d of parameters", group);
}

static hada_buffer *content_of(const hada_engine *engine, int group, hada_content content)
{
    engine_group *it = &engine->groups[group];
    return content == HADA_CONTENT_VALUES ? &it->values : content == HADA_CONTENT_GRADIENT ? &it->gradient : &it->state;
}

/* Complex numbers of a channel's filter in model order. */
static size_t row_major(const hada_engine *engine)
{
    const hada_spectrum_layout *layout = &engine->shape.layout;
    return (size_t)layout->rows * (size_t)(layout->cols / 2 + 1);
}

size_t hada_engine_count(const hada_engine *engine, int group, hada_content content)
{
    if (!has_group(engine, group))
        return 0;
    const engine_group *it = &engine->groups[group];
    const size_t floats = content == HADA_CONTENT_VALUES     ? it->floats
                          : content == HADA_CONTENT_GRADIENT ? it->trained
                                                             : hada_optimizer_state_floats(&it->rule, it->trained);
    return group < HADA_GROUP_FILTERS ? floats : floats / engine->shape.layout.count * row_major(engine);
}

hada_part hada_engine_part(const hada_engine *engine, int group)
{
    return has_group(engine, group) ? engine->groups[group].part : (hada_part){0, 0};
}

hada_status hada_engine_clear(hada_engine *engine, hada_error *err)
{
    (void)err;
    for (int group = 0; group < engine->shape.groups; group++)
        engine->groups[group].clear = engine->groups[group].trained > 0;
    return HADA_OK;
}

int hada_engine_accumulates(hada_engine *engine, int group)
{
    const int adds = !engine->groups[group].clear;
    engine->groups[group].clear = 0;
    return adds;
}

hada_status hada_engine_settle(hada_engine *engine, int group, hada_error *err)
{
    engine_group *it = &engine->groups[group];
    if (!it->clear)
        return HADA_OK;
    const hada_status status = hada_buffer_clear(&it->gradient, engine->slot, 0, it->gradient.bytes, err);
    it->clear = status != HADA_OK;
    return status;
}

/* The norm over `count` parts into ENGINE_TERMS; without any it is 0. */
static hada_status norm_of(hada_engine *engine, const hada_gradient_part *parts, int count, size_t at, hada_error *err)
{
    const hada_floats norm = {engine->buffers[ENGINE_TERMS].mem, ENGINE_NORM + at};
    if (count)
        return hada_clip_gradients(engine->slot, parts, count, 0.0f, norm, engine->buffers[ENGINE_SUMS].mem, err);
    return hada_buffer_clear(&engine->buffers[ENGINE_TERMS], engine->slot, norm.offset * sizeof(float),
                             2 * sizeof(float), err);
}

hada_status hada_engine_norm(hada_engine *engine, const unsigned char *touched, double *norm, double *critic_norm,
                             hada_error *err)
{
    float values[4] = {0.0f};
    hada_gradient_part *parts;
    int count = 0, critic = 0;
    hada_slot_stage(engine->slot, "update");
    hada_status status =
        hada_alloc((void **)&parts, (size_t)engine->shape.groups + 1, sizeof *parts, "the norm of gradients", err);
    for (int group = 0; !status && group < engine->shape.groups; group++) {
        const engine_group *it = &engine->groups[group];
        if (group == HADA_GROUP_CRITIC || !it->trained ||
            (group >= HADA_GROUP_FILTERS && touched && !touched[group - HADA_GROUP_FILTERS]))
            continue;
        status = hada_engine_settle(engine, group, err);
        parts[count++] = (hada_gradient_part){{it->gradient.mem, 0}, it->trained};
    }
    if (!status)
        status = norm_of(engine, parts, count, 0, err);
    if (!status && engine->groups[HADA_GROUP_CRITIC].trained) {
        status = hada_engine_settle(engine, HADA_GROUP_CRITIC, err);
        const engine_group *it = &engine->groups[HADA_GROUP_CRITIC];
        parts[critic++] = (hada_gradient_part){{it->gradient.mem, 0}, it->trained};
    }
    if (!status)
        status = norm_of(engine, parts, critic, 2, err);
    if (!status)
        status = hada_buffer_read(&engine->buffers[ENGINE_TERMS], engine->slot, ENGINE_NORM * sizeof(float), values,
                                  sizeof values, err);
    *norm = values[0];
    *critic_norm = values[2];
    free(parts);
    return status;
}

static void changed(hada_engine *engine, int group)
{
    if (group == HADA_GROUP_NET)
        engine->new_train = engine->new_look = 1;
    else if (group == HADA_GROUP_CRITIC)
        engine->new_judge = 1;
}

hada_status hada_engine_update(hada_engine *engine, int group, uint64_t step, double rate, double scale,
                               hada_error *err)
{
    if (!has_group(engine, group))
        return no_group(group, err);
    const engine_group *it = &engine->groups[group];
    hada_optimizer_desc rule = it->rule;
    rule.scale = scale;
    hada_slot_stage(engine->slot, "update");
    changed(engine, group);
    hada_status status = hada_engine_settle(engine, group, err);
    if (status || !it->part.count)
        return status;
    return hada_optimizer_step(engine->slot, &rule, step, rate, (hada_floats){it->gradient.mem, it->part.first},
                               (hada_floats){it->values.mem, it->part.first}, (hada_floats){it->state.mem, 0},
                               it->part.count, err);
}

/* Floats of a buffer of filters to and from the model's order, channel by channel. */
static size_t images_of(const hada_engine *engine, const hada_buffer *buffer)
{
    return buffer->bytes / (2 * sizeof(float) * engine->shape.layout.count);
}

static hada_status write_filters(hada_engine *engine, hada_buffer *buffer, const float *values, hada_error *err)
{
    const hada_spectrum_layout *layout = &engine->shape.layout;
    float *device;
    hada_status status = hada_alloc_raw((void **)&device, 1, buffer->bytes, "a depth's filters", err);
    if (status)
        return status;
    for (size_t i = 0; i < images_of(engine, buffer); i++)
        hada_layout_pack(layout, values + 2 * i * row_major(engine), device + 2 * i * layout->count);
    status = hada_buffer_write(buffer, engine->slot, 0, device, buffer->bytes, err);
    free(device);
    return status;
}

static hada_status read_filters(hada_engine *engine, const hada_buffer *buffer, float *out, hada_error *err)
{
    const hada_spectrum_layout *layout = &engine->shape.layout;
    float *device;
    hada_status status = hada_alloc_raw((void **)&device, 1, buffer->bytes, "a depth's filters", err);
    if (status)
        return status;
    status = hada_buffer_read(buffer, engine->slot, 0, device, buffer->bytes, err);
    for (size_t i = 0; !status && i < images_of(engine, buffer); i++)
        hada_layout_unpack(layout, device + 2 * i * layout->count, out + 2 * i * row_major(engine));
    free(device);
    return status;
}

/* The arrays of a net's state, of which the engine has a part each. */
static size_t state_arrays(const engine_group *it)
{
    return hada_optimizer_state_floats(&it->rule, 1);
}

static hada_status read_state(hada_engine *engine, const engine_group *it, float *out, hada_error *err)
{
    const size_t bytes = it->part.count * sizeof *out;
    hada_status status = HADA_OK;
    for (size_t i = 0; !status && bytes && i < state_arrays(it); i++)
        status =
            hada_buffer_read(&it->state, engine->slot, i * bytes, out + i * it->trained + it->part.first, bytes, err);
    return status;
}

static hada_status write_state(hada_engine *engine, engine_group *it, const float *values, hada_error *err)
{
    const size_t bytes = it->part.count * sizeof *values;
    hada_status status = HADA_OK;
    for (size_t i = 0; !status && bytes && i < state_arrays(it); i++)
        status = hada_buffer_write(&it->state, engine->slot, i * bytes, values + i * it->trained + it->part.first,
                                   bytes, err);
    return status;
}

hada_status hada_engine_read(hada_engine *engine, int group, hada_content content, float *out, hada_error *err)
{
    if (!has_group(engine, group))
        return no_group(group, err);
    const hada_buffer *buffer = content_of(engine, group, content);
    hada_status status = content == HADA_CONTENT_GRADIENT ? hada_engine_settle(engine, group, err) : HADA_OK;
    if (status)
        return status;
    if (group >= HADA_GROUP_FILTERS)
        return read_filters(engine, buffer, out, err);
    return content == HADA_CONTENT_STATE ? read_state(engine, &engine->groups[group], out, err)
                                         : hada_buffer_read(buffer, engine->slot, 0, out, buffer->bytes, err);
}

hada_status hada_engine_write(hada_engine *engine, int group, hada_content content, const float *values,
                              hada_error *err)
{
    if (!has_group(engine, group))
        return no_group(group, err);
    hada_buffer *buffer = content_of(engine, group, content);
    if (content == HADA_CONTENT_VALUES)
        changed(engine, group);
    if (content == HADA_CONTENT_GRADIENT)
        engine->groups[group].clear = 0;
    if (group >= HADA_GROUP_FILTERS)
        return write_filters(engine, buffer, values, err);
    return content == HADA_CONTENT_STATE ? write_state(engine, &engine->groups[group], values, err)
                                         : hada_buffer_write(buffer, engine->slot, 0, values, buffer->bytes, err);
}

hada_status hada_engine_open(hada_engine *engine, int group, hada_content content, float *room, float **values,
                             hada_error *err)
{
    void *mapped = room;
    *values = NULL;
    if (!has_group(engine, group))
        return no_group(group, err);
    hada_status status = content == HADA_CONTENT_GRADIENT ? hada_engine_settle(engine, group, err) : HADA_OK;
    if (!status && group >= HADA_GROUP_FILTERS)
        status = read_filters(engine, content_of(engine, group, content), room, err);
    else if (!status)
        status = hada_buffer_map(content_of(engine, group, content), engine->slot, &mapped, err);
    if (!status)
        *values = mapped;
    return status;
}

hada_status hada_engine_close(hada_engine *engine, int group, hada_content content, float *values, hada_error *err)
{
    if (group >= HADA_GROUP_FILTERS)
        return hada_engine_write(engine, group, content, values, err);
    if (content == HADA_CONTENT_VALUES)
        changed(engine, group);
    return hada_buffer_unmap(content_of(engine, group, content), engine->slot, values, err);
}
