#!/usr/bin/env python3
"""What weights of pixels gain where noise differs between them: vignetting that leaves 30 % of the light in the corners, and
shot noise of 500 electrons at the brightest pixel. PSNR of five photographs on each camera of perf/psf_only.py (cropping).
  perf/pixel_noise.py HADALENS PHOTOGRAPHS [--seeds 3 7] [--methods model admm]
flat: a constant noise, in parts of the brightest pixel; the frame as it is, divided by the gain g of its pixels, and
besides weighted by g^2, for after the division the variance is 1 / g^2. shot: Poisson, and 2 electrons of read noise;
as it is, and weighted by the inverse of the variance, from the recorded values (mean of 3 x 3) or from the true ones.
both: divided, and besides weighted. Needs NumPy, tifffile, Pillow."""
import argparse
import pathlib
import tempfile

import numpy as np

import frames
from psf_only import GRID, SHAPE, fit, load, optics, save, see

ELECTRONS, READ, EDGE = 500, 2, 0.3


def fall_off():
    y, x = np.mgrid[:SHAPE[0], :SHAPE[1]]
    r = np.hypot((y - SHAPE[0] / 2) / SHAPE[0], (x - SHAPE[1] / 2) / SHAPE[1]) / np.sqrt(0.5)
    return 1 - (1 - EDGE) * r**2


def smooth(image):
    padded = np.pad(image, ((0, 0), (1, 1), (1, 1)), mode="edge")
    return sum(padded[:, i:i + SHAPE[0], j:j + SHAPE[1]] for i in range(3) for j in range(3)) / 9


def variance(light):
    """Of a value, light being in parts of the brightest pixel."""
    return (READ**2 + ELECTRONS * np.clip(light, 0, None)) / ELECTRONS**2


def cases(clean, random):
    """Name -> frame, weights or None; the brightest pixel is 1."""
    g, one = fall_off()[None], np.ones(SHAPE)[None]
    normal = random.standard_normal(clean.shape)

    def shot(light):
        return (random.poisson(ELECTRONS * light) + READ * normal) / ELECTRONS
    found = {}
    for noise in (0.002, 0.01, 0.04):
        frame = g * clean + noise * normal
        found |= {f"flat {noise}, as it is": (frame, None), f"flat {noise}, divided": (frame / g, None),
                  f"flat {noise}, divided, weighted": (frame / g, g**2 * one)}
    frame = shot(clean)
    found |= {"shot, as it is": (frame, None), "shot, weighted": (frame, 1 / variance(smooth(frame))),
              "shot, true weights": (frame, 1 / variance(clean))}
    frame = shot(g * clean)
    found |= {"both, divided": (frame / g, None), "both, weighted": (frame / g, g**2 / variance(smooth(frame))),
              "both, weighted by g^2": (frame / g, g**2 * one), "both, by g": (frame / g, g * one)}
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 7])
    parser.add_argument("--methods", nargs="+", default=["model"])
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    grid, table = GRID["padded"], {}
    for seed in arguments.seeds:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            otf = optics(folder, seed, grid)
            model, out = fit(arguments.hadalens, folder), folder / "out"
            for k in range(5):
                scene = load(photographs[(k + seed) % len(photographs)])
                clean = see(scene, grid, otf).clip(0)
                largest = clean.max()
                for case, (frame, weights) in cases(clean / largest, np.random.default_rng(k)).items():
                    save(folder / "f.tif", frame.astype(np.float32))
                    options = []
                    if weights is not None:
                        save(folder / "weights.tif", np.broadcast_to(weights / weights.max(), frame.shape).astype(np.float32))
                        options = ["--weights", folder / "weights.tif"]
                    for method in arguments.methods:
                        own = [] if method == "model" else ["--method", method, "--prior", "tv"]
                        frames.reconstruct(arguments.hadalens, [folder / "f.tif"], model, out, [*options, *own])
                        image = largest * frames.picture(next(out.glob("*aif*.tif")))
                        scale = (image * scene).sum() / (image**2).sum()
                        found = -10 * np.log10(np.mean((np.clip(scale * image, 0, 1) - scene) ** 2))
                        table.setdefault((case, method, seed), []).append(found)
    print("| frames |" + "".join(f" {m}, camera {s} |" for m in arguments.methods for s in arguments.seeds))
    print("|---|" + "---|" * len(arguments.methods) * len(arguments.seeds))
    for case in dict.fromkeys(key[0] for key in table):
        print(f"| {case} |" + "".join(f" {np.mean(table[case, m, s]):.2f} dB |" for m in arguments.methods for s in arguments.seeds))


if __name__ == "__main__":
    main()
