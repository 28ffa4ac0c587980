#!/usr/bin/env python3
"""Sensors with a colour filter mosaic: frames of one channel (--bayer rggb) beside those that have every colour at every
pixel, and beside frames that were demosaiced by bilinear interpolation first. PSNR of five photographs, at each level of
noise, with a camera that is known by its point spread function, and one that is learned from pairs of the same
kind, which show the OTHERS.
  perf/mosaic.py HADALENS PHOTOGRAPHS [OTHERS] [--seeds 3 7] [--pairs 12] [--boundary padded|circular] [--options=--refine-tv 1e-3]
The camera and the frames are those of psf_only.py. Needs NumPy, SciPy, tifffile, Pillow."""
import argparse
import pathlib
import tempfile

import numpy as np
import scipy.ndimage
import tifffile

import frames
from psf_only import GRID, SHAPE, WINDOW, load, optics, psnr, save, see

NOISE = (0.003, 0.01)
KINDS = ("colours", "demosaiced", "mosaic")
KERNEL = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


def mask():
    """Of each channel, (3, rows, cols): 1 at its pixels. R G in even rows, G B in odd ones."""
    held = np.zeros((3, *SHAPE))
    held[0, ::2, ::2] = held[1, ::2, 1::2] = held[1, 1::2, ::2] = held[2, 1::2, 1::2] = 1
    return held


def save_frame(folder, name, frame):
    """In all three kinds."""
    held = mask()
    path = {kind: folder / kind / name for kind in KINDS}
    save(path["colours"], frame.astype(np.float32))
    sums, weights = (
        np.stack([scipy.ndimage.convolve(channel, KERNEL, mode="constant") for channel in image])
        for image in (frame * held, held)
    )
    save(path["demosaiced"], (sums / weights).astype(np.float32))
    path["mosaic"].parent.mkdir(parents=True, exist_ok=True)
    tifffile.imwrite(path["mosaic"], (frame * held).sum(0).astype(np.float32), photometric="minisblack")


def expose(scene, otf, grid, noise, seed):
    clean = see(scene, grid, otf)
    return clean + noise * clean.max() * np.random.default_rng(seed).standard_normal(clean.shape)


def make(folder, seed, photographs, others, pairs, grid):
    """PSF, test frames and pairs of one level of noise each; returns the test scenes."""
    otf = optics(folder, seed, grid)
    scenes = [load(photographs[(k + seed) % len(photographs)]) for k in range(5)]
    for noise in NOISE:
        for k, scene in enumerate(scenes):
            save_frame(folder / f"test{noise}", f"f{k}.tif", expose(scene, otf, grid, noise, k))
        for k in range(pairs):
            scene = load(others[(k + seed) % len(others)])
            save_frame(folder / f"pairs{noise}", f"z100mm/raw/p{k}.tif", expose(scene, otf, grid, noise, 100 + k))
            for kind in KINDS:
                save(folder / f"pairs{noise}" / kind / f"z100mm/scene/p{k}.tif",
                     np.moveaxis(scene, -1, 0).astype(np.float32))
    return scenes


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("others", type=pathlib.Path, nargs="?")
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 7])
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--boundary", choices=GRID, default="padded")
    parser.add_argument("--options", default="", help="further ones of reconstruct")
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    others = sorted(arguments.others.glob("*.tif")) if arguments.others else []
    pairs = arguments.pairs if others else 0
    print("| camera | known by | noise |" + "".join(f" {kind} |" for kind in KINDS) + "\n|" + "---|" * (len(KINDS) + 3))
    for seed in arguments.seeds:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            scenes = make(folder, seed, photographs, others, pairs, GRID[arguments.boundary])
            psf = ["--psf", folder / "psf.tif", "--distances", "100", "--window", f"{WINDOW}x{WINDOW}", "--boundary",
                   arguments.boundary]
            for source in ["PSF", *([f"{pairs} pairs"] if pairs else [])]:
                for noise in NOISE:
                    row = []
                    for kind in KINDS:
                        bayer = ["--bayer", "rggb"] if kind == "mosaic" else []
                        model, out = folder / "camera.model", folder / "out"
                        data = psf if source == "PSF" else [folder / f"pairs{noise}" / kind]
                        frames.run(arguments.hadalens, "fit", *data, *bayer, "-o", model)
                        files = sorted((folder / f"test{noise}" / kind).glob("*.tif"))
                        options = arguments.options.split()
                        frames.reconstruct(arguments.hadalens, files, model, out, options)
                        row.append(f" {psnr(out, scenes, False):.2f} dB |")
                    print(f"| {seed} | {source} | {noise} |" + "".join(row), flush=True)


if __name__ == "__main__":
    main()
