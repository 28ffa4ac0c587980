#include "option.h"
#include "shared.h"

#include <hadalens/task_optics.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>

typedef struct settings {
    hada_cli_camera_settings camera;
    hada_optics_task task;
    const char *output;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to write"),
    {HADA_OPTION_TARGET, "output", 'o', "FOLDER", "the folder to make", "It must not exist yet, or be empty.",
     AT(output)},
    {HADA_OPTION_REAL, "threshold", 0, "MTF", "frequencies count as passed from here on (default: 0.05)", NULL,
     AT(task.threshold)},
    {HADA_OPTION_TEXT, "psf", 0, "FILE", "PSFs from a TIFF file, a page per depth, instead of by design",
     "Measured ones, for instance: of the sensor's size, near to far as the camera's distances.", AT(task.psf)},
    {HADA_OPTION_FLAG, "coherent", 0, NULL, "wave optics of all lenses together",
     "Light of different lenses interferes. Takes more memory and time; masks without lenses always work so.",
     AT(task.coherent)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    hada_cli_camera_defaults(&set->camera);
    hada_optics_task_init(&set->task);
}

static const char *number(hada_cli_digits text, double value)
{
    return hada_cli_number(text, "%.2f", isfinite(value) ? value : NAN);
}

static void say_rows(hada_cli *cli, const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    hada_cli_say(cli, "%9s %6s %8s %6s %6s %8s %8s %8s %9s %9s", "distance", "1+d/z", "defocus", "Airy", "spot",
                 "support", "sidelobe", "lateral", "axial", "occupancy");
    hada_cli_say(cli, "%9s %6s %8s %6s %6s %8s %8s %8s %9s %9s", "mm", "", "px", "px", "px", "", "", "mm", "mm", "");
    for (int z = 0; z < curves->depths; z++) {
        const hada_optics_row *r = hada_optics_report_row(report, z);
        hada_cli_digits defocus = "", airy = "", axial = "", occupancy = "";
        hada_cli_say(cli, "%9.4g %6.3f %8s %6s %6.2f %8.3f %8.3f %8.3f %9s %9s", r->distance_mm, r->magnification,
                     number(defocus, r->defocus_pixels), number(airy, r->airy_pixels), r->spot_pixels, r->support,
                     r->sidelobe, r->lateral_mm, number(axial, r->axial_mm), number(occupancy, r->occupancy));
    }
}

static json_t *rows_json(const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    json_t *rows = json_array();
    for (int z = 0; z < curves->depths; z++) {
        json_t *row = json_object();
        const char *name;
        double value;
        for (int c = 0; (name = hada_optics_column(c, hada_optics_report_row(report, z), &value)); c++)
            json_object_set_new(row, name, hada_cli_real(value));
        json_array_append_new(rows, row);
    }
    return rows;
}

static void tell(hada_cli *cli, const settings *set, const hada_camera *camera, const hada_optics_report *report,
                 double seconds)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    double fill = NAN;
    hada_camera_fill_factor(camera, &fill, NULL);
    const char *optics = set->task.psf ? "measured" : camera->optics == HADA_OPTICS_WAVE ? "wave" : "geometry";
    say_rows(cli, report);
    hada_cli_say(cli, "%s: mask %s, fill factor %.3f, PSFs: %s, %d distances (%.1f s)", set->output,
                 hada_enum_name(HADA_ENUM_MASK, (int)camera->mask), fill, optics, camera->depths, seconds);
    json_object_update_new(cli->document,
                           json_pack("{s:o, s:s, s:s, s:o, s:f, s:f, s:o}", "folder", hada_cli_json_text(set->output),
                                     "mask", hada_enum_name(HADA_ENUM_MASK, (int)camera->mask), "optics", optics,
                                     "fill_factor", hada_cli_real(fill), "threshold", curves->threshold, "seconds",
                                     seconds, "depths", rows_json(report)));
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    settings *set = user;
    hada_error err = {0};
    hada_camera camera = {.size = sizeof camera};
    hada_context *context = NULL;
    hada_optics_report *report = NULL;
    hada_status status = HADA_OK;
    const double start = hada_cli_seconds();
    if (count > 1 || (count && set->camera.file))
        return hada_cli_usage(cli, "'%s' is one camera too many", arguments[count - 1]);
    if (count)
        set->camera.file = arguments[0];
    if (!set->output)
        return hada_cli_usage(cli, "say where tables, figures and PSFs shall be written, with -o FOLDER");
    set->task.monitor = &cli->monitor;
    hada_cli_pictures(cli);
    HADA_TRY_OR_DONE(hada_cli_make_camera(&camera, &set->camera, &err));
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, &err));
    HADA_TRY_OR_DONE(hada_optics_run(&report, context, &camera, set->output, &set->task, &err));
    tell(cli, set, &camera, report, hada_cli_seconds() - start);
done:
    hada_optics_report_destroy(&report);
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
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
        "docs/explanation/simulation.md says what each number means.\n\n"
        "camera.json serves 'simulate --camera'.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
    .designs_camera = 1,
};
