#!/usr/bin/env python3
"""Distance maps of scenes with dark parts: dark pixels that are called known, bright ones that are not, and the error of known
ones in depth steps, at three levels of noise, for frames that are taken for planes and for surfaces.
  perf/dark_maps.py HADALENS PHOTOGRAPHS [--seeds 2 3] CAMERA:MODEL...
CAMERA: a folder of `hadalens simulate` with psf.tif; MODEL: of it, by fit or fit --psf --colour. Run it with two programs
to compare them. Dark: farther than 6 pixels from light; bright: more than a tenth of the lit parts' mean. Needs NumPy,
tifffile, Pillow."""
import argparse
import json
import pathlib
import tempfile

import numpy as np
import tifffile
from numpy.lib.stride_tricks import sliding_window_view

import frames
from psf_only import NOISE
from sequence import photograph

KINDS = ("disk", "disks", "photographs", "three", "dim", "halves", "whole", "slant")


def box(image, radius):
    return sliding_window_view(np.pad(image, radius, mode="edge"), (2 * radius + 1,) * 2).mean((-1, -2))


def disk(size, y, x, r):
    rows, cols = np.mgrid[:size, :size] / size
    return ((rows - y) ** 2 + (cols - x) ** 2 < r * r).astype(float)


def make(kind, size, depths, photographs, seed):
    """{depth: (3, size, size)} and the depth of each pixel, NaN where it is dark."""
    near, middle, far = (int(z) for z in sorted(np.random.default_rng(seed).choice(depths, 3, replace=False)))
    photos = [photograph(photographs[(3 * seed + k) % len(photographs)], size) for k in range(3)]
    left = (np.mgrid[:size, :size][1] < size / 2).astype(float)
    if kind == "slant":
        mask, depth = disk(size, 0.5, 0.5, 0.38), np.linspace(0, depths - 1, size) * np.ones((size, 1))
        planes = {z: photos[0] * mask * np.clip(1 - abs(depth - z), 0, 1) for z in range(depths)}
        return planes, np.where(mask > 0, depth, np.nan)
    two = [(near, disk(size, 0.3, 0.33, 0.22)), (far, disk(size, 0.66, 0.68, 0.2))]
    parts = {"disk": [(middle, disk(size, 0.5, 0.5, 0.22))],
             "disks": [(near, disk(size, 0.35, 0.35, 0.17)), (far, disk(size, 0.65, 0.65, 0.17))],
             "photographs": two, "dim": two,
             "three": [(far, disk(size, 0.3, 0.3, 0.2)), (middle, disk(size, 0.7, 0.35, 0.18)),
                       (near, disk(size, 0.5, 0.75, 0.18))],
             "halves": [(near, left), (far, 1 - left)], "whole": [(middle, np.ones((size, size)))]}[kind]
    planes, truth = {}, np.full((size, size), np.nan)
    for k, (z, mask) in enumerate(parts):
        image = np.full_like(photos[k], 0.9 - 0.2 * k) if kind.startswith("disk") else photos[k]
        planes = {other: light * (1 - mask) for other, light in planes.items()}
        planes[z] = image * mask * (0.15 if kind == "dim" and k else 1.0)
        truth[mask > 0] = z
    return planes, truth


def otfs(folder, circular):
    with tifffile.TiffFile(folder / "psf.tif") as file:
        psf, lines = file.asarray().astype(float), file.pages[0].description.splitlines()
    distances = [float(d) for d in dict(line.split("=", 1) for line in lines if "=" in line)["distances_mm"].split(",")]
    rows, cols = psf.shape[-2:]
    grid = (rows, cols) if circular else (2 * rows, 2 * cols)
    whole = np.zeros((len(psf), *grid))
    at = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid, (rows, cols)))
    whole[(slice(None), *at)] = psf
    return np.fft.rfft2(np.fft.ifftshift(whole, axes=(1, 2))), grid, at, distances


def score(name, folder, planes, truth, distances):
    """Shares of dark pixels that are known and of bright ones that are not, and the error, NaN where there are none."""
    inverse = 1 / np.array(distances)
    found = tifffile.imread(folder / f"{name}_depth.tif").astype(float)
    known = np.isfinite(found)
    found[known] = np.interp(1 / found[known], inverse[::-1], np.arange(len(distances))[::-1])
    scene = sum(planes.values()).mean(0)
    light = box(scene, 2)
    dark = box((scene > 0.004).astype(float), 6) == 0
    bright = (light > 0.1 * light[np.isfinite(truth)].mean()) & np.isfinite(truth)
    both = known & np.isfinite(truth)
    return (known[dark].mean() if dark.sum() > 50 else np.nan, (~known)[bright].mean(),
            abs(found - truth)[both].mean() if both.any() else np.nan)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("cameras", nargs="+")
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 3])
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    table = {}
    for camera in arguments.cameras:
        folder, model = (pathlib.Path(part) for part in camera.split(":"))
        with open(model, "rb") as file:  # safetensors
            said = json.loads(file.read(int.from_bytes(file.read(8), "little")))["__metadata__"]
        otf, grid, sensor, distances = otfs(folder, said["boundary"] == "circular")
        size = int(said["window"].split("x")[0])
        with tempfile.TemporaryDirectory() as temporary:
            out, todo = pathlib.Path(temporary), {}
            for kind, noise, seed in [(k, n, s) for k in KINDS for n in NOISE for s in arguments.seeds]:
                planes, truth = make(kind, size, len(distances), photographs, seed)
                spectrum = 0
                for z, light in planes.items():
                    whole, at = np.zeros((3, *grid)), [(n - size) // 2 for n in grid]
                    whole[:, at[0]:at[0] + size, at[1]:at[1] + size] = light
                    spectrum = spectrum + np.fft.rfft2(whole) * otf[z]
                frame = np.fft.irfft2(spectrum, s=grid)[(slice(None), *sensor)]
                frame += noise * frame.max() * np.random.default_rng(seed).standard_normal(frame.shape)
                name = f"{kind}_{noise}_{seed}"
                tifffile.imwrite(out / f"{name}.tif", np.moveaxis(frame, 0, -1).astype(np.float32), photometric="rgb")
                todo[name] = (noise, planes, truth)
            report = json.loads(frames.run(arguments.hadalens, "reconstruct", *(out / f"{name}.tif" for name in todo), "-m",
                                           model, "-o", out / "out", "--no-preview", "--json"))
            for (name, (noise, planes, truth)), row in zip(todo.items(), report["files"]):
                scores = score(name, out / "out", planes, truth, distances)
                table.setdefault((row["frames"][0]["scene"], noise), []).append(scores)
    print("| taken for | noise | frames | dark, known | bright, unknown | error, steps |\n|---|---|---|---|---|---|")
    for (scene, noise), rows in sorted(table.items()):
        known, unknown, error = np.nanmean(np.array(rows), 0)
        print(f"| {scene} | {noise} | {len(rows)} | {known:.1%} | {unknown:.2%} | {error:.3f} |")


if __name__ == "__main__":
    main()
