#!/usr/bin/env python3
"""Pairs that spoil a fit: the first pairs of each depth are made unfit, and held-out frames are reconstructed with models of
all pairs (--all-pairs), of those that the fit keeps, and of the sound ones alone.
   perf/spoiled_pairs.py HADALENS PHOTOGRAPHS OTHER_PHOTOGRAPHS [--preset sim300] [--seeds 81,82] [--pairs 8] [--noise 0.01]
                         [--response srgb] [--mask mla]
cut: three times the exposure, cut off at 60 % of its values (2 pairs). swapped: the frame of another scene (2 pairs).
other: a scene that is not in the data set (1 pair). moved: the scene moved by 12 pixels (1 pair). white: scene and frame
exposed longer, a quarter of the scene at white (2 pairs). PSNR of the all-in-focus image in dB; pairs left out, right and
wrong. Needs NumPy and tifffile."""
import argparse
import json
import pathlib
import shutil
import tempfile

import numpy as np
import tifffile
from frames import run

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("hadalens", type=pathlib.Path)
parser.add_argument("photographs")
parser.add_argument("others")
parser.add_argument("--preset", default="sim300")
parser.add_argument("--seeds", default="81,82")
parser.add_argument("--pairs", type=int, default=8)
parser.add_argument("--noise", default="0.01")
parser.add_argument("--response", default="srgb")
parser.add_argument("--mask", default="mla")
parser.add_argument("--kinds", default="none,cut,swapped,other,moved,white")
o = parser.parse_args()
KINDS = {"none": 0, "cut": 2, "swapped": 2, "other": 1, "moved": 1, "white": 2}


def spoil(kind, camera, spare, to):
    """Copy the data set with its first pairs spoilt; their names."""
    shutil.copytree(camera, to)
    names = set()
    for depth in sorted(to.glob("z*mm")):
        raws = sorted((depth / "raw").iterdir())
        frames = [tifffile.imread(raw) for raw in raws]
        for i in range(KINDS[kind]):
            scene = depth / "scene" / raws[i].name
            if kind == "cut":
                tifffile.imwrite(raws[i], np.minimum(3 * frames[i], np.quantile(3 * frames[i], 0.6)))
            elif kind == "swapped":
                tifffile.imwrite(raws[i], frames[1 - i])
            elif kind == "other":
                shutil.copyfile(sorted((spare / depth.name / "scene").iterdir())[0], scene)
            elif kind == "moved":
                tifffile.imwrite(scene, np.roll(tifffile.imread(scene), 12, axis=1))
            elif kind == "white":
                shown = tifffile.imread(scene)
                dtype = shown.dtype
                most = 1 if dtype.kind == "f" else np.iinfo(dtype).max
                shown = shown / most
                light = np.where(shown > 0.04045, ((shown + 0.055) / 1.055) ** 2.4, shown / 12.92)
                more = 1 / np.quantile(light, 0.75)
                light = np.minimum(light * more, 1)
                shown = np.where(light > 0.0031308, 1.055 * light ** (1 / 2.4) - 0.055, 12.92 * light)
                tifffile.imwrite(scene, (shown * most + (0.5 if most > 1 else 0)).astype(dtype))
                tifffile.imwrite(raws[i], (frames[i] * more).astype(frames[i].dtype))
            names.add(f"{depth.name}/raw/{raws[i].name}")
    return names


def sound(names, data, to):
    shutil.copytree(data, to)
    for name in names:
        (to / name).unlink()
        (to / name.replace("/raw/", "/scene/")).unlink()


def judge(data, folder, *options):
    run(o.hadalens, "fit", data, "-o", folder / "m", "-q", *options)
    shutil.rmtree(folder / "out", ignore_errors=True)
    run(o.hadalens, "reconstruct", *sorted((folder / "camera/test/raw").iterdir()), "-m", folder / "m", "-o", folder / "out",
        "--no-preview", "-q")
    table = json.loads(run(o.hadalens, "evaluate", folder / "out", folder / "camera/test/truth", "--json"))
    return np.mean([f["psnr"] for f in table["files"] if f["result"].endswith("aif.tif")])


print("| seed | pairs | all | kept by the fit | sound ones | left out, of them sound |\n|---|---|---|---|---|---|")
for seed in o.seeds.split(","):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        design = ["--preset", o.preset, "--mask", o.mask, "--noise", o.noise, "--seed", seed, "--scene-response", o.response,
                  "--depths", 2, "--pairs", o.pairs, "-q"]
        run(o.hadalens, "simulate", *design, "--scenes", o.photographs, "--test-scenes", o.others, "--test", 4, "--test-depths", 1,
            "-o", folder / "camera")
        run(o.hadalens, "simulate", *design, "--scenes", o.others, "-o", folder / "spare")
        for kind in o.kinds.split(","):
            names = spoil(kind, folder / "camera", folder / "spare", folder / kind)
            clean = folder / f"{kind}-sound"
            sound(names, folder / kind, clean)
            report = json.loads(run(o.hadalens, "fit", folder / kind, "-o", folder / "m", "--json"))
            out = {pair.split(f"{kind}/", 1)[1] for pair in report["left_out"]}
            row = [judge(folder / kind, folder, "--all-pairs"), judge(folder / kind, folder), judge(clean, folder)]
            print(f"| {seed} | {kind} | " + " | ".join(f"{value:.2f}" for value in row) +
                  f" | {len(out & names)} of {len(names)}, {len(out - names)} |", flush=True)
