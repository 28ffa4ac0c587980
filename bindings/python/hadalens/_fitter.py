"""Learning a camera pair by pair."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, Unpack, cast

import numpy as np

from . import errors
from . import response as responses
from ._arrays import Float32, Floats, Mosaic, scale_of
from ._fit import FitOptions, fit_options, monitored, scores_of
from ._fit_report import FitReport
from ._native import Handle, Monitor, Options, Owner, call, check_names, ffi, lib, log, path, span, two, word
from ._pairs import Dataset, Pairs, Reader, as_dataset
from .device import Context, Device, default
from .model import Boundary, Model

#: Shows a pair again: (depth, pair) -> (raw, scene).
Show: TypeAlias = Callable[[int, int], tuple[Any, Any]]


class _Shown(Sequence[tuple[Any, Any]]):
    """The pairs of a depth, which a function gives when they are read."""

    def __init__(self, show: Show, depth: int, count: int) -> None:
        self.show, self.depth, self.pairs = show, depth, count

    def __len__(self) -> int:
        return self.pairs

    def __getitem__(self, pair: Any) -> Any:
        return self.show(self.depth, pair)


@dataclass
class _Seen:
    """What the pairs of a depth showed: frames and scenes with contrast, least PSNR of a scene as one brightness."""

    frames: int = 0
    scenes: int = 0
    flat: float = math.inf

    def add(self, raw: Float32, scene: Float32, window: tuple[int, int], response: float) -> None:
        rows, cols = (min(most, size) for most, size in zip(window, scene.shape[1:], strict=True))
        top, left = (scene.shape[1] - rows) // 2, (scene.shape[2] - cols) // 2
        shown = scene[:, top : top + rows, left : left + cols]
        light = shown if response < 0 and response != responses.SRGB else responses.convert(shown, response, "linear")
        spread = float(np.mean(np.var(light, axis=(1, 2), dtype=np.float64)))
        self.frames += bool(raw.min() != raw.max())
        self.scenes += spread > 0
        self.flat = min(self.flat, -10 * math.log10(max(spread, 1e-30)))


class Fitter(Handle):
    """Learns a camera pair by pair; memory does not grow with their number.

    Sums over the pairs are kept; they can be saved, loaded and merged, on one machine or on several. Ctrl-C ends what
    takes long, learning and finishing, within a second; the sums stay.

    Args:
        distances_mm: of the depths, near to far.
        raw_size: rows and columns of the raw frames.
        window: rows and columns of the scene; None: the frame's.
        channels: 1 for grey, 3 for colour.
        boundary: "circular", or "padded" where light leaves the sensor.
        grid: "padded": rows and columns of the grid; None: large enough for all light.
        context: a device; None: :meth:`Context.default`.
        channel_axis: of arrays of three axes; None: the first.
        full_scale: of raw frames, as for :meth:`Plan.run`.
        options: form, dark, alpha, regularisation, outside, refine_steps, refine_tv, refine_colour,
            refine_ridge, nonnegative, scene_response, frame_encoding, colour_matrix (neither is found here),
            crop_passes, leave_one_out, mosaic, downsample as in :func:`fit`; `raw_size` and `window` are of binned
            pixels, frames and scenes of the sensor's.

    Example:
        >>> fitter = hadalens.Fitter([100.0, 600.0], raw_size=(300, 400), window=(120, 120), channels=3)
        >>> for depth, raw, scene in captures:
        ...     fitter.add(depth, raw, scene)
        >>> model = fitter.finish()

    """

    def __init__(
        self,
        distances_mm: Floats,
        raw_size: tuple[int, int],
        *,
        window: tuple[int, int] | None = None,
        channels: int = 1,
        boundary: Boundary = "circular",
        grid: tuple[int, int] | None = None,
        context: Device | None = None,
        channel_axis: int | None = None,
        full_scale: float | None = None,
        **options: Unpack[FitOptions],
    ) -> None:
        """Take room for the sums."""
        check_names(options, FitOptions.__annotations__, "Fitter")
        chosen = fit_options(
            window=two(window, "window", raw_size),
            depths=len(distances_mm),
            distances_mm=distances_mm,
            channels=channels,
            raw_rows=raw_size[0],
            raw_cols=raw_size[1],
            boundary=boundary,
            grid_rows=None if grid is None else grid[0],
            grid_cols=None if grid is None else grid[1],
            **options,
        )
        self._start(default(context), chosen, channel_axis, full_scale)

    def _start(self, context: Context, options: Options, channel_axis: int | None, full_scale: float | None) -> None:
        self._monitor = Monitor(None)
        options.set(monitor=self._monitor.options)
        owner = Owner("hada_fitter", lib.hada_fitter_destroy, context._own, self._monitor)
        call(lib.hada_fitter_create, owner.pointer, context._c, options.c)
        self._owner = owner
        self._channel_axis, self._full_scale = channel_axis, scale_of(full_scale)
        self._window = (int(options.c.window_rows), int(options.c.window_cols))
        self._response = float(options.c.scene_response)
        sensor = options.c.sensor_mosaic if options.c.downsample > 1 else options.c.mosaic
        self._mosaic, self._downsample = cast(Mosaic, word("hada_mosaic", sensor)), int(options.c.downsample)
        info = self._info
        self._distances = tuple(info.distances_mm[z] for z in range(info.depths))
        self._seen = [_Seen() for _ in self._distances]
        self._scored: dict[float, list[tuple[Any, Any]]] = {distance: [] for distance in self._distances}

    @property
    def _info(self) -> Any:
        return lib.hada_fitter_get_info(self._c)

    @classmethod
    def from_sums(
        cls,
        name: str | os.PathLike[str],
        *,
        depths: int,
        context: Device | None = None,
        channel_axis: int | None = None,
        full_scale: float | None = None,
        **options: Unpack[FitOptions],
    ) -> Fitter:
        """Return a fitter from a file of sums; camera, depths and dark level are the file's."""
        check_names(options, FitOptions.__annotations__, "Fitter.from_sums")
        new = cls.__new__(cls)
        new._start(default(context), fit_options(sums=name, **options), channel_axis, full_scale)
        new._seen_elsewhere()
        if len(new._distances) != depths:
            raise errors.SizeError(f"{os.fspath(name)} has {len(new._distances)} depths, not {depths}")
        return new

    def add(self, depth: int, raw: Any, scene: Any) -> None:
        """Add a pair to the sums of a depth.

        Args:
            depth: index of the distance.
            raw: (Y, X) or (C, Y, X), dtypes as for :meth:`Plan.run`.
            scene: of the window's size, or the frame's, whose middle is used.

        Raises:
            NotFiniteError, SizeError: the pair is refused; the sums are as they were.

        """
        distance = self._distance(depth)
        images = Reader([[(raw, scene)]], self._channel_axis, self._full_scale).read(0, 0)
        pair = Dataset({distance: [images]}, mosaic=self._mosaic, downsample=self._downsample)
        monitored(self._monitor, pair, lib.hada_fitter_add, self._c, pair._c)
        self._seen[depth].add(*images, self._window, self._response)

    def _seen_elsewhere(self) -> None:
        """Nothing is known of pairs whose sums come from a file."""
        self._seen = [_Seen(1, 1, -math.inf) for _ in self._distances]

    def _distance(self, depth: int) -> float:
        if not 0 <= depth < len(self._distances):
            raise ValueError(f"depth {depth} is not one of the {len(self._distances)} of this fit")
        return float(self._distances[depth])

    def score(self, depth: int, raw: Any, scene: Any) -> None:
        """Give a pair of the sums again, for :meth:`finish` to leave out. A few choose alpha and regularisation."""
        self._scored[self._distance(depth)].append((raw, scene))

    def save_sums(self, name: str | os.PathLike[str]) -> None:
        """Write the sums into a file."""
        call(lib.hada_fitter_save_sums, self._c, path(name))

    def load_sums(self, name: str | os.PathLike[str]) -> None:
        """Add the sums of a file to those that are there."""
        call(lib.hada_fitter_load_sums, self._c, path(name))
        self._seen_elsewhere()

    @property
    def pairs(self) -> tuple[int, ...]:
        """Number of pairs in the sums of each depth."""
        info = self._info
        return tuple(info.pairs[z] for z in range(info.depths))

    def _shown(self) -> str:
        return f"{sum(self.pairs)} pairs, {span(self._distances)}"

    @property
    def bytes(self) -> int:
        """Bytes of device memory that the fitter holds."""
        return int(self._info.bytes)

    def finish(self, show: Show | None = None) -> Model:
        """Return the model of the pairs so far.

        Args:
            show: (depth, pair) -> (raw, scene): the pairs of the sums, in the order in which they were added, to leave
                some out, and to learn with the crop and in the window where that pays; None: the exact fit, with the
                choices of the pairs that were given to :meth:`score`.

        Raises:
            DatasetError: all frames of a depth, or all its scenes, are black or of one brightness.

        Example:
            >>> model = fitter.finish(show=lambda depth, pair: pairs[depth][pair])

        """
        for distance, seen, pairs in zip(self._distances, self._seen, self.pairs, strict=True):
            if pairs and not (seen.frames and seen.scenes):
                what = "scenes" if seen.frames else "raw frames"
                raise errors.DatasetError(
                    f"all {what} at {distance:g} mm are black or of one brightness: nothing can be learned from them; "
                    "check the light, the exposure, the lens cap and the pictures"
                )
        again: Pairs | None = None
        if show is not None:
            counts = enumerate(self.pairs)
            again = {self._distances[depth]: _Shown(show, depth, count) for depth, count in counts}
        elif any(self._scored.values()):
            again = self._scored
        data = None
        if again is not None:
            data = Dataset(
                again,
                channel_axis=self._channel_axis,
                mosaic=self._mosaic,
                downsample=self._downsample,
                full_scale=self._full_scale,
            )
        model = Owner("hada_model", lib.hada_model_destroy)
        arguments = (lib.hada_fitter_finish, self._c, ffi.NULL if data is None else data._c, model.pointer)
        monitored(self._monitor, data, *arguments)
        learned = Model._of(model)
        learned.fit_report = FitReport(*scores_of(self._info.scores), self.pairs, None, (), False)
        held_out = [score.psnr_single for score in learned.fit_report.filters]
        if held_out and max(held_out) < sum(seen.flat for seen in self._seen) / len(self._seen):
            log.warning(
                "the model is of no use: held-out scenes come out worse than images of one brightness; check that each "
                "frame is of its scene, that scenes are not turned or mirrored (hadalens.register finds it), and that "
                "frames show more than noise"
            )
        return learned


def find_boundary(
    pairs: Dataset | Pairs | str | os.PathLike[str],
    *,
    context: Device | None = None,
    channel_axis: int | None = None,
    full_scale: float | None = None,
) -> tuple[str, tuple[int, int] | None]:
    """Find from pairs whether light leaves the sensor, and the grid that serves.

    Returns:
        "circular" and None, or "padded" and rows and columns of the grid.

    Example:
        >>> boundary, grid = hadalens.find_boundary("camera")
        >>> fitter = hadalens.Fitter(distances, raw_size, boundary=boundary, grid=grid)

    """
    data = as_dataset(pairs, channel_axis, full_scale=full_scale)
    monitor = Monitor(None)
    options = fit_options(monitor=monitor.options)
    monitored(monitor, data, lib.hada_fit_find_boundary, options.c, default(context)._c, data._c)
    if options.c.boundary == lib.HADA_BOUNDARY_CIRCULAR:
        return "circular", None
    rows, cols = options.c.grid_rows, options.c.grid_cols
    return "padded", (rows, cols) if rows else None
