#!/usr/bin/env python3
"""Cameras that are not simulated by Hadalens: a ray-traced diffuser, whose point spread function of caustics covers little or much of
the sensor; the sensor crops, has shot and read noise, 12 bits in files of 16, and a dark level of 2 %. PSNR in dB of three frames of
other photographs, encoded as these are, a common gain taken off, of the default fit and of one that is told what it has to find.
   perf/caustics.py HADALENS PHOTOGRAPHS OTHER_PHOTOGRAPHS [--spreads 0.18,0.26,0.35] [--pairs 10] [--seed 2]
spread: of the envelope, as a share of the sensor's sides doubled. Needs NumPy, SciPy, Pillow and tifffile."""
import argparse
import pathlib
import tempfile

import numpy as np
import tifffile
from frames import run
from PIL import Image
from scipy import ndimage, signal

ROWS, COLS = 240, 320
WINDOW = (120, 160)
FULL_WELL, READ_NOISE, DARK, BITS = 8000, 4, 0.02, 4095
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("hadalens", type=pathlib.Path)
parser.add_argument("photographs", type=pathlib.Path)
parser.add_argument("others", type=pathlib.Path)
parser.add_argument("--spreads", default="0.18,0.26,0.35")
parser.add_argument("--pairs", type=int, default=10)
parser.add_argument("--seed", type=int, default=2)
o = parser.parse_args()


def light_of(values):
    return np.where(values > 0.04045, ((values + 0.055) / 1.055) ** 2.4, values / 12.92)


def photograph(path):
    return np.asarray(Image.open(path).convert("RGB").resize(WINDOW[::-1], Image.Resampling.LANCZOS))


def caustics(spread, seed):
    """Where rays land that a random smooth surface bends, on twice the sensor, dimmed towards the borders; sum 1."""
    rows, cols = 2 * ROWS, 2 * COLS
    slope = np.stack(np.gradient(ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal((rows, cols)), 9, mode="wrap")))
    slope *= 6 / np.sqrt((slope**2).sum(0).mean())
    at = np.mgrid[0:rows:0.25, 0:cols:0.25] + ndimage.zoom(slope, (1, 4, 4), order=1)
    psf = np.histogram2d(at[0].ravel(), at[1].ravel(), bins=(rows, cols), range=((0, rows), (0, cols)))[0]
    away = [((np.arange(n) - n // 2) / (spread * n)) ** 2 for n in (rows, cols)]
    psf = ndimage.gaussian_filter(psf * np.exp(-((away[0][:, None] + away[1]) ** 3)), 0.7)
    return psf / psf.sum()


def frames_of(paths, psf):
    """Linear frames of the sensor in light, before noise."""
    top, left = psf.shape[0] // 2 - (ROWS - WINDOW[0]) // 2, psf.shape[1] // 2 - (COLS - WINDOW[1]) // 2
    for path in paths:
        light = light_of(photograph(path) / 255)
        full = np.stack([signal.fftconvolve(light[..., c], psf) for c in range(3)], -1)
        yield path, full[top : top + ROWS, left : left + COLS]


def expose(light, chance):
    electrons = chance.poisson(np.maximum(light, 0) * FULL_WELL) + chance.normal(0, READ_NOISE, light.shape)
    counts = np.clip(np.round((electrons / FULL_WELL * (1 - DARK) + DARK) * BITS), 0, BITS)
    return (counts * (65535 / BITS)).astype(np.uint16)


def make(folder, psf):
    learned = sorted(o.photographs.glob("*.tif"))[: o.pairs]
    tested = sorted(o.others.glob("*.tif"))[:3]
    chance = np.random.default_rng(o.seed + 1)
    every = list(frames_of(learned + tested, psf))
    gain = 0.8 / max(frame.max() for _, frame in every)
    for number, (path, frame) in enumerate(every):
        raws = folder / ("z100mm/raw" if number < len(learned) else "test")
        scenes = folder / ("z100mm/scene" if number < len(learned) else "truth")
        raws.mkdir(parents=True, exist_ok=True)
        scenes.mkdir(parents=True, exist_ok=True)
        tifffile.imwrite(raws / path.name, expose(gain * frame, chance), photometric="rgb")
        tifffile.imwrite(scenes / path.name, photograph(path), photometric="rgb")


def measure(folder, *options):
    model, out = folder / "camera.model", folder / "out"
    run(o.hadalens, "fit", folder, "-o", model, "-q", *options)
    run(o.hadalens, "reconstruct", *sorted((folder / "test").iterdir()), "-m", model, "-o", out, "--no-preview", "-q")
    values = []
    for path in sorted((folder / "truth").iterdir()):
        found, truth = tifffile.imread(out / f"{path.stem}_aif.tif"), tifffile.imread(path) / 255
        found = found * (found * truth).sum() / (found**2).sum()
        values.append(-10 * np.log10(((found - truth) ** 2).mean()))
    return " / ".join(f"{v:.1f}" for v in values)


print("| spread | default | --dark 0.02 | --dark 0.02 --frame-encoding linear --scene-response srgb --exposure same |\n|---|---|---|---|")
for spread in o.spreads.split(","):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        make(folder, caustics(float(spread), o.seed))
        told = ["--dark", DARK, "--frame-encoding", "linear", "--scene-response", "srgb", "--exposure", "same"]
        row = [measure(folder), measure(folder, *told[:2]), measure(folder, *told)]
        print(f"| {spread} | " + " | ".join(row) + " |", flush=True)
