#!/usr/bin/env python3
"""Cameras that are known by a point spread function which is not quite theirs: PSNR with the weight of total variation that a
frame chooses, with one program or several.
  perf/psf_errors.py PHOTOGRAPHS OTHERS HADALENS... [--seeds 77] [--masks diffuser contour aperture mla] [--size 200x260]
                     [--noise 0.003 0.01 0.03] [--errors exact noisy ...]
PHOTOGRAPHS are seen; OTHERS make the data set's only pair, which is not used. One depth, a sensor that crops, linear light, 0.3, 1
and 3 % noise. exact: the PSF as it is; shape: its values vary by so much (standard deviation), smoothly over 12 pixels; magnified:
by 1 %; blurred: by a Gaussian of 0.8 pixels; noisy: by 0.3 % of its largest value; uneven: noisy, and
on a background that rises from 3 to 8 %; glow: from 3 to 11 % in a corner; stray light: 3 % of a frame's largest value everywhere in it.
Needs NumPy, tifffile."""
import argparse
import pathlib
import tempfile

import numpy as np
import tifffile

import frames


def blurred(image, sigma):
    rows, cols = (np.fft.fftfreq(n) for n in image.shape)
    return np.fft.ifft2(np.fft.fft2(image) * np.exp(-2 * (np.pi * sigma)**2 * (rows[:, None]**2 + cols**2))).real


def magnified(image, factor):
    """About its centre, by bilinear interpolation."""
    at = [(np.arange(n) - (n - 1) / 2) / factor + (n - 1) / 2 for n in image.shape]
    rows = np.stack([np.interp(at[0], np.arange(image.shape[0]), column) for column in image.T], axis=1)
    return np.stack([np.interp(at[1], np.arange(image.shape[1]), row) for row in rows])


def errors(psf, random):
    """Name -> a point spread function that is not quite right."""
    smooth = blurred(random.standard_normal(psf.shape), 12)
    smooth /= smooth.std()
    y, x = np.mgrid[:psf.shape[0], :psf.shape[1]] / np.array(psf.shape)[:, None, None]
    noisy = psf + 0.003 * psf.max() * random.standard_normal(psf.shape)
    return {"exact": psf, "shape 5 %": psf * np.exp(0.05 * smooth), "shape 15 %": psf * np.exp(0.15 * smooth),
            "magnified": magnified(psf, 1.01), "blurred": np.maximum(blurred(psf, 0.8), 0),
            "noisy": np.maximum(noisy, 0), "uneven": noisy + psf.max() * (0.03 + 0.03 * x + 0.02 * y),
            "glow": noisy + psf.max() * (0.03 + 0.08 * np.exp(-2 * (x**2 + (1 - y)**2))), "stray light": psf}


def psnr(found, truth):
    scaled = found * (found * truth).sum() / (found**2).sum()
    return -10 * np.log10(np.mean((scaled - truth)**2))


def camera(arguments, mask, noise, seed, folder):
    """The PSF, a frame and its scene; of a data set that is made in the folder."""
    frames.run(arguments.hadalens[0], "simulate", "--preset", "crop300", "--size", arguments.size, "--mask", mask, "--noise",
               noise, "--scene-response", "linear", "--depths", 1, "--channels", 1, "--seed", seed, "--pairs", 1, "--scenes",
               arguments.others, "--test", 2, "--test-depths", 1, "--test-scenes", arguments.photographs, "-q", "-o", folder)
    raw = sorted((folder / "test/raw").iterdir())[seed % 2]
    truth = tifffile.imread(folder / "test/truth" / f"{raw.stem}_aif.tif").astype(float).squeeze()
    return tifffile.imread(folder / "psf.tif").astype(float), tifffile.imread(raw), truth


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("others", type=pathlib.Path)
    parser.add_argument("hadalens", nargs="+")
    parser.add_argument("--seeds", type=int, nargs="+", default=[77])
    parser.add_argument("--masks", nargs="+", default=["diffuser", "contour", "aperture", "mla"])
    parser.add_argument("--size", default="200x260")
    parser.add_argument("--noise", nargs="+", default=["0.003", "0.01", "0.03"])
    parser.add_argument("--errors", nargs="+", help="some of those above alone")
    arguments = parser.parse_args()
    print("| mask | noise | error |" + " dB |" * len(arguments.hadalens) + "\n|" + "---|" * (3 + len(arguments.hadalens)))
    table = {}
    for seed, mask, noise in ((s, m, n) for s in arguments.seeds for m in arguments.masks for n in arguments.noise):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            psf, raw, truth = camera(arguments, mask, noise, seed, folder / "set")
            for error, wrong in errors(psf, np.random.default_rng(seed)).items():
                if arguments.errors and error not in arguments.errors:
                    continue
                tifffile.imwrite(folder / "psf.tif", wrong.astype(np.float32))
                stray = 0.03 * raw.max() if error == "stray light" else 0.0
                tifffile.imwrite(folder / "frame.tif", (raw + stray).astype(np.float32))
                row = []
                for hadalens in arguments.hadalens:
                    frames.run(hadalens, "fit", "--psf", folder / "psf.tif", "--window", f"{truth.shape[0]}x{truth.shape[1]}", "-q",
                               "-o", folder / "camera.model")
                    frames.reconstruct(hadalens, [folder / "frame.tif"], folder / "camera.model", folder / "out", [])
                    image = tifffile.imread(next((folder / "out").glob("*_aif.tif"))).astype(float).squeeze()
                    row.append(psnr(image, truth))
                table.setdefault(error, []).append(row)
                print(f"| {mask} | {noise} | {error} |" + "".join(f" {value:.2f} |" for value in row), flush=True)
    for error, rows in table.items():
        print(f"| mean | | {error} |" + "".join(f" {value:.2f} |" for value in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
