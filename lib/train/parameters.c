/* Groups of parameters, and where the training of filters begins: the model's, or random ones. */
#include "train/parameters.h"

#include "core/random.h"
#include "filter/bank.h"

/* Of the real and imaginary parts of a random start. */
#define START_DEVIATION 0.05

/* A filter of normal numbers, row-major. The columns that stand for themselves hold both signs of a frequency: there
 * the filter of a real kernel is conj-symmetric (complex), and both its parts are even (split). */
static void random_filter(const hada_spectrum_layout *layout, int split, hada_random *random, float *filter)
{
    const int cols = layout->cols / 2 + 1;
    for (size_t i = 0; i < 2 * (size_t)layout->rows * (size_t)cols; i++)
        filter[i] = (float)(START_DEVIATION * hada_random_normal(random));
    for (int kx = 0; kx < cols; kx++) {
        if (kx && 2 * kx != layout->cols)
            continue;
        for (int ky = 0; ky < layout->rows; ky++) {
            const int other = ky ? layout->rows - ky : 0;
            const size_t to = 2 * ((size_t)ky * (size_t)cols + (size_t)kx);
            const size_t from = 2 * ((size_t)other * (size_t)cols + (size_t)kx);
            if (other > ky)
                continue;
            filter[to] = filter[from];
            filter[to + 1] = split ? filter[from + 1] : other == ky ? 0.0f : -filter[from + 1];
        }
    }
}

static void take_filter(const hada_model *model, size_t first, size_t count, float *filter)
{
    for (size_t i = 0; i < count; i++)
        filter[i] = model->filter ? model->filter[first + i] : hada_float_from_half(model->filter_half[first + i]);
}

/* Values of a depth's filters, all channels, in the order of the device. */
static hada_status first_filters(const hada_replica_shape *shape, const hada_replica_desc *desc, int depth,
                                 float *values, hada_error *err)
{
    const hada_spectrum_layout *layout = &shape->layout;
    const size_t channels = (size_t)shape->channels, plane = hada_model_plane(desc->model);
    float *filter = NULL;
    hada_random random;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(filter, 2 * plane, "a filter", err));
    hada_random_seed(&random, desc->options->seed, (uint64_t)depth);
    for (size_t c = 0; c < channels; c++) {
        const size_t first = ((size_t)depth * channels + c) * 2 * plane;
        if (desc->options->random_start)
            random_filter(layout, shape->form == HADA_FORM_SPLIT, &random, filter);
        else
            take_filter(desc->model, first, 2 * plane, filter);
        hada_layout_pack(layout, filter, values + 2 * c * layout->count);
    }
done:
    free(filter);
    return status;
}

static hada_status make_buffer(hada_slot *slot, hada_buffer *buffer, size_t floats, hada_error *err)
{
    HADA_TRY(hada_buffer_create(buffer, slot->context, floats * sizeof(float), "the parameters", err));
    return hada_buffer_clear(buffer, slot, 0, floats * sizeof(float), err);
}

static hada_status write_first(hada_parameters *parameters, const hada_replica_shape *shape,
                               const hada_replica_desc *desc, int group, hada_error *err)
{
    hada_parameter_group *it = &parameters->group[group];
    const size_t bytes = it->floats * sizeof(float);
    const hada_net *net = group == HADA_GROUP_NET ? desc->net : desc->discriminator;
    float *values = NULL;
    hada_status status = HADA_OK;
    if (parameters->slot->context->dry)
        return HADA_OK;
    if (group < HADA_GROUP_FILTERS)
        return hada_buffer_write(&it->values, parameters->slot, 0, net->values, bytes, err);
    HADA_TRY_OR_DONE(HADA_NEW(values, it->floats, "a depth's filters", err));
    HADA_TRY_OR_DONE(first_filters(shape, desc, group - HADA_GROUP_FILTERS, values, err));
    HADA_TRY_OR_DONE(hada_buffer_write(&it->values, parameters->slot, 0, values, bytes, err));
done:
    free(values);
    return status;
}

static hada_status make_group(hada_parameters *parameters, const hada_replica_shape *shape,
                              const hada_replica_desc *desc, int group, hada_error *err)
{
    hada_parameter_group *it = &parameters->group[group];
    it->version = 1;
    it->rule = hada_group_rule(desc->options, group);
    hada_group_sizes(shape, desc, group, &it->floats, &it->trained);
    it->part = hada_group_part(desc, group, it->trained);
    if (!it->trained)
        return HADA_OK;
    HADA_TRY(make_buffer(parameters->slot, &it->values, it->floats, err));
    HADA_TRY(make_buffer(parameters->slot, &it->gradient, it->trained, err));
    if (it->part.count)
        HADA_TRY(
            make_buffer(parameters->slot, &it->state, hada_optimizer_state_floats(&it->rule, it->part.count), err));
    return write_first(parameters, shape, desc, group, err);
}

hada_status hada_parameters_create(hada_parameters *parameters, hada_step_images *images, const hada_replica_desc *desc,
                                   hada_error *err)
{
    const hada_replica_shape *shape = images->shape;
    *parameters =
        (hada_parameters){.slot = images->slot, .images = images, .layout = shape->layout, .count = shape->groups};
    HADA_TRY(HADA_NEW(parameters->group, (size_t)shape->groups, "the parameters", err));
    for (int group = 0; group < shape->groups; group++)
        HADA_TRY(make_group(parameters, shape, desc, group, err));
    return HADA_OK;
}

void hada_parameters_destroy(hada_parameters *parameters)
{
    for (int group = 0; parameters->group && group < parameters->count; group++) {
        HADA_DESTROY_BUFFERS(&parameters->group[group].values, &parameters->group[group].gradient,
                             &parameters->group[group].state);
    }
    free(parameters->group);
}

static hada_buffer *content_of(const hada_parameters *parameters, int group, hada_content content)
{
    hada_parameter_group *it = &parameters->group[group];
    return content == HADA_CONTENT_VALUES ? &it->values : content == HADA_CONTENT_GRADIENT ? &it->gradient : &it->state;
}

/* Complex numbers of a channel's filter in model order. */
static size_t row_major(const hada_parameters *parameters)
{
    const hada_spectrum_layout *layout = &parameters->layout;
    return (size_t)layout->rows * (size_t)(layout->cols / 2 + 1);
}

size_t hada_parameters_floats(const hada_parameters *parameters, int group, hada_content content)
{
    const hada_parameter_group *it = &parameters->group[group];
    const size_t floats = content == HADA_CONTENT_VALUES     ? it->floats
                          : content == HADA_CONTENT_GRADIENT ? it->trained
                                                             : hada_optimizer_state_floats(&it->rule, it->trained);
    return group < HADA_GROUP_FILTERS ? floats : floats / parameters->layout.count * row_major(parameters);
}

void hada_parameters_clear(hada_parameters *parameters)
{
    for (int group = 0; group < parameters->count; group++)
        parameters->group[group].clear = parameters->group[group].trained > 0;
}

int hada_parameters_accumulates(hada_parameters *parameters, int group)
{
    const int adds = !parameters->group[group].clear;
    parameters->group[group].clear = 0;
    return adds;
}

hada_status hada_parameters_settle(hada_parameters *parameters, int group, hada_error *err)
{
    hada_parameter_group *it = &parameters->group[group];
    if (!it->clear)
        return HADA_OK;
    const hada_status status = hada_buffer_clear(&it->gradient, parameters->slot, 0, it->gradient.bytes, err);
    it->clear = status != HADA_OK;
    return status;
}

/* The sum of squares over `count` parts to place number `at` of the two; 0 without any part. */
static hada_status squares_of(hada_parameters *parameters, const hada_gradient_part *parts, int count, size_t at,
                              hada_error *err)
{
    hada_step_images *images = parameters->images;
    const hada_floats out = {hada_step_mem(images, HADA_STEP_TERMS), HADA_TERM_SQUARES + at};
    if (count)
        return hada_gradient_squares(parameters->slot, parts, count, out, hada_step_mem(images, HADA_STEP_SCRATCH),
                                     err);
    return hada_buffer_clear(&images->place[HADA_STEP_TERMS], parameters->slot, out.offset * sizeof(float),
                             sizeof(float), err);
}

static hada_status list_gradient(hada_parameters *parameters, int group, hada_gradient_part *part, hada_error *err)
{
    const hada_parameter_group *it = &parameters->group[group];
    *part = (hada_gradient_part){{it->gradient.mem, 0}, it->trained};
    return hada_parameters_settle(parameters, group, err);
}

hada_status hada_parameters_norm(hada_parameters *parameters, const unsigned char *touched, double *norm,
                                 double *discriminator_norm, hada_error *err)
{
    float squares[2] = {0.0f};
    hada_gradient_part *parts = NULL;
    int count = 0, discriminator = 0;
    hada_status status = HADA_OK;
    hada_slot_stage(parameters->slot, "update");
    HADA_TRY_OR_DONE(HADA_NEW(parts, (size_t)parameters->count + 1, "the norm of gradients", err));
    for (int group = 0; group < parameters->count; group++) {
        if (group == HADA_GROUP_DISCRIMINATOR || !parameters->group[group].trained ||
            (group >= HADA_GROUP_FILTERS && touched && !touched[group - HADA_GROUP_FILTERS]))
            continue;
        HADA_TRY_OR_DONE(list_gradient(parameters, group, &parts[count++], err));
    }
    HADA_TRY_OR_DONE(squares_of(parameters, parts, count, 0, err));
    if (parameters->group[HADA_GROUP_DISCRIMINATOR].trained)
        HADA_TRY_OR_DONE(list_gradient(parameters, HADA_GROUP_DISCRIMINATOR, &parts[discriminator++], err));
    HADA_TRY_OR_DONE(squares_of(parameters, parts, discriminator, 1, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&parameters->images->place[HADA_STEP_TERMS], parameters->slot,
                                      HADA_TERM_SQUARES * sizeof(float), squares, sizeof squares, err));
    *norm = sqrtf(squares[0]);
    *discriminator_norm = sqrtf(squares[1]);
done:
    free(parts);
    return status;
}

hada_status hada_parameters_update(hada_parameters *parameters, int group, uint64_t step, double rate, double scale,
                                   hada_error *err)
{
    hada_parameter_group *it = &parameters->group[group];
    hada_optimizer_desc rule = it->rule;
    rule.scale = scale;
    hada_slot_stage(parameters->slot, "update");
    it->version++;
    HADA_TRY(hada_parameters_settle(parameters, group, err));
    if (it->part.count)
        HADA_TRY(hada_optimizer_step(
            parameters->slot, &rule, step, rate, (hada_floats){it->gradient.mem, it->part.first},
            (hada_floats){it->values.mem, it->part.first}, (hada_floats){it->state.mem, 0}, it->part.count, err));
    return HADA_OK;
}

/* Filters from the model's order, channel by channel, or, where `values` is NULL, to it. */
static hada_status move_filters(hada_parameters *parameters, hada_buffer *buffer, const float *values, float *out,
                                hada_error *err)
{
    const hada_spectrum_layout *layout = &parameters->layout;
    const size_t images = buffer->bytes / (2 * sizeof(float) * layout->count), each = 2 * row_major(parameters);
    float *device = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(device = hada_alloc_raw(1, buffer->bytes, "a depth's filters", err)));
    if (!values)
        HADA_TRY_OR_DONE(hada_buffer_read(buffer, parameters->slot, 0, device, buffer->bytes, err));
    for (size_t i = 0; i < images; i++)
        if (values)
            hada_layout_pack(layout, values + i * each, device + 2 * i * layout->count);
        else
            hada_layout_unpack(layout, device + 2 * i * layout->count, out + i * each);
    if (values)
        HADA_TRY_OR_DONE(hada_buffer_write(buffer, parameters->slot, 0, device, buffer->bytes, err));
done:
    free(device);
    return status;
}

/* The arrays of a net's state, of which this replica has a part each. */
static size_t state_arrays(const hada_parameter_group *it)
{
    return hada_optimizer_state_floats(&it->rule, 1);
}

static hada_status read_state(hada_parameters *parameters, const hada_parameter_group *it, float *out, hada_error *err)
{
    const size_t bytes = it->part.count * sizeof *out;
    for (size_t i = 0; bytes && i < state_arrays(it); i++)
        HADA_TRY(hada_buffer_read(&it->state, parameters->slot, i * bytes, out + i * it->trained + it->part.first,
                                  bytes, err));
    return HADA_OK;
}

static hada_status write_state(hada_parameters *parameters, hada_parameter_group *it, const float *values,
                               hada_error *err)
{
    const size_t bytes = it->part.count * sizeof *values;
    for (size_t i = 0; bytes && i < state_arrays(it); i++)
        HADA_TRY(hada_buffer_write(&it->state, parameters->slot, i * bytes, values + i * it->trained + it->part.first,
                                   bytes, err));
    return HADA_OK;
}

hada_status hada_parameters_read(hada_parameters *parameters, int group, hada_content content, float *out,
                                 hada_error *err)
{
    hada_buffer *buffer = content_of(parameters, group, content);
    if (content == HADA_CONTENT_GRADIENT)
        HADA_TRY(hada_parameters_settle(parameters, group, err));
    return group >= HADA_GROUP_FILTERS     ? move_filters(parameters, buffer, NULL, out, err)
           : content == HADA_CONTENT_STATE ? read_state(parameters, &parameters->group[group], out, err)
                                           : hada_buffer_read(buffer, parameters->slot, 0, out, buffer->bytes, err);
}

hada_status hada_parameters_write(hada_parameters *parameters, int group, hada_content content, const float *values,
                                  hada_error *err)
{
    hada_parameter_group *it = &parameters->group[group];
    hada_buffer *buffer = content_of(parameters, group, content);
    it->version += content == HADA_CONTENT_VALUES;
    if (content == HADA_CONTENT_GRADIENT)
        it->clear = 0;
    if (group >= HADA_GROUP_FILTERS)
        return move_filters(parameters, buffer, values, NULL, err);
    return content == HADA_CONTENT_STATE ? write_state(parameters, it, values, err)
                                         : hada_buffer_write(buffer, parameters->slot, 0, values, buffer->bytes, err);
}

hada_status hada_parameters_open(hada_parameters *parameters, int group, hada_content content, float *room,
                                 float **values, hada_error *err)
{
    void *mapped = room;
    *values = NULL;
    hada_buffer *buffer = content_of(parameters, group, content);
    if (content == HADA_CONTENT_GRADIENT)
        HADA_TRY(hada_parameters_settle(parameters, group, err));
    HADA_TRY(group >= HADA_GROUP_FILTERS ? move_filters(parameters, buffer, NULL, room, err)
                                         : hada_buffer_map(buffer, parameters->slot, &mapped, err));
    *values = mapped;
    return HADA_OK;
}

hada_status hada_parameters_close(hada_parameters *parameters, int group, hada_content content, float *values,
                                  hada_error *err)
{
    if (group >= HADA_GROUP_FILTERS)
        return hada_parameters_write(parameters, group, content, values, err);
    parameters->group[group].version += content == HADA_CONTENT_VALUES;
    return hada_buffer_unmap(content_of(parameters, group, content), parameters->slot, values, err);
}
