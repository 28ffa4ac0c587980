"""From a stack of planes to an all-in-focus image and a distance map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from . import errors
from ._arrays import Float32, Floats, Image, NewImage
from ._native import Options, call, doubles, ffi, lib, record
from .device import Device, default


@dataclass(frozen=True)
class FocusReport:
    """What the focus step found: noise and threshold of the measure, margin, share of pixels with a distance."""

    noise: float
    threshold: float
    margin: float
    coverage: float


def focus_stack(
    stack: Any,
    distances_mm: Floats,
    *,
    competing: Sequence[bool] | None = None,
    shared: bool = False,
    measure: Literal["contrast", "energy", "combined"] | None = None,
    fuse: Literal["weighted", "sum"] | None = None,
    window_sigma: float | None = None,
    false_alarm: float | None = None,
    channel_axis: int | None = None,
    context: Device | None = None,
) -> tuple[Float32, Float32, FocusReport]:
    """Return an all-in-focus image (C, Y, X), a distance map (Y, X) in millimetres, and a report.

    Args:
        stack: (Z, C, Y, X), near to far.
        distances_mm: of the planes.
        competing: depths that take part; None: all.
        shared: the planes share out the light (refined ones); otherwise each holds the whole scene (linear filters).
        measure, fuse, window_sigma, false_alarm: None: what suits (hadalens/focus.h).
        channel_axis: of each plane; None: the first.
        context: a device.

    Example:
        >>> sharp, distances, report = hadalens.focus_stack(stack, [100.0, 250.0, 600.0])

    """
    images = Image(*stack, what="stack", channel_axis=channel_axis)
    if len(images.arrays) != len(distances_mm):
        raise errors.SizeError(f"{len(images.arrays)} planes and {len(distances_mm)} distances")
    if competing is not None and len(competing) != len(distances_mm):
        raise errors.SizeError(f"competing has {len(competing)} marks for {len(distances_mm)} planes")
    options = Options("hada_focus_options", int(shared))
    options.set(measure=measure, fuse=fuse, window_sigma=window_sigma, false_alarm=false_alarm)
    made = NewImage(2)
    report = ffi.new("hada_focus_report *", {"size": ffi.sizeof("hada_focus_report")})
    call(
        lib.hada_focus_stack,
        default(context)._c,
        images.c,
        doubles(distances_mm),
        len(distances_mm),
        ffi.NULL if competing is None else bytes(bytearray(map(bool, competing))),
        options.c,
        made.c,
        made.c + 1,
        report,
    )
    return made.array(0), made.plane(1), record(FocusReport, report[0])
