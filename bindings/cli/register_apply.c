#include "register_apply.h"
#include "folder.h"

#include <errno.h>
#include <hadalens/tiff.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static hada_status copy(const char *from, const char *to, hada_error *err)
{
    FILE *file = fopen(from, "rb");
    char *bytes = NULL;
    long size = -1;
    if (file && !fseek(file, 0, SEEK_END) && (size = ftell(file)) >= 0 && !fseek(file, 0, SEEK_SET))
        bytes = malloc((size_t)size + 1);
    const int read = bytes && fread(bytes, 1, (size_t)size, file) == (size_t)size;
    if (file)
        fclose(file);
    hada_status status =
        read ? hada_cli_write_text(to, bytes, (size_t)size, err)
             : hada_cli_error(err, HADA_ERROR_FILE_READ, "%s cannot be read: %s", from, strerror(errno));
    free(bytes);
    return status;
}

static hada_status write_scene(const char *from, const char *to, const hada_registration *registration, int rows,
                               int cols, hada_error *err)
{
    hada_image scene = {0}, out = {0};
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    options.bits = 32;
    hada_status status = hada_tiff_load(from, 0, &scene, err);
    if (!status)
        status = hada_register_apply(&out, &scene, registration, rows, cols, err);
    if (!status)
        status = hada_tiff_save(to, &out, &options, err);
    hada_image_destroy(&scene);
    hada_image_destroy(&out);
    return status;
}

/* The place of a file in another folder, under the same name. */
static char *beside(const char *folder, const char *path)
{
    const char *slash = strrchr(path, '/');
    return hada_cli_text("%s/%s", folder, slash ? slash + 1 : path);
}

static hada_status write_pair(const hada_cli_pair *pair, const hada_registration *registration, int rows, int cols,
                              const char *raws, const char *scenes, hada_error *err)
{
    char *raw = beside(raws, pair->raw), *scene = beside(scenes, pair->scene);
    hada_status status = raw && scene ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status && link(pair->raw, raw))
        status = copy(pair->raw, raw, err);
    if (!status)
        status = write_scene(pair->scene, scene, registration, rows, cols, err);
    free(raw);
    free(scene);
    return status;
}

static hada_status write_depth(hada_cli *cli, const hada_cli_depth *depth, const hada_registration *registration,
                               int rows, int cols, const char *folder, hada_error *err)
{
    char *raws = hada_cli_text("%s/z%gmm/raw", folder, depth->distance_mm);
    char *scenes = hada_cli_text("%s/z%gmm/scene", folder, depth->distance_mm);
    hada_status status = raws && scenes ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = hada_cli_make_folder(raws, err);
    if (!status)
        status = hada_cli_make_folder(scenes, err);
    for (int i = 0; !status && i < depth->pairs; i++) {
        status = write_pair(&depth->pair[i], registration, rows, cols, raws, scenes, err);
        hada_cli_progress_step(cli, NULL);
        if (!status)
            status = hada_cli_check_signals(err);
    }
    free(raws);
    free(scenes);
    return status;
}

hada_status hada_cli_register_write(hada_cli *cli, const hada_cli_dataset *set, const hada_registration *registrations,
                                    int rows, int cols, const char *folder, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int z = 0; !status && z < set->depths; z++)
        status = write_depth(cli, &set->depth[z], &registrations[z], rows, cols, folder, err);
    return status;
}
