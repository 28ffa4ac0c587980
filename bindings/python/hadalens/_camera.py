"""Cameras by design."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Generic, Literal, Self, TypeAlias, TypedDict, TypeVar, Unpack, cast, overload

import numpy as np
import numpy.typing as npt

from . import errors
from ._arrays import Float32, Floats, NewImage
from ._native import c_number, call, check_names, expect, ffi, lib, meant, members, path, two, value_of, word
from .device import Device, default
from .model import Boundary

Mask: TypeAlias = Literal["mla", "grid", "diffuser", "contour", "aperture"]


class CameraMembers(TypedDict, total=False):
    """Members of hada_camera (hadalens/camera.h), by their names."""

    mask: Mask
    boundary: Boundary
    rows: int
    cols: int
    channels: int
    window_rows: int
    window_cols: int
    pixel_pitch_mm: float
    distance_mm: float
    aperture_mm: float
    seed: int
    blur_pixels: float
    optics: Literal["geometry", "wave"]
    lenses: int
    lens_diameter_mm: float
    focal_length_mm: float
    minimum_spacing_mm: float
    maximum_spacing_mm: float
    refractive_index: float
    abbe_number: float
    correlation_mm: float
    deflection_mrad: float
    cell_mm: float
    open_fraction: float
    wavelengths_nm: Floats
    depths: int
    distances_mm: Floats


_MEMBERS = CameraMembers.__annotations__.keys()
Get = TypeVar("Get")
Set = TypeVar("Set")


class _Member(Generic[Get, Set]):
    """A member of hada_camera as a member of Camera."""

    def __init__(self, name: str = "") -> None:
        self.name = name

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = self.name or name

    @overload
    def __get__(self, camera: None, kind: type) -> Self: ...

    @overload
    def __get__(self, camera: Camera, kind: type) -> Get: ...

    def __get__(self, camera: Camera | None, kind: type) -> Self | Get:
        return self if camera is None else cast(Get, camera._get(self.name))

    def __set__(self, camera: Camera, value: Set) -> None:
        camera._set(self.name, value)


class Camera:
    """A lensless camera by design: a mask in front of a bare sensor. Lengths in millimetres.

    Every member of ``hada_camera`` (hadalens/camera.h) can be read and set by its name: ``camera.rows``,
    ``camera.pixel_pitch_mm``, ``camera.boundary = "padded"``; enumerations are words. Two of them are named otherwise:
    ``lens_count`` (``lenses`` in C and among the arguments) and ``material_index`` (``refractive_index``, at 587.6 nm).

    Args:
        preset: "sim512", "sim300", "crop300" or "paper2022".
        members: by their names, in place of the preset's.

    Example:
        >>> camera = hadalens.Camera("sim300", channels=1)
        >>> camera.set_depths(100, 600, 8)
        >>> psf = camera.psf(250.0)

    """

    mask = _Member[Mask, Mask]()
    boundary = _Member[Boundary, Boundary]()
    rows = _Member[int, int]()
    cols = _Member[int, int]()
    channels = _Member[int, int]()
    window_rows = _Member[int, int]()
    window_cols = _Member[int, int]()
    pixel_pitch_mm = _Member[float, float]()
    distance_mm = _Member[float, float]()
    aperture_mm = _Member[float, float]()
    seed = _Member[int, int]()
    blur_pixels = _Member[float, float]()
    optics = _Member[Literal["geometry", "wave"], Literal["geometry", "wave"]]()
    lens_count = _Member[int, int]("lenses")
    lens_diameter_mm = _Member[float, float]()
    focal_length_mm = _Member[float, float]()
    minimum_spacing_mm = _Member[float, float]()
    maximum_spacing_mm = _Member[float, float]()
    material_index = _Member[float, float]("refractive_index")
    abbe_number = _Member[float, float]()
    correlation_mm = _Member[float, float]()
    deflection_mrad = _Member[float, float]()
    cell_mm = _Member[float, float]()
    open_fraction = _Member[float, float]()
    wavelengths_nm = _Member[tuple[float, ...], Floats]()
    depths = _Member[int, int]()
    distances_mm = _Member[tuple[float, ...], Floats]()

    _c: Any

    def __init__(self, preset: str = "sim512", **members: Unpack[CameraMembers]) -> None:
        """Begin with a preset."""
        object.__setattr__(self, "_c", ffi.new("hada_camera *", {"size": ffi.sizeof("hada_camera")}))
        call(lib.hada_camera_preset, self._c, preset.encode())
        check_names(members, _MEMBERS, "Camera")
        for name, value in members.items():
            self._set(name, value)

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Self:
        """Return the camera of a camera.json."""
        camera = cls()
        call(lib.hada_camera_load, camera._c, path(name))
        return camera

    @classmethod
    def _of(cls, given: Camera | str) -> Camera:
        """Return a camera, or that of a preset."""
        return cls(given) if isinstance(given, str) else expect(given, Camera, "camera", "or a preset's name")

    @classmethod
    def _copy(cls, struct: Any) -> Self:
        camera = cls()
        camera._c[0] = struct[0]
        return camera

    def save(self, name: str | os.PathLike[str]) -> Path:
        """Write a camera.json. Returns its path."""
        call(lib.hada_camera_save, self._c, path(name))
        return Path(name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a member; a name that is none is an error."""
        if isinstance(getattr(type(self), name, None), _Member):
            object.__setattr__(self, name, value)
        elif name in _MEMBERS:
            self._set(name, value)
        else:
            raise AttributeError(f"a camera has no {name!r}{meant(name, _MEMBERS)}")

    def _get(self, name: str) -> Any:
        """Return a member of hada_camera."""
        kind, value = members("hada_camera")[name].type, getattr(self._c, name)
        if kind.kind == "array":
            return tuple(value)[: self._c.depths if name == "distances_mm" else None]
        return word(kind.cname, value) if kind.kind == "enum" else value

    def _set(self, name: str, value: Any) -> None:
        """Set a member of hada_camera."""
        kind = members("hada_camera")[name].type
        if kind.kind == "enum":
            setattr(self._c, name, value_of(kind.cname, value, name))
        elif kind.kind == "array":
            if len(value) > kind.length:
                raise errors.ArgumentError(f"{name} has {len(value)} numbers: {kind.length} at most")
            if name == "distances_mm":
                self._c.depths = len(value)
            for index, one in enumerate(value):
                getattr(self._c, name)[index] = c_number(name, kind.item, one)
        else:
            setattr(self._c, name, c_number(name, kind, value))

    def set_depths(self, near_mm: float, far_mm: float, count: int) -> None:
        """Set distances from near to far with equal steps in 1/z."""
        call(lib.hada_camera_set_depths, self._c, near_mm, far_mm, count)

    def resize(self, size: tuple[int, int], window: tuple[int, int] | None = None) -> None:
        """Set rows and columns; the sensor's shorter side keeps its length. window None: it keeps its share."""
        call(lib.hada_camera_resize, self._c, *size, *two(window, "window", (0, 0)))

    def set_mask(self, mask: Mask) -> None:
        """Set another kind of mask, with dimensions that suit the camera."""
        call(lib.hada_camera_set_mask, self._c, value_of("hada_mask", mask, "mask"))

    @property
    def fill_factor(self) -> float:
        """The share of the aperture that lets light through."""
        out = ffi.new("double *")
        call(lib.hada_camera_fill_factor, self._c, out)
        return float(out[0])

    def set_fill_factor(self, fill: float) -> None:
        """Set the lens diameter with which the mask lets this share of the aperture's light through."""
        call(lib.hada_camera_set_fill_factor, self._c, fill)

    def check(self) -> None:
        """Raise ArgumentError with the first value that is impossible."""
        call(lib.hada_camera_check, self._c)

    def lenses(self) -> npt.NDArray[np.float64]:
        """Return the centres of lenses or holes: float64 (lenses, 2), x and y in millimetres."""
        centres = np.empty((2, self._c.lenses))
        x, y = (ffi.cast("double *", ffi.from_buffer(row)) for row in centres)
        call(lib.hada_camera_lenses, self._c, x, y)
        return centres.T.copy()

    def mask_map(self, rows: int, cols: int) -> tuple[Float32, Float32]:
        """Return the mask's thickness in millimetres and its transmission over the aperture, each (Y, X)."""
        images = NewImage(2)
        call(lib.hada_camera_mask_map, self._c, rows, cols, images.c, images.c + 1)
        return images.plane(0), images.plane(1)

    def psf(self, distance_mm: float, size: tuple[int, int] | None = None) -> Float32:
        """Return the point spread function at a distance by geometry: (Y, X), the axis at (rows // 2, columns // 2)."""
        image = NewImage()
        call(lib.hada_camera_psf, self._c, distance_mm, *two(size, "size", (0, 0)), image.c)
        return image.plane()

    def psf_stack(self, *, context: Device | None = None) -> Float32:
        """Return the point spread functions of all distances by the camera's `optics`: (Z, C, Y, X)."""
        images = NewImage(self._c.depths)
        used = ffi.NULL if self.optics == "geometry" else default(context)._c
        call(lib.hada_camera_psf_stack, used, self._c, images.c)
        return np.stack([images.array(z) for z in range(self._c.depths)])

    def _numbers(self, distance_mm: float = 1.0, wavelength_nm: float = 587.6) -> Any:
        numbers = ffi.new("hada_camera_numbers *", {"size": ffi.sizeof("hada_camera_numbers")})
        call(lib.hada_camera_get_numbers, self._c, distance_mm, wavelength_nm, numbers)
        return numbers

    def magnification(self, distance_mm: float) -> float:
        """Return 1 + d/z."""
        return float(self._numbers(distance_mm=distance_mm).magnification)

    def defocus_pixels(self, distance_mm: float) -> float:
        """Return the diameter of a lens's blur at a distance."""
        return float(self._numbers(distance_mm=distance_mm).defocus_pixels)

    def refractive_index(self, wavelength_nm: float) -> float:
        """Return the index of the mask's material."""
        return float(self._numbers(wavelength_nm=wavelength_nm).refractive_index)

    def focal_length(self, wavelength_nm: float) -> float:
        """Return the focal length in millimetres at a wavelength."""
        return float(self._numbers(wavelength_nm=wavelength_nm).focal_length_mm)

    def parallax(self, near_mm: float, far_mm: float, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return how far a near plane's shadow moves on a far one, for a lens at (x, y): rows, columns in pixels."""
        scale = self._c.distance_mm * (1.0 / near_mm - 1.0 / far_mm) / self._c.pixel_pitch_mm
        return y_mm * scale, x_mm * scale

    def __reduce__(self) -> tuple[Any, ...]:
        """Cameras can be pickled, member by member; each is checked when it is set again."""
        return _restored, (
            type(self),
            {name: self._get(name) for name in _MEMBERS},
        )

    def __repr__(self) -> str:
        """Return mask and sizes."""
        return f"<Camera {self.mask}: {self.channels} x {self.rows} x {self.cols}, {self.depths} depths>"


def _restored(kind: type[Camera], given: CameraMembers) -> Camera:
    return kind(**given)
