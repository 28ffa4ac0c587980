"""Cameras by design, what they record, and scenes to show to them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from . import errors
from . import response as responses
from ._arrays import Float32, Image, NewImage, as_array, planes_first, to_float
from ._native import (
    Handle,
    Monitor,
    Options,
    Owner,
    Progress,
    call,
    ffi,
    lib,
    members,
    path,
    record,
    text,
    value_of,
    word,
)
from .dataset import Dataset
from .device import Context, default

Mask: TypeAlias = Literal["mla", "grid", "diffuser", "contour", "aperture"]


class Camera:
    """A lensless camera by design: a mask in front of a bare sensor. Lengths in millimetres.

    Every member of ``hada_camera`` (hadalens/camera.h) can be read and set by its name: ``camera.rows``,
    ``camera.pixel_pitch_mm``, ``camera.boundary = "padded"``; enumerations are words.

    Args:
        preset: "sim512", "sim300", "crop300" or "paper2022".
        members: by their names, in place of the preset's.

    Example:
        >>> camera = hadalens.Camera("sim300", channels=1)
        >>> camera.set_depths(100, 600, 8)
        >>> psf = camera.psf(250.0)

    """

    _c: Any

    def __init__(self, preset: str = "sim512", **members: Any) -> None:
        """Begin with a preset."""
        object.__setattr__(self, "_c", ffi.new("hada_camera *"))
        call(lib.hada_camera_preset, self._c, preset.encode())
        for name, value in members.items():
            setattr(self, name, value)

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Self:
        """Return the camera of a camera.json."""
        camera = cls()
        call(lib.hada_camera_load, camera._c, path(name))
        return camera

    @classmethod
    def _copy(cls, struct: Any) -> Self:
        camera = cls()
        camera._c[0] = struct[0]
        return camera

    def save(self, name: str | os.PathLike[str]) -> Path:
        """Write a camera.json. Returns its path."""
        call(lib.hada_camera_save, self._c, path(name))
        return Path(name)

    def __getattr__(self, name: str) -> Any:
        """Return a member of hada_camera."""
        field = members("hada_camera").get(name)
        if field is None or name == "size":
            raise AttributeError(f"a camera has no {name}")
        value = getattr(self._c, name)
        if name == "distances_mm":
            return tuple(value[z] for z in range(self._c.depths))
        if field.type.kind == "array":
            return tuple(value)
        return word(field.type.cname, value) if field.type.kind == "enum" else value

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a member of hada_camera."""
        field = members("hada_camera").get(name)
        if field is None or name == "size":
            raise AttributeError(f"a camera has no {name}")
        if name == "distances_mm":
            if len(value) > lib.HADA_CAMERA_DEPTHS:
                raise errors.ArgumentError(f"{len(value)} distances: {lib.HADA_CAMERA_DEPTHS} at most")
            self._c.depths = len(value)
        if field.type.kind == "enum":
            value = value_of(field.type.cname, value, name)
        if field.type.kind == "array":
            for index, one in enumerate(value):
                getattr(self._c, name)[index] = one
        else:
            setattr(self._c, name, value)

    def set_depths(self, near_mm: float, far_mm: float, count: int) -> None:
        """Set distances from near to far with equal steps in 1/z."""
        call(lib.hada_camera_set_depths, self._c, near_mm, far_mm, count)

    def resize(self, size: tuple[int, int], window: tuple[int, int] | None = None) -> None:
        """Set rows and columns; the sensor's shorter side keeps its length. window None: it keeps its share."""
        call(lib.hada_camera_resize, self._c, *size, *(window or (0, 0)))

    def set_mask(self, mask: Mask) -> None:
        """Set another kind of mask, with dimensions that suit the camera."""
        kind = lib.hada_mask_from_word(mask.encode())
        call(lib.hada_camera_set_mask, self._c, kind)

    @property
    def mask(self) -> str:
        """The kind of mask."""
        return text(lib.hada_mask_word(self._c.mask))

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
        rows, cols = size or (self._c.rows, self._c.cols)
        call(lib.hada_camera_psf_sized, self._c, distance_mm, rows, cols, image.c)
        return image.plane()

    def psf_stack(self, *, context: Context | None = None) -> Float32:
        """Return the point spread functions of all distances by the camera's `optics`: (Z, C, Y, X)."""
        images = NewImage(self._c.depths)
        used = ffi.NULL if self.optics == "geometry" else default(context)._c
        call(lib.hada_camera_psf_stack, used, self._c, images.c)
        return np.stack([images.array(z) for z in range(self._c.depths)])

    def magnification(self, distance_mm: float) -> float:
        """Return 1 + d/z."""
        return float(lib.hada_camera_magnification(self._c, distance_mm))

    def defocus_pixels(self, distance_mm: float) -> float:
        """Return the diameter of a lens's blur at a distance."""
        return float(lib.hada_camera_defocus_pixels(self._c, distance_mm))

    def refractive_index(self, wavelength_nm: float) -> float:
        """Return the index of the mask's material."""
        return float(lib.hada_camera_refractive_index(self._c, wavelength_nm))

    def focal_length(self, wavelength_nm: float) -> float:
        """Return the focal length in millimetres at a wavelength."""
        return float(lib.hada_camera_focal_length(self._c, wavelength_nm))

    def parallax(self, near_mm: float, far_mm: float, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return how far a near plane's shadow moves on a far one, for a lens at (x, y): rows, columns in pixels."""
        cols, rows = ffi.new("double *"), ffi.new("double *")
        lib.hada_camera_parallax(self._c, near_mm, far_mm, x_mm, y_mm, cols, rows)
        return rows[0], cols[0]

    def __getstate__(self) -> bytes:
        """Cameras can be pickled."""
        return bytes(ffi.buffer(self._c))

    def __setstate__(self, state: bytes) -> None:
        """Restore a camera."""
        object.__setattr__(self, "_c", ffi.new("hada_camera *"))
        ffi.memmove(self._c, state, len(state))

    def __repr__(self) -> str:
        """Return mask and sizes."""
        return f"<Camera {self.mask}: {self.channels} x {self.rows} x {self.cols}, {self.depths} depths>"


def window_origin(full: int, window: int) -> int:
    """Return the first row (or column) of a window in the middle of a frame: (full - window) // 2."""
    return int(lib.hada_window_origin(full, window))


@dataclass(frozen=True)
class Sensor:
    """What a sensor makes of light (hadalens/sensor.h); as it stands, nothing.

    Attributes:
        exposure: share of the full scale that light of 1 makes.
        full_well: electrons at full scale; 0: light is not counted, no shot noise.
        read_noise: standard deviation in electrons; as a share of full scale where full_well is 0.
        dark_level: what a dark pixel reads, as a share of full scale.
        saturate: nothing above full scale.
        bits: of the converter; 0: values are not rounded.
        vignetting: "none", "cos4", or an image (Y, X) of gains.

    """

    exposure: float = 1.0
    full_well: float = 0.0
    read_noise: float = 0.0
    dark_level: float = 0.0
    saturate: bool = True
    bits: int = 0
    vignetting: Any = "none"

    def _options(self) -> Options:
        given = {name: value for name, value in vars(self).items() if name != "vignetting"}
        options = Options("hada_sensor", **given)
        if isinstance(self.vignetting, str):
            options.set(vignetting=self.vignetting)
        else:
            gain = Image(self.vignetting, what="vignetting")
            options.kept.append(gain)
            options.set(vignetting="image", gain=gain.c)
        call(lib.hada_sensor_check, options.c)
        return options


class Simulator(Handle):
    """Renders raw frames of a camera on a device; used by one thread at a time.

    Args:
        camera: it is copied.
        psf: point spread functions (Z, Y, X) or (Z, C, Y, X) in place of the camera's own.
        shift: rows and columns by which the sensor's middle stands from the axis.
        field: rows and columns of scenes that are larger than the window; None: the window.
        context: a device; None: :meth:`Context.default`.

    Example:
        >>> simulator = hadalens.Simulator(hadalens.Camera("sim300"))
        >>> raw = simulator.render({0: near, 3: far}, noise=0.01)

    """

    def __init__(
        self,
        camera: Camera,
        *,
        psf: Any = None,
        shift: tuple[int, int] = (0, 0),
        field: tuple[int, int] | None = None,
        context: Context | None = None,
    ) -> None:
        """Make ready; point spread functions are made when a depth is first used."""
        used = default(context)
        options = Options("hada_simulator_options", shift_rows=shift[0], shift_cols=shift[1])
        if field is not None:
            options.set(field_rows=field[0], field_cols=field[1])
        if psf is not None:
            images = Image(*psf, what="psf")
            if len(images.arrays) != camera.depths:
                raise errors.SizeError(f"{len(images.arrays)} psf for {camera.depths} depths")
            options.kept.append(images)
            options.set(psf=images.c)
        owner = Owner("hada_simulator", lib.hada_simulator_destroy, used._own, options)
        call(lib.hada_simulator_create_with, owner.pointer, used._c, camera._c, options.c)
        self._owner = owner

    @property
    def camera(self) -> Camera:
        """A copy of the camera."""
        return Camera._copy(lib.hada_simulator_camera(self._c))

    def render(
        self,
        planes: dict[int, Any],
        *,
        opacity: dict[int, Any] | None = None,
        lens: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
    ) -> Float32:
        """Return the frame (C, Y, X) of a scene of planes.

        Args:
            planes: {depth index: image (Y, X) or (C, Y, X) of the window's size or the field's}.
            opacity: {depth index: (Y, X), 0 (clear) to 1}: planes hide what stands behind them.
            lens: look through this lens alone.
            noise: Gaussian, its standard deviation as a share of the frame's maximum.
            seed: of the noise.

        """
        images = Image(*planes.values(), what="planes")
        given = ffi.new("hada_plane[]", [(depth, images.c + i) for i, depth in enumerate(planes)])
        frame = NewImage()
        if opacity is None and lens is None:
            call(lib.hada_simulator_render, self._c, given, len(planes), noise, seed, frame.c)
            return frame.array()
        hidden = opacity or {}
        covers = Image(*(hidden[depth] for depth in planes if depth in hidden), what="opacity")
        order = iter(range(len(covers.arrays)))
        array = ffi.new("hada_image *[]", [covers.c + next(order) if depth in hidden else ffi.NULL for depth in planes])
        only = -1 if lens is None else lens
        call(lib.hada_simulator_render_occluded, self._c, given, array, len(planes), only, noise, seed, frame.c)
        return frame.array()

    def render_reliefs(
        self, surfaces: Sequence[tuple[Any, Any]], *, opaque: bool = False, noise: float = 0.0, seed: int = 0
    ) -> Float32:
        """Return the frame (C, Y, X) of surfaces, each an image and its distances (Y, X) in mm; NaN: nothing there."""
        images = Image(*(image for image, _ in surfaces), what="surfaces")
        maps = Image(*(distances for _, distances in surfaces), what="distances")
        given = ffi.new("hada_relief[]", [(images.c + i, maps.c + i) for i in range(len(surfaces))])
        frame = NewImage()
        call(lib.hada_simulator_render_reliefs, self._c, given, len(surfaces), opaque, noise, seed, frame.c)
        return frame.array()

    def expose(self, frame: Any, sensor: Sensor, *, seed: int = 0) -> Float32:
        """Return what a sensor makes of a frame of light (C, Y, X)."""
        copy = np.array(to_float(planes_first(as_array(frame, "frame"), None, "frame")), copy=True)
        image = Image(copy)
        call(lib.hada_simulator_expose, self._c, sensor._options().c, seed, image.c)
        return image.arrays[0]

    def white_exposure(self, share: float) -> float:
        """Return the exposure at which a white scene just reaches a share of full scale."""
        out = ffi.new("double *")
        call(lib.hada_simulator_white_exposure, self._c, share, out)
        return float(out[0])

    def psf(self, depth: int) -> Float32:
        """Return the point spread function in use at a depth: (C, Y, X)."""
        image = NewImage()
        call(lib.hada_simulator_psf, self._c, depth, image.c)
        return image.array()


@dataclass(frozen=True)
class SimulateReport:
    """What was written. `pairs` per depth; `exposure` NaN without a sensor; `light_lost` of a white window."""

    pairs: int
    test_depths: int
    exposure: float
    tests: int
    light_lost: float


def simulate(
    camera: Camera | str,
    folder: str | os.PathLike[str],
    *,
    context: Context | None = None,
    scenes: str | os.PathLike[str] | None = None,
    test_scenes: str | os.PathLike[str] | None = None,
    pairs: int = 8,
    tests: int = 0,
    test_depths: int = 2,
    occlude: bool = False,
    bits: Literal[16, 32] = 32,
    noise: float = 0.01,
    sensor: Sensor | None = None,
    white: float | None = None,
    surfaces: str | None = None,
    scene_response: float | str = "linear",
    progress: Progress | bool | None = None,
) -> tuple[Dataset, SimulateReport]:
    """Write the data set of a camera by design, as ``hadalens simulate`` does.

    Args:
        camera: a :class:`Camera`, or a preset.
        folder: not there yet, or empty; it appears whole or not at all.
        context: a device.
        scenes: a folder of TIFF pictures; None: coloured shapes are drawn.
        test_scenes: for the test frames.
        pairs: of each depth.
        tests: frames with a truth, in folder/test.
        test_depths: depths that a test frame occupies.
        occlude: test scenes of opaque objects.
        bits: of frames and scenes.
        noise: as a share of a frame's maximum.
        sensor: what it makes of light.
        white: with a sensor: its exposure is that with which a white scene reaches this share.
        surfaces: kinds of test scenes on surfaces: "slant,hill,ball", ...
        scene_response: how the pictures stand for light.
        progress: a function, or True for tqdm's bars.

    Returns:
        The data set, and what was written.

    Example:
        >>> pairs, report = hadalens.simulate("sim300", "camera", pairs=4)
        >>> model = hadalens.fit(pairs)

    """
    monitor = Monitor(progress)
    task = Options(
        "hada_simulate_task",
        scenes=scenes,
        test_scenes=test_scenes,
        pairs=pairs,
        tests=tests,
        test_depths=test_depths,
        occlude=occlude,
        bits=bits,
        noise=noise,
        sensor=None if sensor is None else sensor._options(),
        white=white,
        surfaces=surfaces,
        scene_response=responses.number(scene_response),
        monitor=monitor.options,
    )
    report = ffi.new("hada_simulate_report *", {"size": ffi.sizeof("hada_simulate_report")})
    design = Camera(camera) if isinstance(camera, str) else camera
    monitor.run(lib.hada_simulate_run, default(context)._c, design._c, path(folder), task.c, report)
    return Dataset.scan(folder), record(SimulateReport, report[0])
