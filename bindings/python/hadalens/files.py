"""Files: TIFF with all it says, frames to results in folders as the command does it, pictures to look at."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np

from . import errors
from . import response as responses
from ._arrays import Float32, Floats, Image, NewImage, as_array
from ._native import (
    AUTO,
    Handle,
    Monitor,
    Options,
    Owner,
    Progress,
    ascending,
    call,
    checked,
    expect,
    ffi,
    keep_error,
    lib,
    named,
    path,
    paths,
    record,
    text,
)
from ._plan_options import PlanOptions, plan_options
from .device import Device, contexts
from .model import Model, as_model
from .plan import Match, Plan
from .result import Result


@dataclass(frozen=True)
class TiffInfo:
    """What a file holds.

    Attributes:
        frames: images to read, (C, Y, X) each.
        channels, rows, cols: of the first.
        bits: per sample.
        scale: what stored numbers were divided by: 255, 65535, ..., 1 for floats.
        slices, times: of a hyperstack.
        pixel_width_um, pixel_height_um, slice_spacing: micrometres, 0 where the file does not say.
        distances_mm: of the slices, where the file says them.
        encoding: how values stand for light, as :mod:`hadalens.response` has it; 0 where the file does not say.
        description: the text of ImageDescription.
        mosaic: of a raw file: the pattern of its colour filter mosaic, "rggb", "bggr", "grbg", "gbrg"; else "none".

    """

    frames: int
    channels: int
    rows: int
    cols: int
    bits: int
    is_float: bool
    is_signed: bool
    scale: float
    slices: int
    times: int
    pixel_width_um: float
    pixel_height_um: float
    slice_spacing: float
    distances_mm: tuple[float, ...]
    encoding: float
    description: str
    mosaic: str


class TiffReader(Handle):
    """Reads a TIFF file frame by frame: memory does not grow with their number.

    Example:
        >>> with hadalens.TiffReader("sequence.tif") as file:
        ...     results = list(plan.map(file))

    """

    def __init__(self, name: str | os.PathLike[str]) -> None:
        """Open the file.

        Raises:
            FileOpenError, FileReadError, FileFormatError: missing, damaged, or no TIFF that can be read.

        """
        owner = Owner("hada_tiff_reader", lib.hada_tiff_close)
        call(lib.hada_tiff_open, owner.pointer, path(name))
        self._owner = owner

    @property
    def info(self) -> TiffInfo:
        """What the file holds."""
        info = lib.hada_tiff_get_info(self._c)[0]
        return record(TiffInfo, info, distances_mm=tuple(info.distances_mm[z] for z in range(info.distances)))

    def read(self, index: int) -> Float32:
        """Return frame `index`: float32 (C, Y, X), integers divided by full scale."""
        image = NewImage()
        call(lib.hada_tiff_read, self._c, index, image.c)
        return image.array()

    def _shown(self) -> str:
        info = self.info
        return f"{info.frames} frames of {info.channels} x {info.rows} x {info.cols}"

    def __len__(self) -> int:
        """Return the number of frames."""
        return int(lib.hada_tiff_get_info(self._c).frames)

    def __iter__(self) -> Iterator[Float32]:
        """Iterate over the frames."""
        for index in range(len(self)):
            yield self.read(index)


def read_tiff(name: str | os.PathLike[str], index: int | None = None) -> Float32:
    """Return the frames of a TIFF file: float32 (N, C, Y, X), integers divided by full scale.

    Args:
        name: the file.
        index: of one frame, which is returned as (C, Y, X); None: all, of one size.

    Raises:
        FileOpenError, FileReadError, FileFormatError: missing, damaged, or no TIFF that can be read.

    Example:
        >>> raw = hadalens.read_tiff("frame.tif", 0)

    """
    if index is not None:
        image = NewImage()
        call(lib.hada_tiff_load, path(name), index, image.c)
        return image.array()
    with TiffReader(name) as reader:
        return np.stack(list(reader))


def write_tiff(
    name: str | os.PathLike[str],
    frames: Any,
    *,
    bits: Literal[8, 16, 32] = 32,
    hyperstack: bool = False,
    distances_mm: Floats | None = None,
    pixel_um: float | None = None,
    scale: float = 1.0,
    description: str | None = None,
    compress: bool = False,
    encoding: float | str | None = None,
    channel_axis: int | None = None,
) -> Path:
    """Write frames into a TIFF file with the metadata that the library reads again; whole or not at all.

    Args:
        name: the file.
        frames: (Y, X), (C, Y, X), or (N, C, Y, X).
        bits: 32 (float), or 16 and 8 (integers, clipped).
        hyperstack: as ImageJ has it, frames being slices; with distances it is one anyway.
        distances_mm: of the frames, near to far.
        pixel_um: size of a pixel.
        scale: the value that becomes full scale in 8 and 16 bits.
        description: further lines for the metadata, "key=value".
        compress: deflate.
        encoding: how the values stand for light ("linear", "srgb", a power), stated in the metadata.
        channel_axis: of each frame; None: the first.

    Returns:
        The path.

    Example:
        >>> hadalens.write_tiff("stack.tif", result.stack, distances_mm=result.distances_mm)

    """
    array = as_array(frames, "frames")
    several = array if array.ndim == 4 else array[np.newaxis]
    images = Image(*several, what="frames", channel_axis=channel_axis)
    distances = None if distances_mm is None else ascending(distances_mm)
    if distances is not None and len(distances) != len(images.arrays):
        raise errors.SizeError(f"{len(distances)} distances for {len(images.arrays)} frames")
    options = Options(
        "hada_tiff_write_options",
        bits=bits,
        layout="hyperstack" if hyperstack or distances is not None else "pages",
        slices=len(images.arrays),
        times=1,
        distances_mm=distances,
        pixel_um=pixel_um,
        scale=scale,
        description=description,
        compress=compress,
        encoding=None if encoding is None else responses.number(encoding),
    )
    writer = ffi.new("hada_tiff_writer **")
    call(lib.hada_tiff_create, writer, path(name), *images.arrays[0].shape, options.c)
    try:
        for index in range(len(images.arrays)):
            call(lib.hada_tiff_write, writer[0], images.c + index)
        call(lib.hada_tiff_finish, writer)
    finally:
        lib.hada_tiff_abandon(writer)  # nothing where it is finished
    return Path(name)


@dataclass(frozen=True)
class FileResult:
    """What became of a file of frames.

    Attributes:
        path: of the frames.
        frames: how many it had; 0 where it was passed over.
        outputs: files that were written; empty where it failed or was passed over.
        error: why, where it failed.
        there: its results were there already, and it was passed over.
        match: whether the camera belongs to its first frame; None: they were not compared.

    """

    path: Path
    frames: int
    outputs: tuple[Path, ...]
    error: errors.HadalensError | None
    there: bool = False
    match: Match | None = None


class _FilesMonitor(Monitor):
    def __init__(self, progress: Progress | bool | None, tell: Callable[[str, int], None] | None) -> None:
        super().__init__(progress)
        self.tell = tell
        self.results: list[FileResult] = []
        self.match: Match | None = None


@ffi.def_extern(onerror=keep_error)  # type: ignore[untyped-decorator]
def py_files_task_tell(user: Any, state: Any) -> None:
    """Take down what became of a file."""
    from ._native import error_of

    monitor = ffi.from_handle(user)
    name = Path(text(state.path))
    if state.event == lib.HADA_FILES_BEGINS:
        monitor.match = None
    elif state.event == lib.HADA_FILES_FRAME:
        if state.match:
            monitor.match = record(Match, state.match)
        if monitor.tell is not None:
            monitor.tell(str(name), state.frame)
    elif state.event == lib.HADA_FILES_DONE:
        places = [
            text(one)
            for one in (*state.outputs, state.confidence, state.picture, state.emitters_table, state.tracks_table)
        ]
        outputs = tuple(Path(one) for one in places if one)
        monitor.results.append(FileResult(name, state.frames, outputs, None, match=monitor.match))
    elif state.event == lib.HADA_FILES_THERE:
        monitor.results.append(FileResult(name, 0, (), None, there=True))
    elif state.event == lib.HADA_FILES_FAILED:
        monitor.results.append(FileResult(name, state.frames, (), error_of(state.error[0])))


@named
def reconstruct_files(
    plan: Plan,
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    preview: bool = True,
    picture: bool = False,
    emitters: bool = False,
    track_pixels: float = 2.0,
    track_depths: float = 2.5,
    track_gap: int = 2,
    pixel_um: float = 0.0,
    format: Literal["tiff", "numpy"] = "tiff",
    bits: Literal[8, 16, 32] = 32,
    white: float = 1.0,
    encoding: float | str | None = None,
    frame_encoding: float | str | None = None,
    resume: bool = False,
    match: Literal["none", "first", "each"] = "first",
    frame: Any = None,
    tell: Callable[[str, int], None] | None = None,
    progress: Progress | bool | None = None,
) -> list[FileResult]:
    """Reconstruct files of frames into a folder, as ``hadalens reconstruct`` does.

    For each NAME.tif: NAME_stack.tif, NAME_aif.tif, NAME_preview.png, NAME_depth.tif of several depths, and of surfaces
    NAME_confidence.tif. A file that cannot be done does not stop the others.

    Args:
        plan: of the model.
        files: of one frame or a sequence; TIFF, PNG, JPEG, NumPy, MATLAB or raw files.
        output: the folder, made where it is missing.
        preview: a sheet to look at.
        picture: also NAME_aif.png, the first all-in-focus image for a display.
        emitters: also NAME_emitters.csv, the points of light; of a plan with scene="volume" (:meth:`Plan.emitters`);
            of a sequence NAME_tracks.csv, too.
        track_pixels: the largest motion of emitters from frame to frame (:func:`hadalens.track_emitters`).
        track_depths: and along depths.
        track_gap: frames without its emitter after which a track goes on.
        pixel_um: size of a pixel in the scene, stated in the TIFF files; 0: not known.
        format: "numpy": NAME_stack.npy (frames, depths, Y, X, C), NAME_aif.npy and the maps (frames, Y, X, C).
        bits: of stack and all-in-focus image.
        white: value that becomes full scale in 8 and 16 bits.
        encoding: how these stand for light; None: as the scenes of the model did.
        frame_encoding: how the frames stand for light; None: as their files say, else as the model knows.
        resume: files whose results stand in the folder are passed over, whatever made them.
        match: whether the camera belongs to the first frame, or to the first one of each file, is in the results, and
            logged where it does not (:meth:`Plan.match`).
        frame: in place of what the only file holds, such as that of :func:`hadalens.merge_exposures`; as for
            :meth:`Plan.run`.
        tell: called with path and frame number as frames are done.
        progress: a function, or True for tqdm's bars.

    Example:
        >>> for done in hadalens.reconstruct_files(plan, glob.glob("raw/*.tif"), "pictures"):
        ...     print(done.path, done.error or done.outputs)

    """
    expect(plan, Plan, "plan")
    monitor = _FilesMonitor(progress, tell)
    task = Options(
        "hada_files_task",
        output=output,
        preview=preview,
        picture=picture,
        emitters=emitters,
        track_pixels=track_pixels,
        track_depths=track_depths,
        track_gap=track_gap,
        pixel_um=pixel_um,
        format=format,
        bits=bits,
        white=white,
        encoding=None if encoding is None else responses.number(encoding),
        frame_encoding=None if frame_encoding is None else responses.number(frame_encoding),
        resume=resume,
        match=match,
        tell=lib.py_files_task_tell,
        user=monitor.user,
        monitor=monitor.options,
    )
    if frame is not None:
        image = Image(frame, what="frame", full_scale=plan._full_scale)
        task.kept.append(image)
        task.set(frame=image.c)
    names = paths(files)
    array = ffi.new("char *[]", names)
    monitor.run(lib.hada_reconstruct_files, plan._c, plan.model._c, array, len(names), task.c, ffi.NULL)
    return monitor.results


@dataclass(frozen=True)
class Pace:
    """Steps of refinement that keep up with a camera.

    Attributes:
        refine: for :class:`Plan`: the most steps that keep up, or 1; None: all do, or nothing is refined.
        seconds: that a frame takes with them, with reading; more than 1 / fps: they do not keep up.
        seconds_whole: the same with all steps.
        change: of the planes, to all steps, as a part of them.

    """

    refine: int | None
    seconds: float
    seconds_whole: float
    change: float


def find_pace(
    model: Model | str | os.PathLike[str],
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    fps: float,
    *,
    context: Device | Sequence[Device] | None = None,
    frame_encoding: float | str | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[PlanOptions],
) -> Pace:
    """Return how many steps of refinement keep up with so many frames a second, by the first five of some files.

    That depends on how fast the machine is at the time; what a plan with these steps makes does not.

    Args:
        model: the camera.
        files: frames, two at least.
        fps: frames a second.
        context: the device, or several.
        frame_encoding: how the frames stand for light; None: as their files say, else as the model knows.
        progress: a function, or True for tqdm's bars.
        options: those of :class:`Plan`; of `refine`, fewer are tried.

    Example:
        >>> pace = hadalens.find_pace(model, ["film.tif"], 25, warm_start=True)
        >>> plan = hadalens.Plan(model, refine=pace.refine, warm_start=True)

    """
    own, used = as_model(model), contexts(context)
    monitor = Monitor(progress)
    task = Options(
        "hada_files_task",
        frame_encoding=None if frame_encoding is None else responses.number(frame_encoding),
        monitor=monitor.options,
    )
    pace = ffi.new("hada_pace *", {"size": ffi.sizeof("hada_pace")})
    names = paths(files)
    devices, array = ffi.new("hada_context *[]", [one._c for one in used]), ffi.new("char *[]", names)
    plan = plan_options(own.info.depths, **options)
    monitor.run(lib.hada_files_pace, pace, devices, len(used), own._c, plan.c, array, len(names), task.c, fps)
    steps = None if pace.steps == AUTO else pace.steps
    return Pace(steps, pace.seconds, pace.seconds_whole, pace.change)


def pictures_available() -> bool:
    """Return whether previews can be drawn (cairo is there)."""
    return bool(lib.hada_pictures_available())


def save_preview(
    name: str | os.PathLike[str],
    result: Result,
    *,
    raw: Any = None,
    title: str | None = None,
    gamma: float | None = None,
    channel_axis: int | None = None,
    full_scale: float | None = None,
) -> Path:
    """Draw a sheet (PNG) of a result: all-in-focus image, distance map with its scale, and the stack.

    Of a volume maximum projections, grey and coloured by distance, in place of the first two.

    Of a single depth the first alone, which shows it. `channel_axis` and `full_scale` are the raw frame's.

    Raises:
        UnsupportedError: there is no cairo.

    """
    images = Image(*result.stack, what="stack")
    others = Image(result.all_in_focus, result.distance_map, what="result")
    frame = None if raw is None else Image(raw, what="raw", channel_axis=channel_axis, full_scale=full_scale)
    several, volume = len(images.arrays) > 1, result.report.scene == "volume"
    options = Options(
        "hada_preview",
        title=title,
        raw=None if frame is None else frame.c,
        planes=images.c if several else None,
        depths=len(images.arrays),
        distances_mm=result.distances_mm,
        occupied=None if volume else result.report.occupied,
        volume=volume,
        all_in_focus=others.c,
        distance_map=others.c + 1 if several else None,
        gamma=gamma,
    )
    call(lib.hada_preview_save, path(name), options.c)
    return Path(name)


def save_png(
    name: str | os.PathLike[str],
    image: Any,
    *,
    white: float | None = None,
    gamma: float | None = None,
    channel_axis: int | None = None,
) -> Path:
    """Draw an image (Y, X) or (C, Y, X) of linear light as PNG.

    Args:
        name: the file.
        image: the image.
        white: the value that is white; None: the 99.9th percentile.
        gamma: exponent; None: as sRGB.
        channel_axis: where the channels stand; None: first.

    """
    chosen = [AUTO if value is None else checked(name, value) for name, value in (("white", white), ("gamma", gamma))]
    call(lib.hada_png_save, path(name), Image(image, channel_axis=channel_axis).c, *chosen)
    return Path(name)


LIMITS = ("pixels", "pages", "text", "parameters", "isolate", "seconds")


def set_limits(limits: str | None) -> None:
    """Set the budgets for files from elsewhere, such as "pixels=4G,isolate=all"; None: back to the environment's."""
    if limits is None:
        call(lib.hada_limits_set, ffi.NULL)
        return
    options = Options("hada_limits")
    call(lib.hada_limits_parse, options.c, limits.encode())
    call(lib.hada_limits_set, options.c)


def limits() -> dict[str, int]:
    """Return the budgets in force: numbers of a page, pages, bytes of a text, parameters of a net, ...

    "isolate" is 0, 1 or 2 for "none", "some" and "all".
    """
    options = Options("hada_limits")
    call(lib.hada_limits_get, options.c)
    return {name: int(getattr(options.c, name)) for name in LIMITS}


def set_headerless(frames: str | None) -> None:
    """Say how this process reads files of no known format: as frames without a header; None: not at all.

    Args:
        frames: "HxW:PIXELS", or "HxW:PIXELS:N" where rows begin every N bytes. PIXELS: u8; u10, u12, u14, u16 in two
            bytes, the lower one first; csi10, csi12 packed as MIPI CSI-2 has it; rgb8.

    Example:
        >>> hadalens.set_headerless("1520x2028:csi12")
        >>> frames = hadalens.read_tiff("frames.raw")

    """
    call(lib.hada_headerless_set, ffi.NULL if frames is None else frames.encode())
