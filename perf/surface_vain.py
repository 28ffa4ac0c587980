#!/usr/bin/env python3
"""Frames that a surface is tried for in vain: what ends the try at a coarse level, what that saves, and whether a surface
is lost by it. Simulated cameras whose models fit their frames badly in several ways; every frame goes through the program
of --build and through that of --before, which does not end early, and their results are held to be the same files.
  perf/surface_vain.py --before BUILD --scenes FOLDER --test-scenes FOLDER [--build build/release] [--seed 1] [--cameras 10]
                       [--kinds slant,hill,ball,steps] [--planes 5,8] [--spoils none,pairs,response,gain,ghost,bend]
                       [--frames FILE.jsonl] [--read FILE.jsonl,...]
Prints a row for each way of being wrong: frames for which a surface was tried and was taken, and how near the nearest of
them came to being given up (1: it would be); those refused, how many of them ended early, and the processor's seconds of
these and of the others, before and now. A try with a single coarse level cannot end early and counts as none. --frames: every frame's figures are added to this file; --read: no runs, the table of such files.
Needs NumPy and tifffile."""
import argparse
import hashlib
import json
import pathlib
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile

import numpy as np
import tifffile

here = pathlib.Path(__file__).resolve().parent
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=str(here.parent / "build" / "release"))
parser.add_argument("--before", default="", help="the build folder of a program that never ends a try early")
parser.add_argument("--scenes", default="procedural")
parser.add_argument("--test-scenes", default="")
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--cameras", type=int, default=10)
parser.add_argument("--kinds", default="slant,hill,ball,steps")
parser.add_argument("--planes", default="5,8", help="depths of further frames that stand on planes")
parser.add_argument("--spoils", default="none,pairs,response,gain,ghost,bend")
parser.add_argument("--frames", default="")
parser.add_argument("--read", default="")
o = parser.parse_args()

# whose surfaces have two coarse levels and more: elsewhere nothing can end early
CAMERAS = ["--preset sim512 --size 256x256 --window 120x120", "--preset sim512 --size 384x384 --window 180x180 --channels 1",
           "--preset sim512 --size 192x192 --window 96x96 --channels 1",
           "--preset crop300 --size 240x320 --window 96x96 --channels 1",
           "--preset crop300 --size 200x240 --window 100x100 --depths 8 --channels 1",
           "--preset sim512 --size 320x320 --window 150x150 --channels 1", "--preset crop300"]
MASKS = ["", "", "--mask diffuser", "--mask contour", "--mask aperture", "--mask grid"]
UNEXPLAINED = 0.1  # of the frame's amplitude: where a model fits badly


def run(build, *words):
    """What the program prints, and the processor's seconds that it took."""
    start = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([f"{build}/bindings/cli/hadalens", *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{build}: {' '.join(map(str, words))}\n{done.stderr}")
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout + done.stderr, end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime


def bent(image, by, rng):
    """The image drawn at places that are off by waves of `by` pixels."""
    rows, cols = image.shape[:2]
    y, x = np.mgrid[:rows, :cols].astype(float)
    ways = [np.sin(2 * np.pi * (y / rows * rng.uniform(0.5, 2) + x / rows * rng.uniform(0.5, 2)) + rng.uniform(0, 6))
            for _ in range(2)]
    y, x = np.clip(y + by * ways[0], 0, rows - 1), np.clip(x + by * ways[1], 0, cols - 1)
    row, col = np.minimum(y.astype(int), rows - 2), np.minimum(x.astype(int), cols - 2)
    down, along = (y - row)[..., None], (x - col)[..., None]
    upper = (1 - along) * image[row, col] + along * image[row, col + 1]
    lower = (1 - along) * image[row + 1, col] + along * image[row + 1, col + 1]
    return (1 - down) * upper + down * lower


def spoil(path, kind, much, seed):
    """A frame as a sensor may deliver it whose model knows nothing of that."""
    frame = tifffile.imread(path)
    image, rng = frame.reshape(*frame.shape[:2], -1).astype(float), np.random.default_rng(seed)
    rows, cols = image.shape[:2]
    if kind == "gain":  # darker towards the edges, and here and there
        y, x = np.mgrid[:rows, :cols] / rows
        waves = sum(np.cos(2 * np.pi * (rng.integers(0, 3) * y + rng.integers(0, 3) * x) + rng.uniform(0, 6)) for _ in "four")
        image *= np.clip(1 + much * (waves / 4 - 2 * ((y - 0.5) ** 2 + (x - cols / rows / 2) ** 2)), 0.1, None)[..., None]
    elif kind == "ghost":  # a mirror image of the frame, as of a cover glass
        image += much * np.roll(image[::-1], rng.integers(8, rows // 6, 2), (0, 1))
    elif kind == "bend":  # light falls elsewhere than the model says
        image = bent(image, much * rows / 40, rng)
    tifffile.imwrite(path, image.reshape(frame.shape).astype(np.float32))


def make(folder, rng, spoilt):
    """A camera, its model and its frames."""
    camera = [*rng.choice(CAMERAS).split(), *rng.choice(MASKS).split(), "--seed", rng.randrange(1000, 9999), "--noise",
              rng.choice([0.001, 0.003, 0.01, 0.03])]
    design = [*camera, "--scenes", o.scenes, "--quiet"]
    design += ["--test-scenes", o.test_scenes] if o.test_scenes else []
    design += ["--scene-response", "srgb"] if spoilt == "response" else []
    run(o.build, "simulate", *design, "--pairs", 2 if spoilt == "pairs" else 8, "--surface", o.kinds, "--test",
        len(o.kinds.split(",")), "-o", folder / "camera")
    run(o.build, "fit", folder / "camera", "-o", folder / "model", "--scene-response", "linear", "--quiet")
    files = sorted((folder / "camera" / "test" / "raw").glob("*.tif"))
    for depths in filter(None, o.planes.split(",")):
        run(o.build, "simulate", *design, "--pairs", 1, "--test", 1, "--test-depths", depths, "-o", folder / depths)
        files += [f.rename(folder / f"planes_{depths}.tif") for f in (folder / depths / "test" / "raw").glob("*.tif")]
    much, seed = rng.choice([0.15, 0.3, 0.6, 1.2]), rng.randrange(1000)
    for f in files:
        spoil(f, spoilt, much, seed)
    return " ".join(map(str, camera)), files


def results(build, frame, model, folder):
    """One frame: its report, what was said, seconds, and a hash of all images."""
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    said, seconds = run(build, "reconstruct", frame, "-m", model, "-o", out, "--no-preview", "--verbose")
    images = hashlib.sha256(b"".join(f.read_bytes() for f in sorted(out.rglob("*.tif"))))
    looks = [float(b) if float(a) > 1 else float(a)  # the first that holds it back
             for a, b in re.findall(r"pixels: planes (\S+), texture (\S+) of what ends it", said)]
    return {"scene": "surface" if re.search(r": a surface, ", said) else "planes", "seconds": seconds, "looks": looks,
            "ended": "it is given up" in said, "unexplained": float(re.search(r"([\d.]+) % unexplained", said)[1]) / 100,
            "images": images.hexdigest()}


def measure():
    rows, rng = [], random.Random(o.seed)
    for k in range(o.cameras):
        spoilt = o.spoils.split(",")[k % len(o.spoils.split(","))]
        with tempfile.TemporaryDirectory() as scratch:
            design, files = make(pathlib.Path(scratch), rng, spoilt)
            for f in files:
                row = {"spoilt": spoilt, "design": design, "frame": f.stem}
                for name, build in (("now", o.build), ("before", o.before)):
                    row[name] = results(build, f, pathlib.Path(scratch) / "model", pathlib.Path(scratch))
                rows.append(row)
                if o.frames:
                    with open(o.frames, "a") as out:
                        out.write(json.dumps(row) + "\n")
                print(f"{k + 1} of {o.cameras}, {spoilt}: {f.stem}", file=sys.stderr)
    return rows


def line(title, rows):
    tried = [r for r in rows if r["now"]["looks"]]
    taken = [r for r in tried if r["before"]["scene"] == "surface"]
    refused = [r for r in tried if r not in taken]
    ended = [r for r in refused if r["now"]["ended"]]
    badly = [r for r in refused if r["before"]["unexplained"] > UNEXPLAINED]
    nearest = f"{max(max(r['now']['looks']) for r in taken):.2f}" if taken else "-"
    seconds = [" → ".join(f"{sum(r[which]['seconds'] for r in some):.0f}" for which in ("before", "now"))
               for some in (ended, [r for r in tried if not r["now"]["ended"]])]
    differ = sum(r["now"]["images"] != r["before"]["images"] for r in rows)
    print(f"| {title} | {len(rows)} | {len(taken)} | {nearest} | {len(refused)} | {len(ended)} | "
          f"{sum(r['now']['ended'] for r in badly)} of {len(badly)} | {seconds[0]} | {seconds[1]} | {differ} |")


if o.read:
    table = [json.loads(text) for path in o.read.split(",") for text in open(path)]
else:
    table = measure()
print("| what is wrong | frames | tried and taken | nearest to the limit | refused | ended early | of those with more than 10 %"
      " unexplained | seconds of the ended | of the others tried | frames that differ |")
print("|---|---|---|---|---|---|---|---|---|---|")
for kind in dict.fromkeys(r["spoilt"] for r in table):
    line(kind, [r for r in table if r["spoilt"] == kind])
line("all", table)
