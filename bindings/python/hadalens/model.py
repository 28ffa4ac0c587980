"""Models: a camera as data, learned from pairs or measured."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from . import errors
from ._arrays import Float32, Floats, Image, Mosaic, address, as_array, copy_of, nine
from ._fit_report import FitReport
from ._native import (
    AUTO,
    Handle,
    Options,
    Owner,
    ascending,
    call,
    doubles,
    expect,
    ffi,
    lib,
    loaded,
    named,
    path,
    record,
    saved,
    span,
    text,
    two,
    value_of,
)
from ._show import members, table
from .device import Device, default
from .net import Net

Form: TypeAlias = Literal["complex", "split", "matched", "wiener"]
Boundary: TypeAlias = Literal["circular", "padded"]


@dataclass(frozen=True)
class ModelInfo:
    """What a model is. Sizes in pixels, distances in millimetres, near to far.

    Attributes:
        raw_rows, raw_cols: size of the raw frames.
        grid_rows, grid_cols: grid of the transforms; larger than the frame with the boundary "padded".
        window_rows, window_cols: the scene, in the middle of the frame.
        dark: level taken off every pixel, full scale being 1; -1: each frame's own, estimated.
        noise: standard deviation of the frames' noise that the fit found, 0 where unknown.
        refine_steps: refinement that pays for this camera; 0: none does.
        refine_ridge: strength of the learned regulariser in the last steps; 0: none.
        refine_noise, refine_noise_largest: noise of the frames on which refine_tv was chosen, over their root mean
            square and over their largest value; 0: not known.
        scene_response: how the scenes that it was learned from stand for light.
        enhance: it holds a net that enhances refocused planes.
        mosaic: frames of one channel are a colour filter mosaic of this pattern: "rggb", "bggr", "grbg", "gbrg";
            "none": not known to be.
        downsample: the sensor has so many times the rows and columns: frames of its size are binned; 1: it has not.
        sensor_mosaic: of frames of one channel that are binned; "none": not known to be one.
        components: above 1: point spread functions vary over the field, by so many components for each depth.
        positions: at which they were measured; 0: they do not vary.
        lost, lost_single: share of the measured energy that the components leave, and that the mean one alone does.
        colour_matrix: rows of what the sensor's channels see of the scenes' colours, to which frames are brought back;
            None: they are the same.
        frame_encoding: how values of the frames' files stand for light where these are whole numbers and the file says
            nothing; 0: linear. Arrays are linear in light.

    """

    depths: int
    channels: int
    raw_rows: int
    raw_cols: int
    grid_rows: int
    grid_cols: int
    window_rows: int
    window_cols: int
    form: str
    boundary: str
    alpha: float
    dark: float
    noise: float
    refine_steps: int
    refine_rho: float
    refine_tv: float
    has_otf: bool
    half: bool
    enhance: bool
    enhance_rows: int
    enhance_cols: int
    bytes: int
    name: str
    scene_response: float
    refine_colour: float
    refine_share: float
    refine_ridge: float
    mosaic: str
    downsample: int
    sensor_mosaic: str
    components: int
    positions: int
    lost: float
    lost_single: float
    refine_noise: float
    refine_noise_largest: float
    colour_matrix: tuple[tuple[float, ...], ...] | None
    frame_encoding: float
    regularisation: float  # "lambda" in C
    distances_mm: tuple[float, ...]


def _rows(matrix: Any) -> tuple[tuple[float, ...], ...] | None:
    return tuple(tuple(matrix[k : k + 3]) for k in (0, 3, 6)) if matrix[0] else None


class Model(Handle):
    """A camera, learned by :func:`hadalens.fit` or made from its point spread functions.

    A model does not change once it is there; any thread may use it, and it can be pickled.

    Example:
        >>> model = hadalens.Model.load("camera.model")
        >>> model.info.distances_mm
        (100.0, 137.5, 220.0, 600.0)

    """

    #: What the choices of the fit were made from, which copies and pickles keep; None for models that were loaded.
    fit_report: FitReport | None = None
    _name: str | None = None  # of a model that was pickled: C has the name of a file that is gone

    def __init__(self) -> None:
        """Models come from load, from_psf, fit and Trainer."""
        raise TypeError("make a model by Model.load, Model.from_psf, hadalens.fit or a Trainer")

    @classmethod
    def _new(cls, create: Any, *arguments: Any) -> Self:
        model = cls.__new__(cls)
        owner = Owner("hada_model", lib.hada_model_destroy)
        call(create, owner.pointer, *arguments)
        model._owner = owner
        return model

    @classmethod
    def _of(cls, owner: Owner) -> Self:
        """Take over a hada_model that C made."""
        model = cls.__new__(cls)
        model._owner = owner
        return model

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Self:
        """Return the model of a file (safetensors; docs/reference/files.md).

        Raises:
            FileOpenError, FileReadError, FileFormatError: the file is missing, damaged, or no model.

        """
        return cls._new(lib.hada_model_load, path(name))

    def save(self, name: str | os.PathLike[str]) -> Path:
        """Write the model; the file is there whole or not at all. Returns its path.

        Raises:
            FileWriteError: it could not be written.

        """
        call(lib.hada_model_save, self._c, path(name))
        return Path(name)

    @classmethod
    @named
    def from_psf(
        cls,
        psfs: Any,
        distances_mm: Floats | float,
        *,
        context: Device | None = None,
        form: Literal["matched", "wiener"] = "wiener",
        boundary: Boundary = "padded",
        window: tuple[int, int] | None = None,
        regularisation: float | None = None,
        psf_dark: float | None = None,
        dark: float | None = 0.0,
        refine_steps: int | None = None,
        refine_tv: float | None = None,
        turn: Literal["none", "mirror", "flip", "180", "90", "270", "transpose"] = "none",
        mosaic: Mosaic = "none",
        frame: tuple[int, int] | None = None,
        psf_gate: float | None = None,
        psf_taper: int = 0,
        channel_axis: int | None = None,
        downsample: int = 1,
        positions: npt.ArrayLike | None = None,
        components: int | None = None,
        explained: float = 0.99,
        colour_matrix: npt.ArrayLike | None = None,
        full_scale: float | None = None,
    ) -> Self:
        """Return a model made from measured or designed point spread functions.

        Args:
            psfs: a sequence of images (Y, X) or (C, Y, X), or an array (Z, Y, X) or (Z, C, Y, X), one a depth, near to
                far, the optical axis at (rows // 2, columns // 2); of one distance the image itself will do, grey or
                colour. dtypes as for :meth:`Plan.run`.
            distances_mm: of the depths, near to far; of one depth its number will do.
            context: a device for the transforms.
            form: of the linear filters.
            boundary: "padded" for a sensor that crops what the optics cast, "circular" otherwise.
            window: rows and columns of the scene; None: the whole frame.
            regularisation: of the Wiener filter, relative to the mean power; None: chosen.
            psf_dark: taken off the point spread functions; None: estimated from their background.
            dark: of the frames to come; None: estimated from each.
            refine_steps: of refinement; None: chosen.
            refine_tv: weight of total variation in refinement; None: found from each frame.
            turn: how the point spread functions are turned first, about the axis: "mirror" left to right, "flip" top to
                bottom, "180" both, "90" and "270" degrees to the right, "transpose". :meth:`Plan.match` says which of
                the first three explains a frame.
            mosaic: pattern of the colour filter mosaic of frames to come, which have one channel then.
            frame: rows and columns of the frames to come; None: those of the point spread functions.
            psf_gate: standard deviations of noise above the background below which a pixel is set to 0; None: chosen.
            psf_taper: pixels over which a point spread function fades out towards its borders.
            channel_axis: of each image, where it is not the first of three.
            downsample: frames to come have so many times the rows and columns and are binned; the point spread
                functions and `frame` are of binned pixels (:func:`hadalens.downsample`), `mosaic` is the sensor's.
            positions: for functions that vary over the field: (N, 2) or (Z, N, 2), rows and columns from the middle of
                its image at which the point of each stood; `psfs` are (Z, N, Y, X) or (Z, N, C, Y, X), or a list of the
                Z times N images. Methods "rl" and "fista" and the scene "volume" take such models.
            components: of functions that vary; 1: their mean alone; None: as few as explain the next share.
            explained: of their energy.
            colour_matrix: (3, 3), of each of the sensor's channels what it sees of the scenes' red, green and blue;
                frames are brought to the scenes' colours. None: they have them.
            full_scale: of the point spread functions, as for :meth:`Plan.run`.

        Raises:
            SizeError, ArgumentError: sizes or values do not fit.

        Example:
            >>> model = hadalens.Model.from_psf([psf], [250.0], dark=None)

        """
        distances = ascending(distances_mm)
        places = None
        if positions is not None:
            places = np.broadcast_to(np.asarray(positions, np.float64), (len(distances), *np.shape(positions)[-2:]))
            psfs = psfs if isinstance(psfs, list | tuple) else _flat(as_array(psfs, "psfs"), places.shape[:2])
        count = len(distances) * (1 if places is None else places.shape[1])
        images = Image(*_each_psf(psfs, count), what="psf", channel_axis=channel_axis, full_scale=full_scale)
        if len(images.arrays) != count:
            raise errors.SizeError(
                f"{len(images.arrays)} psfs, {len(distances)} distances and {count // len(distances)} position(s): one "
                "psf for each"
            )
        rows, cols = two(window, "window")
        frame_rows, frame_cols = two(frame, "frame")
        options = Options(
            "hada_psf_options",
            frame_rows=frame_rows,
            frame_cols=frame_cols,
            psf_gate=psf_gate,
            psf_taper=psf_taper,
            form=form,
            boundary=boundary,
            window_rows=rows,
            window_cols=cols,
            psf_dark=psf_dark,
            dark=AUTO if dark is None else dark,
            refine_steps=refine_steps,
            refine_tv=refine_tv,
            turn=turn,
            mosaic=mosaic,
            downsample=downsample,
            positions=None if places is None else places.shape[1],
            position_rows=None if places is None else places[..., 0].ravel().tolist(),
            position_cols=None if places is None else places[..., 1].ravel().tolist(),
            components=components,
            explained=explained,
            colour_matrix=None if colour_matrix is None else nine(colour_matrix),
            **{"lambda": regularisation},
        )
        return cls._new(
            lib.hada_model_from_psf,
            default(context)._c,
            images.c,
            len(distances),
            doubles(distances),
            options.c,
        )

    @classmethod
    def from_filters(
        cls,
        filters: npt.ArrayLike,
        distances_mm: Floats,
        raw_size: tuple[int, int],
        *,
        otf: npt.ArrayLike | None = None,
        window: tuple[int, int] | None = None,
        form: Literal["complex", "split"] = "complex",
        boundary: Boundary = "circular",
        grid: tuple[int, int] | None = None,
        dark: float | None = 0.0,
    ) -> Self:
        """Return a model made from filters that others have learned, such as the paper's authors.

        Args:
            filters: complex (Z, C, grid rows, grid columns // 2 + 1): W on the half spectrum, which multiplies the
                frame's spectrum; of the form "split" Wr + i Wi.
            distances_mm: of the depths, near to far.
            raw_size: rows and columns of the raw frames.
            otf: the transfer functions, of the same shape; refinement needs them.
            window: rows and columns of the scene; None: the frame's.
            form: how a filter acts on the spectrum.
            boundary: "circular" or "padded".
            grid: rows and columns of the grid of a padded model; None: as large as the library chooses.
            dark: taken off the frames; None: estimated from each.

        Raises:
            SizeError: an array has not the shape that the sizes say.
            NotFiniteError: filters hold NaN or infinite values.

        Example:
            >>> again = hadalens.Model.from_filters(
            ...     model.filters, model.info.distances_mm, (300, 400), otf=model.otf, window=(120, 120))

        """
        values = np.ascontiguousarray(filters, np.complex64)
        if values.ndim != 4:
            raise errors.SizeError(f"filters have the shape {values.shape}: (Z, C, rows, columns // 2 + 1) is needed")
        rows, cols = two(window, "window", raw_size)
        sizes = Options(
            "hada_fit_options",
            depths=len(distances_mm),
            channels=values.shape[1],
            distances_mm=distances_mm,
            raw_rows=raw_size[0],
            raw_cols=raw_size[1],
            window_rows=rows,
            window_cols=cols,
            form=form,
            boundary=boundary,
            grid_rows=None if grid is None else grid[0],
            grid_cols=None if grid is None else grid[1],
            dark=AUTO if dark is None else dark,
        )
        blank = cls._new(lib.hada_model_from_filters, sizes.c, ffi.NULL, ffi.NULL)
        shape = blank._shape()
        functions = None if otf is None else np.ascontiguousarray(otf, np.complex64)
        for name, array in (("filters", values), ("otf", functions)):
            if array is not None and array.shape != shape:
                raise errors.SizeError(f"{name} have the shape {array.shape}, not {shape}")
        pointers = [ffi.NULL if array is None else ffi.cast("float *", address(array)) for array in (values, functions)]
        return cls._new(lib.hada_model_from_filters, sizes.c, *pointers)

    @classmethod
    def from_psf_file(
        cls,
        name: str | os.PathLike[str],
        distances_mm: Floats | None = None,
        *,
        context: Device | None = None,
        colour: bool = False,
        half: bool = False,
        every: int = 1,
        recentre: bool = False,
        window: tuple[int, int] | None = None,
        components: int | None = None,
    ) -> Self:
        """Return a model made from the pages of a TIFF file, near to far; options are those of :meth:`from_psf`.

        Args:
            name: the file; or the list of point spread functions that vary over the field, or its folder
                (docs/how-to/use-a-measured-psf.md).
            distances_mm: of the pages; None: what the file says.
            context: a device.
            colour: a grey page serves red, green and blue alike.
            half: filters in half precision.
            every: takes each so many-th page, from the first on; distances are those of all.
            recentre: takes off what the bead drifted over the depths.
            window: rows and columns of the scene; None: the whole frame.
            components: of functions that vary over the field; None: chosen.

        """
        rows, cols = two(window, "window")
        psf = Options("hada_psf_options", window_rows=rows, window_cols=cols, components=components)
        task = Options(
            "hada_psf_task",
            distances_mm=distances_mm,
            distances=None if distances_mm is None else len(distances_mm),
            colour=colour,
            half=half,
            every=every,
            recentre=recentre,
            psf=psf,
        )
        return cls._new(lib.hada_psf_run, default(context)._c, path(name), task.c)

    def _shape(self) -> tuple[int, int, int, int]:
        info = lib.hada_model_get_info(self._c)
        return info.depths, info.channels, info.grid_rows, info.grid_cols // 2 + 1

    def _array(self, pointer: Any, dtype: npt.DTypeLike, shape: tuple[int, ...] | None = None) -> npt.NDArray[Any]:
        """Return a view of the model's memory, which lives as long."""
        shape = shape or (*self._shape(), 2)
        owner = self._own
        held = ffi.gc(ffi.cast("char *", pointer), lambda _: owner)  # the buffer holds it, and it the model
        count = int(np.prod(shape)) * np.dtype(dtype).itemsize
        view = np.frombuffer(ffi.buffer(held, count), dtype).reshape(shape)
        view.flags.writeable = False
        return view

    @property
    def _arrays(self) -> Any:
        arrays = ffi.new("hada_model_arrays *", {"size": ffi.sizeof("hada_model_arrays")})
        call(lib.hada_model_get_arrays, self._c, arrays)
        return arrays

    @property
    def filters(self) -> npt.NDArray[np.complex64]:
        """The filters W: complex64 (Z, C, grid rows, grid columns // 2 + 1), read-only; docs/reference/files.md.

        They multiply the half spectrum of the frame; of the form "split" real and imaginary parts are Wr and Wi.
        """
        arrays = self._arrays
        if arrays.filters != ffi.NULL:
            return self._array(arrays.filters, np.float32).view(np.complex64)[..., 0]
        halves = self._array(arrays.half_filters, np.float16)
        return halves.astype(np.float32).view(np.complex64)[..., 0]

    @property
    def otf(self) -> npt.NDArray[np.complex64] | None:
        """The optical transfer functions H, as :attr:`filters`; None where the model has none."""
        pointer = self._arrays.otf
        return None if pointer == ffi.NULL else self._array(pointer, np.float32).view(np.complex64)[..., 0]

    @property
    def components(self) -> tuple[npt.NDArray[np.complex64], Float32, npt.NDArray[np.float64]] | None:
        """Of point spread functions that vary over the field; None where they are the same everywhere.

        Transfer functions, complex64 (Z, K, C, grid rows, grid columns // 2 + 1), weights over the window, float32
        (Z, K, rows, columns), and singular values (Z, N), read-only: the frame is the sum of h_k * (w_k scene).
        """
        arrays, info = self._arrays, self.info
        if arrays.component_otf == ffi.NULL:
            return None
        depths, *rest = self._shape()
        first = (depths, info.components)
        otf = self._array(arrays.component_otf, np.float32, (*first, *rest, 2)).view(np.complex64)[..., 0]
        weights = self._array(arrays.component_weights, np.float32, (*first, info.window_rows, info.window_cols))
        return otf, weights, self._array(arrays.singular_values, np.float64, (depths, info.positions))

    @property
    def flat(self) -> Float32 | None:
        """What pixels make of the same light, 1 in the mean of a channel: frames are divided by it; None: not known."""
        flat = lib.hada_model_get_info(self._c).flat
        return None if flat == ffi.NULL else copy_of(flat)

    @property
    def dark_frame(self) -> Float32 | None:
        """What frames hold without the scene's light, which is subtracted; None: not known."""
        dark = lib.hada_model_get_info(self._c).dark_frame
        return None if dark == ffi.NULL else copy_of(dark)

    @property
    def psf(self) -> Float32 | None:
        """The point spread functions that the transfer functions stand for: float32 (Z, C, grid rows, grid columns).

        The optical axis is at (rows // 2, columns // 2). None where the model has no transfer functions.
        """
        otf = self.otf
        if otf is None:
            return None
        rows, cols = self.info.grid_rows, self.info.grid_cols
        spread = np.fft.irfft2(otf, s=(rows, cols))
        return np.ascontiguousarray(np.roll(spread, (rows // 2, cols // 2), axis=(-2, -1)), np.float32)

    @property
    def enhance(self) -> Net | None:
        """A copy of the net that enhances refocused planes; None where the model has none."""
        net = lib.hada_model_get_enhance(self._c)
        return None if net == ffi.NULL else Net._copy(net)

    def with_enhance(self, net: Net | None, size: tuple[int, int] | None = None) -> Model:
        """Return a copy with a net that enhances refocused planes, or without one.

        Args:
            net: it is copied; None: none.
            size: rows and columns at which it runs; None: the window's.

        Raises:
            ModelError: the net's channels are not the model's.

        """
        rows, cols = two(size, "size", (0, 0))
        pointer = ffi.NULL if net is None else net._c
        return Model._new(lib.hada_model_with_enhance, self._c, pointer, rows, cols)

    @property
    def info(self) -> ModelInfo:
        """What the model is."""
        struct = lib.hada_model_get_info(self._c)[0]
        return record(
            ModelInfo,
            struct,
            name=text(struct.name) if self._name is None else self._name,
            regularisation=getattr(struct, "lambda"),
            distances_mm=tuple(struct.distances_mm[z] for z in range(struct.depths)),
            colour_matrix=_rows(struct.colour_matrix),
        )

    def to_half(self) -> Model:
        """Return a copy with filters in half precision: a quarter less memory and traffic."""
        return Model._new(lib.hada_model_to_half, self._c)

    def with_form(self, form: Literal["matched", "wiener"], regularisation: float = 0.1) -> Model:
        """Return a copy with the fixed filters "matched" or "wiener" made from the transfer functions.

        Raises:
            ModelError: the model has no transfer functions.

        """
        return Model._new(lib.hada_model_with_form, self._c, value_of("hada_form", form, "form"), regularisation)

    def __reduce__(self) -> tuple[Any, ...]:
        """Models can be pickled, as the bytes of their file."""
        return _restored, (saved(self), self.info.name, self.fit_report)

    def __copy__(self) -> Model:
        """Copies share what does not change."""
        copy = Model._of(self._own)
        copy.fit_report, copy._name = self.fit_report, self._name
        return copy

    def __deepcopy__(self, _: Any) -> Model:
        """Copies share what does not change."""
        return self.__copy__()

    def _shown(self) -> str:
        info = self.info
        return (
            f"{info.name + ', ' if info.name else ''}{span(info.distances_mm)}, {info.channels} x {info.raw_rows} x "
            f"{info.raw_cols}, window {info.window_rows} x {info.window_cols}"
        )

    def _repr_html_(self) -> str:
        return table(repr(self), [] if self._owner is None else members(self.info))


def _restored(content: bytes, name: str, report: FitReport | None) -> Model:
    model: Model = loaded(Model, content, Path(name).name or "model")
    model._name, model.fit_report = name, report
    return model


def _flat(array: npt.NDArray[Any], places: tuple[int, int]) -> list[npt.NDArray[Any]]:
    """Return the images of (Z, N, ...), or of one depth of (N, ...)."""
    if array.shape[:2] != places and places[0] == 1:
        array = array[np.newaxis]
    if array.shape[:2] != places:
        raise errors.SizeError(
            f"psfs have the shape {array.shape}: {places[0]} depths of {places[1]} positions are needed"
        )
    return list(array.reshape(-1, *array.shape[2:]))


def _each_psf(psfs: Any, depths: int) -> Sequence[Any]:
    """Return one image a depth: an array for a single depth may be that image itself."""
    if isinstance(psfs, list | tuple):
        return psfs
    array = as_array(psfs, "psfs")
    one = array.ndim == 2 or (array.ndim == 3 and depths == 1 and array.shape[0] != 1)
    return [array] if one else list(array)


def as_model(given: Model | str | os.PathLike[str]) -> Model:
    """Return a model, or that of a file."""
    if isinstance(given, str | os.PathLike):
        return Model.load(given)
    return expect(given, Model, "model", "or the file of one")
