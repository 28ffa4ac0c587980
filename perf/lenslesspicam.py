"""Beside LenslessPiCam on the same real frames, from Python: processor seconds and PSNR.

lenslesspicam.py PAIRS [HAND]: PAIRS is a folder of pairs of one distance (as hadalens fit takes it), of which two are
held out in turn; HAND holds a PSF (psf_sample.tif) and a frame (rawdata_hand_sample.tif), without a truth.
LenslessPiCam (the package lensless, 1.0.8) gets the point spread function of the camera that Hadalens learned from the
other pairs, since none was measured, and its ADMM as it comes: 100 iterations, total variation, non-negative. Hadalens
has two rows: as it comes, and the same method, ADMM of 100 iterations with that PSF and LenslessPiCam's weights. Every
frame is new to its plan. PSNR is in the window, after the one factor that is best for each image, for ADMM's scale is
arbitrary.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import hadalens
import numpy as np
from lensless.recon.admm import ADMM


def seconds() -> float:
    """Return seconds of the processor that this process has used."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the PSNR after the best factor."""
    factor = float(np.vdot(image, truth) / max(np.vdot(image, image), 1e-20))
    return hadalens.metrics.psnr(np.ascontiguousarray(factor * image, np.float32), truth)


def admm(psf: np.ndarray, raw: np.ndarray, dark: np.ndarray | float = 0.0) -> np.ndarray:
    """Return what LenslessPiCam makes of a frame; all (C, Y, X)."""
    frame = np.clip(raw - dark, 0, None)
    one = np.moveaxis(psf, 0, -1)[np.newaxis]
    method = ADMM(np.ascontiguousarray(one / np.linalg.norm(one), np.float32))
    method.set_data(np.ascontiguousarray(np.moveaxis(frame, 0, -1)[np.newaxis] / frame.max(), np.float32))
    return np.moveaxis(np.asarray(method.apply(n_iter=100, disp_iter=None, plot=False))[0], -1, 0)


def same_method(psf: np.ndarray, raw: np.ndarray) -> hadalens.Plan:
    """Return ADMM of this package with LenslessPiCam's weights, which are absolute there, for a frame like that one."""
    otf = float((psf / np.linalg.norm(psf)).sum((1, 2)).max())
    light = float(np.sqrt(np.mean(np.square(np.clip(raw, 0, None) / raw.max(), dtype=np.float64))))
    mu1, mu2, mu3, tau = 1e-6, 1e-5, 4e-5, 1e-4  # of lensless.recon.admm.ADMM
    weights = {"mu1": mu1, "mu2": mu2 / (mu1 * otf**2), "mu3": mu3 / (mu1 * otf**2), "weight": tau / (otf * light)}
    model = hadalens.Model.from_psf(psf, 100.0, psf_dark=0.0)
    return hadalens.Plan(model, dark=0.0, classic=hadalens.Classic("admm", iterations=100, prior="tv", **weights))


def of_pairs(folder: Path) -> None:
    """Hold out two pairs in turn."""
    names = sorted(path.name for path in (folder / "raw").iterdir())
    read = {n: [hadalens.read_tiff(folder / kind / n, 0) for kind in ("raw", "scene")] for n in names}
    methods = ("Hadalens", "Hadalens, ADMM of 100", "LenslessPiCam, ADMM of 100")
    quality, used = {one: [] for one in methods}, {one: [] for one in methods}
    for first in range(0, len(names), 2):
        held = names[first : first + 2]
        began = seconds()
        model = hadalens.fit({100.0: [read[n] for n in names if n not in held]})
        print(
            f"learned from {len(names) - len(held)} pairs in {seconds() - began:.1f} s, {model.info.refine_steps} steps"
        )
        grid = (model.info.grid_rows, model.info.grid_cols)
        psf = np.fft.fftshift(np.fft.irfft2(model.otf[0], s=grid), axes=(1, 2))
        rows, cols = read[held[0]][0].shape[1:]
        top, left = grid[0] // 2 - rows // 2, grid[1] // 2 - cols // 2
        psf = np.clip(psf[:, top : top + rows, left : left + cols], 0, None)
        plan = hadalens.Plan(model)
        plan.run(0.9 * read[held[0]][0])  # kernels; another frame, for an equal one would be skipped
        for name in held:
            raw, scene = read[name]
            same = same_method(psf, raw)
            same.run(0.9 * read[held[0]][0])
            works = (lambda: plan.run(raw).all_in_focus, lambda: same.run(raw).stack[0], lambda: admm(psf, raw))
            for method, work in zip(methods, works, strict=True):
                began = seconds()
                image = work()
                used[method].append(seconds() - began)
                top, left = ((a - b) // 2 for a, b in zip(image.shape[1:], scene.shape[1:], strict=True))
                image = image[:, top : top + scene.shape[1], left : left + scene.shape[2]]
                quality[method].append(psnr(image, scene))
            print(name, *(f"{one}: {quality[one][-1]:.2f} dB, {used[one][-1]:.2f} s;" for one in methods), flush=True)
    print("mean", *(f"{one}: {np.mean(quality[one]):.2f} dB, {np.median(used[one]):.2f} s;" for one in methods))


def of_hand(folder: Path) -> None:
    """Reconstruct the hand at a quarter of its size, as LenslessPiCam's examples do."""

    def quarter(name: str) -> np.ndarray:
        image = hadalens.read_tiff(folder / name, 0)
        channels, rows, cols = image.shape
        return image.reshape(channels, rows // 4, 4, cols // 4, 4).mean(axis=(2, 4))

    psf, raw = quarter("psf_sample.tif"), quarter("rawdata_hand_sample.tif")
    plan = hadalens.Plan(hadalens.Model.from_psf(psf[np.newaxis], [250.0], dark=None))
    plan.run(0.9 * raw)
    began = seconds()
    plan.run(raw)
    middle = seconds()
    admm(np.clip(psf - np.percentile(psf, 1), 0, None), raw, np.percentile(raw, 1))
    print(f"hand, {raw.shape[1]} x {raw.shape[2]}: Hadalens {middle - began:.2f} s, ADMM {seconds() - middle:.2f} s")


if __name__ == "__main__":
    of_pairs(Path(sys.argv[1]))
    if len(sys.argv) > 2:
        of_hand(Path(sys.argv[2]))
