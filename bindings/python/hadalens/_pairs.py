"""Pairs of raw frame and known scene: folders as people keep them, or arrays."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Self, TypeAlias

import numpy as np

from . import errors
from . import response as responses
from ._arrays import Float32, Image, Mosaic, MosaicOfFiles, NewImage, address, copy_of, scale_of, taken
from ._native import (
    AUTO,
    Caller,
    Handle,
    Monitor,
    Options,
    Owner,
    brief,
    call,
    ffi,
    keep_error,
    lib,
    path,
    paths,
    span,
    text,
    value_of,
)

#: An image of a pair: an array, a TIFF or .npy file, or a function without arguments that returns an array.
Source: TypeAlias = Any
#: Pairs of arrays: {distance in mm: (raw, scene) one after the other}, or an iterable of (distance in mm, raw, scene).
Pairs: TypeAlias = Mapping[float, Iterable[tuple[Source, Source]]] | Iterable[tuple[float, Source, Source]]


class Reader(Caller):
    """Gives pairs of arrays to C.

    A Ctrl-C while a pair is read is kept with the monitor of the call, if there is one, and the pair is read again: C
    then stops as it does for any Ctrl-C, and keeps what is done so far. A second one comes through at once.
    """

    monitor: Monitor | None = None

    def __init__(
        self,
        depths: list[Sequence[tuple[Source, Source]]],
        channel_axis: int | None,
        full_scale: float | None,
    ) -> None:
        super().__init__()
        self.depths = depths
        self.channel_axis = channel_axis
        self.full_scale = scale_of(full_scale)

    def read(self, depth: int, pair: int) -> tuple[Float32, Float32]:
        try:
            return self._read(depth, pair)
        except KeyboardInterrupt as stop:
            if self.monitor is None or self.monitor.error is not None:
                raise
            self.monitor.error = stop
        return self._read(depth, pair)

    def _read(self, depth: int, pair: int) -> tuple[Float32, Float32]:
        images = self.depths[depth][pair]
        if hasattr(images, "shape") or isinstance(images, str) or len(images) != 2:
            raise TypeError(f"pair {pair} of depth {depth} is no (raw, scene), as those of list(zip(raws, scenes)) are")
        return self._image(images[0], "raw", self.full_scale), self._image(images[1], "scene", None)

    def _image(self, source: Source, what: str, full_scale: float | None) -> Float32:
        if isinstance(source, str | os.PathLike):
            if os.fspath(source).endswith(".npy"):
                source = np.load(source)
            else:
                image = NewImage()
                call(lib.hada_tiff_load, path(source), 0, image.c)
                return _scaled(image.array(), source, full_scale)
        elif callable(source) and not hasattr(source, "__array_interface__"):
            source = source()
        return taken(source, what, self.channel_axis, full_scale)


def _scaled(image: Float32, name: str | os.PathLike[str], full_scale: float | None) -> Float32:
    """Return what was read from a file, whose numbers are of this full scale."""
    scale = scale_of(full_scale)
    if scale is None:
        return image
    reader = Owner("hada_tiff_reader", lib.hada_tiff_close)
    call(lib.hada_tiff_open, reader.pointer, path(name))
    return image * np.float32(lib.hada_tiff_get_info(reader.c).scale / scale)


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
    mosaic: MosaicOfFiles,
    downsample: int,
    flat_frame: Any,
    flat_dark: float | None,
    dark_frame: Any,
    full_scale: float | None = None,
) -> Options:
    options = Options(
        "hada_dataset_options", mosaic=mosaic, downsample=downsample, flat_dark=AUTO if flat_dark is None else flat_dark
    )
    for name, frame in (("flat_frame", flat_frame), ("dark_frame", dark_frame)):
        if frame is not None:
            image = Image(frame, what=name, full_scale=full_scale)
            options.kept.append(image)
            options.set(**{name: image.c})
    return options


def _collected(pairs: Pairs) -> dict[float, Sequence[tuple[Source, Source]]]:
    """Return the pairs of each distance, near to far."""
    found: dict[float, Any] = {}
    if isinstance(pairs, Mapping):
        for key, some in pairs.items():
            found[_distance(key)] = some if hasattr(some, "__len__") else list(some)
    else:
        for row in pairs:
            if hasattr(row, "shape") or isinstance(row, str) or len(row) != 3:
                raise TypeError(
                    "pairs are {distance in mm: [(raw, scene), ...]}, such as {250.0: pairs}, or (distance in mm, raw, "
                    f"scene) one after the other, not {brief(row)}"
                )
            found.setdefault(_distance(row[0]), []).append((row[1], row[2]))
    if not found:
        raise errors.DatasetError("there is no pair")
    if len({f"{distance:g}" for distance in found}) < len(found):
        raise errors.DatasetError(f"two distances are the same to six digits: {sorted(found)}")
    return dict(sorted(found.items()))


def _distance(given: Any) -> float:
    try:
        return float(given)
    except (TypeError, ValueError):
        raise TypeError(f"{brief(given)} is no distance: a number of millimetres is needed, such as 100.0") from None


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
        full_scale: of raw frames, flat and dark frame, as for :meth:`Plan.run`; scenes have their types'.

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
        full_scale: float | None = None,
    ) -> None:
        """Take the pairs; none is read yet."""
        given = _collected(pairs)
        self._reader: Reader | None = Reader(list(given.values()), channel_axis, full_scale)
        owner = Owner("hada_dataset", lib.hada_dataset_destroy, self._reader)
        call(
            lib.hada_dataset_create,
            owner.pointer,
            len(given),
            ffi.new("double[]", list(given)),
            ffi.new("int[]", [len(some) for some in self._reader.depths]),
            lib.py_dataset_read_pair,
            self._reader.user,
            _options(mosaic, downsample, flat_frame, flat_dark, dark_frame, full_scale).c,
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
    full_scale: float | None = None,
) -> Dataset:
    """Return a data set of what is given: one, a folder, or pairs."""
    if full_scale is not None and isinstance(pairs, Dataset | str | os.PathLike):
        raise errors.ArgumentError("full_scale is of arrays: a Dataset is told its own, and folders say theirs")
    if isinstance(pairs, Dataset):
        return pairs
    if isinstance(pairs, str | os.PathLike):
        return Dataset.scan(pairs, mosaic=mosaic, downsample=downsample)
    pattern: Mosaic = "none" if mosaic == "auto" else mosaic
    return Dataset(pairs, channel_axis=channel_axis, mosaic=pattern, downsample=downsample, full_scale=full_scale)


def load_dark(name: str | os.PathLike[str], *, full_scale: float | None = None) -> tuple[Float32, float]:
    """Return the mean over the pages of a TIFF file, (C, Y, X), and its mean: what a dark frame is taken from.

    Numbers in the file are divided by `full_scale`; None: by what the file says.

    Example:
        >>> frame, level = hadalens.load_dark("dark.tif")
        >>> plan = hadalens.Plan(model, dark=frame)

    """
    image, level = NewImage(), ffi.new("double *")
    call(lib.hada_dark_frame_load, image.c, level, path(name))
    dark = _scaled(image.array(), name, full_scale)
    return dark, level[0] if full_scale is None else float(dark.mean(dtype=np.float64))


def merge_exposures(
    *frames: Any, mosaic: Mosaic = "none", channel_axis: int | None = None, full_scale: float | None = None
) -> tuple[Float32, Float32, tuple[float, ...], float]:
    """Return one frame of exposures of the same scene, linear in light and in any order.

    `channel_axis` and `full_scale` are as for :meth:`Plan.run`; what is returned is divided already.

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
    images = Image(*frames, channel_axis=channel_axis, full_scale=full_scale)
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
    files = paths(names)
    encoding = AUTO if frame_encoding is None else responses.number(frame_encoding)
    pattern = value_of("hada_mosaic", mosaic, "mosaic")
    array = ffi.new("char *[]", files)
    call(lib.hada_exposures_load, made.c, weights.c, array, len(files), encoding, pattern, ffi.NULL)
    return made.array(), weights.array()
