"""What cameras by design record: frames, and whole data sets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from . import errors
from . import response as responses
from ._arrays import Float32, Image, Mosaic, NewImage, taken
from ._camera import Camera
from ._native import (
    Handle,
    Monitor,
    Options,
    Owner,
    Progress,
    call,
    ffi,
    lib,
    named,
    path,
    record,
)
from ._pairs import Dataset
from .device import Device, default


def window_origin(full: int, window: int) -> int:
    """Return the first row (or column) of a window in the middle of a frame: (full - window) // 2."""
    return (full - window) // 2


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
        camera: it is copied; or a preset.
        psf: point spread functions (Z, Y, X) or (Z, C, Y, X) in place of the camera's own.
        shift: rows and columns by which the sensor's middle stands from the axis.
        field: rows and columns of scenes that are larger than the window; None: the window.
        field_varying: point spread functions vary over the field: in the corners of the window they correlate so much
            with that of the middle, between 0 and 1; None: they are the same everywhere.
        context: a device; None: :meth:`Context.default`.

    Example:
        >>> simulator = hadalens.Simulator(hadalens.Camera("sim300"))
        >>> raw = simulator.render({0: near, 3: far}, noise=0.01)

    """

    def __init__(
        self,
        camera: Camera | str,
        *,
        psf: Any = None,
        shift: tuple[int, int] = (0, 0),
        field: tuple[int, int] | None = None,
        field_varying: float | None = None,
        context: Device | None = None,
    ) -> None:
        """Make ready; point spread functions are made when a depth is first used."""
        used, camera = default(context), Camera._of(camera)
        options = Options(
            "hada_simulator_options", shift_rows=shift[0], shift_cols=shift[1], field_varying=field_varying
        )
        if field is not None:
            options.set(field_rows=field[0], field_cols=field[1])
        if psf is not None:
            images = Image(*psf, what="psf")
            if len(images.arrays) != camera.depths:
                raise errors.SizeError(f"{len(images.arrays)} psf for {camera.depths} depths")
            options.kept.append(images)
            options.set(psf=images.c)
        owner = Owner("hada_simulator", lib.hada_simulator_destroy, used._own, options)
        call(lib.hada_simulator_create, owner.pointer, used._c, camera._c, options.c)
        self._owner = owner

    @property
    def camera(self) -> Camera:
        """A copy of the camera."""
        return Camera._copy(lib.hada_simulator_camera(self._c))

    def _shown(self) -> str:
        return repr(self.camera)

    def render(
        self,
        planes: dict[int, Any],
        *,
        opacity: dict[int, Any] | None = None,
        lens: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
        channel_axis: int | None = None,
    ) -> Float32:
        """Return the frame (C, Y, X) of a scene of planes.

        Args:
            planes: {depth index: image (Y, X) or (C, Y, X) of the window's size or the field's}.
            opacity: {depth index: (Y, X), 0 (clear) to 1}: planes hide what stands behind them.
            lens: look through this lens alone.
            noise: Gaussian, its standard deviation as a share of the frame's maximum.
            seed: of the noise.
            channel_axis: of the images; None: the first.

        """
        images = Image(*planes.values(), what="planes", channel_axis=channel_axis)
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
        maps = Image(*(distances for _, distances in surfaces), what="distances", light=False)
        given = ffi.new("hada_relief[]", [(images.c + i, maps.c + i) for i in range(len(surfaces))])
        frame = NewImage()
        call(lib.hada_simulator_render_reliefs, self._c, given, len(surfaces), opaque, noise, seed, frame.c)
        return frame.array()

    def expose(self, frame: Any, sensor: Sensor, *, seed: int = 0, channel_axis: int | None = None) -> Float32:
        """Return what a sensor makes of a frame of light (C, Y, X)."""
        image = Image(np.array(taken(frame, "frame", channel_axis), copy=True))
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

    def psf_at(self, depth: int, row: int, col: int) -> Float32:
        """Return what the sensor sees of a point at `row` and `col` pixels from the axis, with `field_varying`."""
        image = NewImage()
        call(lib.hada_simulator_psf_at, self._c, depth, row, col, image.c)
        return image.array()


@dataclass(frozen=True)
class SimulateReport:
    """What was written. `pairs` per depth; `exposure` NaN without a sensor; `light_lost` of a white window."""

    pairs: int
    test_depths: int
    exposure: float
    tests: int
    light_lost: float


@named
def simulate(
    camera: Camera | str,
    folder: str | os.PathLike[str],
    *,
    context: Device | None = None,
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
    mosaic: Mosaic = "none",
    raw: Literal["tiff", "dng", "numpy", "packed12"] = "tiff",
    field_varying: float | None = None,
    field_psfs: int = 5,
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
        mosaic: pattern of the sensor's colour filter mosaic; raw frames have one channel then.
        raw: the files of raw frames; DNG and packed12 hold one channel. Packed ones have no header: call
            :func:`set_headerless` first.
        field_varying: as of :class:`Simulator`; functions of `field_psfs` times as many points are written to
            folder/field.
        field_psfs: 0: none.
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
        mosaic=mosaic,
        raw=raw,
        field_psfs=field_psfs,
        simulator=Options("hada_simulator_options", field_varying=field_varying),
        monitor=monitor.options,
    )
    report = ffi.new("hada_simulate_report *", {"size": ffi.sizeof("hada_simulate_report")})
    design = Camera._of(camera)
    monitor.run(lib.hada_simulate_run, default(context)._c, design._c, path(folder), task.c, report)
    return Dataset.scan(folder, mosaic=mosaic), record(SimulateReport, report[0])
