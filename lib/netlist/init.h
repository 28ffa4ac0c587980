/* First values of weights, on the host, with the same bits on every machine. Internal.
 *
 * The values depend on the seed and on the parameter's name ("down1.0.weight") alone: a net that gains a layer starts
 * the others as before. Fans are counted as torch.nn.init counts them, from the weight's shape as PyTorch stores it. */
#ifndef HADA_NETLIST_INIT_H
#define HADA_NETLIST_INIT_H

#include <stddef.h>
#include <stdint.h>

#include "core/error.h"

/*   zeros, constant
 *   xavier_uniform, xavier_normal    Glorot and Bengio 2010: variance gain^2 2 / (fan_in + fan_out)
 *   kaiming_uniform, kaiming_normal  He et al. 2015: variance gain^2 / fan_in; gain sqrt(2) suits ReLU
 *   torch                            uniform in +- 1 / sqrt(fan_in): PyTorch's own for weights and biases of
 *                                    convolutions and linear layers */
typedef enum hada_init {
    HADA_INIT_ZEROS = 0,
    HADA_INIT_CONSTANT = 1,
    HADA_INIT_XAVIER_UNIFORM = 2,
    HADA_INIT_XAVIER_NORMAL = 3,
    HADA_INIT_KAIMING_UNIFORM = 4,
    HADA_INIT_KAIMING_NORMAL = 5,
    HADA_INIT_TORCH = 6
} hada_init;

/* The name of an initialisation as above, and back. glorot_uniform, glorot_normal, he_uniform and he_normal are taken
 * too, for the Xavier and Kaiming ones (without Keras's cutting of normal values at two standard deviations). */
const char *hada_init_name(hada_init init);
hada_status hada_init_find(const char *name, hada_init *out, hada_error *err);

/* fan_in = shape[1] * kernel, fan_out = shape[0] * kernel, for shapes [out][in] and [out][in][rows][cols]. */
hada_status hada_init_fans(const int64_t *shape, int dims, double *fan_in, double *fan_out, hada_error *err);

typedef struct hada_init_desc {
    hada_init init;
    double value; /* CONSTANT: the value; XAVIER, KAIMING: the gain, 0: 1 and sqrt(2) */
    double fan_in, fan_out;
} hada_init_desc;

hada_status hada_init_fill(float *out, size_t count, const hada_init_desc *desc, const char *parameter, uint64_t seed,
                           hada_error *err);

#endif
