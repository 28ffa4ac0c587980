/* What the kernels of training and the host agree on. */
#ifndef SHARED_TRAIN_H
#define SHARED_TRAIN_H

enum {
    HADA_TRAIN_VECTOR = 8, /* frequencies, or floats of planes, that a step takes */
    HADA_TRAIN_RUN = 1024  /* floats of planes that a work-item takes: one partial sum */
};

#endif
