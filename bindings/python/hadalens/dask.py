"""Many frames on many workers, with Dask: threads of one process, or a cluster of processes and machines.

Each worker process keeps one plan. On a cluster each worker has a device: the environment variable HADALENS_DEVICE of
its process says which, or the argument `devices` here.
"""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt

from . import errors
from ._files import extra
from ._native import check_names
from ._plan_options import PlanOptions, indices
from .device import Context
from .model import Model, as_model
from .plan import Plan

with extra("dask"):
    import dask
    import dask.array as da
    from dask.base import tokenize

__all__ = ["Frames", "reconstruct"]


@dataclass(frozen=True)
class Frames:
    """Results of many frames, as Dask arrays that are computed when they are asked for.

    Compute several of them in one call, ``dask.compute(results.all_in_focus, results.distance_map)``: every frame is
    then reconstructed once.

    Attributes:
        stack: float32 (T, Z, C, Y, X), linear light.
        all_in_focus: float32 (T, C, Y, X).
        distance_map: float32 (T, Y, X), millimetres, NaN where nothing is in focus.
        distances_mm: (Z,), of the planes.

    """

    stack: Any
    all_in_focus: Any
    distance_map: Any
    distances_mm: tuple[float, ...]


def reconstruct(
    frames: Any,
    model: Model | str | os.PathLike[str],
    *,
    channel_axis: int | None = None,
    devices: str | Sequence[str] | None = None,
    **options: Unpack[PlanOptions],
) -> Frames:
    """Reconstruct an array of frames in blocks.

    Blocks of frames are tasks, so a worker holds the results of a few blocks at a time: some frames a block
    (``frames.rechunk({0: 8})``) keep that small. The bits are those of :meth:`hadalens.Plan.run`, whoever computes them
    (on devices of one kind).

    Args:
        frames: a Dask array, or what :func:`dask.array.asarray` makes one of: (T, Y, X), (T, C, Y, X), or with
            channel_axis=-1 (T, Y, X, C). Chunks along other axes than the first are put together.
        model: the camera; sent once to each worker.
        channel_axis: of a frame, where the channels do not stand first.
        devices: which device a worker uses, as :class:`hadalens.Context` takes it: one for all, or a list that is dealt
            out by the workers' numbers ("0:1/2", "0:2/2": two workers share a CPU). None: what the environment of each
            worker says (HADALENS_DEVICE), else what the library chooses there.
        options: of :class:`hadalens.Plan`, but for `warm_start`, which needs frames in their order.

    Raises:
        ValueError: `frames` are not frames, or frames would depend on those before them.
        HadalensError: when computed, as :meth:`hadalens.Plan.run`.

    Example:
        >>> with LocalCluster(n_workers=2, threads_per_worker=1) as cluster, Client(cluster):
        ...     results = hadalens.dask.reconstruct(frames, model, devices=["0:1/2", "0:2/2"])
        ...     pictures = results.all_in_focus.compute()

    """
    check_names(options, PlanOptions.__annotations__, "hadalens.dask.reconstruct")
    if options.get("warm_start"):
        raise errors.ArgumentError("warm_start=True: blocks are done in any order; Plan.map takes frames in theirs")
    model = as_model(model)
    array = da.asarray(frames)
    if array.ndim not in (3, 4) or not array.shape[0]:
        raise ValueError(f"frames are (T, Y, X), (T, C, Y, X), or (T, Y, X, C) with channel_axis=-1, not {array.shape}")
    array = array.rechunk(dict.fromkeys(range(1, array.ndim), -1))
    info = model.info
    if info.refine_tv < 0 and options.get("refine_tv") is None:
        options["refine_tv"] = "frame"  # a weight that is kept would go by the order in which blocks are done
    depths = options.get("depths")
    options["depths"] = None if depths is None else indices("depths", depths, info.depths)
    distances = tuple(info.distances_mm[z] for z in options["depths"] or range(info.depths))
    window = (info.channels, info.window_rows, info.window_cols)
    # The plan's key says all that it depends on: the same call again finds its plan.
    key = tokenize(model.__reduce__(), options)
    camera = dask.delayed(_Camera(key, model, options, devices), name=f"hadalens-camera-{key}", traverse=False)
    work = dask.delayed(_reconstruct, pure=True)
    parts: dict[str, list[Any]] = {"stack": [], "all_in_focus": [], "distance_map": []}
    shapes = {"stack": (len(distances), *window), "all_in_focus": window, "distance_map": window[1:]}
    for block, count in zip(array.to_delayed().ravel(), array.chunks[0], strict=True):
        if not count:
            continue
        done = work(block, camera, channel_axis)
        for name, shape in shapes.items():
            parts[name].append(da.from_delayed(done[name], (count, *shape), np.float32))
    return Frames(**{name: da.concatenate(blocks) for name, blocks in parts.items()}, distances_mm=distances)


@dataclass(frozen=True)
class _Camera:
    """What a worker makes its plan of."""

    key: str
    model: Model
    options: PlanOptions
    devices: str | Sequence[str] | None


def _reconstruct(frames: Any, camera: _Camera, channel_axis: int | None) -> dict[str, npt.NDArray[Any]]:
    """Reconstruct a block of frames, on a worker."""
    plan = _plan(camera)
    results = list(plan.map(frames, channel_axis=channel_axis))
    return {
        name: np.stack([getattr(one, name) for one in results]) for name in ("stack", "all_in_focus", "distance_map")
    }


_lock = threading.Lock()
_kept: tuple[str, Plan] | None = None


def _plan(camera: _Camera) -> Plan:
    """Return the plan of this process: threads share it; another camera's takes its place."""
    global _kept
    with _lock:
        device = _device(camera.devices)
        key = f"{camera.key} {device}"
        if _kept is None or _kept[0] != key:
            _kept = None  # its memory goes when the last thread is done with it
            context = None if device is None else Context(device)
            _kept = (key, Plan(camera.model, context=context, **camera.options))
        return _kept[1]


def _device(devices: str | Sequence[str] | None) -> str | None:
    if devices is None or isinstance(devices, str):
        return devices
    return devices[_number() % len(devices)]


def _number() -> int:
    """Return the number of this worker: its name where that is one, as in a LocalCluster; 0 without workers."""
    try:
        from distributed import get_worker

        name = get_worker().name
    except (ImportError, ValueError):
        return 0
    text = str(name)
    return int(text) if text.isdigit() else zlib.crc32(text.encode())
