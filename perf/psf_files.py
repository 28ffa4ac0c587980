#!/usr/bin/env python3
"""Point spread functions as people have them: PSNR of five photographs (0.5 % noise) with each over that with the right
one; cameras of 29 lenses and of a diffuser, 300 x 400 pixels. Then depths that are made from one PSF, or two, by the law of
magnification, against those measured at each: `hadalens simulate`, presets and masks as given.
  perf/psf_files.py HADALENS PHOTOGRAPHS [--depths-only]
Needs NumPy, SciPy, tifffile, Pillow."""
import argparse
import json
import pathlib
import tempfile

import numpy as np
import tifffile
from scipy.ndimage import gaussian_filter

import frames
import psf_only

GRID, SHAPE, WINDOW = psf_only.GRID["padded"], psf_only.SHAPE, psf_only.WINDOW
NOISE, REACH, SMOOTH = 0.005, 110, 14


def diffuser(seed):
    """What rays make behind a random smooth surface, (3, rows, cols), sum 1 a channel."""
    side, fine = 2 * REACH * 4, 4
    height = gaussian_filter(np.random.default_rng(seed).standard_normal((side, side)), SMOOTH * fine)
    down, right = np.gradient(height)
    bend = SMOOTH * fine * 0.55 / np.std(down)
    y, x = np.mgrid[:side, :side] - side / 2
    inside = np.hypot(y, x) < side / 2
    channels = []
    for c in range(3):
        scale = (1 + 0.004 * (c - 1)) / fine
        places = [(scale * (at + bend * slope))[inside] + n // 2 + 0.5 for at, slope, n in ((y, down, GRID[0]), (x, right, GRID[1]))]
        image = gaussian_filter(np.histogram2d(*places, bins=GRID, range=((0, GRID[0]), (0, GRID[1])))[0], 0.8)
        channels.append(image / image.sum())
    return np.stack(channels)


def clipped(image, share):
    """Cut off so that pixels at white hold this share of the light that is left."""
    low, high = 0.0, image.max()
    for _ in range(50):
        level = (low + high) / 2
        cut = np.minimum(image, level)
        low, high = (level, high) if cut[cut >= level].sum() > share * cut.sum() else (low, level)
    return np.minimum(image, high) / high


def variants(whole):
    """Name, image (3 or 1, rows, cols), options of fit."""
    right = whole[psf_only.middle(GRID, *SHAPE)] / whole.max()
    random = np.random.default_rng(1)

    def taken(noise, captures=1):
        return [right + 0.1 + noise * random.standard_normal(right.shape) for _ in range(captures)]
    frame = ["--frame", f"{SHAPE[0]}x{SHAPE[1]}"]
    small = psf_only.middle(GRID, 262, 266)
    yield "right", [right], ["--psf-dark", "0"]
    yield "cut to 262 x 266", [whole[small] / whole.max()], frame
    yield "432 x 540", [whole / whole.max()], frame
    yield "turned by 180 degrees, --turn 180", [np.roll(right[:, ::-1, ::-1], (1, 1), (1, 2))], ["--turn", "180"]
    yield "grey", [right.mean(0, keepdims=True)], ["--colour"]
    for share in (0.02, 0.05, 0.1, 0.2, 0.3, 0.5):
        yield f"{100 * share:.0f} % of the light at white", [clipped(right, share)], ["--psf-dark", "0"]
    for noise in (0.002, 0.01, 0.03):
        yield f"background 0.1, noise {noise}", taken(noise), []
        yield f"background 0.1, noise {noise}, first percentile off", taken(noise), ["--psf-gate", "0"]
    for noise in (0.002, 0.01):
        values = np.clip(right + noise * random.standard_normal(right.shape), 0, 1)
        yield f"noise {noise}, cut off at black", [values], []
        yield f"noise {noise}, cut off at black, 8 bits", [np.round(255 * values)], []
    yield "background 0.1, four captures of noise 0.01", taken(0.01, 4), []


def files(hadalens, photographs):
    for name, make, seed in (("lenses", lambda s: psf_only.lenses(s, GRID), 3), ("diffuser", diffuser, 3)):
        psf_only.NOISE, psf_only.lenses, kept = (NOISE,), (lambda s, g: make(s)), psf_only.lenses
        with tempfile.TemporaryDirectory() as temporary:
            folder = pathlib.Path(temporary)
            whole = kept(seed, GRID) if name == "lenses" else make(seed)
            psf_only.lenses = lambda s, g: whole
            scenes = psf_only.make(folder, seed, photographs, GRID)
            psf_only.lenses = kept
            print(f"| {name} | dB |\n|---|---|")
            for what, images, options in variants(whole):
                paths = [folder / f"taken{k}.tif" for k in range(len(images))]
                for path, image in zip(paths, images):
                    tifffile.imwrite(path, np.squeeze(np.moveaxis(image, 0, -1)).astype(np.float32))
                frames.run(hadalens, "fit", "--psf", *paths, "--window", f"{WINDOW}x{WINDOW}", *options, "-o", folder / "m")
                frames.reconstruct(hadalens, sorted((folder / f"{NOISE}").glob("*.tif")), folder / "m", folder / "out", [])
                print(f"| {what} | {psf_only.psnr(folder / 'out', scenes, True):.2f} |", flush=True)


def depths(hadalens, photographs, preset, mask):
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        frames.run(hadalens, "simulate", "--preset", preset, "--mask", mask, "--scenes", photographs, "--depths", 4, "--pairs", 3,
                   "--noise", NOISE, "-o", folder / "set")
        camera = json.loads((folder / "set" / "camera.json").read_text())
        near, far = camera["distances_mm"][0], camera["distances_mm"][-1]
        pages, listed = tifffile.imread(folder / "set" / "psf.tif"), ",".join(map(str, camera["distances_mm"]))
        size = ["--window", f"{camera['window_rows']}x{camera['window_cols']}", "--boundary", camera["boundary"]]
        ways = {"all measured": (range(4), [])}
        ways |= {f"one, at {camera['distances_mm'][k]:.0f} mm": ([k], ["--mask-distance", camera["distance_mm"], "--psf-distance",
                                                                       camera["distances_mm"][k]]) for k in (0, 2)}
        ways["two, the law from them"] = ([0, 3], ["--psf-distance", f"{near},{far}"])
        for way, (kept, options) in ways.items():
            tifffile.imwrite(folder / "psf.tif", pages[list(kept)], photometric="minisblack")
            frames.run(hadalens, "fit", "--psf", folder / "psf.tif", "--colour", "--distances", listed, *options, *size, "-o", folder / "m")
            row = []
            for z, raws in enumerate(sorted((folder / "set").glob("z*mm"), key=lambda path: float(path.name[1:-2]))):
                frames.reconstruct(hadalens, sorted((raws / "raw").glob("*.tif")), folder / "m", folder / "out", ["--occupied", z + 1])
                table = frames.run(hadalens, "evaluate", folder / "out", raws / "scene", "--match-gain", "--json")
                row.append(np.mean([one["psnr"] for one in json.loads(table)["files"]]))
            print(f"| {preset}, {mask} | {way} |" + "".join(f" {value:.2f} |" for value in row), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("--depths-only", action="store_true")
    arguments = parser.parse_args()
    if not arguments.depths_only:
        files(arguments.hadalens, sorted(arguments.photographs.glob("*.tif")))
    print("| camera | PSFs | dB at each of four depths ||||\n|---|---|---|---|---|---|")
    for preset, mask in (("sim300", "aperture"), ("sim300", "contour"), ("sim300", "diffuser"), ("sim300", "mla")):
        depths(arguments.hadalens, arguments.photographs, preset, mask)


if __name__ == "__main__":
    main()
