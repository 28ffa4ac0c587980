"""Sample data: a small lensless camera, made of numbers in milliseconds."""

from __future__ import annotations

import numpy as np

from ._layers import LayerData, image_layer, stack_layer

ROWS, COLS, WINDOW = 120, 160, 60
DISTANCES = (100.0, 200.0, 300.0)
LENSES = 12


def small_camera() -> list[LayerData]:
    """Return its point spread functions, and a raw frame of two squares and a disc at three distances."""
    rng = np.random.default_rng(3)
    places = rng.uniform(-0.3, 0.3, (LENSES, 2)) * (ROWS, COLS)
    psf = np.zeros((len(DISTANCES), 3, ROWS, COLS), np.float32)
    row, col = np.indices((ROWS, COLS))
    for depth, distance in enumerate(DISTANCES):
        for y, x in places * (1 + 20 / distance) / 1.2:  # near scenes cast a larger pattern
            spot = np.exp(-((row - ROWS // 2 - y) ** 2 + (col - COLS // 2 - x) ** 2) / (2 * 0.7**2))
            psf[depth] += spot / spot.sum() / LENSES
    scene = np.zeros_like(psf)
    top, left = (ROWS - WINDOW) // 2, (COLS - WINDOW) // 2
    near, middle, far = (scene[z, :, top : top + WINDOW, left : left + WINDOW] for z in range(3))
    near[:, 6:24, 6:24] = np.array([0.9, 0.2, 0.1])[:, None, None]
    middle[:, 34:54, 34:54] = np.array([0.1, 0.7, 0.3])[:, None, None]
    inside = (np.indices((WINDOW, WINDOW))[0] - 16) ** 2 + (np.indices((WINDOW, WINDOW))[1] - 44) ** 2 < 100
    far[:, inside] = np.array([0.2, 0.4, 0.9])[:, None]
    spectrum = np.fft.rfft2(np.fft.ifftshift(psf, axes=(-2, -1))) * np.fft.rfft2(scene)
    raw = np.fft.irfft2(spectrum.sum(axis=0), s=(ROWS, COLS)) + rng.normal(0, 1e-3, (3, ROWS, COLS))
    camera = stack_layer(psf, DISTANCES, "point spread functions")
    camera[1]["metadata"]["hadalens_psf"] = True
    return [camera, image_layer(raw.astype(np.float32), "raw frame")]
