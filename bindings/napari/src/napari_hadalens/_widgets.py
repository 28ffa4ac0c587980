"""The plugin's widgets: each hands its work to a thread, shows how far it is, and can cancel it."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hadalens
import numpy as np
from hadalens.ome import is_even
from magicgui.widgets import CheckBox, ComboBox, Container, FileEdit, Label, LineEdit, ProgressBar, PushButton
from napari.layers import Image, Layer
from napari.qt.threading import create_worker
from qtpy.QtCore import QTimer

from ._layers import LayerData, result_layers
from ._reader import read

if TYPE_CHECKING:
    import napari

# What a thread does: it tells how far it is, now and then, and returns what layers are made of.
Work = Generator[tuple[float, str], None, list[LayerData]]
# It looks at the event now and then, and ends soon after that is set.
Start = Callable[[threading.Event], Work]

POLL = 0.05  # seconds between two looks at a job
STEPS = 1000  # of the progress bar


class Worker(Container):  # type: ignore[misc]  # which is Any to the type checker
    """A widget with one piece of work at a time: a button that starts it, one that cancels it, and a progress bar."""

    def __init__(self, viewer: napari.Viewer, start: str, settings: list[Any]) -> None:
        """Lay the widgets out."""
        self._viewer = viewer
        self._worker: Any = None
        self._halt = threading.Event()
        self.start = PushButton(text=start)
        self.cancel = PushButton(text="Cancel", enabled=False)
        self.progress = ProgressBar(max=STEPS, value=0, label="Progress")
        self.message = Label(value="")
        super().__init__(widgets=[*settings, self.start, self.cancel, self.progress, self.message])
        self.start.changed.connect(lambda: self._begin())
        self.cancel.changed.connect(lambda: self.stop())

    def work(self) -> Start:
        """Return the work that the settings ask for; read from them now, done in a thread later.

        Raises:
            ValueError: something is missing; the message says what.

        """
        raise NotImplementedError

    def _begin(self) -> None:
        try:
            work = self.work()
        except ValueError as error:
            self.message.value = str(error)
            return
        halt = self._halt = threading.Event()

        def run() -> Generator[tuple[float, str], None, list[Layer]]:
            return [Layer.create(*one) for one in (yield from work(halt))]

        worker: Any = create_worker(run, _start_thread=False)
        worker.yielded.connect(lambda told: self._tell(worker, *told))
        worker.returned.connect(lambda layers: self._end(worker, "done", layers))
        worker.errored.connect(lambda error: self._end(worker, _words(error), []))
        self._worker = worker
        self.start.enabled, self.cancel.enabled = False, True
        self._tell(worker, 0.0, "starting")
        worker.start()

    def stop(self) -> None:
        """Cancel: the widget is free at once, the thread ends soon, and what it makes is dropped."""
        self._halt.set()
        if self._worker is not None:
            self._end(self._worker, "cancelled", [])

    def _tell(self, worker: Any, part: float, words: str) -> None:
        if worker is self._worker:
            self.progress.value = round(part * STEPS)
            self.message.value = words

    def _end(self, worker: Any, words: str, layers: list[Layer]) -> None:
        if worker is not self._worker:
            return
        self._worker = None
        self.start.enabled, self.cancel.enabled = True, False
        self.progress.value = STEPS if words == "done" else 0
        self.message.value = words
        self._show(list(layers))

    def _show(self, layers: list[Layer]) -> None:
        """Show layers one by one, so that the interface is drawn and heard between them.

        A layer that is there under this name, of the same kind and size, takes the new values: napari needs 50 to 120
            ms
        of its own to add one.
        """
        if not layers:
            return
        new = layers.pop(0)
        old = next((layer for layer in self._viewer.layers if layer.name == new.name), None)
        if old is not None and type(old) is type(new) and old.ndim == new.ndim:
            old.data, old.metadata = new.data, new.metadata
        else:
            self._viewer.add_layer(new)
            distances = new.metadata.get("distances_mm", [])
            if not is_even(distances):
                follow(self._viewer, new, distances)
        QTimer.singleShot(0, lambda: self._show(layers))


class Reconstruct(Worker):
    """Reconstructs the selected raw frame with a camera that is open: a model, or point spread functions."""

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        """Make the settings."""
        self.camera = ComboBox(label="Camera", choices=lambda _: _cameras(napari_viewer), nullable=True)
        self.distances = LineEdit(
            label="Its distances (mm)",
            value="",
            tooltip="of a plain layer of point spread functions: near to far, with commas; empty for a single one",
        )
        self.scene = ComboBox(label="Scene", choices=["auto", "planes", "surface", "volume"], value="auto")
        self.quick = CheckBox(label="Quick: linear filters alone", value=False)
        self.device = LineEdit(label="Device", value="", tooltip="an index, a kind, or part of a name; empty: chosen")
        super().__init__(
            napari_viewer,
            "Reconstruct the selected layer",
            [self.camera, self.distances, self.scene, self.quick, self.device],
        )
        self._kept: tuple[Any, hadalens.Plan] | None = None
        for event in (napari_viewer.layers.events.inserted, napari_viewer.layers.events.removed):
            event.connect(lambda: self.camera.reset_choices())

    def work(self) -> Start:
        """Return the reconstruction of the selected layer."""
        layer = self._viewer.layers.selection.active
        if not isinstance(layer, Image) or layer is self.camera.value:
            raise ValueError("Select the layer with the raw frame.")
        if self.camera.value is None:
            raise ValueError("Open a camera first: a model file, or an image of its point spread function.")
        frame, channel_axis = frame_of(layer, self._viewer.dims.current_step)
        device, distances = self.device.value.strip(), numbers_of(self.distances.value)
        return functools.partial(
            self._reconstruct, layer.name, frame, channel_axis, self.camera.value, distances, self.options(), device
        )

    def options(self) -> dict[str, Any]:
        """Return what the settings mean for a :class:`hadalens.Plan`."""
        return {"scene": self.scene.value, "refine": 0 if self.quick.value else None}

    def _reconstruct(
        self,
        name: str,
        frame: Any,
        channel_axis: int | None,
        camera: Layer,
        distances: list[float],
        options: dict[str, Any],
        device: str,
        halt: threading.Event,
    ) -> Work:
        yield 0.0, "getting the camera ready"
        key = (camera, device, *distances, *options.values())
        if self._kept is None or self._kept[0] != key:
            context = hadalens.Context(device) if device else None
            self._kept = (key, hadalens.Plan(model_of(camera, context, distances), context=context, **options))
        job = self._kept[1].submit(frame, channel_axis=channel_axis)
        while not job.wait(POLL):
            if halt.is_set():
                job.cancel()
            yield job.progress, "reconstructing"
        return [] if halt.is_set() else result_layers(job.result(), name)


class LearnCamera(Worker):
    """Learns a camera from a folder of pairs, saves it, and opens it."""

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        """Make the settings."""
        self.folder = FileEdit(
            label="Folder of pairs", mode="d", tooltip="z100mm/raw/NAME.tif, z100mm/scene/NAME.tif, ..."
        )
        self.model = FileEdit(label="Model to write", mode="w", value="camera.model")
        super().__init__(napari_viewer, "Learn the camera", [self.folder, self.model])

    def work(self) -> Start:
        """Return the learning of the folder."""
        folder, model = Path(self.folder.value), Path(self.model.value)
        if not any(folder.glob("z*mm")):
            raise ValueError("Choose a folder that holds one folder per distance, such as z100mm.")
        if not model.name or model.is_dir():
            raise ValueError("Choose a file for the model.")
        return functools.partial(learn, folder, model)


class Halted(Exception):  # noqa: N818  it is no error
    """Somebody has cancelled."""


def learn(folder: Path, model: Path, halt: threading.Event) -> Work:
    """Learn a camera from a folder of pairs, write its model, and return that as layers."""
    told = (0.0, "looking at the pairs")

    def progress(what: str, done: int, total: int, _note: str | None) -> None:
        nonlocal told
        if halt.is_set():
            raise Halted
        told = (done / total if total else 0.0, what or told[1])

    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(hadalens.fit, folder, progress=progress)
        while wait([future], POLL).not_done:
            yield told
    try:
        future.result().save(model)
    except Halted:
        return []
    return read(str(model))


def numbers_of(text: str) -> list[float]:
    """Return the numbers of a text, with commas or spaces between."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise ValueError("Distances are numbers in millimetres, near to far, with commas between.") from None


def model_of(camera: Layer, context: hadalens.Context | None, distances: Sequence[float] = ()) -> hadalens.Model:
    """Return the model of a layer: of its file, or made from its point spread functions.

    Those of a plain image have the `distances` that are given; a single one may be without.
    """
    if "hadalens_model" in camera.metadata:
        return hadalens.Model.load(camera.metadata["hadalens_model"])
    psfs, axis = camera.metadata.get("light"), None
    if psfs is None:
        psfs, axis = np.asarray(camera.data), -1 if camera.rgb else None
    known = camera.metadata.get("distances_mm") or list(distances) or [0.0]
    return hadalens.Model.from_psf(psfs, known, context=context, channel_axis=axis)


def frame_of(layer: Image, step: tuple[int, ...]) -> tuple[Any, int | None]:
    """Return the raw frame of a layer and where its channels stand: the light itself where it is kept.

    Of a sequence, it is the frame that is shown.
    """
    data, channel_axis = layer.metadata.get("light"), None
    if data is None:
        data, channel_axis = np.asarray(layer.data), -1 if layer.rgb else None
    axes = 3 if channel_axis or "light" in layer.metadata or data.shape[-3:-2] == (3,) else 2
    while data.ndim > axes:
        data, step = data[min(step[0], len(data) - 1)], step[1:]
    return data, channel_axis


def follow(viewer: napari.Viewer, layer: Layer, distances: list[float]) -> None:
    """Write the distance of the shown plane over the picture, where the axis cannot tell it."""

    def show() -> None:
        depth = viewer.dims.current_step[-3] if viewer.dims.ndim > 2 else 0
        overlay = viewer.canvas.overlays.text if hasattr(viewer, "canvas") else viewer.text_overlay  # before napari 0.9
        overlay.visible = layer in viewer.layers and viewer.dims.ndisplay == 2
        overlay.text = f"{distances[min(depth, len(distances) - 1)]:g} mm"

    viewer.dims.events.current_step.connect(show)
    show()


def _cameras(viewer: napari.Viewer) -> list[Layer]:
    """Return the layers that may be a camera: those that are known to be first, then all other images."""
    known = [layer for layer in viewer.layers if {"hadalens_model", "hadalens_psf"} & layer.metadata.keys()]
    return known + [layer for layer in viewer.layers if isinstance(layer, Image) and layer not in known]


def _words(error: BaseException) -> str:
    return str(error) or type(error).__name__
