#!/usr/bin/env python3
"""Cameras that are known by their point spread function alone: five photographs each at three levels of noise, and with
saturated pixels; PSNR with the weight of total variation that the frame chooses and with given ones, by refinement or a classic method.
  perf/psf_only.py HADALENS PHOTOGRAPHS [--seeds 3 7] [--boundary padded|circular]
                   [--weights 0 1e-2 3e-3 1e-3 3e-4 1e-4] [--method fista|admm]
The camera: 29 lenses, 300 x 400 pixels, colours, a sensor that crops (or light that wraps around), a window of 120 x 120. Noise is Gaussian, in parts of
the brightest pixel. Saturated: cut at 0.6 of it, 16 bits. Needs NumPy, tifffile, Pillow."""
import argparse
import pathlib
import tempfile

import numpy as np
import tifffile
from PIL import Image

import frames

SHAPE, WINDOW, LENSES = (300, 400), 120, 29
GRID = {"padded": (432, 540), "circular": SHAPE}  # light beyond the sensor is lost, or wraps around
NOISE = (0.002, 0.01, 0.04)


def middle(grid, rows, cols):
    """Of images on the grid, (channels, rows, cols)."""
    return (slice(None), *(slice((n - size) // 2, (n - size) // 2 + size) for n, size in zip(grid, (rows, cols))))


def lenses(seed, grid):
    """A point spread function on the grid, (3, rows, cols), sum 1 a channel: spots that keep apart, slightly coloured."""
    random, places, apart = np.random.default_rng(seed), [], 26.0
    while len(places) < LENSES:
        place = random.uniform(-125, 125, 2)
        apart *= 0.9999
        if np.hypot(*place) <= 125 and all(np.hypot(*(place - other)) > apart for other in places):
            places.append(place)
    y, x = np.mgrid[:grid[0], :grid[1]].astype(float)
    y, x = y - grid[0] // 2, x - grid[1] // 2
    channels = []
    for c in range(3):
        scale, sigma = 1 + 0.004 * (c - 1), 0.8 + 0.1 * c
        spots = sum(np.exp(-((x - scale * a) ** 2 + (y - scale * b) ** 2) / (2 * sigma**2)) for a, b in places)
        channels.append(spots / spots.sum())
    return np.stack(channels)


def save(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    tifffile.imwrite(path, np.ascontiguousarray(np.moveaxis(image, 0, -1)), photometric="rgb")


def optics(folder, seed, grid):
    """PSF as a file; returns its transfer function."""
    psf = lenses(seed, grid)
    save(folder / "psf.tif", (psf[middle(grid, *SHAPE)] / psf.max()).astype(np.float32))
    return np.fft.rfft2(np.fft.ifftshift(psf, axes=(1, 2)))


def fit(hadalens, folder, *options):
    """A model of the camera whose PSF is in the folder."""
    model = folder / "camera.model"
    frames.run(hadalens, "fit", "--psf", folder / "psf.tif", "--distances", "100", "--window", f"{WINDOW}x{WINDOW}",
               *options, "-o", model)
    return model


def load(path):
    """A photograph in the size of the window, (rows, cols, 3)."""
    return np.asarray(Image.fromarray(tifffile.imread(path)).resize((WINDOW, WINDOW), Image.LANCZOS)) / 255


def see(scene, grid, otf):
    """What the sensor has of a scene, without noise, (3, rows, cols)."""
    light = np.zeros((3, *grid))
    light[middle(grid, WINDOW, WINDOW)] = np.moveaxis(scene, -1, 0)
    return np.fft.irfft2(np.fft.rfft2(light) * otf, s=grid)[middle(grid, *SHAPE)]


def make(folder, seed, photographs, grid):
    """PSF and frames as files; returns the scenes, (rows, cols, 3)."""
    otf, scenes = optics(folder, seed, grid), []
    for k in range(5):
        scene = load(photographs[(k + seed) % len(photographs)])
        scenes.append(scene)
        clean = see(scene, grid, otf)
        random = np.random.default_rng(k).standard_normal(clean.shape)
        for noise in NOISE:
            save(folder / f"{noise}" / f"f{k}.tif", (clean + noise * clean.max() * random).astype(np.float32))
        seen = (clean + 0.005 * clean.max() * random) / clean.max()
        for name, full in (("whole", 1.1), ("saturated", 0.6)):
            save(folder / name / f"f{k}.tif", (np.clip(seen / full, 0, 1) * 65535).round().astype(np.uint16))
    return scenes


def psnr(folder, scenes, scaled):
    found = []
    for k, scene in enumerate(scenes):
        image = frames.picture(next(folder.glob(f"f{k}_*aif*.tif")))
        scale = (image * scene).sum() / (image**2).sum() if scaled else 1.0
        found.append(-10 * np.log10(np.mean((np.clip(scale * image, 0, 1) - scene) ** 2)))
    return np.mean(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 7])
    parser.add_argument("--weights", nargs="*", default=["0", "1e-2", "3e-3", "1e-3", "3e-4", "1e-4"])
    parser.add_argument("--boundary", choices=GRID, default="padded")
    parser.add_argument("--method", choices=["fista", "admm"])
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    sets = [str(noise) for noise in NOISE] + ["whole", "saturated"]
    print("| camera | weight |" + "".join(f" {name} |" for name in sets) + "\n|" + "---|" * (len(sets) + 2))
    for seed in arguments.seeds:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            scenes = make(folder, seed, photographs, GRID[arguments.boundary])
            model, out = fit(arguments.hadalens, folder, "--boundary", arguments.boundary), folder / "out"
            for weight in ["frame", *arguments.weights]:
                row = []
                for part in sets:
                    options = ["--refine-tv", weight, "--refine-colour", "1.5", "--refine-ridge", "1"]
                    if arguments.method:
                        options = ["--method", arguments.method, "--tv", "auto" if weight == "frame" else weight]
                    files = sorted((folder / part).glob("*.tif"))
                    seconds = frames.reconstruct(arguments.hadalens, files, model, out, options)
                    row.append(f" {psnr(out, scenes, part in ('whole', 'saturated')):.2f} dB, {seconds:.2f} s |")
                print(f"| {seed} | {weight} |" + "".join(row), flush=True)


if __name__ == "__main__":
    main()
