/* Where scenes come from: a folder of TIFF pictures, or drawn from a seed. */
#ifndef HADA_CLI_SCENE_SOURCE_H
#define HADA_CLI_SCENE_SOURCE_H

#include "cli.h"

#include <hadalens/image.h>
#include <stdint.h>

typedef struct hada_cli_scenes {
    char *folder; /* NULL: procedural */
    char **names;
    int count; /* of pictures in the folder; as many as asked for when procedural */
    uint64_t seed;
    int channels, rows, cols;
} hada_cli_scenes;

/* `folder` "procedural" draws them. Scenes are cut to the aspect ratio and scaled to rows x cols. */
hada_status hada_cli_scenes_open(hada_cli_scenes *scenes, const char *folder, uint64_t seed, int channels, int rows,
                                 int cols, hada_error *err);
void hada_cli_scenes_close(hada_cli_scenes *scenes);

/* Scene number `index`; *name (may be NULL) is a file name without extension, on the heap. */
hada_status hada_cli_scenes_get(const hada_cli_scenes *scenes, int index, hada_image *image, char **name,
                                hada_error *err);

#endif
