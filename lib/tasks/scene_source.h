/* Where scenes come from: a folder of TIFF pictures, or drawn from a seed. Internal. */
#ifndef HADA_TASKS_SCENE_SOURCE_H
#define HADA_TASKS_SCENE_SOURCE_H

#include <hadalens/image.h>
#include <stdint.h>

typedef struct hada_scenes {
    const char *folder; /* the caller's; NULL: drawn */
    char **names;
    int count; /* of pictures in the folder; as many as asked for where they are drawn */
    uint64_t seed;
    int channels, rows, cols;
    double response; /* of the pictures (hadalens/response.h) */
} hada_scenes;

/* Pictures are cut to the aspect ratio and scaled to rows x cols; they are linear until `response` says otherwise. */
hada_status hada_scenes_open(hada_scenes *scenes, const char *folder, uint64_t seed, int channels, int rows, int cols,
                             hada_error *err);
void hada_scenes_close(hada_scenes *scenes);

/* The light of scene number `index`; *name (may be NULL) is a file name without ending, on the heap. */
hada_status hada_scenes_get(const hada_scenes *scenes, int index, hada_image *image, char **name, hada_error *err);

#endif
