#include "ref/ref_optimizer.h"

#include <math.h>

void hada_ref_rmsprop_keras(const hada_ref_rmsprop *rule, size_t count, const double *g, double *p, double *v,
                            double *a, double *b)
{
    for (size_t i = 0; i < count; i++) {
        p[i] -= rule->rate * rule->weight_decay * p[i];
        v[i] = rule->decay * v[i] + (1.0 - rule->decay) * g[i] * g[i];
        double centre = v[i];
        if (rule->centered) {
            a[i] = rule->decay * a[i] + (1.0 - rule->decay) * g[i];
            centre -= a[i] * a[i];
        }
        const double increment = rule->rate * g[i] / sqrt(centre + rule->eps);
        if (rule->momentum > 0.0) {
            b[i] = rule->momentum * b[i] + increment;
            p[i] -= b[i];
        } else {
            p[i] -= increment;
        }
    }
}

void hada_ref_rmsprop_torch(const hada_ref_rmsprop *rule, size_t count, const double *g, double *p, double *v,
                            double *a, double *b)
{
    for (size_t i = 0; i < count; i++) {
        const double decayed = g[i] + rule->weight_decay * p[i];
        v[i] = rule->decay * v[i] + (1.0 - rule->decay) * decayed * decayed;
        double centre = v[i];
        if (rule->centered) {
            a[i] = rule->decay * a[i] + (1.0 - rule->decay) * decayed;
            centre -= a[i] * a[i];
        }
        const double step = decayed / (sqrt(centre) + rule->eps);
        if (rule->momentum > 0.0) {
            b[i] = rule->momentum * b[i] + step;
            p[i] -= rule->rate * b[i];
        } else {
            p[i] -= rule->rate * step;
        }
    }
}

void hada_ref_adam_step(const hada_ref_adam *rule, int t, size_t count, const double *g, double *p, double *m,
                        double *v)
{
    for (size_t i = 0; i < count; i++) {
        const double decayed = g[i] + (rule->decoupled ? 0.0 : rule->weight_decay * p[i]);
        if (rule->decoupled)
            p[i] -= rule->rate * rule->weight_decay * p[i];
        m[i] = rule->beta1 * m[i] + (1.0 - rule->beta1) * decayed;
        v[i] = rule->beta2 * v[i] + (1.0 - rule->beta2) * decayed * decayed;
        const double mean = m[i] / (1.0 - pow(rule->beta1, t)), square = v[i] / (1.0 - pow(rule->beta2, t));
        p[i] -= rule->rate * mean / (sqrt(square) + rule->eps);
    }
}
