"""What a camera resolves, by its point spread functions; and these by wave optics."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Float32, Image, NewImage
from ._camera import Camera
from ._native import AUTO, Handle, Monitor, Options, Owner, Progress, call, checked, ffi, lib, path, record, span, two
from ._show import members, table
from .device import Device, default

__all__ = [
    "OpticsReport",
    "OpticsRow",
    "Wave",
    "report",
    "write_report",
]


def __dir__() -> list[str]:
    """Return the names for users."""
    return __all__


class Wave(Handle):
    """Makes point spread functions of a camera by wave optics on a device; used by one thread at a time.

    Args:
        camera: it is copied.
        coherent: all lenses together, with the fringes where their spots overlap; takes far more memory.
        stray: share of light that may be left out; None: 0.002.
        context: a device; None: :meth:`Context.default`.

    Example:
        >>> psf = hadalens.optics.Wave(hadalens.Camera("sim300")).psf(250.0)

    """

    def __init__(
        self, camera: Camera, *, coherent: bool = False, stray: float | None = None, context: Device | None = None
    ) -> None:
        """Make ready."""
        used = default(context)
        options = Options("hada_wave_options", coherent=coherent, stray=stray)
        owner = Owner("hada_wave", lib.hada_wave_destroy, used._own)
        call(lib.hada_wave_create, owner.pointer, used._c, camera._c, options.c)
        self._owner = owner
        self._size = (camera.rows, camera.cols)

    def psf(self, distance_mm: float, size: tuple[int, int] | None = None) -> Float32:
        """Return the point spread function (C, Y, X) at a distance, the axis at (rows // 2, columns // 2)."""
        image = NewImage()
        call(lib.hada_wave_psf, self._c, distance_mm, *two(size, "size", self._size), image.c)
        return image.array()


@dataclass(frozen=True)
class OpticsRow:
    """What a camera resolves at a distance; the members are those of hada_optics_row (hadalens/optics.h)."""

    distance_mm: float
    magnification: float
    defocus_pixels: float
    airy_pixels: float
    object_pixel_mm: float
    light: float
    spot_pixels: float
    sidelobe: float
    cutoff: float
    support: float
    lateral_mm: float
    axial_mm: float
    axial_design_mm: float
    occupancy: float


@dataclass(frozen=True, repr=False)
class OpticsReport:
    """What a camera resolves.

    Attributes:
        rows: of each distance.
        threshold: of the MTF, for cutoff and support.
        mtf: float64 (depth, frequency): mean of abs(OTF) over rings; 1 at 0.
        self_correlation: float64 (depth, lag): largest self-correlation at that many pixels.
        correlation: float64 (depth, depth): of the point spread functions with each other.

    """

    rows: tuple[OpticsRow, ...]
    threshold: float
    mtf: npt.NDArray[np.float64]
    self_correlation: npt.NDArray[np.float64]
    correlation: npt.NDArray[np.float64]

    def __repr__(self) -> str:
        """Return distances in a line."""
        return f"<OpticsReport: {span([row.distance_mm for row in self.rows])}>"

    def _repr_html_(self) -> str:
        names = [name for name, _ in members(self.rows[0])]
        return table(repr(self), [names, *([value for _, value in members(row)] for row in self.rows)])


def _array(pointer: Any, *shape: int) -> npt.NDArray[np.float64]:
    return np.frombuffer(ffi.buffer(pointer, 8 * int(np.prod(shape))), np.float64).reshape(shape).copy()


def _report(report: Any) -> OpticsReport:
    curves = lib.hada_optics_report_curves(report)
    depths = curves.depths
    return OpticsReport(
        tuple(record(OpticsRow, lib.hada_optics_report_row(report, z)[0]) for z in range(depths)),
        curves.threshold,
        _array(curves.mtf, depths, curves.frequencies),
        _array(curves.self, depths, curves.lags),
        _array(curves.correlation, depths, depths),
    )


def report(
    camera: Camera | str, psfs: Any = None, *, threshold: float | None = None, context: Device | None = None
) -> OpticsReport:
    """Return what a camera resolves.

    Args:
        camera: with its distances; or a preset.
        psfs: (Z, Y, X) or (Z, C, Y, X), designed or measured, of the sensor's size; None: the camera's own.
        threshold: of the MTF; None: 0.05.
        context: a device; None: :meth:`Context.default`.

    Example:
        >>> for row in hadalens.optics.report(camera).rows:
        ...     print(row.distance_mm, row.lateral_mm, row.axial_mm)

    """
    used, camera = default(context), Camera._of(camera)
    images = Image(*(camera.psf_stack(context=used) if psfs is None else psfs), what="psfs")
    owner = Owner("hada_optics_report", lib.hada_optics_report_destroy, used._own)
    level = AUTO if threshold is None else checked("threshold", threshold)
    call(lib.hada_optics_report_create, owner.pointer, used._c, camera._c, level)
    for index in range(len(images.arrays)):
        call(lib.hada_optics_report_add, owner.c, images.c + index)
    return _report(owner.c)


def write_report(
    camera: Camera | str,
    folder: str | os.PathLike[str],
    *,
    psf: str | os.PathLike[str] | None = None,
    coherent: bool = False,
    threshold: float | None = None,
    context: Device | None = None,
    progress: Progress | bool | None = None,
) -> OpticsReport:
    """Write what ``hadalens optics`` writes into a folder: tables, curves and pictures; return the report."""
    monitor, camera = Monitor(progress), Camera._of(camera)
    task = Options("hada_optics_task", psf=psf, coherent=coherent, threshold=threshold, monitor=monitor.options)
    owner = Owner("hada_optics_report", lib.hada_optics_report_destroy)
    monitor.run(lib.hada_optics_run, owner.pointer, default(context)._c, camera._c, path(folder), task.c)
    return _report(owner.c)
