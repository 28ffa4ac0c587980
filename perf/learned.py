#!/usr/bin/env python3
"""Learned cameras, by two versions of the program: each is fitted and reconstructs the same held-out frames.
   perf/learned.py BEFORE HADALENS PHOTOGRAPHS OTHER_PHOTOGRAPHS [--diffusers]
A camera is learned from either set and sees the other; --diffusers: other cameras, half of them with diffusers. PSNR of the all-in-focus image and of the occupied planes, dB."""
import argparse
import json
import pathlib
import statistics
import tempfile

from frames import reconstruct, run

# preset, mask, noise, seed, scenes, pairs of a depth, occupied depths, depths
CAMERAS = [
    ("sim300", "mla", 0.01, 301, "srgb", 12, 1, 2),
    ("crop300", "contour", 0.005, 302, "linear", 8, 2, 4),
    ("sim300", "aperture", 0.02, 303, "linear", 6, 1, 2),
    ("crop300", "mla", 0.01, 304, "srgb", 8, 2, 3),
    ("sim300", "diffuser", 0.005, 305, "srgb", 10, 1, 1),
    ("crop300", "aperture", 0.02, 306, "srgb", 5, 1, 2),
    ("sim300", "contour", 0.003, 307, "srgb", 8, 2, 2),
    ("crop300", "mla", 0.003, 308, "linear", 16, 1, 1),
    ("sim300", "mla", 0.05, 309, "srgb", 8, 1, 2),
    ("crop300", "contour", 0.03, 310, "srgb", 8, 2, 3),
]
DIFFUSERS = [
    ("crop300", "diffuser", 0.01, 801, "srgb", 8, 1, 1),
    ("crop300", "diffuser", 0.004, 802, "linear", 8, 1, 3),
    ("crop300", "diffuser", 0.02, 803, "srgb", 12, 2, 3),
    ("sim300", "diffuser", 0.01, 804, "srgb", 8, 1, 2),
    ("sim300", "diffuser", 0.02, 805, "linear", 8, 2, 3),
    ("crop300", "mla", 0.01, 806, "srgb", 6, 1, 2),
    ("crop300", "aperture", 0.02, 807, "srgb", 8, 1, 2),
    ("sim300", "mla", 0.01, 808, "linear", 8, 1, 3),
    ("crop300", "contour", 0.01, 809, "linear", 8, 1, 2),
    ("sim300", "contour", 0.01, 810, "srgb", 8, 2, 3),
]
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("before", type=pathlib.Path)
parser.add_argument("hadalens", type=pathlib.Path)
parser.add_argument("photographs")
parser.add_argument("others")
parser.add_argument("--diffusers", action="store_true")
o = parser.parse_args()


def quality(program, camera, model, out):
    run(program, "fit", camera, "-o", model, "--quiet")
    reconstruct(program, sorted((camera / "test/raw").iterdir()), model, out, [])
    rows = json.loads(run(o.hadalens, "evaluate", out, camera / "test/truth", "--json"))["files"]
    return [statistics.mean(row["psnr"] for row in rows if row["kind"] == kind and row["psnr"] is not None)
            for kind in ("images", "stack")]


print("| camera | learned from | before: all-in-focus, planes | now |\n|---|---|---|---|")
gains = []
for preset, mask, noise, seed, response, pairs, occupied, depths in DIFFUSERS if o.diffusers else CAMERAS:
    for learned, seen in ((o.photographs, o.others), (o.others, o.photographs)):
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            run(o.hadalens, "simulate", "--preset", preset, "--mask", mask, "--noise", noise, "--seed", seed,
                "--scene-response", response, "--depths", depths, "--pairs", pairs, "--scenes", learned, "--test-scenes", seen,
                "--test", 6, "--test-depths", occupied, "-o", work / "camera", "--quiet")
            before, now = [quality(program, work / "camera", work / f"{name}.model", work / name)
                           for program, name in ((o.before, "before"), (o.hadalens, "now"))]
        gains.append([now[i] - before[i] for i in range(2)])
        print(f"| {preset}, {mask}, {100 * noise:g} %, {response}, {occupied} of {depths} depths, seed {seed} | "
              f"{pathlib.Path(learned).name} | {before[0]:.2f}, {before[1]:.2f} | {now[0]:.2f}, {now[1]:.2f} |", flush=True)
print("mean gain", ", ".join(f"{statistics.mean(g):.2f} (least {min(g):.2f})" for g in zip(*gains)), "dB")
