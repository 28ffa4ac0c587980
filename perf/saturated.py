#!/usr/bin/env python3
"""Frames with saturated or missing values: PSNR of the all-in-focus image, error of the distances in steps, and the depths
that were found, one row for each kind of scene and each spoiling.
   perf/saturated.py [--build build/release] [--preset crop300] [--seed 5] [--frames 4] [--kinds 1,2,3,slant]
                     [--spoil whole,cut3,cut6,cut10,missing5]
A kind is a number of occupied depths or a surface of `simulate --surface`. cutP: the brightest P % of the values are cut to
one value; missingP: P % of the pixels are NaN. Needs NumPy and tifffile."""
import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy as np
import tifffile

here = pathlib.Path(__file__).resolve().parent
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=str(here.parent / "build" / "release"))
parser.add_argument("--preset", default="crop300")
parser.add_argument("--seed", default="5")
parser.add_argument("--frames", type=int, default=4)
parser.add_argument("--kinds", default="1,2,3,slant")
parser.add_argument("--spoil", default="whole,cut3,cut6,cut10,missing5")
o = parser.parse_args()


def run(*words):
    program = f"{o.build}/bindings/cli/hadalens"
    return subprocess.run([program, *map(str, words)], check=True, capture_output=True, text=True).stdout


def spoil(how, image):
    if how.startswith("cut"):
        return np.minimum(image, np.quantile(image, 1 - float(how[3:]) / 100).astype(image.dtype))
    if how.startswith("missing"):
        image = image.astype(np.float32)
        image[np.random.default_rng(7).random(image.shape[:2]) < float(how[7:]) / 100] = np.nan
    return image


def mean(rows, key):
    values = [row[key] for row in rows if row.get(key) is not None]
    return sum(values) / len(values) if values else float("nan")


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    design = ["--preset", o.preset, "--seed", o.seed, "--noise", "0.01"]
    run("simulate", *design, "-o", folder / "camera", "--pairs", 8, "--quiet")
    run("fit", folder / "camera", "-o", folder / "model", "--quiet")
    distances = np.array(json.loads((folder / "camera" / "camera.json").read_text())["distances_mm"])
    print("| kind | values | all-in-focus, dB | distances, steps | depths of each frame (S: a surface) |")
    print("|---|---|---|---|---|")
    for kind in o.kinds.split(","):
        scenes = folder / f"scenes-{kind}"
        how = ["--test-depths", kind] if kind.isdigit() else ["--surface", kind]
        run("simulate", *design, "-o", scenes, "--pairs", 1, "--test", o.frames, *how, "--quiet")
        for name in o.spoil.split(","):
            raw, out = folder / f"{kind}-{name}", folder / f"{kind}-{name}-out"
            raw.mkdir()
            for file in sorted((scenes / "test" / "raw").glob("*.tif")):
                image = spoil(name, tifffile.imread(file))
                tifffile.imwrite(raw / file.name, image, photometric="rgb" if image.ndim == 3 else "minisblack")
            report = json.loads(run("reconstruct", *sorted(raw.glob("*.tif")), "-m", folder / "model", "-o", out,
                                    "--no-preview", "--json", "--repair"))
            scores = json.loads(run("evaluate", out, scenes / "test" / "truth", "--json"))["files"]
            pictures = [row for row in scores if pathlib.Path(row["truth"]).stem.endswith("_aif")]
            maps = [row for row in scores if row["kind"] == "distance_map"]
            found = []
            for frame in (file["frames"][0] for file in report["files"]):
                near = sorted(int(np.argmin(abs(distances - mm))) for mm in frame["occupied_mm"])
                found.append("S" if frame.get("scene") == "surface" else " ".join(map(str, near)))
            print(f"| {kind} | {name} | {mean(pictures, 'psnr'):.2f} | {mean(maps, 'mean_error_steps'):.3f} | "
                  + "; ".join(found) + " |", flush=True)
