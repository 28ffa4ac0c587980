/* What is trained: parameters in groups, with their gradients and optimiser states. Internal.
 *
 * Each group is an array of floats with an optimiser state of its own: the net; the discriminator; the filters
 * of each depth (a depth's filters are updated only in steps that show it, with a count of steps of their own). */
#ifndef HADA_TRAIN_PARAMETERS_H
#define HADA_TRAIN_PARAMETERS_H

#include "train/replica_shape.h"

/* What stands in a group. */
typedef enum hada_content { HADA_CONTENT_VALUES = 0, HADA_CONTENT_GRADIENT = 1, HADA_CONTENT_STATE = 2 } hada_content;

typedef struct hada_parameter_group {
    hada_buffer values, gradient, state;
    size_t trained, floats; /* on the device */
    hada_part part;         /* of the trained ones, which are updated here */
    int clear;              /* the gradient begins anew: what stands there does not count */
    uint64_t version;       /* grows with every change of the values */
    hada_optimizer_desc rule;
} hada_parameter_group;

typedef struct hada_parameters {
    hada_slot *slot;
    hada_step_images *images; /* for norms */
    hada_spectrum_layout layout;
    hada_parameter_group *group;
    int count;
} hada_parameters;

hada_status hada_parameters_create(hada_parameters *parameters, hada_step_images *images, const hada_replica_desc *desc,
                                   hada_error *err);
void hada_parameters_destroy(hada_parameters *parameters);

/* VALUES of a net are its parameters with the running statistics of batch norms behind them. STATE: of all shares. In
 * floats of the model's order; 0 where the stage has no such group. */
size_t hada_parameters_floats(const hada_parameters *parameters, int group, hada_content content);

static inline hada_floats hada_parameters_values(const hada_parameters *parameters, int group)
{
    return (hada_floats){parameters->group[group].values.mem, 0};
}

static inline hada_floats hada_parameters_gradient(const hada_parameters *parameters, int group)
{
    return (hada_floats){parameters->group[group].gradient.mem, 0};
}

/* The gradients of all groups begin anew: what comes first replaces what stands there. */
void hada_parameters_clear(hada_parameters *parameters);
/* Whether what comes next is added to a net's gradient; from then on it is. */
int hada_parameters_accumulates(hada_parameters *parameters, int group);
/* A gradient that begins anew and to which nothing came becomes zero (enqueued). */
hada_status hada_parameters_settle(hada_parameters *parameters, int group, hada_error *err);

/* The norm over the gradients of net and filters (groups that are touched), and of the discriminator by itself. */
hada_status hada_parameters_norm(hada_parameters *parameters, const unsigned char *touched, double *norm,
                                 double *discriminator_norm, hada_error *err);

/* One update of a group, or of this replica's part of it, from its gradient times `scale`; step counts from 1. */
hada_status hada_parameters_update(hada_parameters *parameters, int group, uint64_t step, double rate, double scale,
                                   hada_error *err);

/* To and from the host. */
hada_status hada_parameters_read(hada_parameters *parameters, int group, hada_content content, float *out,
                                 hada_error *err);
hada_status hada_parameters_write(hada_parameters *parameters, int group, hada_content content, const float *values,
                                  hada_error *err);
hada_status hada_parameters_open(hada_parameters *parameters, int group, hada_content content, float *room,
                                 float **values, hada_error *err);
hada_status hada_parameters_close(hada_parameters *parameters, int group, hada_content content, float *values,
                                  hada_error *err);

#endif
