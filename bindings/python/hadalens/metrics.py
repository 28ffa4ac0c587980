"""Yardsticks for images and distance maps; on the host, in double precision.

Images are (Y, X) or (C, Y, X) of the same shape, or with channel_axis=-1 (Y, X, C). A mask (Y, X) leaves out the pixels
where it is 0. ``peak`` is the largest value that could occur, 1 for images that were divided by their full scale.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import errors
from . import response as responses
from ._arrays import Float32, Floats, Image, NewImage
from ._native import AUTO, Handle, Monitor, Options, Owner, call, checked, ffi, lib, path, record, value_of, word
from .device import Device, default

__all__ = [
    "ConfidenceScore",
    "DepthScore",
    "Evaluation",
    "Lpips",
    "authors_psnr",
    "authors_ssim",
    "depth",
    "depth_confidence",
    "depth_distance",
    "depth_index",
    "depth_nearer",
    "depth_parts",
    "evaluate",
    "mae",
    "mse",
    "psnr",
    "sharpness",
    "ssim",
]


def __dir__() -> list[str]:
    """Return the names for users."""
    return __all__


class _Mask:
    """A mask as C takes it, NULL for none."""

    def __init__(self, mask: Any, image: Image) -> None:
        self.c = ffi.NULL
        if mask is not None:
            marks = np.ascontiguousarray(np.asarray(mask) != 0).view(np.uint8)
            if marks.shape != image.arrays[0].shape[1:]:
                raise errors.SizeError(f"the mask has {marks.shape}, the image {image.arrays[0].shape[1:]}")
            self.c = ffi.from_buffer("unsigned char[]", marks)  # which holds the array


def _compare(metric: str, a: Any, b: Any, mask: Any, axis: int | None, peak: float = 1.0) -> float:
    images, out = Image(a, b, channel_axis=axis), ffi.new("double *")
    kind = value_of("hada_metric", metric, "metric")
    call(lib.hada_metric_compare, kind, images.c, images.c + 1, peak, _Mask(mask, images).c, out)
    return float(out[0])


def mse(a: Any, b: Any, *, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return the mean of squared differences."""
    return _compare("mse", a, b, mask, channel_axis)


def mae(a: Any, b: Any, *, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return the mean of absolute differences."""
    return _compare("mae", a, b, mask, channel_axis)


def psnr(a: Any, b: Any, *, peak: float = 1.0, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return 10 log10(peak^2 / mse) in dB; infinite for equal images.

    Example:
        >>> hadalens.metrics.psnr(result.all_in_focus, truth)
        31.4

    """
    return _compare("psnr", a, b, mask, channel_axis, peak)


def ssim(a: Any, b: Any, *, peak: float = 1.0, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return the structural similarity (Wang et al. 2004): Gaussian window, as scikit-image has it."""
    return _compare("ssim", a, b, mask, channel_axis, peak)


def authors_psnr(a: Any, b: Any, *, peak: float = 1.0, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return what the code of the 2022 paper calls PSNR, for comparing with its figures."""
    return _compare("authors_psnr", a, b, mask, channel_axis, peak)


def authors_ssim(a: Any, b: Any, *, peak: float = 1.0, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return what the code of the 2022 paper calls SSIM, for comparing with its figures."""
    return _compare("authors_ssim", a, b, mask, channel_axis, peak)


def sharpness(image: Any, *, mask: Any = None, channel_axis: int | None = None) -> float:
    """Return the mean magnitude of the gradient, in intensity per pixel."""
    given, out = Image(image, channel_axis=channel_axis), ffi.new("double *")
    call(lib.hada_metric_sharpness, given.c, _Mask(mask, given).c, out)
    return float(out[0])


@dataclass(frozen=True)
class DepthScore:
    """How good a distance map is.

    Attributes:
        coverage: share of the pixels with a true distance that the map covers.
        within: share of the covered pixels within the tolerance.
        mean_error_mm: over the covered pixels.
        mean_steps: the same in depth steps; NaN without a list of distances.
        pixels: with a true distance.

    """

    coverage: float
    within: float
    mean_error_mm: float
    mean_steps: float
    pixels: int


@dataclass(frozen=True)
class ConfidenceScore:
    """Whether a map knows where it is wrong, in steps of the list, in millimetres without one.

    Attributes:
        half_error: mean absolute error of the more confident half of the pixels.
        risk: area under the curve of risk against coverage.
        pixels: that are known in all three images.

    """

    half_error: float
    risk: float
    pixels: int


def _distances(distances_mm: Floats | None) -> tuple[Any, int]:
    if distances_mm is None:
        return ffi.NULL, 0
    return ffi.new("double[]", [float(d) for d in distances_mm]), len(distances_mm)


def depth(
    distance_map: Any,
    truth: Any,
    distances_mm: Floats | None = None,
    *,
    tolerance: float = 0.5,
    mask: Any = None,
) -> DepthScore:
    """Compare a distance map (Y, X) with the truth, millimetres, NaN where nothing is.

    Args:
        distance_map: as of :attr:`Result.distance_map`.
        truth: NaN: left out.
        distances_mm: of the depths, near to far: errors and tolerance count in steps of it; None: in millimetres.
        tolerance: of `within`.
        mask: pixels that count.

    """
    images = Image(distance_map, truth, light=False)
    out = ffi.new("hada_depth_score *", {"size": ffi.sizeof("hada_depth_score")})
    marks = _Mask(mask, images)
    call(lib.hada_metric_depth, images.c, images.c + 1, *_distances(distances_mm), tolerance, marks.c, out)
    return record(DepthScore, out[0])


def depth_confidence(
    distance_map: Any, truth: Any, confidence: Any, distances_mm: Floats | None = None, *, mask: Any = None
) -> ConfidenceScore:
    """Say how well a confidence map (Y, X) sorts the errors of a distance map."""
    images = Image(distance_map, truth, confidence, light=False)
    out = ffi.new("hada_confidence_score *", {"size": ffi.sizeof("hada_confidence_score")})
    marks = _Mask(mask, images)
    call(
        lib.hada_metric_depth_confidence,
        images.c,
        images.c + 1,
        images.c + 2,
        *_distances(distances_mm),
        marks.c,
        out,
    )
    return record(ConfidenceScore, out[0])


def depth_parts(
    truth: Any, distances_mm: Floats, *, jump_steps: float | None = None, reach_pixels: int | None = None
) -> npt.NDArray[np.uint8]:
    """Return what kind of place each pixel of a true map is, (Y, X): 0 no distance, 1 smooth, 2 a jump, 3 outside."""
    image = Image(truth, light=False)
    parts = np.empty(image.arrays[0].shape[1:], np.uint8)
    call(
        lib.hada_metric_depth_parts,
        image.c,
        *_distances(distances_mm),
        AUTO if jump_steps is None else checked("jump_steps", jump_steps),
        lib.HADA_AUTO if reach_pixels is None else checked("reach_pixels", reach_pixels),
        ffi.cast("unsigned char *", ffi.from_buffer(parts)),
    )
    return parts


def depth_nearer(truth: Any, second: Any, distance_map: Any, distances_mm: Floats | None = None) -> Float32:
    """Return, where two surfaces are seen through each other, the true distance (Y, X) that is nearer to the map's."""
    images = Image(np.array(truth, np.float32), second, distance_map, light=False)
    call(lib.hada_metric_depth_nearer, images.c, images.c + 1, images.c + 2, *_distances(distances_mm))
    return images.arrays[0].reshape(images.arrays[0].shape[1:])


def depth_index(distances_mm: Floats, distance_mm: float) -> float:
    """Return the fractional index of a distance in a list, linear in 1/z."""
    return float(lib.hada_depth_index(*_distances(distances_mm), distance_mm))


def depth_distance(distances_mm: Floats, index: float) -> float:
    """Return the distance of a fractional index: the inverse of :func:`depth_index`."""
    return float(lib.hada_depth_distance(*_distances(distances_mm), index))


class Lpips(Handle):
    """LPIPS, the learned perceptual distance of two images; used by one thread at a time.

    Args:
        backbone: safetensors file of VGG-16 or AlexNet, torchvision's names. None comes with the library
            (docs/reference/measures.md says where weights come from).
        heads: file of the linear heads; None: they stand in the same file.
        net: "vgg", "alex", or "auto": what the file says.
        context: a device; None: :meth:`Context.default`.

    Example:
        >>> lpips = hadalens.metrics.Lpips("vgg.safetensors")
        >>> lpips(result.all_in_focus, truth)

    """

    def __init__(
        self,
        backbone: str | os.PathLike[str],
        heads: str | os.PathLike[str] | None = None,
        *,
        net: Literal["auto", "vgg", "alex"] = "auto",
        context: Device | None = None,
    ) -> None:
        """Read the weights."""
        used = default(context)
        owner = Owner("hada_lpips", lib.hada_lpips_destroy, used._own)
        kind = value_of("hada_lpips_net", net, "net")
        second = ffi.NULL if heads is None else path(heads)
        call(lib.hada_lpips_create, owner.pointer, used._c, kind, path(backbone), second)
        self._owner = owner

    @property
    def net(self) -> str:
        """Which net it is: "vgg" or "alex"."""
        return word("hada_lpips_net", lib.hada_lpips_get_net(self._c))

    def _shown(self) -> str:
        return self.net

    def bytes(self, rows: int, cols: int) -> int:
        """Return the device memory that comparing images of a size takes."""
        out = ffi.new("uint64_t *")
        call(lib.hada_lpips_bytes, self._c, rows, cols, out)
        return int(out[0])

    def __call__(
        self, a: Any, b: Any, *, peak: float = 1.0, mask: Any = None, channel_axis: int | None = None
    ) -> float:
        """Return the distance of two images; 0 for equal ones."""
        images, out = Image(a, b, channel_axis=channel_axis), ffi.new("double *")
        call(lib.hada_lpips_run, self._c, images.c, images.c + 1, peak, _Mask(mask, images).c, out)
        return float(out[0])

    def map(self, a: Any, b: Any, *, peak: float = 1.0, channel_axis: int | None = None) -> Float32:
        """Return the distance at every pixel, (Y, X)."""
        images, made = Image(a, b, channel_axis=channel_axis), NewImage()
        call(lib.hada_lpips_map, self._c, images.c, images.c + 1, peak, made.c)
        return made.plane()


@dataclass(frozen=True)
class Evaluation:
    """A result and its truth (hada_evaluation of hadalens/task_evaluate.h has every member explained)."""

    name: str
    result: str
    truth: str
    what: str
    pages: int
    occupied: int
    missing: int
    gain: float
    psnr: float
    psnr_all: float
    ssim: float
    mae: float
    sharpness: float
    sharpness_truth: float
    lpips: float
    authors_psnr: float
    authors_ssim: float
    depth: DepthScore
    steps_known: bool
    psnr_jumps: float
    psnr_away: float
    ssim_jumps: float
    ssim_away: float
    steps_jumps: float
    steps_away: float
    within_jumps: float
    within_away: float
    coverage_jumps: float
    coverage_away: float
    outside: float
    outside_unknown: float
    confident_half: float
    risk: float
    result_encoding: float
    encoding: float
    downsample: int
    emitters: int
    emitters_truth: int
    recall: float
    precision: float
    f1: float
    jaccard: float
    lateral_rmse: float
    axial_rmse: float
    tracks: int
    tracks_truth: int
    switches: float


def evaluate(
    result: str | os.PathLike[str],
    truth: str | os.PathLike[str],
    *,
    peak: float = 1.0,
    tolerance: float = 0.5,
    distances_mm: Floats | None = None,
    match_gain: bool = False,
    authors: bool = False,
    lpips: Lpips | None = None,
    window: tuple[int, int] | None = None,
    window_at: tuple[int, int] | None = None,
    mask: str | os.PathLike[str] | None = None,
    truth_encoding: float | str | None = None,
    encoding: float | str | None = None,
    gate_pixels: float = 2.0,
    gate_depths: float = 2.5,
) -> list[Evaluation]:
    """Compare two files, or two folders of them, as ``hadalens evaluate`` does.

    Args:
        result, truth: files, or folders in which NAME.tif goes with NAME.tif or NAME_aif.tif.
        peak: value that counts as full scale.
        tolerance: of distances, in depth steps (millimetres where these are not known).
        distances_mm: of the camera; None: read from NAME_stack.tif.
        match_gain: each result is multiplied by the factor that brings it nearest to the truth.
        authors: also the measures of the 2022 paper's code.
        lpips: also the perceptual distance.
        window: rows and columns that are compared; None: all.
        window_at: its top left; None: centred.
        mask: a TIFF file of pixels that count.
        truth_encoding, encoding: how the truth stands for light, and in which encoding both are compared.
        gate_pixels, gate_depths: of tables of emitters (two .csv files): how far a true one may be from a found one.

    Example:
        >>> for one in hadalens.metrics.evaluate("pictures", "camera/test/truth"):
        ...     print(one.name, one.psnr)

    """
    distances, count = _distances(distances_mm)
    options = Options(
        "hada_evaluate_task",
        peak=peak,
        tolerance=tolerance,
        distances_mm=distances if count else None,
        distances=count,
        match_gain=match_gain,
        authors=authors,
        lpips=None if lpips is None else lpips._c,
        mask=mask,
        truth_encoding=None if truth_encoding is None else responses.number(truth_encoding),
        encoding=None if encoding is None else responses.number(encoding),
        gate_pixels=gate_pixels,
        gate_depths=gate_depths,
    )
    if window is not None:
        options.set(window_rows=window[0], window_cols=window[1])
    if window_at is not None:
        options.set(window_row=window_at[0], window_col=window_at[1])
    monitor = Monitor(None)
    options.set(monitor=monitor.options)
    report = Owner("hada_evaluate_report", lib.hada_evaluate_report_destroy)
    monitor.run(lib.hada_evaluate_run, report.pointer, path(result), path(truth), options.c)
    rows = [lib.hada_evaluate_report_get(report.c, i)[0] for i in range(lib.hada_evaluate_report_count(report.c))]
    return [record(Evaluation, row, depth=record(DepthScore, row.depth)) for row in rows]
