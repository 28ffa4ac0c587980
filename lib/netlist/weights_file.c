#include "netlist/net_list.h"

#include "io/folder.h"

/* The tensor of a parameter, checked. */
static hada_status find(const hada_parameter *parameter, const hada_tensors *file, const char *prefix,
                        const hada_stored_tensor **out, hada_error *err)
{
    char name[512];
    if (snprintf(name, sizeof name, "%s%s", prefix, parameter->name) >= (int)sizeof name)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a prefix of more than 400 characters");
    const hada_stored_tensor *tensor = hada_tensors_find(file, name);
    if (!tensor)
        return hada_fail(err, HADA_ERROR_MODEL, "the file holds no tensor %s: it is not for this net", name);
    int same = tensor->dims == parameter->dims;
    for (int d = 0; same && d < tensor->dims; d++)
        same = tensor->shape[d] == parameter->shape[d];
    if (!same)
        return hada_fail(err, HADA_ERROR_MODEL, "the tensor %s has another shape than this net's", name);
    *out = tensor;
    return HADA_OK;
}

hada_status hada_net_read_but(hada_net *net, const hada_tensors *file, const char *prefix, const char *own,
                              hada_error *err)
{
    hada_status status = HADA_OK;
    float *values = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(values, net->floats, "the weights", err));
    for (int i = 0; i < net->parameter_count; i++) {
        const hada_parameter *parameter = &net->parameters[i];
        const hada_stored_tensor *tensor = NULL;
        float *at = values + parameter->offset;
        if (own && !strncmp(parameter->name, own, strlen(own))) {
            memcpy(at, net->values + parameter->offset, parameter->count * sizeof *at);
            continue;
        }
        HADA_TRY_OR_DONE(find(parameter, file, prefix, &tensor, err));
        HADA_TRY_OR_DONE(hada_tensor_copy_f32(tensor, 0, parameter->count, at, err));
        for (size_t k = 0; k < parameter->count; k++)
            if (!isfinite(at[k]) || (at[k] < 0.0f && strstr(parameter->name, "running_var")))
                HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NOT_FINITE,
                                           "the tensor %s%s holds values that are not finite, or negative variances",
                                           prefix, parameter->name));
    }
    memcpy(net->values, values, net->floats * sizeof *values);
done:
    free(values);
    return status;
}

hada_status hada_net_from_file(hada_net **out, const char *description, const hada_tensors *file, const char *prefix,
                               hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_error_of_file(hada_net_create_within(out, description, hada_tensors_bytes(file), 0, err), err));
    HADA_TRY_OR_DONE(hada_net_read_but(*out, file, prefix, NULL, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_net_declare(const hada_net *net, hada_tensors_writer *writer, const char *prefix, hada_error *err)
{
    char name[512];
    for (int i = 0; i < net->parameter_count; i++) {
        const hada_parameter *parameter = &net->parameters[i];
        snprintf(name, sizeof name, "%.300s%s", prefix, parameter->name);
        HADA_TRY(hada_tensors_declare(writer, name, HADA_F32, parameter->dims, parameter->shape, err));
    }
    return HADA_OK;
}

hada_status hada_net_write(const hada_net *net, hada_tensors_writer *writer, hada_error *err)
{
    for (int i = 0; i < net->parameter_count; i++) {
        const hada_parameter *parameter = &net->parameters[i];
        HADA_TRY(hada_tensors_write(writer, net->values + parameter->offset, parameter->count * sizeof(float), err));
    }
    return HADA_OK;
}

hada_status hada_net_load_weights(hada_net *net, const char *path, const char *prefix, hada_error *err)
{
    hada_tensors *file = NULL;
    HADA_NEED(net && path, err);
    HADA_TRY(hada_tensors_open(&file, path, err));
    hada_status status = hada_net_read_but(net, file, prefix ? prefix : "", NULL, err);
    hada_tensors_close(&file);
    return hada_named(status, path, err);
}

hada_status hada_net_load(hada_net **out, const char *path, hada_error *err)
{
    hada_tensors *file = NULL;
    HADA_NEED(out && path, err);
    *out = NULL;
    HADA_TRY(hada_tensors_open(&file, path, err));
    const char *description = hada_tensors_meta(file, HADA_NET_META);
    hada_status status = description
                             ? hada_net_from_file(out, description, file, "", err)
                             : hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                         "there is no description of a net in the metadata (\"" HADA_NET_META
                                         "\"); weights alone are loaded into a net with hada_net_load_weights()");
    hada_tensors_close(&file);
    return hada_named(status, path, err);
}

hada_status hada_net_save(const hada_net *net, const char *path, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tensors_writer *writer = NULL;
    char *description = NULL;
    HADA_NEED(net && path, err);
    HADA_TRY_OR_DONE(hada_net_describe(net, &description, err));
    HADA_TRY_OR_DONE(hada_tensors_create(&writer, path, err));
    HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, HADA_NET_META, description, err));
    HADA_TRY_OR_DONE(hada_net_declare(net, writer, "", err));
    HADA_TRY_OR_DONE(hada_net_write(net, writer, err));
    HADA_TRY_OR_DONE(hada_tensors_finish(&writer, err));
done:
    hada_tensors_abandon(&writer);
    free(description);
    return status;
}
