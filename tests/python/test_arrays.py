"""What goes in and comes out: dtypes, strides, protocols, arrays to fill."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
from hadalens._arrays import Pixels, address, to_float
from hadalens._native import call, ffi, lib

Array = npt.NDArray[Any]


@pytest.fixture(scope="module")
def linear(model: hadalens.Model) -> hadalens.Plan:
    """Return a plan that is quick."""
    return hadalens.Plan(model, refine=0)


@pytest.fixture(scope="module")
def integers(raw: Array) -> Array:
    """Return a frame of 16 bits."""
    levels: Array = np.clip(raw / raw.max(), 0, 1) * 65535
    return levels.astype(np.uint16)


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "u4", "i4", ">u2", "<u4", "f8", ">f4"])
def test_dtypes_are_as_tiff_has_them(dtype: str, integers: Array, tmp_path: Path) -> None:
    """Integers are divided by their full scale: the bits are those of the C library's TIFF reader."""
    tifffile = pytest.importorskip("tifffile")
    kind = np.dtype(dtype)
    if kind.kind == "f":
        values = (integers / 65535.0).astype(kind)
    else:
        span = np.iinfo(kind).max
        values = (integers.astype(np.float64) / 65535 * span).astype(kind)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack")
    read = hadalens.read_tiff(tmp_path / "a.tif")
    np.testing.assert_array_equal(to_float(values), read.reshape(values.shape))


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", "u4", "f4", "f8"])
def test_frames_of_every_dtype_give_the_same(dtype: str, linear: hadalens.Plan, integers: Array) -> None:
    """A frame as integers gives the bits of the same frame as floats."""
    kind = np.dtype(dtype)
    values = integers / 65535.0 if kind.kind == "f" else integers / 65535.0 * np.iinfo(kind).max
    frame = values.astype(kind)
    np.testing.assert_array_equal(linear.run(frame).stack, linear.run(to_float(frame)).stack)


def test_pixels_are_the_librarys(integers: Array) -> None:
    """C converts these pixels to the same floats as to_float does."""
    pixels, image = Pixels(integers, None, None), ffi.new("hada_image *")
    call(lib.hada_pixels_to_image, pixels.c, image)
    count = integers.size
    mine = np.frombuffer(ffi.buffer(image.data, 4 * count), np.float32).reshape(integers.shape).copy()
    lib.hada_image_destroy(image)
    np.testing.assert_array_equal(mine, to_float(integers))


@pytest.mark.parametrize("wrong", ["c8", "f2", "?", "i8", "u8", "O", "U3", "M8[s]"])
def test_other_dtypes_are_type_errors(wrong: str, linear: hadalens.Plan, raw: Array) -> None:
    """Nothing is guessed."""
    with pytest.raises(TypeError, match="float32"):
        linear.run(np.zeros(raw.shape, wrong))


@pytest.mark.parametrize("wrong", [[[1.0]], 3, None, "frame.tif"])
def test_what_is_no_array_is_a_type_error(wrong: Any, linear: hadalens.Plan) -> None:
    """Lists would have to be guessed as well."""
    with pytest.raises(TypeError, match="array"):
        linear.run(wrong)


def test_float32_is_shared(raw: Array) -> None:
    """C reads the array in place, whatever its strides."""
    for view in (raw, raw[:, ::-1], raw[:, :, ::2], np.moveaxis(raw, 0, -1).copy()):
        axis = -1 if view.shape[-1] == 3 else None
        pixels = Pixels(view, axis, None)
        assert int(ffi.cast("uintptr_t", pixels.c.data)) == address(view)


def test_strides_and_channel_axis(linear: hadalens.Plan, raw: Array) -> None:
    """Views give what their copies give."""
    expected = linear.run(raw).stack
    interleaved = np.ascontiguousarray(np.moveaxis(raw, 0, -1))
    wide = np.repeat(raw, 2, axis=2)
    readonly = raw.copy()
    readonly.flags.writeable = False
    np.testing.assert_array_equal(linear.run(interleaved, channel_axis=-1).stack, expected)
    np.testing.assert_array_equal(linear.run(np.moveaxis(raw, 0, 1), channel_axis=1).stack, expected)
    np.testing.assert_array_equal(linear.run(wide[:, :, ::2]).stack, expected)
    np.testing.assert_array_equal(linear.run(raw[:, ::-1][:, ::-1]).stack, expected)
    np.testing.assert_array_equal(linear.run(readonly).stack, expected)


def test_full_scale(linear: hadalens.Plan, integers: Array) -> None:
    """A camera of 12 bits in uint16, its counts as floats, and its dark frame and exposures."""
    twelve, dark = integers >> 4, np.full_like(integers, 64)
    light = twelve.astype(np.float32) / np.float32(4095)
    expected = linear.run(light).stack
    for counts in (twelve, twelve.astype(">f4"), twelve.astype(np.float32), twelve.astype(np.float64)):
        np.testing.assert_array_equal(linear.run(counts, full_scale=4095).stack, expected)
    assert linear.match(counts, full_scale=4095) == linear.match(light)
    expected = hadalens.Plan(linear.model, refine=0, dark=dark / np.float32(4095)).run(light).stack
    told = hadalens.Plan(linear.model, refine=0, dark=dark, full_scale=4095)
    for result in (told.run(twelve), next(told.map([counts])), told.run(light, full_scale=1)):
        np.testing.assert_array_equal(result.stack, expected)
    exposures = [np.minimum(0.05 + length * light, 1) for length in (0.2, 0.9)]
    merged = hadalens.merge_exposures(*[one * 4095 for one in exposures], full_scale=4095)[0]
    np.testing.assert_allclose(merged, hadalens.merge_exposures(*exposures)[0], atol=1e-6)
    with pytest.raises(ValueError, match="full_scale"):
        linear.run(twelve, full_scale=0)


class OnlyDlpack:
    """What has DLPack alone, as tensors have."""

    def __init__(self, array: Array, device: int = 1) -> None:
        """Wrap an array; device 2 is CUDA."""
        self.array, self.device = array, device

    def __dlpack__(self, **given: Any) -> Any:
        """Return the capsule."""
        return self.array.__dlpack__(**given)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return kind and number."""
        return self.device, 0


class OnlyInterface:
    """What has the array interface alone."""

    def __init__(self, array: Array) -> None:
        """Wrap an array."""
        self.array = array
        self.__array_interface__ = array.__array_interface__


def test_protocols(linear: hadalens.Plan, raw: Array) -> None:
    """DLPack, the array interface and buffers go in, and values that stand where no float should."""
    expected = linear.run(raw).stack
    buffer, skew = np.ctypeslib.as_ctypes(raw.copy()), np.zeros(raw.nbytes + 1, np.uint8)[1:].view(np.float32)
    skew[:] = raw.ravel()
    assert to_float(skew).flags.aligned
    frames = (OnlyDlpack(raw), OnlyInterface(raw), memoryview(raw), buffer, skew.reshape(raw.shape))  # type: ignore[arg-type]
    for frame in frames:
        np.testing.assert_array_equal(linear.run(frame).stack, expected)
    for host in (3, 11, 13):  # pinned and managed memory of GPUs, which the host reads
        np.testing.assert_array_equal(linear.run(OnlyDlpack(raw, device=host)).stack, expected)


class OnGpu:
    """An array of CuPy's, as far as it shows: the host has no way to its values but get()."""

    def __init__(self, array: Array) -> None:
        """Hold the values."""
        self._array = array
        self.__cuda_array_interface__ = {"shape": array.shape, "typestr": "<f4", "data": (0xDEAD, False), "version": 3}

    def __dlpack__(self, **_: Any) -> Any:
        """Hand out device memory, which nobody here could read."""
        raise AssertionError("device memory was asked for")

    def __dlpack_device__(self) -> tuple[int, int]:
        """CUDA, the first device."""
        return 2, 0

    def __array__(self, *_: Any, **__: Any) -> Any:
        """Refuse, as CuPy does."""
        raise AssertionError("CuPy converts nothing by itself")

    def get(self) -> Array:
        """Return a copy on the host."""
        return self._array.copy()


class Numba:
    """A device array of Numba's: the CUDA array interface alone."""

    def __init__(self, array: Array) -> None:
        """Show where it would be."""
        self.__cuda_array_interface__ = OnGpu(array).__cuda_array_interface__


def test_arrays_of_gpus(linear: hadalens.Plan, raw: Array) -> None:
    """Arrays in a GPU's memory are refused with the way out, untouched; on the host they go in."""
    for given in (OnGpu(raw), Numba(raw), OnlyDlpack(raw, device=2), OnlyDlpack(raw, device=10)):
        with pytest.raises(TypeError, match=r"\.cpu\(\) of PyTorch, \.get\(\) of CuPy"):
            linear.run(given)
    np.testing.assert_array_equal(linear.run(OnGpu(raw).get()).stack, linear.run(raw).stack)


class Unwilling(OnlyDlpack):
    """A tensor that does not hand its values out, as PyTorch's with gradients."""

    def __dlpack__(self, **_: Any) -> Any:
        """Refuse."""
        raise BufferError("Can't export tensors that require gradient, use tensor.detach()")


def test_tensors_that_refuse(linear: hadalens.Plan, raw: Array) -> None:
    """What they say comes through, as a TypeError."""
    with pytest.raises(TypeError, match="detach"):
        linear.run(Unwilling(raw))


def test_torch_tensors(linear: hadalens.Plan, raw: Array) -> None:
    """Tensors of PyTorch on the host."""
    torch = pytest.importorskip("torch")
    np.testing.assert_array_equal(linear.run(torch.from_numpy(raw)).stack, linear.run(raw).stack)


def test_out_is_filled(linear: hadalens.Plan, raw: Array) -> None:
    """The caller's arrays are those of the result."""
    expected = linear.run(raw)
    stack = np.full(linear.stack_shape, np.nan, np.float32)
    result = linear.run(raw, out=stack)
    assert result.stack is stack
    np.testing.assert_array_equal(stack, expected.stack)
    again = linear.run(raw / 2, out=result)
    assert again.stack is stack
    assert again.distance_map is result.distance_map
    assert not np.array_equal(stack, expected.stack)


def test_out_of_another_kind(linear: hadalens.Plan, raw: Array) -> None:
    """Arrays that cannot be filled are refused before anything is done."""
    shape = linear.stack_shape
    frozen = np.zeros(shape, np.float32)
    frozen.flags.writeable = False
    with pytest.raises(TypeError, match="float32"):
        linear.run(raw, out=np.zeros(shape))
    for wrong in (np.zeros((1, *shape[1:]), np.float32), np.zeros(shape[::-1], np.float32).T, frozen):
        with pytest.raises(hadalens.SizeError, match="out"):
            linear.run(raw, out=wrong)


def test_shapes(linear: hadalens.Plan, raw: Array) -> None:
    """Frames of other shapes say what the model takes."""
    with pytest.raises(hadalens.ModelError, match="colour filter mosaic"):
        linear.run(raw[0])
    with pytest.raises(hadalens.SizeError, match="channel_axis"):
        linear.run(raw[0, 0])
    with pytest.raises(hadalens.SizeError, match="channel_axis"):
        linear.run(raw[np.newaxis])
