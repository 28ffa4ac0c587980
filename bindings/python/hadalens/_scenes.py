"""Scenes to show to a camera: drawn from a seed, cut from photographs, parted over depths."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import errors
from ._arrays import Float32, Image, Mosaic, NewImage, taken
from ._native import call, checked, ffi, lib, value_of


def procedural_scene(rows: int, cols: int, *, channels: int = 3, seed: int = 0) -> Float32:
    """Return a scene (C, Y, X) drawn from a seed: a coloured background, shapes and textures before it; 0 to 1."""
    image = NewImage()
    call(lib.hada_scene_procedural, image.c, seed, channels, rows, cols)
    return image.array()


def fit_scene(image: Any, rows: int, cols: int, *, channel_axis: int | None = None) -> Float32:
    """Return the largest centred part of an image with the aspect ratio rows:cols, scaled to that size."""
    made = NewImage()
    call(lib.hada_scene_fit, made.c, Image(image, channel_axis=channel_axis).c, rows, cols)
    return made.array()


def downsample(
    image: Any,
    factor: int,
    *,
    mosaic: Mosaic = "none",
    keep_saturated: bool = False,
    channel_axis: int | None = None,
    full_scale: float | None = None,
) -> Float32:
    """Return an image whose pixels are the means of factor x factor pixels, (C, Y, X).

    Args:
        image: (Y, X) or (C, Y, X); what fills no bin is left out.
        factor: a whole number, even for a mosaic.
        mosaic: pattern of the colour filter mosaic that an image of one channel is; each colour is binned by itself.
        keep_saturated: for raw frames: where values of a channel are cut off at its largest one, bins that hold such a
            value get it, so that they are still known to be saturated.
        channel_axis: of three axes; None: the first.
        full_scale: as for :meth:`Plan.run`.

    Example:
        >>> hadalens.downsample(np.ones((480, 640)), 4).shape
        (1, 120, 160)

    """
    given, made = Image(image, channel_axis=channel_axis, full_scale=full_scale), NewImage()
    pattern = value_of("hada_mosaic", mosaic, "mosaic")
    call(lib.hada_image_downsample, made.c, given.c, factor, pattern, keep_saturated)
    return made.array()


def resize(image: Any, rows: int, cols: int, *, channel_axis: int | None = None) -> Float32:
    """Return a whole image scaled to rows x cols: mean over area where it shrinks, bilinear where it grows."""
    given, made = Image(image, channel_axis=channel_axis), NewImage()
    call(lib.hada_image_resize, made.c, given.c, rows, cols)
    return made.array()


def crop(image: Any, row: int, col: int, rows: int, cols: int, *, channel_axis: int | None = None) -> Float32:
    """Return a rectangle of an image; parts outside it are zero."""
    given, made = Image(image, channel_axis=channel_axis), NewImage()
    call(lib.hada_image_crop, made.c, given.c, row, col, rows, cols)
    return made.array()


def regions(count: int, rows: int, cols: int, *, seed: int = 0) -> npt.NDArray[np.int32]:
    """Return labels 0 to count - 1 of every pixel, int32 (Y, X): compact regions with smooth outlines."""
    labels = np.empty((rows, cols), np.int32)
    call(lib.hada_scene_regions, ffi.cast("int *", ffi.from_buffer(labels)), seed, count, rows, cols)
    return labels


def part(image: Any, labels: npt.NDArray[np.int32], label: int, *, channel_axis: int | None = None) -> Float32:
    """Return the part of an image whose label is `label`; the rest is zero."""
    given, made = Image(image, channel_axis=channel_axis), NewImage()
    marks = np.ascontiguousarray(labels, np.int32)
    if marks.shape != given.arrays[0].shape[1:]:
        raise errors.SizeError(f"labels of {marks.shape} for an image of {given.arrays[0].shape[1:]}")
    call(lib.hada_scene_part, made.c, given.c, ffi.cast("int *", ffi.from_buffer(marks)), label)
    return made.array()


def relief(
    kind: Literal["slant", "half", "hill", "ball", "steps", "bars"], rows: int, cols: int, *, seed: int = 0
) -> Float32:
    """Return depth over a window, (Y, X): 0 (nearest) to 1 (farthest), linear in 1/z; seed 0 is the plain shape."""
    made = NewImage()
    call(lib.hada_scene_relief, made.c, value_of("hada_relief_kind", kind, "kind"), seed, rows, cols)
    return made.plane()


def add_noise(image: Any, sigma: float, *, seed: int = 0, channel_axis: int | None = None) -> Float32:
    """Return an image with Gaussian noise of standard deviation `sigma`."""
    noisy = Image(np.array(taken(image, "image", channel_axis), copy=True))
    lib.hada_image_add_noise(noisy.c, checked("sigma", sigma), seed)
    return noisy.arrays[0]
