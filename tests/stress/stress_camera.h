/* A camera whose model is made from point spread functions, and what it shows in double precision. */
#ifndef HADA_STRESS_CAMERA_H
#define HADA_STRESS_CAMERA_H

#include "stress.h"

typedef struct stress_camera {
    int rows, cols, depths;
    hada_image psf[4];
    hada_model *model; /* circular, Wiener filters, the window is the middle half of the frame */
} stress_camera;

stress_camera stress_camera_make(const stress_device *device, int rows, int cols, int depths, double lambda);
void stress_camera_free(stress_camera *camera);

/* A frame of a random scene at the first depth, with 1 % noise. */
void stress_camera_expose(const stress_camera *camera, hada_image *frame, uint64_t seed);

/* The window of a depth by the model's filter, in double precision; returns the largest |W|; *whole (may be NULL) takes
 * the norm of the image on the whole grid. */
double stress_camera_plane(const stress_camera *camera, const hada_image *frame, int depth, double *window,
                           double *whole);

#endif
