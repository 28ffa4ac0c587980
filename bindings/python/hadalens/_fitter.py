"""Learning a camera pair by pair."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeAlias

from ._arrays import Floats, Image
from ._fit import FitReport, fit_options, monitored, scores_of
from ._native import Caller, Handle, Monitor, Options, Owner, call, ffi, keep_error, lib, path
from ._pairs import Dataset, Pairs, as_dataset
from .device import Context, default
from .model import Boundary, Model

#: Shows a pair again: (depth, pair) -> (raw, scene).
Show: TypeAlias = Callable[[int, int], tuple[Any, Any]]


class _Shower(Caller):
    """Shows pairs to C again."""

    def __init__(self, show: Show, channel_axis: int | None) -> None:
        super().__init__()
        self.show = show
        self.channel_axis = channel_axis
        self.shown: Any = None


@ffi.def_extern(error=lib.HADA_ERROR_CANCELLED, onerror=keep_error)  # type: ignore[untyped-decorator]
def py_fit_show(user: Any, depth: int, pair: int, raw: Any, scene: Any, _err: Any) -> int:
    """Show a pair to C; it lasts until the next one."""
    shower = ffi.from_handle(user)
    frame, shown = shower.show(depth, pair)
    shower.shown = (
        Image(frame, what="raw", channel_axis=shower.channel_axis),
        Image(shown, what="scene", channel_axis=shower.channel_axis),
    )
    raw[0], scene[0] = (image.c for image in shower.shown)
    return int(lib.HADA_OK)


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
        options: form, dark, alpha, regularisation, outside, refine_steps, refine_tv, refine_colour,
            refine_shrink, nonnegative, scene_response, crop_passes as in :func:`fit`.

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
        context: Context | None = None,
        channel_axis: int | None = None,
        **options: Any,
    ) -> None:
        """Take room for the sums."""
        chosen = fit_options(
            window=window or raw_size,
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
        self._start(lib.hada_fitter_create, default(context), chosen, channel_axis, len(distances_mm))

    def _start(
        self, create: Any, context: Context, options: Options, channel_axis: int | None, depths: int, *given: Any
    ) -> None:
        self._monitor = Monitor(None)
        options.set(monitor=self._monitor.options)
        owner = Owner("hada_fitter", lib.hada_fitter_destroy, context._own, self._monitor)
        call(create, owner.pointer, context._c, *given, options.c)
        self._owner = owner
        self._channel_axis = channel_axis
        self._depths = depths

    @classmethod
    def from_sums(
        cls,
        name: str | os.PathLike[str],
        *,
        depths: int,
        context: Context | None = None,
        channel_axis: int | None = None,
        **options: Any,
    ) -> Fitter:
        """Return a fitter from a file of sums; camera, depths and dark level are the file's."""
        new = cls.__new__(cls)
        chosen = fit_options(**options)
        new._start(lib.hada_fitter_create_from_sums, default(context), chosen, channel_axis, depths, path(name))
        return new

    def _images(self, raw: Any, scene: Any) -> tuple[Image, Image]:
        axis = self._channel_axis
        return Image(raw, what="raw", channel_axis=axis), Image(scene, what="scene", channel_axis=axis)

    def add(self, depth: int, raw: Any, scene: Any) -> None:
        """Add a pair to the sums of a depth.

        Args:
            depth: index of the distance.
            raw: (Y, X) or (C, Y, X), dtypes as for :meth:`Plan.run`.
            scene: of the window's size, or the frame's, whose middle is used.

        Raises:
            NotFiniteError, SizeError: the pair is refused; the sums are as they were.

        """
        frame, shown = self._images(raw, scene)
        call(lib.hada_fitter_add, self._c, depth, frame.c, shown.c)

    def score(self, depth: int, raw: Any, scene: Any) -> None:
        """Show a pair of the sums again: its leave-one-out errors choose alpha and regularisation. A few are enough."""
        frame, shown = self._images(raw, scene)
        call(lib.hada_fitter_score, self._c, depth, frame.c, shown.c)

    def save_sums(self, name: str | os.PathLike[str]) -> None:
        """Write the sums into a file."""
        call(lib.hada_fitter_save_sums, self._c, path(name))

    def load_sums(self, name: str | os.PathLike[str]) -> None:
        """Add the sums of a file to those that are there."""
        call(lib.hada_fitter_load_sums, self._c, path(name))

    @property
    def pairs(self) -> tuple[int, ...]:
        """Number of pairs in the sums of each depth."""
        return tuple(lib.hada_fitter_pairs(self._c, z) for z in range(self._depths))

    @property
    def bytes(self) -> int:
        """Bytes of device memory that the fitter holds."""
        return int(lib.hada_fitter_bytes(self._c))

    def _show_all(self, function: Any, show: Show, *others: Any) -> None:
        shower = _Shower(show, self._channel_axis)
        monitored(self._monitor, shower.run, function, self._c, lib.py_fit_show, shower.user, *others)

    def learn_cropped(self, show: Show) -> None:
        """Learn transfer functions with the crop of the sensor in the model ("padded"); pairs are shown again.

        Args:
            show: (depth, pair) -> (raw, scene): the pairs of the sums, in the order in which they were added.

        """
        self._show_all(lib.hada_fitter_learn_cropped, show)

    def learn_windowed(self, show: Show) -> None:
        """Judge filters in the window alone; every pair is shown up to 12 times. `show` as in learn_cropped."""
        self._show_all(lib.hada_fitter_learn_windowed, show)

    def finish(self, show: Show | None = None) -> Model:
        """Return the model of the pairs so far.

        Args:
            show: (depth, pair) -> (raw, scene), to learn with the crop and in the window where that serves; None: the
                exact fit.

        Example:
            >>> model = fitter.finish(show=lambda depth, pair: pairs[depth][pair])

        """
        model = Owner("hada_model", lib.hada_model_destroy)
        scores = Owner("hada_fit_scores", lib.hada_fit_scores_destroy)
        if show is None:
            monitored(self._monitor, call, lib.hada_fitter_finish, self._c, model.pointer, scores.pointer)
        else:
            self._show_all(lib.hada_fitter_learn_and_finish, show, model.pointer, scores.pointer)
        learned = Model._of(model)
        learned.fit_report = FitReport(*scores_of(scores.c), self.pairs, None, (), False)
        return learned


def find_boundary(
    pairs: Dataset | Pairs | str | os.PathLike[str], *, context: Context | None = None, channel_axis: int | None = None
) -> tuple[str, tuple[int, int] | None]:
    """Find from pairs whether light leaves the sensor, and the grid that serves.

    Returns:
        "circular" and None, or "padded" and rows and columns of the grid.

    Example:
        >>> boundary, grid = hadalens.find_boundary("camera")
        >>> fitter = hadalens.Fitter(distances, raw_size, boundary=boundary, grid=grid)

    """
    data = as_dataset(pairs, channel_axis)
    monitor = Monitor(None)
    options = fit_options(monitor=monitor.options)
    data._call(lib.hada_fit_options_from_dataset, options.c, data._c, lib.HADA_BOUNDARY_PADDED, ffi.NULL)
    shower = _Shower(data.read, None)
    counts = ffi.new("int[]", data.counts)
    arguments = (options.c, default(context)._c, counts, lib.py_fit_show, shower.user)
    monitored(monitor, shower.run, lib.hada_fit_find_boundary, *arguments)
    if options.c.boundary == lib.HADA_BOUNDARY_CIRCULAR:
        return "circular", None
    rows, cols = options.c.grid_rows, options.c.grid_cols
    return "padded", (rows, cols) if rows else None
