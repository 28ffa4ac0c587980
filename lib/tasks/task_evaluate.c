/* Results against the truth: which files go together. */
#include <hadalens/folder.h>

#include "core/callers.h"
#include "io/folder.h"
#include "tasks/evaluate.h"

struct hada_evaluate_report {
    hada_evaluation *rows; /* their names are on the heap */
    int count;
};

/* The result that belongs to a truth file: the same name, else NAME_aif.tif for NAME.tif; NULL: none. */
static hada_status find_result(char **out, const char *folder, const char *stem, hada_error *err)
{
    static const char *const endings[] = {".tif", ".tiff", "_aif.tif"};
    hada_status status = HADA_OK;
    int there = 0;
    *out = NULL;
    for (size_t k = 0; !there && k < sizeof endings / sizeof *endings; k++) {
        free(*out);
        HADA_TRY_OR_DONE(hada_path_format(out, err, "%s/%s%s", folder, stem, endings[k]));
        HADA_TRY_OR_DONE(hada_path_finds_file(*out, &there, err));
    }
done:
    if (!there) {
        free(*out);
        *out = NULL;
    }
    return status;
}

/* A row named after a file, that of `named`. */
static hada_status add(hada_evaluate_report *report, const char *named, const char *result, const char *truth,
                       hada_error *err)
{
    hada_status status = HADA_OK;
    char *name = NULL, *result_copy = NULL, *truth_copy = NULL;
    HADA_TRY_OR_DONE(hada_path_stem(&name, named, err));
    HADA_TRY_OR_DONE(hada_path_format(&result_copy, err, "%s", result));
    HADA_TRY_OR_DONE(hada_path_format(&truth_copy, err, "%s", truth));
    report->rows[report->count++] =
        (hada_evaluation){.size = sizeof(hada_evaluation), .name = name, .result = result_copy, .truth = truth_copy};
    name = result_copy = truth_copy = NULL;
done:
    HADA_FREE(name, result_copy, truth_copy);
    return status;
}

static hada_status add_file(hada_evaluate_report *report, const char *folder, const char *truth_folder,
                            const char *file, int *alone, hada_error *err)
{
    hada_status status = HADA_OK;
    char *stem = NULL, *result = NULL;
    hada_path truth;
    if (hada_stem_ends(file, hada_stem_of(file), "_depth2")) /* goes with NAME_depth.tif */
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_path_stem(&stem, file, err));
    HADA_TRY_OR_DONE(find_result(&result, folder, stem, err));
    *alone += !result;
    if (result) {
        HADA_TRY_OR_DONE(hada_path_write(truth, err, "%s/%s", truth_folder, file));
        HADA_TRY_OR_DONE(add(report, file, result, truth, err));
    }
done:
    HADA_FREE(stem, result);
    return status;
}

static hada_status list_folders(hada_evaluate_report *report, const char *result, const char *truth,
                                const hada_monitor *monitor, hada_error *err)
{
    hada_status status = HADA_OK;
    char **names = NULL;
    int count = 0, alone = 0;
    HADA_TRY_OR_DONE(hada_folder_list_tiffs(truth, &names, &count, err));
    HADA_TRY_OR_DONE(HADA_NEW(report->rows, (size_t)count + 1, "a list of files", err));
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(add_file(report, result, truth, names[i], &alone, err));
    if (!report->count)
        HADA_TRY_OR_DONE(hada_fail(
            err, HADA_ERROR_DATASET,
            "no TIFF file in %s has a partner in %s; NAME.tif goes with NAME.tif or NAME_aif.tif", truth, result));
    if (alone)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "%d %s in %s without a result in %s", alone,
                          alone == 1 ? "file" : "files", truth, result);
done:
    hada_names_free(&names, &count);
    return status;
}

static hada_status list_files(hada_evaluate_report *report, const char *result, const char *truth, hada_error *err)
{
    HADA_TRY(HADA_NEW(report->rows, 1, "a list of files", err));
    return add(report, result, result, truth, err);
}

static hada_status list(hada_evaluate_report *report, const char *result, const char *truth,
                        const hada_monitor *monitor, hada_error *err)
{
    hada_stands one, other;
    HADA_TRY(hada_path_kind(result, &one, err));
    HADA_TRY(hada_path_kind(truth, &other, err));
    const int folder = one == HADA_STANDS_FOLDER;
    if (folder != (other == HADA_STANDS_FOLDER))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "%s is a folder and %s is not; give two files or two folders",
                           folder ? result : truth, folder ? truth : result));
    return folder ? list_folders(report, result, truth, monitor, err) : list_files(report, result, truth, err);
}

hada_status hada_evaluate_run(hada_evaluate_report **out, const char *result, const char *truth,
                              const hada_evaluate_task *callers, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_evaluate_report *report = NULL;
    hada_evaluate_task task;
    hada_region region = {0};
    HADA_NEED(out && result && truth, err);
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&task, callers, hada_evaluate_task, err));
    if (!(task.peak > 0.0) || !(task.tolerance > 0.0))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT, "options.peak and options.tolerance must be greater than zero"));
    if (!(task.gate_pixels > 0.0) || !(task.gate_depths > 0.0))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "options.gate_pixels and options.gate_depths must be greater than zero"));
    HADA_TRY_OR_DONE(hada_region_read(&region, &task, err));
    HADA_TRY_OR_DONE(HADA_NEW(report, 1, "a report", err));
    HADA_TRY_OR_DONE(list(report, result, truth, task.monitor, err));
    for (int i = 0; i < report->count; i++) {
        HADA_TRY_OR_DONE(hada_evaluate_compare(&report->rows[i], &task, &region, err));
        HADA_TRY_OR_DONE(hada_monitor_check(task.monitor, err));
    }
    if (report->rows[0].downsample > 1)
        hada_monitor_tell(
            task.monitor, HADA_MESSAGE_NOTE,
            "the truth has %d times the rows and columns of the results, and is binned as the frames were",
            report->rows[0].downsample);
    *out = report;
    report = NULL;
done:
    hada_region_free(&region);
    hada_evaluate_report_destroy(&report);
    return status;
}

int hada_evaluate_report_count(const hada_evaluate_report *report)
{
    return report ? report->count : 0;
}

const hada_evaluation *hada_evaluate_report_get(const hada_evaluate_report *report, int index)
{
    return report && index >= 0 && index < report->count ? &report->rows[index] : NULL;
}

void hada_evaluate_report_destroy(hada_evaluate_report **pointer)
{
    hada_evaluate_report *report = hada_taken(pointer);
    if (!report)
        return;
    for (int i = 0; i < report->count; i++) {
        free((void *)(uintptr_t)report->rows[i].name);
        free((void *)(uintptr_t)report->rows[i].result);
        free((void *)(uintptr_t)report->rows[i].truth);
    }
    HADA_FREE(report->rows, report);
}
