"""Plans: a model on a device, and what frames become there."""

from __future__ import annotations

import collections
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Unpack

import numpy as np
import numpy.typing as npt

from . import errors
from ._arrays import Mosaic, Pixels, check_out
from ._job import Job
from ._native import Handle, Monitor, Options, Owner, call, check_names, ffi, lib, log, named, record
from ._plan_options import Classic, Method, PlanOptions, Skip, plan_options
from .device import Device, address_of, contexts, default
from .model import Model, as_model
from .result import Result, Results

_SAME = 3  # frames in a row that are repeated: somebody measures time


@dataclass(frozen=True)
class QueueInfo:
    """What a queue of a plan did: frames begun, batches of depths done, seconds busy; `lost`: it failed."""

    device: int
    frames: int
    batches: int
    busy_seconds: float
    lost: bool


@dataclass(frozen=True)
class Match:
    """Whether a camera belongs to a frame.

    Attributes:
        verdict: "belongs"; "turned" or "magnified": such a camera explains the frame better; "unrelated": the camera
            explains it no better than turned ones; "unknown": noise is all that is left, or the frame says too little.
        turn: how the point spread functions have to be turned, as :meth:`Model.from_psf` has it.
        magnification: of the better camera.
        factor: what the camera leaves unexplained over what the best other way leaves.
        unexplained: of the frame's fine structure, at a reduced size.

    """

    verdict: str
    turn: str
    magnification: float
    factor: float
    unexplained: float


@dataclass(frozen=True)
class KernelTime:
    """Time of a kernel, or of a kind of transfer, in a stage; bytes and flops are the least that the work needs."""

    name: str
    stage: str
    transfer: bool
    launches: int
    seconds: float
    bytes: float
    flops: float


@dataclass(frozen=True)
class CallCounts:
    """What a plan asked of its devices so far: calls, and bytes that went up and came down."""

    launches: int
    transfers: int
    waits: int
    arguments: int
    bytes_up: float
    bytes_down: float


class Plan(Handle):
    """A model on one or more devices, ready to reconstruct frames. Any thread may hand frames in.

    Args:
        model: the camera, or its file.
        context: a device, by its name as well, or several that share the frames; None: :meth:`Context.default`.
        depths: indices of the depths to compute, ascending, or a mask of all depths; None: all.
        occupied: depths where the scene may be: "auto" (found for each frame), "all", their indices, or a mask.
        scene: what scenes are taken for: "auto", "planes" (objects at some depths), "surface" (one texture on one
            continuous surface, anywhere between the depths) or "volume" (light at all depths, such as emitters).
        refine: steps of refinement; None: the model's, 0: linear filters alone.
        refine_tv: weight of total variation in it; "frame": found from each frame; None: the model's, or where it knows
            none found from a frame, and kept for those after it while their noise and light stay the same.
        refine_colour: there, weight of differences of colour over those of brightness, 1 to 16; None: the model's.
        refine_ridge: there, strength of the learned regulariser in the last steps, 0 (none) to 100; None: the model's.
        crosstalk: where refined planes are dark beside a brighter one, their light goes there: the share of its light
            at which they keep half, 0 (they stay as refined) to 1; None: 0.12.
        dark: taken off the frames: None (what the model says), "auto" (each frame's own, estimated), a level from 0
            (nothing) to 1, or a dark frame (an array like raw frames).
        pixel_weights: how much each of a frame's values counts in refinement and in classic methods that iterate: 0
            (bad pixels, dust) or more, in units of the largest; an array (rows, cols), or like raw frames; None: all
            alike.
        flat_frame: an evenly lit sensor, its dark level taken off, by which frames are divided: an array (rows, cols),
            or like raw frames; None: the model's, where it has one.
        mosaic: pattern of the colour filter mosaic that frames of one channel are: "rggb", "bggr", "grbg", "gbrg",
            "none"; "auto": what the model says. Planes have the model's three channels.
        downsample: frames of so many times the model's rows and columns are binned; `mosaic` is the sensor's then, and
            dark and flat frame and `pixel_weights` may be of the sensor's size too; None: as the model says.
        support: of refinement where a sensor crops: where light may come from, the "window" or the whole "grid";
            "auto": the grid for models of point spread functions whose window is the whole frame.
        repair: NaN and infinite pixels take the median of their neighbours; otherwise such frames are refused.
        enhance: planes go through the model's net, where it has one.
        classic: a :class:`Classic` method in place of filters and refinement, or its word.
        gamma: exponent on the finished images; 1: linear.
        max_error: largest relative L2 change of the stack that skipped work may bring; 0: only what is exact.
        skip: kinds of work that may be skipped; None: all, (): none. docs/explanation/speed-and-accuracy.md.
        band: share of the sensor's Nyquist limits beyond which linear filters leave frequencies out; 1: none.
        half: filters on the device in half precision.
        batch: depths at once; None: chosen from the memory.
        queues: frames in flight on each device; None: 1.
        warm_start: frames are a sequence, in the order in which they are given: each one's refinement goes on from the
            one before, unless too much changed. One queue of the first device does it.
        full_scale: what frames, and arrays for `dark` and `flat_frame`, are divided by, such as 4095 for 12 bits in
            uint16, floats as well; None: integers by their type's full scale, floats by nothing.

    Raises:
        ModelError, ArgumentError: options that do not fit the model, or are not possible.
        DeviceMemoryError: the device has too little memory; the message says what would help.

    Example:
        >>> plan = hadalens.Plan(hadalens.Model.load("camera.model"))
        >>> result = plan.run(tifffile.imread("frame.tif"), channel_axis=-1)
        >>> result.stack.shape, result.stack.dtype
        ((4, 3, 120, 120), dtype('float32'))

    """

    @named
    def __init__(
        self,
        model: Model | str | os.PathLike[str],
        *,
        context: Device | Sequence[Device] | None = None,
        depths: Sequence[int] | None = None,
        occupied: Literal["auto", "all"] | Sequence[int] = "auto",
        scene: Literal["auto", "planes", "surface", "volume"] = "auto",
        refine: int | None = None,
        refine_tv: float | Literal["frame"] | None = None,
        refine_colour: float | None = None,
        refine_ridge: float | None = None,
        crosstalk: float | None = None,
        dark: Any = None,
        pixel_weights: Any = None,
        flat_frame: Any = None,
        mosaic: Literal["auto"] | Mosaic = "auto",
        support: Literal["auto", "window", "grid"] = "auto",
        repair: bool = False,
        enhance: bool = True,
        classic: Classic | Method | None = None,
        gamma: float = 1.0,
        max_error: float = 0.0,
        skip: Iterable[Skip] | None = None,
        band: float = 1.0,
        half: bool = False,
        batch: int | None = None,
        queues: int | None = None,
        downsample: int | None = None,
        warm_start: bool = False,
        full_scale: float | None = None,
    ) -> None:
        """Make the plan: memory on the device is taken, kernels are compiled or loaded."""
        model = as_model(model)
        info = model.info
        options = plan_options(
            info.depths,
            depths=depths,
            occupied=occupied,
            scene=scene,
            refine=refine,
            refine_tv=refine_tv,
            refine_colour=refine_colour,
            refine_ridge=refine_ridge,
            crosstalk=crosstalk,
            dark=dark,
            pixel_weights=pixel_weights,
            flat_frame=flat_frame,
            mosaic=mosaic,
            support=support,
            repair=repair,
            enhance=enhance,
            classic=classic,
            gamma=gamma,
            max_error=max_error,
            skip=skip,
            band=band,
            half=half,
            batch=batch,
            queues=queues,
            downsample=downsample,
            warm_start=warm_start,
            full_scale=full_scale,
        )
        used = contexts(context)
        owner = Owner("hada_plan", lib.hada_plan_destroy, [one._own for one in used], model._own)
        array = ffi.new("hada_context *[]", [one._c for one in used])
        call(lib.hada_plan_create_on, owner.pointer, array, len(used), model._c, options.c)
        self._owner = owner
        self._same = 0
        self.model = model
        self._full_scale = full_scale
        self._planes = info.depths if depths is None else int(options.c.depth_count)
        self._frame = (info.channels, info.raw_rows, info.raw_cols)
        self._window = (info.channels, info.window_rows, info.window_cols)

    @property
    def stack_shape(self) -> tuple[int, int, int, int]:
        """Shape (Z, C, Y, X) of the stacks."""
        return (self._planes, *self._window)

    def _results(self, out: Any) -> Results:
        shape = self.stack_shape
        buffer = _device_buffer(out, shape, "out")
        if buffer is not None:
            results = self._results(None)
            arrays = Options("hada_cl_arrays", stack=buffer[0], stack_offset=buffer[1])
            call(lib.hada_result_use_cl, results.c, arrays.c)
            results.device = out  # which must live as long
            start = int(ffi.cast("uintptr_t", buffer[0]))
            results.filled.append((start, buffer[1], buffer[1] + 4 * math.prod(shape)))
            return results
        if isinstance(out, Result):
            return Results(
                check_out(out.stack, shape, "out.stack"),
                check_out(out.all_in_focus, shape[1:], "out.all_in_focus"),
                check_out(out.distance_map, shape[2:], "out.distance_map"),
            )
        stack = np.empty(shape, np.float32) if out is None else check_out(out, shape, "out")
        return Results(stack, np.empty(shape[1:], np.float32), np.empty(shape[2:], np.float32))

    def _pixels(self, raw: Any, channel_axis: int | None, full_scale: float | None, copy: bool = False) -> Pixels:
        return Pixels(raw, channel_axis, self._full_scale if full_scale is None else full_scale, copy=copy)

    def run(
        self,
        raw: Any,
        out: Any = None,
        *,
        channel_axis: int | None = None,
        full_scale: float | None = None,
    ) -> Result:
        """Reconstruct one frame.

        Args:
            raw: (Y, X), (C, Y, X), or with channel_axis=-1 (Y, X, C), in linear light. Integers of 8, 16 or 32 bits
                are divided by their full scale, float32 is read where it stands, float64 is copied. Anything with the
                array interface, DLPack or the buffer protocol on the host; ``pyopencl`` arrays and buffers on a
                device of :meth:`Context.adopt`, float32 (C, Y, X).
            out: what is filled: the stack, a dense float32 array (Z, C, Y, X), or a :class:`Result` of an earlier
                frame, whose arrays are used again; None: new arrays. A ``pyopencl`` array or buffer on the plan's
                device gets the stack as well, without a way over the host.
            channel_axis: where the channels stand; None: first.
            full_scale: what values are divided by, such as 4095 for 12 bits in uint16, floats as well; None: the
                plan's, else integers by their type's.

        Raises:
            TypeError: no array, or of another dtype.
            ModelError: the frame has not the model's size or channels.
            NotFiniteError: it holds NaN or infinite values, and the plan does not repair.
            HadalensError: other failures; the message says what to do.

        Example:
            >>> result = plan.run(raw)
            >>> result = plan.run(raw, out=result)  # the same arrays, filled again

        """
        job = self.submit(raw, out, channel_axis=channel_axis, full_scale=full_scale)
        try:
            result = job.result()
        except BaseException:
            job.cancel()
            raise
        self._same = self._same + 1 if result.report.skipped.frame else 0
        if self._same == _SAME:
            log.warning(
                "%d frames in a row were that before them, and were not computed: take new frames to measure time, or "
                "plans with skip=()",
                _SAME,
            )
        return result

    def submit(
        self,
        raw: Any,
        out: Any = None,
        *,
        channel_axis: int | None = None,
        full_scale: float | None = None,
        copy: bool = False,
    ) -> Job:
        """Hand a frame in and return at once; arguments as :meth:`run`.

        Args:
            raw, out, channel_axis, full_scale: as of :meth:`run`.
            copy: the frame is copied; otherwise it must not change until the job has ended.

        Raises:
            StateError: another job that has not ended fills `out`, or a part of it.

        Example:
            >>> first, second = plan.submit(a), plan.submit(b)
            >>> stack = (await first).stack

        """
        results = self._results(out)
        buffer = _device_buffer(raw, self._frame, "raw")
        if buffer is not None:
            if full_scale is not None or self._full_scale is not None:
                raise errors.ArgumentError("full_scale is of arrays on the host: divide those on the device before")
            frame = Options("hada_cl_frame", pixels=buffer[0], offset=buffer[1], queue=buffer[2])
            return Job(self._own, lib.hada_job_submit_cl, frame.c, results, (raw, frame))
        pixels = self._pixels(raw, channel_axis, full_scale, copy)
        return Job(self._own, lib.hada_job_submit_pixels, pixels.c, results, pixels)

    def map(
        self,
        frames: Iterable[Any],
        *,
        channel_axis: int | None = None,
        full_scale: float | None = None,
        copy: bool = True,
    ) -> Iterator[Result]:
        """Yield the results of many frames in their order, some of them being computed while others are read.

        Memory does not grow with their number: as many frames are in flight as the plan has queues, and two more.

        Args:
            frames: one after the other, as :meth:`run` takes them.
            channel_axis, full_scale: as of :meth:`run`.
            copy: each frame is copied when it comes, so that cameras and readers may fill one buffer again and again.
                False saves the copy where every frame is an array of its own. Frames on a device are never copied.

        Example:
            >>> with tifffile.TiffFile("sequence.tif") as file:
            ...     for result in plan.map(page.asarray() for page in file.pages):
            ...         show(result.all_in_focus)

        """
        jobs: collections.deque[Job] = collections.deque()
        ahead = lib.hada_files_ahead(self._c)
        try:
            for raw in frames:
                jobs.append(self.submit(raw, channel_axis=channel_axis, full_scale=full_scale, copy=copy))
                if len(jobs) >= ahead:
                    yield jobs.popleft().result()
            while jobs:
                yield jobs.popleft().result()
        finally:
            for job in jobs:
                job.cancel()

    def match(self, raw: Any, *, channel_axis: int | None = None, full_scale: float | None = None) -> Match:
        """Return whether the camera belongs to a frame, by turned and magnified ones beside it.

        Example:
            >>> if plan.match(raw).verdict not in ("belongs", "unknown"):
            ...     print("another camera, or its point spread function lies another way")

        """
        pixels = self._pixels(raw, channel_axis, full_scale)
        match = ffi.new("hada_match *", {"size": ffi.sizeof("hada_match")})
        call(lib.hada_plan_match, self._c, pixels.c, match)
        return record(Match, match)

    def emitters(
        self, raw: Any, *, channel_axis: int | None = None, full_scale: float | None = None
    ) -> npt.NDArray[np.void]:
        """Reconstruct a frame as a volume and return the points of light in it, by falling amplitude.

        The plan has scene="volume" and a model of one channel. Fields: x, y (pixels of the window) and z (depths), all
        from 0 on and between whole numbers; distance_mm; amplitude, in light of a voxel; sd_x, sd_y, sd_z and
        sd_amplitude, standard deviations; residual, what is left of the frame around it.

        Example:
            >>> found = hadalens.Plan(model, scene="volume").emitters(raw)
            >>> found["z"][found["amplitude"] > 2]

        """
        results, pixels = self._results(None), self._pixels(raw, channel_axis, full_scale)
        job = Job(self._own, lib.hada_job_submit_pixels, pixels.c, results, pixels)
        try:
            job.result()
        except BaseException:
            job.cancel()
            raise
        found = Owner("hada_emitters", lib.hada_memory_destroy)
        monitor = Monitor(None)
        monitor.run(lib.hada_plan_emitters, found.pointer, self._c, pixels.c, results.c, monitor.c)
        names = [name for name, _ in ffi.typeof("hada_emitter").fields]
        rows = [found.c.list[i] for i in range(found.c.count)]
        return np.array([tuple(getattr(row, name) for name in names) for row in rows], [(name, "f8") for name in names])

    @staticmethod
    def estimate(
        model: Model | str | os.PathLike[str], *, context: Device | None = None, **options: Unpack[PlanOptions]
    ) -> tuple[int, int]:
        """Return the bytes that a plan would need on the device, and that a run would add on the host.

        `options` are those of a plan; nothing is allocated.
        """
        device, host = ffi.new("uint64_t *"), ffi.new("uint64_t *")
        check_names(options, PlanOptions.__annotations__, "Plan.estimate")
        model = as_model(model)
        chosen = plan_options(model.info.depths, **options)
        call(lib.hada_plan_estimate, default(context)._c, model._c, chosen.c, device, host)
        return int(device[0]), int(host[0])

    @property
    def memory(self) -> tuple[int, int]:
        """Bytes of device memory that the plan holds, and that it would hold if buffers did not share room."""
        held, apart = ffi.new("uint64_t *"), ffi.new("uint64_t *")
        lib.hada_plan_memory(self._c, held, apart)
        return int(held[0]), int(apart[0])

    @property
    def queues(self) -> list[QueueInfo]:
        """What each queue did so far."""
        count = lib.hada_plan_queues(self._c, ffi.NULL, 0)
        rows = ffi.new("hada_queue_info[]", count)
        lib.hada_plan_queues(self._c, rows, count)
        return [record(QueueInfo, rows[i]) for i in range(count)]

    def cl_queue(self, index: int = 0) -> int:
        """Return the address of the cl_command_queue that a queue works on, 0 where it has none now."""
        return int(ffi.cast("uintptr_t", lib.hada_plan_cl_queue(self._c, index)))

    def profile(self, on: bool = True) -> None:
        """Turn profiling on, from nothing, or off, which forgets; not while a frame runs."""
        call(lib.hada_plan_profile, self._c, on)

    def kernel_times(self) -> list[KernelTime]:
        """Return where the time went since profiling was turned on.

        Raises:
            StateError: profiling is off.

        """
        rows, count = ffi.new("hada_kernel_time **"), ffi.new("size_t *")
        call(lib.hada_plan_kernel_times, self._c, rows, count)
        times = [record(KernelTime, rows[0][i]) for i in range(count[0])]
        lib.hada_memory_destroy(rows)
        return times

    def calls(self) -> CallCounts:
        """Return what was asked of the devices since the plan was made; the difference of two is a frame's."""
        counts = ffi.new("hada_call_counts *")
        call(lib.hada_plan_calls, self._c, counts)
        return record(CallCounts, counts)

    def _shown(self) -> str:
        return f"stacks of {' x '.join(map(str, self.stack_shape))}, of {self.model!r}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Plans stay in their process."""
        raise TypeError("a Plan cannot be pickled: pickle its model, and make a plan in each process")


def _device_buffer(given: Any, shape: tuple[int, ...], what: str) -> tuple[Any, int, Any] | None:
    """Return buffer, offset and queue of a pyopencl array (of this shape) or buffer; None for everything else."""
    data = getattr(given, "base_data", None)
    if data is None:
        return (ffi.cast("cl_mem", address_of(given)), 0, None) if hasattr(given, "int_ptr") else None
    if given.dtype != np.float32 or not given.flags.c_contiguous:
        raise TypeError(f"{what} on the device must be dense float32")
    if given.shape != shape and (1, *given.shape) != shape:
        raise errors.SizeError(f"{what} has the shape {given.shape}: {shape} is needed")
    queue = None if given.queue is None else ffi.cast("cl_command_queue", address_of(given.queue))
    return ffi.cast("cl_mem", address_of(data)), int(given.offset), queue


def track_emitters(
    frames: Iterable[npt.NDArray[np.void]], *, pixels: float = 2.0, depths: float = 2.5, gap: int = 2
) -> npt.NDArray[np.void]:
    """Join the emitters of successive frames to tracks, all at once for each frame.

    Args:
        frames: what :meth:`Plan.emitters` returned for each.
        pixels: the largest motion from a frame to the next, to which deviations of places add.
        depths: and along depths.
        gap: a track goes on after so many frames without its emitter.

    Returns a table with the fields of `frames` behind `track` and `frame`, track by track, both from 0 on.

    Example:
        >>> table = hadalens.track_emitters(plan.emitters(raw) for raw in film)
        >>> trace = table[table["track"] == 3]["amplitude"]

    """
    tracker = Owner("hada_tracker", lib.hada_tracker_destroy)
    call(lib.hada_tracker_create, tracker.pointer, pixels, depths, gap)
    names = [name for name, _ in ffi.typeof("hada_emitter").fields]
    rows: list[tuple[float, ...]] = []
    for number, frame in enumerate(frames):
        if not isinstance(frame, np.ndarray) or not set(names) <= set(frame.dtype.names or ()):
            raise TypeError(f"frame {number} is no table of Plan.emitters; frames are several of them")
        emitters = ffi.new("hada_emitter[]", [{name: float(one[name]) for name in names} for one in frame])
        pointers = ffi.new("hada_emitter *[]", [emitters + i for i in range(len(frame))])
        tracks = ffi.new("int[]", len(frame))
        call(lib.hada_tracker_add, tracker.c, pointers, len(frame), tracks)
        rows += [(track, number, *one.item()) for track, one in zip(tracks, frame, strict=True)]
    kinds = [("track", "i8"), ("frame", "i8"), *((name, "f8") for name in names)]
    return np.array(sorted(rows, key=lambda row: row[:2]), kinds)
