#include "shared.h"

#include <stdio.h>

/* What must be done to the scenes, in words. */
static const char *orientation(const hada_registration *r)
{
    static const char *const words[] = {"as it is", "turn left",         "half a turn", "turn right",
                                        "mirror",   "mirror, turn left", "upside down", "mirror, turn right"};
    return words[4 * r->mirrored + r->quarter_turns];
}

static json_t *depth_json(double distance_mm, const hada_registered_depth *one)
{
    const hada_registration *r = one->found, *a = one->applied;
    json_t *entry = json_pack("{s:f, s:i, s:b, s:i, s:s}", "distance_mm", distance_mm, "pairs", one->pairs, "mirrored",
                              r->mirrored, "quarter_turns", r->quarter_turns, "orientation", orientation(r));
    HADA_CLI_SET(entry, {"magnification", r->magnification}, {"rotation_deg", r->rotation_deg});
    json_object_set_new(entry, "perspective", json_pack("[f, f]", r->perspective_row, r->perspective_col));
    json_object_set_new(entry, "offset", json_pack("[f, f]", r->offset_row, r->offset_col));
    HADA_CLI_SET(entry, {"likeness_to_the_depth_before", one->likeness}, {"explained", r->explained},
                 {"explained_otherwise", r->explained_otherwise}, {"displacement", one->displacement});
    json_object_set_new(entry, "stands_right", json_boolean(one->stands_right));
    json_object_set_new(entry, "applied",
                        json_pack("{s:f, s:f, s:[f, f], s:[f, f]}", "magnification", a->magnification, "rotation_deg",
                                  a->rotation_deg, "perspective", a->perspective_row, a->perspective_col, "offset",
                                  a->offset_row, a->offset_col));
    return entry;
}

static void print_depth(hada_cli *cli, double distance_mm, int first, const hada_registered_depth *one)
{
    const hada_registration *r = one->found;
    char offset[48] = "-";
    if ((first || one->likeness >= 0) && !one->offset_unknown)
        snprintf(offset, sizeof offset, "%.1f, %.1f", r->offset_row, r->offset_col);
    hada_cli_say(cli, "%6g mm  %-18s  %13.4f  %8.2f\xc2\xb0  %16s  %8.1f%%  %8.1f%%", distance_mm, orientation(r),
                 r->magnification, r->rotation_deg, offset, 100 * r->explained, 100 * r->explained_otherwise);
    if (r->perspective_row == 0.0 && r->perspective_col == 0.0)
        return;
    int rows, cols;
    hada_register_size(r, one->scene_rows, one->scene_cols, &rows, &cols);
    hada_cli_say(cli, "%9s  perspective: sizes change by %.1f %% from top to bottom and by %.1f %% from left to right",
                 "", -100 * rows * r->perspective_row, -100 * cols * r->perspective_col);
}

static void warn_depth(hada_cli *cli, const hada_dataset *data, int z, const hada_registered_depth *one)
{
    const char *folder = hada_dataset_get_info(data)->folders[z];
    if (one->offset_unknown)
        hada_cli_warn(cli,
                      "%s: its PSF is not like that of the depth before (%.2f), so the shift between them is not known",
                      folder, one->likeness);
    if (one->rough)
        hada_cli_warn(cli, "%s: only %.1f %% of the frames' structure is explained, so these figures are rough", folder,
                      100 * one->found->explained);
    if (one->other_orientation)
        hada_cli_warn(cli, "%s stands in another orientation than %s", folder, hada_dataset_get_info(data)->folders[0]);
}

void hada_cli_tell_registered(hada_cli *cli, const hada_dataset *data, const hada_register_report *report)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    int right = 0;
    json_t *depths = json_array();
    json_object_set_new(cli->document, "depths", depths);
    hada_cli_say(cli, "%9s  %-18s  %13s  %9s  %16s  %9s  %9s", "distance", "scenes", "magnification", "rotation",
                 "offset", "explained", "otherwise");
    for (int z = 0; z < info->depths; z++) {
        const hada_registered_depth *one = report->depths[z];
        print_depth(cli, info->distances_mm[z], !z, one);
        warn_depth(cli, data, z, one);
        json_array_append_new(depths, depth_json(info->distances_mm[z], one));
        right += one->stands_right;
    }
    json_object_set_new(cli->document, "registered", json_boolean(right == info->depths));
    if (right == info->depths)
        hada_cli_say(cli, "The scenes stand as the sensor sees them: there is nothing to do.");
    else if (right)
        hada_cli_say(cli, "%d of %d depths stand as the sensor sees them.", right, info->depths);
}
