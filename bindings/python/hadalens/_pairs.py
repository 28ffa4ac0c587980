"""Pairs of raw frame and known scene: folders as people keep them, or arrays."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Self, TypeAlias

import numpy as np

from . import errors
from . import response as responses
from ._arrays import Float32, Image, Mosaic, MosaicOfFiles, NewImage, address, as_array, copy_of, planes_first, to_float
from ._native import (
    AUTO,
    Caller,
    Handle,
    Monitor,
    Options,
    Owner,
    call,
    ffi,
    keep_error,
    lib,
    path,
    span,
    text,
    value_of,
)

#: An image of a pair: an array, a TIFF or .npy file, or a function without arguments that returns an array.
Source: TypeAlias = Any
#: Pairs of arrays: {distance in mm: sequence of (raw, scene)}, or an iterable of (distance in mm, raw, scene).
Pairs: TypeAlias = Mapping[float, Sequence[tuple[Source, Source]]] | Iterable[tuple[float, Source, Source]]


class Reader(Caller):
    """Gives pairs of arrays to C.

    A Ctrl-C while a pair is read is kept with the monitor of the call, if there is one, and the pair is read again: C
    then stops as it does for any Ctrl-C, and keeps what is done so far. A second one comes through at once.
    """

    monitor: Monitor | None = None

    def __init__(self, depths: list[Sequence[tuple[Source, Source]]], channel_axis: int | None) -> None:
        super().__init__()
        self.depths = depths
        self.channel_axis = channel_axis

    def read(self, depth: int, pair: int) -> tuple[Float32, Float32]:
        try:
            return self._read(depth, pair)
        except KeyboardInterrupt as stop:
            if self.monitor is None or self.monitor.error is not None:
                raise
            self.monitor.error = stop
        return self._read(depth, pair)

    def _read(self, depth: int, pair: int) -> tuple[Float32, Float32]:
        raw, scene = self.depths[depth][pair]
        return self._image(raw, "raw"), self._image(scene, "scene")

    def _image(self, source: Source, what: str) -> Float32:
        if isinstance(source, str | os.PathLike):
            if os.fspath(source).endswith(".npy"):
                source = np.load(source)
            else:
                return _load(source)
        elif callable(source) and not hasattr(source, "__array_interface__"):
            source = source()
        array = as_array(source, what)
        return to_float(planes_first(array, self.channel_axis, what))


def _load(name: str | os.PathLike[str]) -> Float32:
    image = NewImage()
    call(lib.hada_tiff_load, path(name), 0, image.c)
    return image.array()


def give_image(image: Any, array: Float32) -> int:
    """Fill an empty hada_image of C's; return a status."""
    failure = ffi.new("hada_error *")
    status = int(lib.hada_image_create(image, *array.shape, failure))
    if not status:
        ffi.memmove(image.data, ffi.cast("char *", address(array)), array.nbytes)
    return status


@ffi.def_extern(error=lib.HADA_ERROR_DATASET, onerror=keep_error)  # type: ignore[untyped-decorator]
def py_dataset_read_pair(user: Any, depth: int, pair: int, raw: Any, scene: Any, _err: Any) -> int:
    """Read a pair for C."""
    reader = ffi.from_handle(user)
    frame, shown = reader.read(depth, pair)
    return give_image(raw, frame) or give_image(scene, shown)


def _options(
    mosaic: MosaicOfFiles, downsample: int, flat_frame: Any, flat_dark: float | None, dark_frame: Any
) -> Options:
    options = Options(
        "hada_dataset_options", mosaic=mosaic, downsample=downsample, flat_dark=AUTO if flat_dark is None else flat_dark
    )
    for name, frame in (("flat_frame", flat_frame), ("dark_frame", dark_frame)):
        if frame is not None:
            image = Image(frame, what=name)
            options.kept.append(image)
            options.set(**{name: image.c})
    return options


class Dataset(Handle):
    """Pairs of raw frame and known scene, per distance; read when they are needed.

    Args:
        pairs: a mapping from the distance in millimetres to a sequence of (raw, scene), or an iterable of (distance,
            raw, scene). Each image is an array (Y, X) or (C, Y, X), a TIFF or .npy file, or a function that returns an
            array; sequences may read what they are asked for. dtypes as for :meth:`Plan.run`.
        channel_axis: of images of three axes; None: the first, -1 for (Y, X, C). Files of TIFF need none.
        mosaic: pattern of the colour filter mosaic that raw frames of one channel are; they are read with three, and a
            camera that is learned from them knows the pattern.
        downsample: raw frames and scenes are binned, N x N pixels to one, raw frames of a mosaic by colour; a camera
            that is learned from them bins frames.
        flat_frame: an evenly lit sensor, its dark level taken off, by which raw frames are divided: an array (rows,
            cols), or like raw frames, binned or not; None: none.
        flat_dark: dark level above which they are divided; None: each frame's and channel's own.
        dark_frame: what raw frames hold without the scenes' light, which is subtracted: an array like raw frames; None:
            nothing is.

    Example:
        >>> pairs = hadalens.Dataset({100.0: [(raw, scene), ...], 250.0: [...]})
        >>> folder = hadalens.Dataset.scan("camera")       # camera/z100mm/raw/NAME.tif, camera/z100mm/scene/NAME.tif
        >>> folder.distances_mm, folder.counts
        ((100.0, 250.0), (8, 8))

    """

    def __init__(
        self,
        pairs: Pairs,
        *,
        channel_axis: int | None = None,
        mosaic: Mosaic = "none",
        downsample: int = 1,
        flat_frame: Any = None,
        flat_dark: float | None = 0.0,
        dark_frame: Any = None,
    ) -> None:
        """Take the pairs; none is read yet."""
        if not isinstance(pairs, Mapping):
            collected: dict[float, list[tuple[Source, Source]]] = {}
            for distance, raw, scene in pairs:
                collected.setdefault(float(distance), []).append((raw, scene))
            pairs = collected
        distances = sorted(float(distance) for distance in pairs)
        if not distances:
            raise errors.DatasetError("there is no pair")
        given = {float(distance): some for distance, some in pairs.items()}
        self._reader: Reader | None = Reader([given[distance] for distance in distances], channel_axis)
        owner = Owner("hada_dataset", lib.hada_dataset_destroy, self._reader)
        call(
            lib.hada_dataset_create,
            owner.pointer,
            len(distances),
            ffi.new("double[]", distances),
            ffi.new("int[]", [len(some) for some in self._reader.depths]),
            lib.py_dataset_read_pair,
            self._reader.user,
            _options(mosaic, downsample, flat_frame, flat_dark, dark_frame).c,
        )
        self._owner = owner

    @classmethod
    def scan(
        cls,
        folder: str | os.PathLike[str],
        *,
        skip_incomplete: bool = False,
        frame_encoding: float | str | None = None,
        mosaic: MosaicOfFiles = "auto",
        downsample: int = 1,
        flat_frame: Any = None,
        flat_dark: float | None = 0.0,
        dark_frame: Any = None,
    ) -> Self:
        """Return the data set of a folder: z<distance>mm/raw/NAME.tif and z<distance>mm/scene/NAME.tif.

        Args:
            folder: where the depths' folders stand.
            skip_incomplete: files without their partner are left out; otherwise they are an error.
            frame_encoding: how raw frames stand for light; None: as their files say, else linear, or as `fit` finds.
            mosaic: as of a data set of arrays; "auto": what the first raw file states (DNG), if its scene is in colour.
            downsample, flat_frame, flat_dark, dark_frame: as of a data set of arrays.

        Raises:
            DatasetError: no depths, a depth without a pair, files without their partner.

        """
        new = cls.__new__(cls)
        new._reader = None
        owner = Owner("hada_dataset", lib.hada_dataset_destroy)
        options = _options(mosaic, downsample, flat_frame, flat_dark, dark_frame)
        options.set(skip_incomplete=skip_incomplete)
        if frame_encoding is not None:
            options.set(frame_encoding=responses.number(frame_encoding))
        call(lib.hada_dataset_scan, owner.pointer, path(folder), options.c)
        new._owner = owner
        return new

    @property
    def _info(self) -> Any:
        return lib.hada_dataset_get_info(self._c)

    @property
    def distances_mm(self) -> tuple[float, ...]:
        """Distances in millimetres, near to far."""
        return tuple(self._info.distances_mm[z] for z in range(self._info.depths))

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of pairs of each depth."""
        return tuple(self._info.counts[z] for z in range(self._info.depths))

    @property
    def incomplete(self) -> str:
        """In words, the first of the files that were left out; "" where there is none."""
        return text(self._info.incomplete_text)

    def __len__(self) -> int:
        """Return the number of pairs."""
        return int(self._info.pairs)

    def _shown(self) -> str:
        return f"{len(self)} pairs, {span(self.distances_mm)}"

    def names(self, depth: int, pair: int) -> tuple[str, str]:
        """Return the paths of a pair's files; of arrays, the names that they would have."""
        self._check(depth, pair)
        files = self._info.files[depth][pair]
        return text(files.raw), text(files.scene)

    def folder(self, depth: int) -> str:
        """Return the folder of a depth."""
        self._check(depth, 0)
        return text(self._info.folders[depth])

    def read(self, depth: int, pair: int) -> tuple[Float32, Float32]:
        """Return raw frame and scene of a pair, float32 (C, Y, X)."""
        self._check(depth, pair)
        images = NewImage(2)
        self._call(lib.hada_dataset_read, self._c, depth, pair, images.c, images.c + 1)
        return copy_of(images.c[0]), copy_of(images.c[1])

    def split(self, hold_out: float) -> tuple[Self, Self]:
        """Return two data sets: to learn from, and the last pairs of each depth, `hold_out` of them or that share."""
        parts = []
        for _ in range(2):
            part = type(self).__new__(type(self))
            part._reader = self._reader
            part._owner = Owner("hada_dataset", lib.hada_dataset_destroy, self._own, self._reader)
            parts.append(part)
        call(lib.hada_dataset_split, self._c, hold_out, parts[0]._own.pointer, parts[1]._own.pointer)
        return parts[0], parts[1]

    def _check(self, depth: int, pair: int) -> None:
        if not 0 <= depth < len(self.counts) or not 0 <= pair < self.counts[depth]:
            raise IndexError(f"there is no pair {pair} of depth {depth}: {self.counts} pairs")

    def _call(self, function: Callable[..., int], *arguments: Any) -> None:
        """Call C, which may read pairs; what reading raised comes first."""
        if self._reader is None:
            call(function, *arguments)
        else:
            self._reader.error = None
            self._reader.run(function, *arguments)


def as_dataset(
    pairs: Dataset | Pairs | str | os.PathLike[str],
    channel_axis: int | None = None,
    mosaic: MosaicOfFiles = "auto",
    downsample: int = 1,
) -> Dataset:
    """Return a data set of what is given: one, a folder, or pairs."""
    if isinstance(pairs, Dataset):
        return pairs
    if isinstance(pairs, str | os.PathLike):
        return Dataset.scan(pairs, mosaic=mosaic, downsample=downsample)
    return Dataset(
        pairs, channel_axis=channel_axis, mosaic="none" if mosaic == "auto" else mosaic, downsample=downsample
    )


def load_dark(name: str | os.PathLike[str]) -> tuple[Float32, float]:
    """Return the mean over the pages of a TIFF file, (C, Y, X), and its mean: what a dark frame is taken from.

    Example:
        >>> frame, level = hadalens.load_dark("dark.tif")
        >>> plan = hadalens.Plan(model, dark=frame)

    """
    image, level = NewImage(), ffi.new("double *")
    call(lib.hada_dark_frame_load, image.c, level, path(name))
    return image.array(), level[0]


def merge_exposures(
    *frames: Any, mosaic: Mosaic = "none", channel_axis: int | None = None
) -> tuple[Float32, Float32, tuple[float, ...], float]:
    """Return one frame of exposures of the same scene, linear in light and in any order.

    The frame (C, Y, X) is in the units of the shortest exposure. Its weights, which a plan takes as `pixel_weights`,
    are larger where longer exposures are not saturated and noise is lower; take ``weights**0.25`` where the plan finds
    the weight of total variation from the frame, as for models of point spread functions. Then come the lengths of the
    exposures over the shortest, found from the frames, and what a pixel without light reads.

    Raises:
        NumericError: exposures of different scenes, or that share too few pixels which neither saturates.

    Example:
        >>> frame, weights, lengths, dark = hadalens.merge_exposures(short, medium, long)
        >>> result = hadalens.Plan(model, pixel_weights=weights, dark=dark).run(frame)

    """
    images = Image(*frames, channel_axis=channel_axis)
    made, weights = NewImage(), NewImage()
    scales, dark = ffi.new("double[]", len(frames)), ffi.new("double *")
    pattern = value_of("hada_mosaic", mosaic, "mosaic")
    call(lib.hada_image_merge_exposures, made.c, weights.c, images.c, len(frames), pattern, scales, dark)
    return made.array(), weights.array(), tuple(scales), dark[0]


def load_exposures(
    *names: str | os.PathLike[str], frame_encoding: float | str | None = None, mosaic: Mosaic = "none"
) -> tuple[Float32, Float32]:
    """Return one frame of all pages of some files, exposures of the same scene, and its weights: merge_exposures.

    Example:
        >>> frame, weights = hadalens.load_exposures("short.tif", "long.tif")

    """
    made, weights = NewImage(), NewImage()
    paths = [ffi.new("char[]", path(name)) for name in names]
    encoding = AUTO if frame_encoding is None else responses.number(frame_encoding)
    pattern = value_of("hada_mosaic", mosaic, "mosaic")
    array = ffi.new("char *[]", paths)
    call(lib.hada_exposures_load, made.c, weights.c, array, len(paths), encoding, pattern, ffi.NULL)
    return made.array(), weights.array()
