/* What registration found, for what writes it. Internal. */
#ifndef HADA_TASKS_REGISTERED_H
#define HADA_TASKS_REGISTERED_H

#include <hadalens/task_register.h>

typedef struct hada_registered {
    hada_registered_depth depth; /* points into what follows */
    hada_registration found, applied;
} hada_registered;

struct hada_register_report {
    hada_registered *depth;
};

#endif
