#include "ref/ref_optimizer.h"

#include <math.h>

void hada_ref_rmsprop_step(const hada_ref_rmsprop *rule, size_t count, const double *g, double *p, double *v)
{
    for (size_t i = 0; i < count; i++) {
        v[i] = rule->decay * v[i] + (1.0 - rule->decay) * g[i] * g[i];
        p[i] -= rule->rate * g[i] / sqrt(v[i] + rule->eps);
    }
}

void hada_ref_adam_step(const hada_ref_adam *rule, int t, size_t count, const double *g, double *p, double *m,
                        double *v)
{
    for (size_t i = 0; i < count; i++) {
        m[i] = rule->beta1 * m[i] + (1.0 - rule->beta1) * g[i];
        v[i] = rule->beta2 * v[i] + (1.0 - rule->beta2) * g[i] * g[i];
        const double mean = m[i] / (1.0 - pow(rule->beta1, t)), square = v[i] / (1.0 - pow(rule->beta2, t));
        p[i] -= rule->rate * mean / (sqrt(square) + rule->eps);
    }
}
