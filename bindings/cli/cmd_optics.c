#include "camera_options.h"
#include "command.h"
#include "folder.h"
#include "optics_files.h"

#include <errno.h>
#include <hadalens/preview.h>
#include <hadalens/tiff.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct settings {
    hada_cli_camera_settings camera;
    const char *output, *psf;
    int coherent;
    double threshold;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to write"),
    {HADA_OPTION_TEXT, "output", 'o', "FOLDER", "the folder to make", "It must not exist yet, or be empty.",
     AT(output)},
    {HADA_OPTION_REAL, "threshold", 0, "MTF", "frequencies count as passed from here on (default: 0.05)", NULL,
     AT(threshold)},
    {HADA_OPTION_TEXT, "psf", 0, "FILE", "PSFs from a TIFF file, a page per depth, instead of by design",
     "Measured ones, for instance: of the sensor's size, near to far as the camera's distances.", AT(psf)},
    {HADA_OPTION_FLAG, "coherent", 0, NULL, "wave optics of all lenses together",
     "Light of different lenses interferes. Takes more memory and time; masks without lenses always work so.",
     AT(coherent)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    hada_cli_camera_defaults(&set->camera);
}

/* Where PSFs come from. */
typedef struct source {
    hada_tiff_reader *reader;
    hada_wave *wave;
} source;

static hada_status source_open(source *from, const settings *set, const hada_camera *camera, hada_context *context,
                               hada_error *err)
{
    if (!set->psf) {
        hada_wave_options waves;
        hada_wave_options_init(&waves);
        waves.coherent = set->coherent;
        return camera->optics == HADA_OPTICS_WAVE ? hada_wave_create(&from->wave, context, camera, &waves, err)
                                                  : HADA_OK;
    }
    hada_status status = hada_tiff_open(&from->reader, set->psf, err);
    if (status)
        return status;
    const hada_tiff_info *info = hada_tiff_get_info(from->reader);
    if (info->frames != camera->depths || info->rows != camera->rows || info->cols != camera->cols)
        return hada_cli_error(err, HADA_ERROR_SIZE,
                              "%s holds %d pages of %dx%d; the camera has %d depths and %dx%d pixels: set --depths and "
                              "--size, or give its camera.json",
                              set->psf, info->frames, info->rows, info->cols, camera->depths, camera->rows,
                              camera->cols);
    return HADA_OK;
}

static hada_status source_get(source *from, const hada_camera *camera, int z, hada_image *psf, hada_error *err)
{
    const double distance = camera->distances_mm[z];
    if (from->reader)
        return hada_tiff_read(from->reader, z, psf, err);
    return from->wave ? hada_wave_psf(from->wave, distance, camera->rows, camera->cols, psf, err)
                      : hada_camera_psf(camera, distance, psf, err);
}

static void source_close(source *from)
{
    if (from->reader)
        hada_tiff_close(&from->reader);
    hada_wave_destroy(&from->wave);
}

static hada_status write_psf(hada_tiff_writer **writer, const hada_camera *camera, const hada_image *psf,
                             const char *folder, hada_error *err)
{
    if (*writer)
        return hada_tiff_write(*writer, psf, err);
    hada_tiff_write_options how;
    hada_tiff_write_options_init(&how);
    how.layout = HADA_TIFF_HYPERSTACK;
    how.slices = camera->depths;
    how.times = 1;
    how.distances_mm = camera->distances_mm;
    char *path = hada_cli_text("%s/psf.tif", folder);
    hada_status status = path ? hada_tiff_create(writer, path, psf->channels, psf->rows, psf->cols, &how, err)
                              : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    free(path);
    return status ? status : hada_tiff_write(*writer, psf, err);
}

static hada_status write_picture(const hada_image *psf, double distance, const char *folder, hada_error *err)
{
    char *path = hada_cli_text("%s/psf_z%gmm.png", folder, distance);
    hada_status status =
        path ? hada_png_save(path, psf, HADA_AUTO, 0.4, err) : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    free(path);
    return status;
}

static hada_status write_all(hada_cli *cli, const settings *set, const hada_camera *camera, hada_optics_report *report,
                             const char *folder, hada_error *err)
{
    hada_context *context = NULL;
    hada_tiff_writer *writer = NULL;
    hada_cli_progress progress;
    source from = {0};
    char *path = hada_cli_text("%s/camera.json", folder);
    hada_status status =
        path ? hada_camera_save(camera, path, err) : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    free(path);
    if (!status)
        status = hada_cli_optics_mask(camera, folder, err);
    const int holes = camera->mask == HADA_MASK_APERTURE && !(camera->cell_mm > 0.0);
    if (!status && (camera->mask == HADA_MASK_MLA || camera->mask == HADA_MASK_GRID || holes))
        status = hada_cli_optics_lenses(camera, folder, err);
    if (!status)
        status = hada_cli_open(cli, &context, err);
    if (!status)
        status = source_open(&from, set, camera, context, err);
    if (!status)
        status =
            hada_optics_report_begin(report, context, camera, set->threshold > 0 ? set->threshold : HADA_AUTO, err);
    hada_cli_progress_begin(cli, &progress, "depths", camera->depths);
    for (int z = 0; z < camera->depths && !status; z++) {
        hada_image psf = {0};
        status = source_get(&from, camera, z, &psf, err);
        if (!status)
            status = write_psf(&writer, camera, &psf, folder, err);
        if (!status && hada_pictures_available())
            status = write_picture(&psf, camera->distances_mm[z], folder, err);
        if (!status)
            status = hada_optics_report_add(report, &psf, err);
        hada_image_destroy(&psf);
        hada_cli_progress_step(cli, NULL);
        if (!status)
            status = hada_cli_check_signals(err);
    }
    hada_cli_progress_end(cli);
    if (!status)
        status = hada_tiff_finish(&writer, err);
    if (writer)
        hada_tiff_abandon(&writer);
    if (!status)
        status = hada_cli_optics_tables(report, folder, err);
    if (!status && hada_cli_pictures(cli))
        status = hada_cli_optics_plots(report, folder, err);
    if (status)
        hada_optics_report_end(report);
    source_close(&from);
    hada_cli_close(cli, &context);
    return status;
}

typedef struct writing {
    hada_cli *cli;
    const settings *set;
    const hada_camera *camera;
    hada_optics_report *report;
} writing;

static hada_status fill_folder(void *user, const char *folder, hada_error *err)
{
    const writing *w = user;
    return write_all(w->cli, w->set, w->camera, w->report, folder, err);
}

static const char *number(char *text, size_t size, double value, const char *format)
{
    if (isfinite(value))
        snprintf(text, size, format, value);
    else
        snprintf(text, size, "-");
    return text;
}

static void say_rows(hada_cli *cli, const hada_optics_report *report)
{
    hada_cli_say(cli, "%9s %6s %8s %6s %6s %8s %8s %8s %9s %9s", "distance", "1+d/z", "defocus", "Airy", "spot",
                 "support", "sidelobe", "lateral", "axial", "occupancy");
    hada_cli_say(cli, "%9s %6s %8s %6s %6s %8s %8s %8s %9s %9s", "mm", "", "px", "px", "px", "", "", "mm", "mm", "");
    for (int z = 0; z < report->depths; z++) {
        const hada_optics_row *r = &report->row[z];
        char defocus[32], airy[32], axial[32], occupancy[32];
        hada_cli_say(cli, "%9.4g %6.3f %8s %6s %6.2f %8.3f %8.3f %8.3f %9s %9s", r->distance_mm, r->magnification,
                     number(defocus, sizeof defocus, r->defocus_pixels, "%.2f"),
                     number(airy, sizeof airy, r->airy_pixels, "%.2f"), r->spot_pixels, r->support, r->sidelobe,
                     r->lateral_mm, number(axial, sizeof axial, r->axial_mm, "%.2f"),
                     number(occupancy, sizeof occupancy, r->occupancy, "%.2f"));
    }
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    settings *set = user;
    hada_error err = {0};
    hada_camera camera;
    hada_optics_report report = {0};
    const double start = hada_cli_seconds();
    if (count > 1 || (count && set->camera.file))
        return hada_cli_usage(cli, "'%s' is one camera too many", arguments[count - 1]);
    if (count)
        set->camera.file = arguments[0];
    if (!set->output)
        return hada_cli_usage(cli, "say where tables, figures and PSFs shall be written, with -o FOLDER");
    if (set->threshold < 0 || set->threshold >= 1)
        return hada_cli_usage(cli, "--threshold takes a number from 0 to 1");
    if (hada_cli_make_camera(&camera, &set->camera, &err))
        return hada_cli_fail(cli, &err);
    writing w = {.cli = cli, .set = set, .camera = &camera, .report = &report};
    if (hada_folder_create(set->output, fill_folder, &w, &err)) {
        hada_optics_report_end(&report);
        return hada_cli_fail(cli, &err);
    }
    double fill = NAN;
    hada_camera_fill_factor(&camera, &fill, NULL);
    const char *optics = set->psf ? "measured" : camera.optics == HADA_OPTICS_WAVE ? "wave" : "geometry";
    say_rows(cli, &report);
    hada_cli_say(cli, "%s: mask %s, fill factor %.3f, PSFs: %s, %d distances (%.1f s)", set->output,
                 hada_mask_word(camera.mask), fill, optics, camera.depths, hada_cli_seconds() - start);
    json_object_update_new(cli->document,
                           json_pack("{s:s, s:s, s:s, s:o, s:f, s:f, s:o}", "folder", set->output, "mask",
                                     hada_mask_word(camera.mask), "optics", optics, "fill_factor", hada_cli_real(fill),
                                     "threshold", report.threshold, "seconds", hada_cli_seconds() - start, "depths",
                                     hada_cli_optics_json(&report)));
    hada_optics_report_end(&report);
    return HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens optics --preset paper2022 --optics wave -o paper", "what the camera of the 2022 paper resolves."},
    {"hadalens optics --preset sim300 --mask diffuser -o diffuser", "another mask in a small camera."},
    {"hadalens optics camera/camera.json --psf camera/psf.tif -o measured", "PSFs from a file."},
    {0},
};

const hada_cli_command hada_cli_optics = {
    .name = "optics",
    .summary = "tell what a camera resolves, by its design",
    .synopsis = "[CAMERA.json] -o FOLDER [OPTION...]",
    .description =
        "Makes the response of a camera to a point at each of its distances, by rays or by wave optics, and writes "
        "what follows from it.\n\n"
        "FOLDER holds depths.csv (magnification, defocus, diffraction, resolution, occupancy), mtf.csv (modulation "
        "transfer), self_correlation.csv, correlation.csv (of PSFs at different distances), the same as figures "
        "(.svg), psf.tif and psf_z<distance>mm.png, mask.png, lenses.csv (where they stand) and camera.json. "
        "docs/optics.md says what each number means.\n\n"
        "camera.json serves 'simulate --camera'.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
    .designs_camera = 1,
};
