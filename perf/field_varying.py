#!/usr/bin/env python3
"""PSFs that vary over the field: what components from a measured grid are worth, beside a single PSF and exact
knowledge, the whole way by files (simulate, fit, reconstruct, evaluate).
  perf/field_varying.py [--seeds 11,12,13] [--correlation 0.6] [--noise 0.01,0.02] [--grid 5] [--components 1,3,5]
                        [--masks mla,diffuser] [--psf-noise 0.01] [--size 256] [--window 128] [--build build/release]
A camera whose PSF in the corners of the window correlates by --correlation with that of the middle; frames are made with
the PSF of every point. Planes: drawn shapes at one depth, FISTA with total variation whose weight is found from each
frame, PSNR of the all-in-focus image. Volume: --points points of light among 8 depths, Richardson-Lucy, F1 of maxima
within 2 pixels and 1 depth at the threshold that suits them best, and the share of light within a pixel of a point. PSFs are measured at
--grid x --grid points over the window, with --psf-noise of their brightest pixel on a background. Exact knowledge: 16
components of 13 x 13 points without noise. Means over seeds and frames. Needs NumPy, SciPy and tifffile."""
import argparse
import json
import pathlib
import re
import tempfile

import numpy as np
import tifffile
from scipy.ndimage import maximum_filter

import frames

here = pathlib.Path(__file__).resolve().parent
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=str(here.parent / "build" / "release"))
parser.add_argument("--seeds", default="11,12,13")
parser.add_argument("--correlation", default="0.6")
parser.add_argument("--noise", default="0.01,0.02")
parser.add_argument("--grid", type=int, default=5)
parser.add_argument("--components", default="1,3,5")
parser.add_argument("--masks", default="mla")
parser.add_argument("--psf-noise", type=float, default=0.01)
parser.add_argument("--size", type=int, default=256)
parser.add_argument("--window", type=int, default=128)
parser.add_argument("--tests", type=int, default=3)
parser.add_argument("--points", type=int, default=800)
parser.add_argument("--iterations", type=int, default=400)
parser.add_argument("--kinds", default="planes,volume")
o = parser.parse_args()
hadalens = f"{o.build}/bindings/cli/hadalens"


def run(*words):
    return frames.run(hadalens, *words)


def points(folder, rng, count, depths):
    """Pictures of points, one for each test frame's depth."""
    folder.mkdir()
    for frame in range(o.tests * depths):
        picture = np.zeros((o.window, o.window), np.float32)
        at = rng.integers(4, o.window - 4, (count, 2))
        picture[at[:, 0], at[:, 1]] = rng.uniform(0.5, 1.5, count)
        tifffile.imwrite(folder / f"points{frame:03d}.tif", picture)
    return folder


def camera(folder, seed, mask, noise, grid, kind, pictures):
    depths = 1 if kind == "planes" else 8
    words = ["--preset", "sim300", "--mask", mask, "--size", f"{o.size}x{o.size}", "--window", f"{o.window}x{o.window}",
             "--channels", 1, "--boundary", "padded", "--depths", depths, "--near", 100, "--far", 300 if depths > 1 else 101,
             "--pairs", 1, "--seed", seed, "--noise", noise, "--field-varying", o.correlation, "--field-psfs", grid]
    if pictures:
        words += ["--test", o.tests, "--test-depths", depths]
        if kind == "volume":
            words += ["--test-scenes", pictures]
    run("simulate", *words, "-o", folder)


def spoil(field, rng):
    """Noise and a background on measured PSFs."""
    for path in sorted(field.glob("*.tif")):
        pages = tifffile.imread(path).astype(np.float64)
        pages += pages.max() * (0.05 + o.psf_noise * rng.standard_normal(pages.shape))
        tifffile.imwrite(path, pages.astype(np.float32), photometric="minisblack")


def psnr(result, truth):
    rows = json.loads(run("evaluate", result, truth, "--json"))["files"]
    return np.mean([row["psnr"] for row in rows if row["kind"] == "images" and "_aif" in row["result"]])


def maxima(volume, limit):
    peaks = (volume == maximum_filter(volume, (3, 5, 5))) & (volume > limit)
    return np.argwhere(peaks)


def found(volume, truth):
    """F1 at the best threshold, and the share of light within a pixel of a point of its depth."""
    there = np.argwhere(truth > 0)
    best = 0.0
    for share in (0.05, 0.1, 0.15, 0.2, 0.3, 0.4):
        peaks, hits, left = maxima(volume, share * np.quantile(volume[volume > 0], 0.9999)), 0, list(range(len(there)))
        for peak in peaks:
            if not left:
                break
            off = np.abs(there[left] - peak) / (1, 2, 2)
            near = int(np.argmin(off.max(1)))
            if off[near].max() <= 1:
                hits += 1
                left.pop(near)
        best = max(best, 2 * hits / (len(peaks) + len(there)))
    near = maximum_filter(truth, (1, 3, 3)) > 0
    return best, float(volume[near].sum() / volume.sum())


def scores(kind, model, data, out):
    if kind == "planes":
        run("reconstruct", *sorted((data / "test/raw").glob("*.tif")), "-m", model, "--method", "fista", "--prior", "tv",
            "--iterations", o.iterations, "-o", out)
        return [psnr(out, data / "test/truth")]
    run("reconstruct", *sorted((data / "test/raw").glob("*.tif")), "-m", model, "--scene", "volume", "-o", out)
    rows = []
    for path in sorted((data / "test/raw").glob("*.tif")):
        name = f"{path.stem}_stack.tif"
        rows.append(found(tifffile.imread(out / name), tifffile.imread(data / "test/truth" / name)))
    return list(np.mean(rows, 0))


for kind in o.kinds.split(","):
    for mask in o.masks.split(","):
        for noise in map(float, o.noise.split(",")):
            table = {}
            for seed in map(int, o.seeds.split(",")):
                with tempfile.TemporaryDirectory() as temporary:
                    folder, rng = pathlib.Path(temporary), np.random.default_rng(seed)
                    pictures = points(folder / "points", rng, o.points // 8, 8) if kind == "volume" else True
                    camera(folder / "data", seed, mask, noise, o.grid, kind, pictures)
                    camera(folder / "dense", seed, mask, 0, 13, kind, None)
                    spoil(folder / "data/field", rng)
                    distances = ["--distances", ",".join(
                        re.sub("^z|mm$", "", path.name) for path in sorted(
                            (folder / "data").glob("z*mm"), key=lambda path: float(path.name[1:-2])))]
                    window = ["--window", f"{o.window}x{o.window}"]
                    for components in [*o.components.split(","), "exact"]:
                        model = folder / f"{components}.model"
                        field = folder / ("dense/field" if components == "exact" else "data/field")
                        given = ["--components", 16 if components == "exact" else components]
                        said = run("fit", "--psf", field, *window, *distances, *given, "-o", model, "--json")
                        lost = json.loads(said)["model"]["lost"]
                        row = scores(kind, model, folder / "data", folder / f"out{components}")
                        table.setdefault(components, []).append([100 * lost, *row])
            for components, rows in table.items():
                values = "  ".join(f"{value:8.3f}" for value in np.mean(rows, 0))
                print(f"{kind} {mask} noise {noise:g} components {components:>5}: lost % and "
                      f"{'PSNR dB' if kind == 'planes' else 'F1, light'}: {values}", flush=True)
