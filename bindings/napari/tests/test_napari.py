"""The plugin in a real viewer, on a screen in memory (Xvfb)."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import pytest
import tifffile
from hadalens.ome import OmeZarrWriter, is_even
from napari_hadalens import _layers, _reader, _sample, _widgets, _writer
from npe2 import PluginManifest
from qtpy.QtCore import QTimer

BLOCKED = 0.05  # seconds that the interface may be busy at a stretch
LAYERS = ["planes", "distances", "distances, surface", "all in focus"]


class Heart:
    """A timer of the interface, and the longest time that it was busy between two beats.

    Seconds are those of the processor in this thread: other programs do not count, and neither does waiting.
    """

    def __init__(self) -> None:
        """Begin to beat."""
        self.longest, self._last = 0.0, time.thread_time()
        self._timer = QTimer()
        self._timer.timeout.connect(self._beat)
        self._timer.start(1)

    def _beat(self) -> None:
        now = time.thread_time()
        self.longest, self._last = max(self.longest, now - self._last), now

    def stop(self) -> float:
        """Return the longest."""
        self._timer.stop()
        return self.longest


@pytest.fixture
def viewer(make_napari_viewer: Callable[..., Any]) -> Any:
    """Return a viewer with the sample's layers."""
    viewer = make_napari_viewer(show=bool(os.environ.get("SCREENSHOT")))
    camera, raw = viewer.open_sample("napari-hadalens", "small-camera")
    assert (camera.name, raw.name) == ("point spread functions", "raw frame")
    return viewer


def reconstruct(viewer: Any) -> Any:
    """Return the widget, set to the sample."""
    _, widget = viewer.window.add_plugin_dock_widget("napari-hadalens", "Reconstruct")
    viewer.layers.selection.active = viewer.layers["raw frame"]
    widget.camera.value = viewer.layers["point spread functions"]
    return widget


def test_manifest() -> None:
    """The manifest is valid, and what it names is there."""
    manifest = PluginManifest.from_distribution("napari-hadalens")
    manifest.validate_imports()


def test_reconstruct(viewer: Any, qtbot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sample's scene comes out, the interface is free meanwhile, and a second run fills the same layers."""
    widget = reconstruct(viewer)
    show, hearts, made = _widgets.Worker._show, [], []

    def stop(self: Any, layers: list[Any]) -> None:  # napari's own work of adding layers comes after this
        if hearts:
            assert hearts.pop().stop() < BLOCKED
            made.append(layers)
        show(self, layers)

    monkeypatch.setattr(_widgets.Worker, "_show", stop)
    for _ in range(2):
        qtbot.wait(300)  # what the widget's own appearance takes
        hearts.append(Heart())
        viewer.layers.selection.active = viewer.layers["raw frame"]
        widget.start.native.click()
        assert not widget.start.enabled
        qtbot.waitUntil(lambda: widget.message.value == "done", timeout=60000)
        qtbot.waitUntil(lambda: not made[-1], timeout=60000)
        assert [layer.name for layer in viewer.layers[2:]] == [f"raw frame: {name}" for name in LAYERS]
    planes = viewer.layers["raw frame: planes"]
    assert tuple(planes.scale) == (100, 1, 1)
    assert tuple(planes.translate) == (100, 0, 0)
    picture = viewer.layers["raw frame: all in focus"].metadata["light"]
    top, left = 30, 50  # of the sample's window
    red, green, blue = picture[:, top + 12, left + 12], picture[:, top + 44, left + 44], picture[:, top + 16, left + 44]
    assert (np.argmax(red), np.argmax(green), np.argmax(blue)) == (0, 1, 2)
    if file := os.environ.get("SCREENSHOT"):
        viewer.dims.ndisplay = 2
        viewer.dims.set_current_step(0, 1)
        qtbot.wait(500)
        viewer.screenshot(file, canvas_only=False, flash=False)


def test_cancel(viewer: Any, qtbot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long reconstruction ends within a second of Cancel, and leaves no layer."""
    widget = reconstruct(viewer)
    monkeypatch.setattr(_widgets.Reconstruct, "options", lambda _: {"scene": "planes", "refine": 1_000_000})
    ended = []
    widget.start.native.click()
    worker = widget._worker
    worker.finished.connect(lambda: ended.append(time.process_time()))
    qtbot.waitUntil(lambda: widget.message.value == "reconstructing", timeout=60000)
    qtbot.wait(200)
    began = time.process_time()  # of all threads: by the clock, other programs may be at work meanwhile
    widget.cancel.native.click()
    assert widget.message.value == "cancelled"
    assert widget.start.enabled
    qtbot.waitUntil(lambda: bool(ended), timeout=60000)
    assert ended[0] - began < (os.cpu_count() or 1)
    assert len(viewer.layers) == 2


def test_what_is_missing_is_said(viewer: Any, qtbot: Any) -> None:
    """Nothing selected, no camera, a frame that does not fit."""
    widget = reconstruct(viewer)
    viewer.layers.selection.clear()
    widget.start.native.click()
    assert "Select the layer" in widget.message.value
    viewer.layers.selection.active = viewer.layers["raw frame"]
    widget.camera.value = None
    widget.start.native.click()
    assert "Open a camera" in widget.message.value
    widget.camera.value = viewer.layers["point spread functions"]
    viewer.layers.selection.active = viewer.add_image(np.zeros((50, 50), np.float32))
    with qtbot.captureExceptions():
        widget.start.native.click()
        qtbot.waitUntil(lambda: widget.start.enabled, timeout=60000)
    assert "50" in widget.message.value


def test_learn(viewer: Any, qtbot: Any, tmp_path: Path) -> None:
    """A camera learned from a folder is written and opened, and reconstructs."""
    data = tmp_path / "pairs"
    camera = hadalens.Camera("sim300", window_rows=60, window_cols=60)
    camera.set_depths(100, 600, 3)
    hadalens.simulate(camera, data, pairs=3)
    _, widget = viewer.window.add_plugin_dock_widget("napari-hadalens", "Learn a camera")
    widget.folder.value, widget.model.value = tmp_path, tmp_path / "small.model"
    widget.start.native.click()
    assert "one folder per distance" in widget.message.value
    widget.folder.value = data
    widget.start.native.click()
    qtbot.waitUntil(lambda: len(viewer.layers) == 3, timeout=120000)
    assert hadalens.Model.load(tmp_path / "small.model").info.depths == 3
    assert viewer.layers[-1].metadata["hadalens_model"] == str(tmp_path / "small.model")


def test_frames_of_layers() -> None:
    """Grey, colour, planar, and sequences, of which the shown frame is taken."""
    from napari.layers import Image

    grey, colour = np.zeros((6, 8), np.float32), np.zeros((6, 8, 3), np.float32)
    film = np.arange(4, dtype=np.float32).reshape(4, 1, 1) * np.ones((1, 6, 8), np.float32)
    assert _widgets.frame_of(Image(grey), (0, 0))[0].shape == (6, 8)
    frame, axis = _widgets.frame_of(Image(colour, rgb=True), (0, 0))
    assert (frame.shape, axis) == ((6, 8, 3), -1)
    assert _widgets.frame_of(Image(np.zeros((3, 6, 8))), (0, 0, 0))[0].shape == (3, 6, 8)
    assert _widgets.frame_of(Image(film), (2, 0, 0))[0].mean() == 2


def test_uneven_distances() -> None:
    """The axis counts depths then and says which; the surface stands among them."""
    distances = [100.0, 130.0, 220.0]
    data, options, _ = _layers.stack_layer(np.zeros((3, 3, 4, 5), np.float32), distances, "x")
    assert data.shape == (3, 4, 5, 3)
    assert options["scale"] == (1, 1, 1)
    assert options["axis_labels"][0] == "depth: 0 = 100 mm, 1 = 130 mm, 2 = 220 mm"
    where = np.full((4, 5), 175, np.float32)
    where[0, 0] = np.nan
    surface = _layers.surface_of(where, distances)
    assert surface is not None
    vertices, faces, values = surface
    assert np.all(vertices[:, 0] == 1.5)
    assert len(faces) == 2 * 3 * 4 - 1
    assert np.all(values == 175)
    assert _layers.surface_of(np.full((4, 5), np.nan, np.float32), distances) is None


def test_files(viewer: Any, tmp_path: Path) -> None:
    """Models and what the command line writes are opened; other files are left to others."""
    camera = viewer.layers["point spread functions"]
    model = hadalens.Model.from_psf(camera.metadata["light"], camera.metadata["distances_mm"])
    model.save(tmp_path / "small.model")
    (layer,) = viewer.open(tmp_path / "small.model", plugin="napari-hadalens")
    assert layer.name == "small: point spread functions"
    assert is_even(layer.metadata["distances_mm"])
    made = _widgets.model_of(layer, None)
    assert made.info.window_rows == model.info.window_rows
    text = "Hadalens=0.1.0\nchannels=3\ndistances_mm=100,200,300\nvalue_scale=1\nfull_scale=65535\n"
    stack = np.linspace(0, 65535, 9 * 20, dtype=np.uint16).reshape(9, 4, 5)
    tifffile.imwrite(tmp_path / "a_stack.tif", stack, description=text, metadata=None, photometric="minisblack")
    where = np.full((4, 5), 150, np.float32)
    tifffile.imwrite(tmp_path / "a_depth.tif", where, description="Hadalens=0.1.0\n", metadata=None)
    planes, *maps = viewer.open([tmp_path / "a_stack.tif", tmp_path / "a_depth.tif"], plugin="napari-hadalens")
    assert planes.metadata["light"].shape == (3, 3, 4, 5)
    assert planes.metadata["light"].max() == 1
    assert maps[0].contrast_limits == [100, 300]
    assert np.all(maps[1].data[0][:, 0] == 150)
    tifffile.imwrite(tmp_path / "b_stack.tif", where)
    assert _reader.get_reader(str(tmp_path / "b_stack.tif")) is None
    assert _reader.get_reader(str(tmp_path / "none.model")) is None


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[hadalens.Result]]:
    """Return a folder with a sequence as ``hadalens reconstruct`` writes it, and its results."""
    folder = tmp_path_factory.mktemp("film")
    (psf, options, _), (_, raw, _) = _sample.small_camera()
    model = hadalens.Model.from_psf(options["metadata"]["light"], options["metadata"]["distances_mm"])
    assert psf.shape[0] == 3
    plan = hadalens.Plan(model, refine=0)
    frames = [raw["metadata"]["light"] * np.float32(1 + i) for i in range(3)]
    hadalens.write_tiff(folder / "film.tif", np.stack(frames))
    hadalens.reconstruct_files(plan, [folder / "film.tif"], folder, preview=False)
    return folder, list(plan.map(frames))


def test_sequences(film: tuple[Path, list[hadalens.Result]]) -> None:
    """Every frame of the files of a sequence is there, not the first alone."""
    folder, results = film
    (_, planes, _), *maps = _reader.read([str(folder / "film_stack.tif"), str(folder / "film_depth.tif")])
    ((_, picture, _),) = _reader.read(str(folder / "film_aif.tif"))
    np.testing.assert_allclose(planes["metadata"]["light"], [result.stack for result in results], rtol=1e-6)
    np.testing.assert_allclose(picture["metadata"]["light"], [result.all_in_focus for result in results], rtol=1e-6)
    np.testing.assert_array_equal(maps[0][0], [result.distance_map for result in results])
    assert planes["scale"] == (1, 100, 1, 1)
    assert planes["axis_labels"][0] == "frame"
    assert [kind for _, _, kind in maps] == ["image"]


@pytest.mark.parametrize("count", [1, 3])
def test_ome_zarr(count: int, film: tuple[Path, list[hadalens.Result]], viewer: Any, tmp_path: Path) -> None:
    """OME-Zarr of Hadalens is opened, written from the layers, and the same again; other folders are left to others."""
    pytest.importorskip("zarr")
    with OmeZarrWriter(tmp_path / "film.zarr") as writer:
        for result in film[1][:count]:
            writer.append(result)
    viewer.open(tmp_path / "film.zarr", plugin="napari-hadalens")
    made = [layer for layer in viewer.layers if layer.name.startswith("film")]
    light = made[0].metadata["light"]
    np.testing.assert_array_equal(light.reshape(count, *film[1][0].stack.shape), [r.stack for r in film[1][:count]])
    viewer.layers.selection = set(made)
    assert viewer.layers.save(str(tmp_path / "again.zarr"), selected=True, plugin="napari-hadalens")
    for before, after in zip(*(_reader.read(str(tmp_path / f"{one}.zarr")) for one in ("film", "again")), strict=True):
        np.testing.assert_array_equal(before[0] if before[2] == "image" else 0, after[0] if after[2] == "image" else 0)
    planes = [made[0].as_layer_data_tuple()]
    _writer.write(str(tmp_path / "planes.zarr"), planes)
    ((_, options, _), *_) = _reader.read(str(tmp_path / "planes.zarr"))
    np.testing.assert_array_equal(options["metadata"]["light"], light)
    with pytest.raises(ValueError, match="there are 0"):
        _writer.write(str(tmp_path / "none.zarr"), [])
    assert _reader.get_reader(str(tmp_path)) is None


def test_a_plain_layer_can_be_a_camera(viewer: Any, qtbot: Any) -> None:
    """An image of a point spread function, of one depth or of several whose distances are typed."""
    psf = viewer.layers["point spread functions"].metadata["light"]
    for data, rgb, distances in (
        (psf[0, 0], False, ""),
        (np.moveaxis(psf[0], 0, -1), True, "250"),
        (psf[:, 0], False, "1, 2, 3"),
    ):
        layer = viewer.add_image(data, rgb=rgb, name="mine")
        widget = reconstruct(viewer)
        assert layer in widget.camera.choices
        widget.camera.value, widget.distances.value = layer, distances
        assert hadalens.Plan(_widgets.model_of(layer, None, _widgets.numbers_of(distances))).stack_shape[0] in (1, 3)
        viewer.layers.remove(layer)
    with pytest.raises(ValueError, match="numbers"):
        _widgets.numbers_of("near, far")
    single = viewer.add_image(psf[0].max(0), name="single")
    widget = reconstruct(viewer)
    viewer.layers.selection.active = viewer.add_image(viewer.layers["raw frame"].metadata["light"].mean(0), name="grey")
    widget.camera.value, widget.distances.value = single, ""
    widget.start.native.click()
    qtbot.waitUntil(lambda: widget.message.value == "done", timeout=60000)
    qtbot.waitUntil(lambda: "grey: all in focus" in viewer.layers, timeout=60000)
