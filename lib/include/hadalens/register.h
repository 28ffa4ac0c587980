/* Hadalens: where the scenes of a data set are on the sensor's grid. Registration (hada_register_run() of
 * hadalens/task_register.h) finds from the pairs alone how scenes have to be turned, mirrored, scaled and moved; this
 * header has what it finds, and applies it to a scene.
 *
 * Computed on the host. Thread-safe: no state. */
#ifndef HADALENS_REGISTER_H
#define HADALENS_REGISTER_H

#include <hadalens/image.h>
#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Where the pixels of a scene file are on the sensor's grid. With p and q as (row, column) from the middles of the
 * registered scene and of the file, in pixels:
 *
 *     s = magnification * R(rotation) * Q^quarter_turns * M^mirrored * q,   p = s / (1 + perspective . s) + offset
 *
 * M exchanges left and right (column to -column), Q is a quarter turn and R a turn to the left (counter-clockwise as
 * seen on a screen, rows downwards). Mirrored with two quarter turns is upside down. The perspective is that of a
 * tilted display: with 0.001 along the columns, what is 100 pixels right of the middle is a tenth
 * smaller. */
typedef struct hada_registration {
    size_t size;                   /* sizeof(hada_registration), set by the caller */
    int mirrored;                  /* 0 or 1 */
    int quarter_turns;             /* 0 to 3 */
    double magnification;          /* pixels of the sensor per pixel of the file */
    double rotation_deg;           /* the rest of the turn, -45 to 45 */
    double offset_row, offset_col; /* pixels of the sensor */
    /* How sure it is: the share of the raw frames' structure that a convolution learned from the other pairs explains,
     * with this transform and with the best one of another orientation (0 to 1, all frequencies alike). */
    double explained, explained_otherwise;
    double perspective_row, perspective_col; /* per pixel of the sensor */
} hada_registration;
/* As the file is: nothing turned, mirrored, scaled or moved. */
HADA_INIT(hada_registration, HADA_STRUCT_REGISTRATION)

/* The size of registered scenes: that of the file, magnified, with rows and columns exchanged by odd quarter turns. */
HADA_API void hada_register_size(const hada_registration *registration, int scene_rows, int scene_cols, int *rows,
                                 int *cols);

/* A scene on the sensor's grid: rows x cols about the same middle (0, 0: of hada_register_size()), zero where the file
 * has nothing. Where the transform
 * is a matter of flips and quarter turns alone, pixels are moved as they are; else they are interpolated (cubic, with
 * smoothing where the scene shrinks). */
HADA_API hada_status hada_register_apply(hada_image *out, const hada_image *scene,
                                         const hada_registration *registration, int rows, int cols, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
