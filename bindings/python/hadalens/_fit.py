"""Learning a camera from pairs: all at once, or pair by pair."""

from __future__ import annotations

import numbers
import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, TypedDict

import numpy.typing as npt

from . import errors
from . import response as responses
from ._arrays import Mosaic, MosaicOfFiles, nine
from ._fit_report import FilterScore, FitReport, OutsideScore, RefineScore, ResponseRow
from ._native import (
    AUTO,
    Monitor,
    Options,
    Owner,
    Progress,
    brief,
    call,
    ffi,
    lib,
    named,
    paths,
    record,
    two,
    value_of,
)
from ._pairs import Dataset, Pairs, as_dataset
from .device import Device, default
from .model import Boundary, Model


def _each(rows: Any) -> Iterator[Any]:
    """Iterate over a list of pointers that NULL ends."""
    index = 0
    while rows[index] != ffi.NULL:
        yield rows[index][0]
        index += 1


def scores_of(
    scores: Any,
) -> tuple[tuple[FilterScore, ...], tuple[OutsideScore, ...], tuple[RefineScore, ...]]:
    """Return what was compared, of each kind."""
    return (
        tuple(record(FilterScore, row, regularisation=getattr(row, "lambda")) for row in _each(scores.filters)),
        tuple(record(OutsideScore, row) for row in _each(scores.outsides)),
        tuple(record(RefineScore, row) for row in _each(scores.refinements)),
    )


class FitOptions(TypedDict, total=False):
    """What :func:`fit` and :class:`Fitter` take alike, by keyword."""

    form: Literal["complex", "split"]
    dark: float | Literal["pairs"] | None
    alpha: float | None
    regularisation: float | None
    outside: float | None
    refine_steps: int | None
    refine_tv: float | None
    refine_colour: float | None
    refine_ridge: float | None
    nonnegative: bool
    scene_response: float | str | None
    frame_encoding: float | str | None
    colour_matrix: npt.ArrayLike | Literal["auto"] | None
    crop_passes: int | None
    leave_one_out: bool
    mosaic: Mosaic
    downsample: int


def fit_options(
    *,
    form: str = "complex",
    window: tuple[int, int] | None = None,
    dark: float | Literal["pairs"] | None = "pairs",
    alpha: float | None = None,
    regularisation: float | None = None,
    outside: float | None = None,
    refine_steps: int | None = None,
    refine_tv: float | None = None,
    refine_colour: float | None = None,
    refine_ridge: float | None = None,
    nonnegative: bool = True,
    scene_response: float | str | None = None,
    frame_encoding: float | str | None = None,
    colour_matrix: npt.ArrayLike | Literal["auto"] | None = "auto",
    crop_passes: int | None = None,
    leave_one_out: bool = True,
    mosaic: Mosaic = "none",
    downsample: int = 1,
    **others: Any,
) -> Options:
    """Return hada_fit_options of what fit and Fitter take alike."""
    rows, cols = two(window, "window")
    find_dark = isinstance(dark, str) and dark == "pairs"
    if not find_dark and not isinstance(dark, numbers.Real | None):
        raise TypeError(f"dark={brief(dark)}: a level, 'pairs' or None is needed; a frame is Dataset(dark_frame=...)")
    found = isinstance(colour_matrix, str)
    if found and colour_matrix != "auto":
        raise errors.ArgumentError(f"colour_matrix={colour_matrix!r} is not known: 'auto', None, or 3 x 3 numbers")
    return Options(
        "hada_fit_options",
        form=form,
        window_rows=rows,
        window_cols=cols,
        dark=0.0 if find_dark else AUTO if dark is None else dark,
        find_dark=find_dark,
        alpha=alpha,
        outside=outside,
        refine_steps=refine_steps,
        refine_tv=refine_tv,
        refine_colour=refine_colour,
        refine_ridge=refine_ridge,
        nonnegative=nonnegative,
        scene_response=None if scene_response is None else responses.number(scene_response),
        frame_encoding=None if frame_encoding is None else responses.number(frame_encoding),
        find_colours=found,
        colour_matrix=None if found or colour_matrix is None else nine(colour_matrix),
        crop_passes=crop_passes,
        leave_one_out=leave_one_out,
        mosaic="none" if downsample > 1 else mosaic,
        downsample=downsample,
        sensor_mosaic=mosaic if downsample > 1 else "none",
        **{"lambda": regularisation},
        **others,
    )


@named
def fit(
    pairs: Dataset | Pairs | str | os.PathLike[str] | None,
    *,
    context: Device | None = None,
    boundary: Boundary | None = None,
    window: tuple[int, int] | None = None,
    form: Literal["complex", "split"] = "complex",
    dark: float | Literal["pairs"] | None = "pairs",
    alpha: float | None = None,
    regularisation: float | None = None,
    outside: float | None = None,
    refine_steps: int | None = None,
    refine_tv: float | None = None,
    refine_colour: float | None = None,
    refine_ridge: float | None = None,
    nonnegative: bool = True,
    scene_response: float | str | None = None,
    frame_encoding: float | str | None = None,
    colour_matrix: npt.ArrayLike | Literal["auto"] | None = "auto",
    exposure: Literal["auto", "same", "each"] = "auto",
    crop_passes: int | None = None,
    leave_one_out: bool = True,
    half: bool = False,
    merge: Sequence[str | os.PathLike[str]] | str | os.PathLike[str] = (),
    save_sums: str | os.PathLike[str] | None = None,
    resume: bool = False,
    save_seconds: float | None = None,
    all_pairs: bool = False,
    mosaic: MosaicOfFiles = "auto",
    downsample: int = 1,
    channel_axis: int | None = None,
    full_scale: float | None = None,
    progress: Progress | bool | None = None,
) -> Model:
    """Learn a camera from pairs of raw frame and known scene: what ``hadalens fit`` does, with the same bits.

    Args:
        pairs: a folder, a :class:`Dataset`, {distance in mm: [(raw, scene), ...]}, or (distance, raw, scene) one after
            the other. None: from the sums of `merge` alone.
        context: a device; None: :meth:`Context.default`.
        boundary: whether light leaves the sensor ("padded") or not ("circular"); None: found from the pairs.
        window: rows and columns of the scene; None: the scenes' size.
        form: of the filters.
        dark: taken off the frames; "pairs": found from all pairs; None: estimated from each frame.
        alpha, regularisation, outside, refine_steps, refine_tv, refine_colour, refine_ridge, crop_passes: None: chosen
            by leaving pairs out (docs/explanation/learning-a-camera.md, docs/explanation/refinement.md).
        nonnegative: point spread functions are nowhere negative, where the pairs say too little.
        scene_response: how scenes stand for light: "linear", "srgb", a power; None: found.
        frame_encoding: the same of files of whole numbers that hold raw frames and do not say it, of the pairs and of
            new frames; None: "linear", or "srgb" where that explains the pairs far better.
        colour_matrix: (3, 3), of each of the sensor's channels what it sees of the scenes' red, green and blue; "auto":
            found from pairs in full colour; None: they see the same. Results have the scenes' colours.
        exposure: whether frames of a depth were exposed alike: "auto" (found), "same" or "each".
        leave_one_out: False: what is open takes plain defaults, at once.
        half: filters in half precision.
        merge: files of sums (:meth:`Fitter.save_sums`) of the same camera, to add.
        save_sums: a file for the sums over all pairs.
        resume: go on after an interruption: pairs that `save_sums` holds, or what was saved on the way beside it, are
            not added again. The bits are those of a fit without interruption.
        save_seconds: between saves on the way, at least; None: 60.
        all_pairs: also those that spoil what the others of their depth say (frames that are cut off, or of another
            scene), which are left out otherwise; ``model.fit_report.left_out`` names them.
        mosaic: of pairs that are no :class:`Dataset`, which knows it: pattern of the colour filter mosaic that raw
            frames of one channel are; "auto": as raw files state (DNG).
        downsample: of the same: raw frames and scenes are binned, N x N pixels to one.
        channel_axis: of arrays of three axes; None: the first.
        full_scale: of raw frames of pairs that are no :class:`Dataset`, as for :meth:`Plan.run`.
        progress: a function (what, done, total, note), or True for tqdm's bars.

    Returns:
        The model; ``model.fit_report`` tells what the choices were made from.

    Raises:
        DatasetError, SizeError, NotFiniteError: pairs that are incomplete or do not fit.
        KeyboardInterrupt: Ctrl-C ends it within a second.

    Example:
        >>> model = hadalens.fit("camera", progress=True)
        >>> model = hadalens.fit({100.0: near, 600.0: far})
        >>> model.save("camera.model")

    """
    data = None if pairs is None else as_dataset(pairs, channel_axis, mosaic, downsample, full_scale)
    options = fit_options(
        form=form,
        window=window,
        dark=dark,
        alpha=alpha,
        regularisation=regularisation,
        outside=outside,
        refine_steps=refine_steps,
        refine_tv=refine_tv,
        refine_colour=refine_colour,
        refine_ridge=refine_ridge,
        nonnegative=nonnegative,
        scene_response=scene_response,
        frame_encoding=frame_encoding,
        colour_matrix=colour_matrix,
        crop_passes=crop_passes,
        leave_one_out=leave_one_out,
    )
    monitor = Monitor(progress)
    task = Options(
        "hada_fit_task",
        fit=options,
        boundary=None if boundary is None else value_of("hada_boundary", boundary, "boundary"),
        half=half,
        save_sums=save_sums,
        resume=resume,
        save_seconds=save_seconds,
        all_pairs=all_pairs,
        monitor=monitor.options,
        exposure=exposure,
    )
    names = paths(merge)
    array = ffi.new("char *[]", names)  # which lives until C is done, as the names do
    task.set(merge=array if names else None, merge_count=len(names))
    model = Owner("hada_model", lib.hada_model_destroy)
    report = Owner("hada_fit_report", lib.hada_fit_report_destroy)
    monitored(
        monitor,
        data,
        lib.hada_fit_run,
        model.pointer,
        report.pointer,
        default(context)._c,
        ffi.NULL if data is None else data._c,
        task.c,
    )
    learned = Model._of(model)
    learned.fit_report = _report(report.c, (0,) * learned.info.depths if data is None else data.counts)
    return learned


def monitored(monitor: Monitor, data: Dataset | None, function: Callable[..., int], *arguments: Any) -> None:
    """Call C, which may read pairs of `data`.

    What a Ctrl-C or progress raised comes before what reading pairs raised, and that before C.
    """
    monitor.error = None
    reader = None if data is None else data._reader
    if reader is not None:
        reader.monitor = monitor
    try:
        (call if data is None else data._call)(function, *arguments)
    except Exception as failed:
        if monitor.error is not None:
            raise monitor.error from failed
        raise
    finally:
        if reader is not None:
            reader.monitor = None
    if monitor.error is not None:
        raise monitor.error


def _report(report: Any, counts: Sequence[int]) -> FitReport:
    depths = len(counts)
    left_out = tuple(
        (depth, pair)
        for depth in range(depths if report.left_out != ffi.NULL else 0)
        for pair in range(counts[depth])
        if report.left_out[depth][pair]
    )
    compared = scores_of(report.scores)
    pairs = tuple(report.pairs[z] for z in range(depths))
    survey = report.survey
    if survey == ffi.NULL:
        return FitReport(*compared, pairs, None, (), False, left_out)
    responses = tuple(record(ResponseRow, row) for row in _each(survey.rows))
    return FitReport(*compared, pairs, survey.response, responses, bool(survey.exposed), left_out)
