#!/usr/bin/env python3
"""Writes a C program that calls every public function with NULL: null_arguments.py HEADERS OUTPUT.c

Each pointer of each function is NULL in turn, while the others point to zeroed memory, in a process of its own. No call
may crash, and a hada_status must be HADA_ERROR_ARGUMENT, except for the arguments that may be NULL. So it is where each
image that is read has sizes but no pixels, in functions that need no object but a context.
"""

import re
import sys
from pathlib import Path

# Arguments that may be NULL, as their headers say: by name everywhere, and by function.
ANYWHERE = {"err", "user", "options", "task", "monitor", "mask", "report", "callers"}
MAY_BE_NULL = {
    "hada_camera_mask_map": {"thickness_mm", "transmission"},
    "hada_camera_psf_stack": {"context"},
    "hada_dark_frame_load": {"level"},
    "hada_device_call_costs": {"launch_seconds", "wait_seconds", "write_bytes_per_second"},
    "hada_device_peaks": {"copy_bytes_per_second", "flops_per_second"},
    "hada_fit_run": {"data"},
    "hada_fitter_finish": {"pairs"},
    "hada_focus_stack": {"distances_mm", "competing"},
    "hada_inputs_protect": {"paths"},
    "hada_headerless_set": {"text"},
    "hada_limits_set": {"limits"},
    "hada_lpips_create": {"heads"},
    "hada_metric_depth": {"distances_mm"},
    "hada_metric_depth_confidence": {"distances_mm"},
    "hada_metric_depth_nearer": {"distances_mm"},
    "hada_model_from_filters": {"filters", "otf"},
    "hada_model_with_enhance": {"net"},
    "hada_net_load_weights": {"prefix"},
    "hada_plan_estimate": {"device_bytes", "host_bytes"},
    "hada_plan_memory": {"held", "apart"},
    "hada_plan_queues": {"info"},
    "hada_plot_legend": {"mark"},
    "hada_plot_save": {"plot"},
    "hada_reconstruct_files": {"failed"},
    "hada_register_write": {"rows", "cols"},
    "hada_result_use": {"arrays"},
    "hada_result_use_cl": {"arrays"},
    "hada_simulator_render_occluded": {"opacity"},
    "hada_trainer_create": {"held_out"},
    "hada_trainer_show": {"raw", "before", "after", "truth"},
}

# No pixels are read: a data set of no pairs.
READS_NONE = {"hada_dataset_from_images"}

HEAD = r"""#include <hadalens/hadalens.h>
#include <hadalens/opencl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static void *zeroes; /* what the arguments that are not NULL point to */
static hada_image whole = {1, 20, 20, NULL}, hollow = {1, 20, 20, NULL};
static int failures;

/* In a process of its own: 0 right, 1 another status, else a crash. */
static void judge(const char *what, int right)
{
    _exit(right ? 0 : (fprintf(stderr, "%s: not HADA_ERROR_ARGUMENT\n", what), 1));
}

static int begins(void)
{
    fflush(NULL);
    const pid_t child = fork();
    if (child <= 0)
        return 1;
    int status = 0;
    waitpid(child, &status, 0);
    if (!WIFEXITED(status))
        failures++;
    failures += WIFEXITED(status) && WEXITSTATUS(status) != 0;
    return WIFEXITED(status) ? 0 : -1;
}

#define CALL(what, right)                                                                                              \
    switch (begins()) {                                                                                                \
    case 1: judge(what, right); break;                                                                                 \
    case -1: fprintf(stderr, "%s: crashed\n", what); break;                                                           \
    default: break;                                                                                                    \
    }

int main(void)
{
    zeroes = calloc(1, 1 << 20);
    whole.data = (float *)zeroes + 4096;
    alarm(600);
"""


def split(text: str) -> list[str]:
    """The parameters of a declaration."""
    parts, depth, now = [], 0, ""
    for sign in text:
        depth += {"(": 1, ")": -1}.get(sign, 0)
        if sign == "," and not depth:
            parts.append(now.strip())
            now = ""
        else:
            now += sign
    return [part for part in [*parts, now.strip()] if part and part != "void"]


def main(folder: str, output: str) -> None:
    """Read the headers and write the program."""
    texts = {
        path.name: re.sub(r"/\*.*?\*/", " ", path.read_text(encoding="utf-8"), flags=re.S)
        for path in sorted(Path(folder, "hadalens").glob("*.h"))
    }
    callbacks = set(re.findall(r"typedef [\w ]+?\(\*(\w+)\)\(", " ".join(texts.values())))
    structs = {"hada_plot_axis"} | callbacks
    objects = set(re.findall(r"typedef struct (hada_\w+) \1;", " ".join(texts.values()))) - {"hada_context"}
    calls = []
    for text in texts.values():
        for declaration in re.findall(r"^HADA_API\s+([^;]*?);", text, re.M | re.S):
            declaration = re.sub(r"\s+", " ", declaration)
            result, name, inside = re.fullmatch(r"(.*?)\b(hada_\w+)\((.*)\)", declaration).groups()
            names, kinds = [], []
            for parameter in split(inside):
                names.append(re.search(r"(\w+)(\[.*\])?$", parameter).group(1))
                kind = parameter[: parameter.rindex(names[-1])].strip()
                pointer = "*" in parameter or "[" in parameter or kind in callbacks
                kinds.append((pointer, kind))
            closed = name in READS_NONE or objects & set(re.findall(r"\w+", " ".join(kind for _, kind in kinds)))
            for missing, (pointer, own) in zip(names, kinds, strict=True):
                if not pointer or missing == "err":
                    continue
                for hollow in (False, True) if own == "const hada_image *" and not closed else (False,):
                    values = []
                    for other, (is_pointer, kind) in zip(names, kinds, strict=True):
                        if not is_pointer:
                            values.append("1")
                        elif hollow and kind == own:
                            values.append("&hollow" if other == missing else "&whole")
                        elif other in (missing, "err") or kind in structs or other in ANYWHERE:
                            values.append("NULL")
                        else:
                            values.append("zeroes")
                    call = f"{name}({', '.join(values)})"
                    open_ = missing in ANYWHERE or missing in MAY_BE_NULL.get(name, set())
                    if open_ and not hollow:
                        continue  # what it does without that argument is tested where it is used
                    fails = "hada_status" in result.split()
                    right = f"{call} == HADA_ERROR_ARGUMENT" if fails else f"((void){call}, 1)"
                    calls.append(f'    CALL("{name}({missing}{" hollow" if hollow else ""})", {right})')
    body = "\n".join(calls)
    tail = '\n    printf("%d calls, %d failures\\n", ' + str(len(calls)) + ", failures);\n"
    tail += "    free(zeroes);\n    return failures != 0;\n}\n"
    Path(output).write_text(HEAD + body + tail, encoding="utf-8")


main(*sys.argv[1:])
