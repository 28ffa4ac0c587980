#!/usr/bin/env python3
"""A real camera that is known by its point spread function alone: refinement as it comes beside ADMM with several weights.
  perf/real_psf.py HADALENS FOLDER [--sheet FILE]
FOLDER holds rawN.png, psfN.tif and displayedN.png of the LCD-mask camera (daminovkamil/lensless-reconstruction, MIT): linear
frames of 380 x 507 pixels, upside down, and what a display showed. PSNR where the picture stands, of light with the best
factor of each channel, and of both encoded as sRGB. Needs NumPy, tifffile, Pillow."""
import argparse
import pathlib
import tempfile

import numpy as np
import tifffile
from PIL import Image

import frames

CENTRE = {0: (182, 237), 1: (184, 231)}  # of the picture in the window, and its size, found by correlation
SIZE = {0: (192, 192), 1: (163, 258)}
WEIGHTS = ("3e-2", "1e-2", "3e-3", "1e-3", "3e-4")


def light(a):
    return np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4)


def encoded(a):
    a = np.clip(a, 0, 1)
    return np.where(a <= 0.0031308, 12.92 * a, 1.055 * a ** (1 / 2.4) - 0.055)


def psnr(a, b):
    return -10 * np.log10(np.mean((a - b) ** 2))


def judge(out, name, k, shown):
    """The picture in the scale of what was shown, and its two figures."""
    rows, cols = SIZE[k]
    top, left = CENTRE[k][0] - rows // 2, CENTRE[k][1] - cols // 2
    image = frames.picture(out / f"{name}_aif.tif")[top:top + rows, left:left + cols]
    truth = light(shown)
    image = np.clip(image * (image * truth).sum((0, 1)) / (image**2).sum((0, 1)), 0, 1)
    return encoded(image), psnr(image, truth), psnr(encoded(image), shown)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--sheet", type=pathlib.Path, help="a picture: refinement, ADMM of weight 1e-3, what was shown")
    arguments = parser.parse_args()
    sheet = []
    print("| frame | method | of light | encoded | s |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as room:
        folder = pathlib.Path(room)
        for k in CENTRE:
            name, raw = f"raw{k}", np.asarray(Image.open(arguments.folder / f"raw{k}.png"), np.float32) / 255
            tifffile.imwrite(folder / f"{name}.tif", np.ascontiguousarray(raw[::-1, ::-1]), photometric="rgb")
            shown = Image.open(arguments.folder / f"displayed{k}.png").convert("RGB")
            shown = np.asarray(shown.resize(SIZE[k][::-1], Image.LANCZOS)) / 255
            model, out, row = folder / f"{k}.model", folder / "out", []
            frames.run(arguments.hadalens, "fit", "--psf", arguments.folder / f"psf{k}.tif", "--distances", "250", "-o",
                       model)
            for weight in [None, *WEIGHTS]:
                options = ["--method", "admm", "--tv", weight] if weight else []
                seconds = frames.reconstruct(arguments.hadalens, [folder / f"{name}.tif"], model, out, options)
                picture, linear, coded = judge(out, name, k, shown)
                what = f"ADMM, 100 iterations, {weight}" if weight else "refinement"
                print(f"| {k} | {what} | {linear:.2f} dB | {coded:.2f} dB | {seconds:.1f} |", flush=True)
                row += [picture] if weight in (None, "1e-3") else []
            sheet.append(np.concatenate([*row, shown], 1))
    if arguments.sheet:
        width = max(row.shape[1] for row in sheet)
        frames.png(arguments.sheet, np.concatenate(
            [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in sheet]), gamma=1)


main()
