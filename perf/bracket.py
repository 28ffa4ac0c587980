#!/usr/bin/env python3
"""What exposures of one scene, merged, gain over each of them: PSNR of photographs with three lamps in them, on each camera of
perf/psf_only.py (cropping).
  perf/bracket.py HADALENS PHOTOGRAPHS [--seeds 3 7] [--count 3]
A lamp is LAMP times as bright as white, and 3 x 3 pixels large; it is left out of the PSNR. Exposures differ by 6 each; the
shortest saturates nothing. 8,000 electrons fill a pixel; read noise is 12, a dark pixel reads 0.03, values have 12 bits.
Merged without weights: the mean of all that does not saturate, by the squares of the lengths, made here. Needs NumPy,
tifffile, Pillow."""
import argparse
import pathlib
import tempfile

import numpy as np

import frames
from psf_only import GRID, WINDOW, fit, load, optics, save, see

WELL, READ, DARK, STEP, LAMP = 8000, 12, 0.03, 6.0, 60.0


def expose(light, length, random):
    electrons = random.poisson(WELL * length * light) + READ * random.standard_normal(light.shape)
    return np.round(np.clip(electrons / WELL + DARK, 0, 1) * 4095) / 4095


def merged(exposures, lengths):
    counts = [np.where(e < 0.99, length, 0) for e, length in zip(exposures, lengths)]
    return sum((e - DARK) * c for e, c in zip(exposures, counts)) / sum(c**2 for c in counts) + DARK


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 7])
    parser.add_argument("--count", type=int, default=3)
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    grid, table = GRID["padded"], {}
    for seed in arguments.seeds:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            otf = optics(folder, seed, grid)
            model, out = fit(arguments.hadalens, folder, "--dark", str(DARK)), folder / "out"
            for k in range(arguments.count):
                random, counts = np.random.default_rng(10 * seed + k), np.ones((WINDOW, WINDOW, 1), bool)
                scene = load(photographs[(k + seed) % len(photographs)]) ** 2.2
                for row, col in random.integers(8, WINDOW - 8, (3, 2)):
                    scene[row - 1:row + 2, col - 1:col + 2] = LAMP
                    counts[row - 3:row + 4, col - 3:col + 4] = False
                clean = see(scene, grid, otf).clip(0)
                lengths = [0.9 / clean.max() * STEP**i for i in range(3)]
                exposures = [expose(clean, length, random) for length in lengths]
                names = [folder / f"{word}.tif" for word in ("short", "middle", "long")]
                for file, frame in zip(names, exposures):
                    save(file, frame.astype(np.float32))
                save(folder / "merged.tif", merged(exposures, [length / lengths[0] for length in lengths]).astype(np.float32))
                cases = {"short": [names[:1], []], "middle": [names[1:2], []], "long": [names[2:], []],
                         "merged without weights": [[folder / "merged.tif"], []], "--bracket": [names, ["--bracket"]]}
                for case, (files, options) in cases.items():
                    frames.reconstruct(arguments.hadalens, files, model, out, options)
                    image = frames.picture(next(out.glob("*aif*.tif")))
                    image = image * (counts * image * scene).sum() / (counts * image**2).sum()
                    error = (np.clip(image, 0, 1) - scene)[np.broadcast_to(counts, scene.shape)]
                    table.setdefault((case, seed), []).append(-10 * np.log10(np.mean(error**2)))
    print("| frames |" + "".join(f" camera {s} |" for s in arguments.seeds) + "\n|---|" + "---|" * len(arguments.seeds))
    for case in dict.fromkeys(key[0] for key in table):
        print(f"| {case} |" + "".join(f" {np.mean(table[case, s]):.2f} dB |" for s in arguments.seeds))


if __name__ == "__main__":
    main()
