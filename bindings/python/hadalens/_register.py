"""How scenes stand on the sensor, found from pairs alone."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import errors
from ._arrays import Float32, Image, NewImage
from ._fit import monitored
from ._native import Monitor, Options, Owner, Progress, call, ffi, lib, path, record, two
from ._pairs import Dataset, Pairs, as_dataset


@dataclass(frozen=True)
class Registration:
    """Where the pixels of a scene stand on the sensor's grid (hadalens/register.h has the formula).

    Attributes:
        mirrored: left and right exchanged; with two quarter turns: upside down.
        quarter_turns: 0 to 3, counter-clockwise.
        magnification: pixels of the sensor per pixel of the scene.
        rotation_deg: the rest of the turn.
        offset_row, offset_col: in pixels of the sensor.
        explained: share of the frames' structure that this transform explains.
        explained_otherwise: with the best one of another orientation.
        perspective_row, perspective_col: of a tilted display, per pixel of the sensor.

    """

    mirrored: bool = False
    quarter_turns: int = 0
    magnification: float = 1.0
    rotation_deg: float = 0.0
    offset_row: float = 0.0
    offset_col: float = 0.0
    explained: float = 0.0
    explained_otherwise: float = 0.0
    perspective_row: float = 0.0
    perspective_col: float = 0.0

    def _options(self) -> Options:
        if not self.magnification > 0:
            raise errors.ArgumentError(f"magnification={self.magnification} is not possible; it is above 0")
        return Options("hada_registration", **vars(self))

    def apply(self, scene: Any, size: tuple[int, int] | None = None, *, channel_axis: int | None = None) -> Float32:
        """Return a scene on the sensor's grid, (C, Y, X); zero where it has nothing.

        Args:
            scene: (Y, X) or (C, Y, X).
            size: rows and columns about the same middle; None: what the scene fills.
            channel_axis: of the scene; None: the first.

        """
        given, made, options = Image(scene, what="scene", channel_axis=channel_axis), NewImage(), self._options()
        rows, cols = two(size, "size", self.size(*given.arrays[0].shape[1:]))
        call(lib.hada_register_apply, made.c, given.c, options.c, rows, cols)
        return made.array()

    def size(self, rows: int, cols: int) -> tuple[int, int]:
        """Return the size that a scene of rows x cols has on the sensor."""
        out = ffi.new("int[2]")
        lib.hada_register_size(self._options().c, rows, cols, out, out + 1)
        return out[0], out[1]


def _task(magnification: tuple[float, float] | None, most_rotation_deg: float | None, **others: Any) -> Options:
    least, most = two(magnification, "magnification")
    return Options(
        "hada_register_task",
        least_magnification=least,
        most_magnification=most,
        most_rotation_deg=most_rotation_deg,
        **others,
    )


def register(
    raws: Sequence[Any],
    scenes: Sequence[Any],
    *,
    magnification: tuple[float, float] | None = None,
    most_rotation_deg: float | None = None,
    channel_axis: int | None = None,
    full_scale: float | None = None,
) -> Registration:
    """Find how the scenes of one depth stand on the sensor, from two pairs or more.

    Args:
        raws: frames of one size, (Y, X) or (C, Y, X).
        scenes: of one size.
        magnification: least and most that are searched; None: chosen.
        most_rotation_deg: to either side of the quarter turns; None: 15.
        channel_axis: of arrays of three axes; None: the first.
        full_scale: of `raws`, as for :meth:`Plan.run`.

    Raises:
        DatasetError: the pairs do not tell.
        KeyboardInterrupt: Ctrl-C ends it at once.

    Example:
        >>> found = hadalens.register(raws, scenes)
        >>> registered = [found.apply(scene) for scene in scenes]

    """
    data = Dataset({1.0: list(zip(raws, scenes, strict=True))}, channel_axis=channel_axis, full_scale=full_scale)
    return register_dataset(data, magnification=magnification, most_rotation_deg=most_rotation_deg)[0].found


@dataclass(frozen=True)
class RegisteredDepth:
    """What was found for a depth of a folder, and what of it is applied (hadalens/task_register.h)."""

    found: Registration
    applied: Registration
    pairs: int
    scene_rows: int
    scene_cols: int
    displacement: float
    likeness: float
    offset_unknown: bool
    rough: bool
    other_orientation: bool
    stands_right: bool


def register_dataset(
    data: Dataset | Pairs | str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    place: bool = False,
    keep_offsets: bool = False,
    window: tuple[int, int] | None = None,
    magnification: tuple[float, float] | None = None,
    most_rotation_deg: float | None = None,
    progress: Progress | bool | None = None,
) -> list[RegisteredDepth]:
    """Find how the scenes of each depth of a data set stand, as ``hadalens register`` does.

    Args:
        data: the pairs, or their folder.
        output: a folder for a data set with registered scenes, for pairs that are files; None: nothing is written.
        place: `data`, a :class:`Dataset` of files, gives out registered scenes from now on.
        keep_offsets: shifts between the depths are left as they are.
        window: rows and columns of the registered scenes; None: what they fill.
        magnification, most_rotation_deg: as of :func:`register`.
        progress: a function, or True for tqdm's bars.

    Example:
        >>> data = hadalens.Dataset.scan("captures")
        >>> hadalens.register_dataset(data, place=True)
        >>> model = hadalens.fit(data)

    """
    monitor, data = Monitor(progress), as_dataset(data)
    rows, cols = two(window, "window")
    task = _task(
        magnification,
        most_rotation_deg,
        keep_offsets=keep_offsets,
        window_rows=rows,
        window_cols=cols,
        monitor=monitor.options,
    )
    report = Owner("hada_register_report", lib.hada_register_report_destroy)
    monitored(monitor, data, lib.hada_register_run, report.pointer, data._c, task.c)
    if output is not None:
        arguments = (report.c, data._c, path(Path(output)), task.c, ffi.NULL, ffi.NULL)
        monitored(monitor, data, lib.hada_register_write, *arguments)
    if place:
        monitored(monitor, data, lib.hada_register_place, report.c, data._c, task.c, ffi.NULL, ffi.NULL)
    found = [report.c.depths[z][0] for z in range(len(data.distances_mm))]
    return [
        record(
            RegisteredDepth,
            one,
            found=record(Registration, one.found[0]),
            applied=record(Registration, one.applied[0]),
        )
        for one in found
    ]
