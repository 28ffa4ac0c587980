#!/usr/bin/env python3
"""Headers of a version that never was, from frozen ones: derive.py FROZEN OUT older|newer

older: structs end before their last members, as if those had come later; newer: one has a member more."""
import pathlib
import re
import shutil
import sys

OLDER = {
    "net.h": [r"    int last_relu;.*?\*/\n    int last_norm;.*?\*/\n"],
    "sensor.h": [r"    const hada_image \*gain;.*?\*/\n"],
    "metrics.h": [r"    long long pixels; +/\* with a true.*?\*/\n"],
}
NEWER = {"net.h": [r"(?=\} hada_unet_options;)"]}


def main():
    frozen, out, which = sys.argv[1:]
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(frozen, out)
    for name, patterns in (OLDER if which == "older" else NEWER).items():
        file = pathlib.Path(out) / "hadalens" / name
        text = file.read_text(encoding="utf-8")
        for pattern in patterns:
            text, count = re.subn(pattern, "" if which == "older" else "    double unknown;\n", text, flags=re.S)
            assert count == 1, (name, pattern)
        file.write_text(text, encoding="utf-8")


main()
