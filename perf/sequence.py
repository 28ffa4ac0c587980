#!/usr/bin/env python3
"""Sequences of ten frames through a camera that is known by its PSF alone: decibels and seconds a frame with a weight of
total variation that each frame finds, and with the one that is kept. Moving: a photograph that moves by 3 pixels a
frame; photographs: ten different ones, which should not keep it.
  perf/sequence.py HADALENS PHOTOGRAPHS [--seed 7] [--boundary padded|circular] [--scenes 0 1]
The camera, and noise, are those of psf_only.py. Needs NumPy, tifffile, Pillow."""
import argparse
import json
import pathlib
import tempfile

import numpy as np
import tifffile
from PIL import Image

import frames
from psf_only import GRID, NOISE, WINDOW, fit, optics, see

FRAMES = 10


def photograph(path, size):
    return np.moveaxis(np.asarray(Image.fromarray(tifffile.imread(path)).resize((size, size), Image.LANCZOS)), -1, 0) / 255


def moving(photographs, number):
    image = photograph(photographs[3 * number % len(photographs)], WINDOW * 3 // 2)
    return [image[:, 10 + 3 * t // 2:10 + 3 * t // 2 + WINDOW, 8 + 3 * t:8 + 3 * t + WINDOW] for t in range(FRAMES)]


def different(photographs, number):
    return [photograph(photographs[(t + number) % len(photographs)], WINDOW) for t in range(FRAMES)]


def expose(scene, otf, grid, noise, seed):
    clean = see(np.moveaxis(scene, 0, -1), grid, otf)
    return (clean + noise * clean.max() * np.random.default_rng(seed).standard_normal(clean.shape)).astype(np.float32)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--scenes", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--boundary", choices=GRID, default="padded")
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    photographs = photographs[arguments.seed % len(photographs):] + photographs[:arguments.seed % len(photographs)]
    grid = GRID[arguments.boundary]
    print("| scenes | noise | each frame | kept | lost, most | kept by |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        out, file, otf = folder / "out", folder / "f.tif", optics(folder, arguments.seed, grid)
        model = fit(arguments.hadalens, folder, "--boundary", arguments.boundary)
        for kind in (moving, different):
            for noise in NOISE:
                found = {"frame": [], "auto": []}  # decibels, seconds, kept
                for number in arguments.scenes:
                    scenes = kind(photographs, number)
                    seen = [expose(s, otf, grid, noise, t + 100 * number) for t, s in enumerate(scenes)]
                    tifffile.imwrite(file, np.moveaxis(np.stack(seen), 1, -1), photometric="rgb")
                    for way, rows in found.items():
                        report = json.loads(frames.run(arguments.hadalens, "reconstruct", file, "-m", model, "-o", out,
                                                       "--no-preview", "--json", "--refine-tv", way))
                        images = np.moveaxis(tifffile.imread(out / "f_aif.tif").astype(float), -1, 1)
                        rows += [(-10 * np.log10(np.mean((np.clip(image, 0, 1) - scene) ** 2)), frame["seconds"]["total"],
                                  frame["refine_tv_kept"])
                                 for image, scene, frame in zip(images, scenes, report["files"][0]["frames"])]
                each, kept = np.array(found["frame"]), np.array(found["auto"])
                lost = each[:, 0] - kept[:, 0]
                print(f"| {kind.__name__} | {noise} | {each[:, 0].mean():.2f} dB, {each[:, 1].mean():.2f} s | "
                      f"{kept[:, 0].mean():.2f} dB, {kept[:, 1].mean():.2f} s | {lost.mean():.2f}, {lost.max():.2f} dB | "
                      f"{kept[:, 2].mean():.0%} |", flush=True)


if __name__ == "__main__":
    main()
