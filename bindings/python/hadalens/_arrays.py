"""Arrays on their way in and out: one rule for all that takes pixels.

Integers of 8, 16 and 32 bits are divided by their type's full scale, float32 is shared without a copy, float64 is
copied to float32; anything else is a TypeError. A `full_scale` that is given divides all of them. What is not a NumPy
array comes in by DLPack, the array interface or the buffer protocol.
"""

from __future__ import annotations

import math
import numbers
import os
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from . import errors
from ._native import ffi, lib, tie

Float32: TypeAlias = npt.NDArray[np.float32]
#: Numbers, such as the distances of depths.
Floats: TypeAlias = Sequence[float] | npt.NDArray[np.float64]
#: The pattern of a colour filter mosaic: the colours of the first two rows and columns.
Mosaic: TypeAlias = Literal["none", "rggb", "bggr", "grbg", "gbrg"]
#: The same, or "auto": what raw files state (DNG), else none.
MosaicOfFiles: TypeAlias = Mosaic | Literal["auto"]

# Memory that the host reads, of dlpack.h: kDLCPU, kDLCUDAHost, kDLROCMHost, kDLCUDAManaged; NumPy takes these.
_DLPACK_HOST = (1, 3, 11, 13)
_TO_HOST = "bring it to the host first (.cpu() of PyTorch, .get() of CuPy, .copy_to_host() of Numba)"
_FEW = 4  # channels of pictures, at most: no image has so few columns
_PIXELS = {"|u1": lib.HADA_PIXEL_U8, "<u2": lib.HADA_PIXEL_U16, "<f4": lib.HADA_PIXEL_F32}


def as_array(given: Any, what: str, light: bool = True) -> npt.NDArray[Any]:
    """Return an array of what is given, without a copy where that goes; TypeError for what is no array of numbers.

    `light`: pixel values, whose types say their full scale; else any numbers, such as millimetres.
    """
    if isinstance(given, np.ndarray):
        array = given
    elif hasattr(given, "__array_interface__"):
        array = np.asarray(given)
    elif hasattr(given, "__dlpack__"):
        if given.__dlpack_device__()[0] not in _DLPACK_HOST:
            raise TypeError(f"{what} is on a device: {_TO_HOST}")
        array = _from_dlpack(given, what)
    elif hasattr(given, "__cuda_array_interface__"):
        raise TypeError(f"{what} is on a device: {_TO_HOST}")
    elif hasattr(given, "__array__"):
        array = np.asarray(given)
    else:
        try:
            array = np.asarray(memoryview(given))
        except TypeError:
            raise TypeError(
                f"{what} is a {type(given).__name__}: an array is needed (NumPy's, or one with DLPack)"
                + "; hadalens.read_tiff reads a file" * isinstance(given, str | os.PathLike)
            ) from None
    kind, size = array.dtype.kind, array.dtype.itemsize
    if isinstance(array, np.ma.MaskedArray):
        if np.ma.is_masked(array):
            raise errors.ArgumentError(
                f"{what} has {np.sum(array.mask)} masked values, whose numbers would count: fill them "
                "(array.filled(0)); a plan takes pixel_weights=~array.mask"
            )
        array = array.data
    if not light and kind in "buif" and size <= 8:
        return array
    if kind == "i" and size <= 4 and array.size and array.min() < 0:
        raise errors.ArgumentError(
            f"{what} of {array.dtype} has values below 0, down to {array.min()}, but light is 0 or more: take off its "
            "offset, or convert to float32 with 1 for full scale"
        )
    if (kind in "ui" and size <= 4) or (kind == "f" and size in (4, 8)):
        return array
    raise TypeError(
        f"{what} is of {array.dtype}: integers of 8, 16 or 32 bits, float32 and float64 are taken; convert others to "
        "float32, with 1 for full scale"
    )


def _from_dlpack(given: Any, what: str) -> npt.NDArray[Any]:
    """Return a view of what has DLPack; TypeError for what it, or NumPy, cannot hand over (bfloat16, gradients)."""
    try:
        return np.from_dlpack(given)
    except (BufferError, RuntimeError) as failed:
        raise TypeError(f"{what} cannot be taken over: {failed}") from failed


def planes_first(array: npt.NDArray[Any], channel_axis: int | None, what: str) -> npt.NDArray[Any]:
    """Return a view (C, Y, X) of an image (Y, X), or of three axes one of which is the channels'."""
    if array.ndim == 2:
        return array[np.newaxis]
    if array.ndim != 3:
        raise errors.SizeError(
            f"{what} has the shape {array.shape}: (Y, X), (C, Y, X), or (Y, X, C) with channel_axis=-1"
        )
    if channel_axis is None:
        if array.shape[-1] <= _FEW < array.shape[0]:
            raise errors.SizeError(
                f"{what} has the shape {array.shape}: channels seem to stand last, but (C, Y, X) is expected; give "
                f"channel_axis=-1, or np.moveaxis({what}, -1, 0)"
            )
        return array
    if isinstance(channel_axis, bool) or not isinstance(channel_axis, numbers.Integral):
        raise TypeError(f"channel_axis={channel_axis!r:.60}: a whole number is needed")
    if not -3 <= channel_axis < 3:
        raise errors.ArgumentError(f"channel_axis={channel_axis}: {what} has three axes, 0 to 2, or -1 for the last")
    return np.moveaxis(array, channel_axis, 0)


def scale_of(full_scale: float | None) -> float | None:
    """Return a full scale that somebody gave, checked."""
    if full_scale is None:
        return None
    if isinstance(full_scale, bool) or not isinstance(full_scale, numbers.Real):
        raise TypeError(f"full_scale={full_scale!r:.60}: a number is needed, such as 4095")
    if not 0 < full_scale < math.inf:
        raise errors.ArgumentError(f"full_scale={full_scale} is not possible; it is above 0")
    return float(full_scale)


def to_float(array: npt.NDArray[Any], full_scale: float | None = None) -> Float32:
    """Return dense float32 values: the very bits that reading the same numbers from a TIFF file gives."""
    dtype, scale = array.dtype, scale_of(full_scale)
    if scale is None and dtype.kind != "f":
        scale = float(np.iinfo(dtype).max)
    if scale is not None and scale != 1:
        # up to 16 bits, and of single precision, both numbers are exact in single precision
        wide = np.float32 if dtype.itemsize <= 2 or dtype.char == "f" else np.float64
        array = np.divide(array, wide(scale), dtype=wide)
    return np.require(array, np.float32, ["C", "A"])


def taken(
    given: Any, what: str, channel_axis: int | None = None, full_scale: float | None = None, light: bool = True
) -> Float32:
    """Return an image, float32 (C, Y, X), of what is given as one; what is no light is plainly cast."""
    array = planes_first(as_array(given, what, light), channel_axis, what)
    return to_float(array, full_scale if light else 1)


class Pixels:
    """A frame as the library takes it: `c` is a hada_pixels that looks into the caller's memory where it can."""

    def __init__(
        self, given: Any, channel_axis: int | None, full_scale: float | None, what: str = "raw", copy: bool = False
    ) -> None:
        """Check and wrap; `copy`: never the caller's memory."""
        array = planes_first(as_array(given, what), channel_axis, what)
        full_scale = scale_of(full_scale)
        here = array.dtype.newbyteorder("<").str in _PIXELS and array.dtype.isnative and array.flags.aligned
        if not here or (array.dtype.kind == "f" and full_scale is not None):
            array, full_scale = to_float(array, full_scale), None
        if copy and np.may_share_memory(array, given if isinstance(given, np.ndarray) else array):
            array = array.copy()
        if any(stride == 0 < size - 1 for stride, size in zip(array.strides, array.shape, strict=True)):
            array = array.copy()  # one that NumPy spread over an axis
        self.array = array  # whose memory C reads
        self.c = tie(ffi.new("hada_pixels *"), array)
        lib.hada_pixels_init(self.c)
        self.c.data = ffi.cast("void *", address(array))
        self.c.type = _PIXELS[array.dtype.newbyteorder("<").str]
        self.c.channels, self.c.rows, self.c.cols = array.shape
        self.c.channel_stride, self.c.row_stride, self.c.col_stride = array.strides
        if full_scale is not None:
            self.c.full_scale = full_scale


def address(array: npt.NDArray[Any]) -> int:
    """Return where an array's values stand."""
    return int(array.__array_interface__["data"][0])


class Image:
    """An array as a hada_image that C only reads: `c` points to one, or to the first of several."""

    def __init__(
        self,
        *given: Any,
        what: str = "image",
        channel_axis: int | None = None,
        full_scale: float | None = None,
        light: bool = True,
    ) -> None:
        """Take images of (Y, X) or (C, Y, X)."""
        self.arrays = [taken(one, what, channel_axis, full_scale, light) for one in given]
        self.c = tie(ffi.new("hada_image[]", max(len(given), 1)), self.arrays)
        for index, array in enumerate(self.arrays):
            image = self.c[index]
            image.channels, image.rows, image.cols = array.shape
            image.data = ffi.cast("float *", address(array))


class NewImage:
    """An image that C makes: `c` to hand over, then `array()` once."""

    def __init__(self, count: int = 1) -> None:
        """Make room for `count` of them."""
        self.c = ffi.new("hada_image[]", count)
        self._count = count

    def array(self, index: int = 0) -> Float32:
        """Return the pixels (C, Y, X), copied, and free C's."""
        return copy_of(self.c[index])

    def plane(self, index: int = 0) -> Float32:
        """Return the pixels (Y, X) of an image of one channel."""
        image = self.array(index)
        return image.reshape(image.shape[1:])

    def __del__(self) -> None:
        """Free what C made."""
        for index in range(self._count):
            lib.hada_image_destroy(self.c + index)


def copy_of(image: Any) -> Float32:
    """Return a copy (C, Y, X) of a hada_image."""
    shape = (image.channels, image.rows, image.cols)
    if image.data == ffi.NULL:
        return np.empty(shape, np.float32)
    count = image.channels * image.rows * image.cols
    return np.frombuffer(ffi.buffer(image.data, 4 * count), np.float32).reshape(shape).copy()


def floats(array: Float32) -> Any:
    """Return the C pointer to an array's values."""
    return ffi.cast("float *", address(array))


def check_out(array: Any, shape: Sequence[int], what: str) -> Float32:
    """Check an array that is to be filled."""
    if not isinstance(array, np.ndarray) or array.dtype != np.float32:
        raise TypeError(f"{what} must be a NumPy array of float32")
    if array.shape != tuple(shape) or not array.flags.c_contiguous or not array.flags.writeable:
        raise errors.SizeError(f"{what} must be a dense, writable array of shape {tuple(shape)}, not {array.shape}")
    return array


def nine(matrix: npt.ArrayLike) -> list[float]:
    """Return a colour matrix as C takes it."""
    values = np.asarray(matrix, np.float64)
    if values.shape != (3, 3):
        raise errors.SizeError(f"colour_matrix has the shape {values.shape}: it must be (3, 3)")
    rows: list[float] = values.ravel().tolist()
    return rows
