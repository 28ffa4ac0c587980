#!/usr/bin/env python3
"""Learned cameras, by two versions of the program: each is fitted and reconstructs the same held-out frames.
   perf/learned.py BEFORE HADALENS PHOTOGRAPHS OTHER_PHOTOGRAPHS [--diffusers | --random FIRST_SEED LAST_SEED]
A camera is learned from either set and sees the other; --diffusers: other cameras, half of them with diffusers; --random: of any
mask, size, depths and noise, from 2 to 8 pairs a depth of OTHER_PHOTOGRAPHS or drawings, which see one plane, two, and surfaces of
PHOTOGRAPHS. PSNR of the all-in-focus image and of the occupied planes, dB."""
import argparse
import json
import pathlib
import random
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
parser.add_argument("--random", type=int, nargs=2)
o = parser.parse_args()


def quality(program, camera, model, out):
    if not model.exists():
        run(program, "fit", camera, "-o", model, "--quiet")
    reconstruct(program, sorted((camera / "test/raw").iterdir()), model, out, [])
    rows = json.loads(run(o.hadalens, "evaluate", out, camera / "test/truth", "--json"))["files"]
    return [statistics.mean(row["psnr"] for row in rows if row["kind"] == kind and row["psnr"] is not None)
            for kind in ("images", "stack")]


PROGRAMS = (("before", o.before), ("now", o.hadalens))


def any_camera(seed):
    """The words of simulate that describe it."""
    pick = random.Random(seed)
    rows, cols = pick.choice([(120, 160), (200, 260), (177, 233), (256, 256)])
    preset = pick.choice(["crop300", "crop300", "sim300"])
    words = ["--preset", preset, "--size", f"{rows}x{cols}", "--mask", pick.choice(["mla", "diffuser", "contour", "aperture", "grid"]),
             "--depths", pick.choice([3, 5, 8, 12]), "--channels", pick.choice([1, 1, 3]), "--pairs", pick.choice([2, 3, 4, 8]),
             "--scenes", pick.choice(["procedural", o.others]), "--test-scenes", o.photographs, "--seed", seed]
    if preset == "crop300" and pick.random() < 0.5:
        words += ["--window", f"{int(rows * pick.uniform(0.4, 0.8))}x{int(cols * pick.uniform(0.4, 0.8))}"]
    if pick.random() < 0.5:
        words += ["--noise", pick.choice([0.002, 0.005, 0.01, 0.02, 0.04])]
    else:
        words += ["--full-well", pick.choice([2000, 10000, 30000]), "--read-noise", 5, "--bits", 16, "--adc-bits",
                  pick.choice([8, 10, 12]), "--exposure", pick.choice([0.3, 0.8])]
    if pick.random() < 0.3:
        words += ["--scene-response", "srgb"]
    return words


def compare_random():
    kinds = {"one plane": ["--test", 2, "--test-depths", 1], "two planes": ["--test", 2, "--test-depths", 2],
             "surfaces": ["--test", 3, "--surface", "slant,hill,ball"]}
    print("| seed | scenes | before: all-in-focus, planes | now |\n|---|---|---|---|")
    rows = {kind: [] for kind in kinds}
    for seed in range(o.random[0], o.random[1] + 1):
        with tempfile.TemporaryDirectory() as folder:
            work = pathlib.Path(folder)
            for kind, test in kinds.items():
                run(o.hadalens, "simulate", *any_camera(seed), *test, "-o", work / kind, "--quiet")
                row = [quality(program, work / kind, work / f"{name}.model", work / f"{kind} {name}") for name, program in PROGRAMS]
                rows[kind].append(row)
                print(f"| {seed} | {kind} |" + "".join(f" {images:.2f}, {planes:.2f} |" for images, planes in row), flush=True)
    for kind, found in rows.items():
        gains = [now[0] - before[0] for before, now in found]
        means = [[statistics.mean(row[k][i] for row in found) for i in range(2)] for k in range(2)]
        print(f"| mean | {kind} |" + "".join(f" {images:.2f}, {planes:.2f} |" for images, planes in means)
              + f" all-in-focus {min(gains):+.2f} to {max(gains):+.2f}")


def compare():
    print("| camera | learned from | before: all-in-focus, planes | now |\n|---|---|---|---|")
    gains = []
    for preset, mask, noise, seed, response, pairs, occupied, depths in DIFFUSERS if o.diffusers else CAMERAS:
        for learned, seen in ((o.photographs, o.others), (o.others, o.photographs)):
            with tempfile.TemporaryDirectory() as folder:
                work = pathlib.Path(folder)
                run(o.hadalens, "simulate", "--preset", preset, "--mask", mask, "--noise", noise, "--seed", seed,
                    "--scene-response", response, "--depths", depths, "--pairs", pairs, "--scenes", learned, "--test-scenes", seen,
                    "--test", 6, "--test-depths", occupied, "-o", work / "camera", "--quiet")
                before, now = [quality(program, work / "camera", work / f"{name}.model", work / name) for name, program in PROGRAMS]
            gains.append([now[i] - before[i] for i in range(2)])
            print(f"| {preset}, {mask}, {100 * noise:g} %, {response}, {occupied} of {depths} depths, seed {seed} | "
                  f"{pathlib.Path(learned).name} | {before[0]:.2f}, {before[1]:.2f} | {now[0]:.2f}, {now[1]:.2f} |", flush=True)
    print("mean gain", ", ".join(f"{statistics.mean(g):.2f} (least {min(g):.2f})" for g in zip(*gains)), "dB")


compare_random() if o.random else compare()
