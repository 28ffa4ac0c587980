/* Test scenes that stand on surfaces: which kinds there are, and their making. Internal. */
#ifndef HADA_TASKS_TEST_SURFACE_H
#define HADA_TASKS_TEST_SURFACE_H

#include "tasks/test_scene.h"

/* The words of "slant,map.tif,...": kinds, and files of distance maps. */
typedef struct hada_surface_words {
    char **words;
    int count;
} hada_surface_words;

/* HADA_ERROR_ARGUMENT where a word is neither a kind nor a file. */
hada_status hada_surface_words_read(hada_surface_words *words, const char *list, hada_error *err);
void hada_surface_words_free(hada_surface_words *words);

/* The kind's word, "surface" for a file. */
const char *hada_surface_name(const hada_surface_words *words, int test);

/* Test scene number `test`: pictures `number` and, where two surfaces overlap, `number` + `step` of the source. The
 * first scene of each kind has its plain shape. scene->planes, one for each of the camera's depths, hold the light
 * shared out to the two depths nearest to each pixel. Ended by hada_test_scene_free(). */
hada_status hada_test_surface_make(hada_test_scene *scene, const hada_surface_words *words, int test,
                                   const hada_scenes *source, int number, int step, const hada_camera *camera,
                                   int opaque, uint64_t seed, hada_error *err);

#endif
