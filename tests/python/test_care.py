"""What people get wrong gives no wrong result, no crash and no riddle."""

from __future__ import annotations

import copy as copying
import errno
import inspect
import itertools
import json
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
from hadalens._camera import CameraMembers
from hadalens._fit import FitOptions, fit_options
from hadalens._native import ffi, spoken
from hadalens._plan_options import PlanOptions
from hadalens._trainer import TrainOptions
from hadalens.ome import OmeZarrWriter

Array = npt.NDArray[Any]
NOTEBOOKS = sorted((Path(__file__).parents[2] / "docs/python/notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def linear(model: hadalens.Model) -> hadalens.Plan:
    """Return a plan that is quick."""
    return hadalens.Plan(model, refine=0)


# one buffer for many frames -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["f4", "u2"])
def test_map_may_be_given_one_buffer_again_and_again(dtype: str, linear: hadalens.Plan, raw: Array) -> None:
    """Cameras fill one buffer; every frame is right all the same."""
    scale = 1.0 if dtype == "f4" else 1000.0
    frames = [(raw * scale * (1 + i)).astype(dtype) for i in range(20)]
    buffer = np.empty_like(frames[0])

    def filled() -> Iterator[Array]:
        for frame in frames:
            buffer[:] = frame
            yield buffer

    for result, frame in zip(linear.map(filled()), frames, strict=True):
        np.testing.assert_array_equal(result.stack, linear.run(frame).stack)


def test_two_jobs_do_not_fill_one_array(model: hadalens.Model, raw: Array) -> None:
    """The second is refused while the first is at work, also for a part of the array; after that it is fine."""
    plan = hadalens.Plan(model, classic=hadalens.Classic("admm", iterations=10**7))
    planes = plan.stack_shape[0]
    room = np.zeros((planes + 1, *plan.stack_shape[1:]), np.float32)
    first = plan.submit(raw, room[:planes])
    with pytest.raises(hadalens.StateError, match="filled by another job"):
        plan.submit(raw, room[1:])
    with pytest.raises(hadalens.StateError, match="filled by another job"):
        hadalens.Plan(model, refine=0).run(raw, room[:planes])
    first.cancel()
    first.wait()
    hadalens.Plan(model, refine=0).run(raw, room[:planes])
    assert room[:planes].any()


# pickles from elsewhere -----------------------------------------------------------------------------------------------


def test_cameras_are_pickled_member_by_member() -> None:
    """All bits come back; what is no camera is refused, not copied into memory."""
    camera = hadalens.Camera("paper2022", rows=1000, pixel_pitch_mm=0.0034567890123456789)
    camera.set_depths(100, 600, 3)
    for copy in (pickle.loads(pickle.dumps(camera)), copying.deepcopy(camera)):
        assert bytes(ffi.buffer(copy._c)) == bytes(ffi.buffer(camera._c))
    with pytest.raises((AttributeError, TypeError)):
        hadalens.Camera.__new__(hadalens.Camera).__setstate__(b"\xff" * 100_000)  # type: ignore[attr-defined]
    restore, (kind, members) = camera.__reduce__()
    for wrong in ({"rows": "many"}, {"distances_mm": (1.0,) * 10_000}, {"mask": "fog"}, {"nothing": 1}):
        with pytest.raises((hadalens.ArgumentError, TypeError, AttributeError)):
            restore(kind, members | wrong)


# values that mean nothing ---------------------------------------------------------------------------------------------


WRONG = """refine=-1 refine=-2 refine_tv=-1 refine_tv=-2 refine_colour=-1 refine_ridge=-1 crosstalk=-1 batch=-1
queues=-1 dark=-1 dark=2 dark=nan gamma=nan max_error=-0.5"""


@pytest.mark.parametrize("option", WRONG.split())
def test_options_below_zero_and_nan_are_refused(option: str, model: hadalens.Model) -> None:
    """In C, -1 stands for "automatic", -2 for "found from the frame": here None and words do."""
    name, _, value = option.partition("=")
    given: Any = {name: int(value) if value.lstrip("-").isdigit() else float(value)}
    with pytest.raises(hadalens.ArgumentError, match=name):
        hadalens.Plan(model, **given)


def test_first_mistakes_are_named(
    model: hadalens.Model, linear: hadalens.Plan, camera: Path, frames: list[Path], raw: Array, tmp_path: Path
) -> None:
    """What people try first works, or the error says what is needed."""
    wrong: Any = hadalens
    fit, psf, scene, nan = wrong.fit, np.eye(24, dtype=np.float32), np.ones((48, 48)), float("nan")
    stacks, mask, levels = (np.stack([raw] * 4), np.stack([scene] * 4)), raw > raw.mean(), (raw * 99).astype(np.int16)
    file, argument, planes = tmp_path / "a", hadalens.ArgumentError, np.ones((2, 9, 9))
    from_psf = wrong.Model.from_psf
    file.write_text("no folder")
    works: list[tuple[type[Exception], str, Callable[[], Any]]] = [
        (argument, "dark", lambda: fit(camera, dark=-1.0)),
        (argument, "dark", lambda: fit(camera, dark=nan)),
        (argument, "dark", lambda: from_psf([psf], [100.0], dark=nan)),
        (argument, "regularisation", lambda: fit(camera, regularisation=-1.0)),
        (argument, "steps", lambda: hadalens.Trainer(model, camera, steps=-1)),
        (argument, "gamma", lambda: hadalens.save_png(tmp_path / "no.png", scene, gamma=-1)),
        (argument, "masked", lambda: linear.run(np.ma.masked_array(raw, mask))),
        (argument, "down to -3", lambda: linear.run(np.maximum(levels, 0) - np.int16(3))),
        (TypeError, r"such as \{250.0: pairs\}", lambda: fit([(raw, scene)])),
        (TypeError, r"list\(zip\(raws, scenes\)\)", lambda: fit({100.0: stacks})),
        (TypeError, "'z100mm' is no distance", lambda: fit({"z100mm": [(raw, scene)]})),
        (hadalens.DatasetError, "six digits", lambda: fit({100.0: [], 100.0000001: []})),
        (TypeError, "dark_frame", lambda: fit({100.0: [(raw, scene)]}, dark=raw)),
        (argument, "folders say theirs", lambda: fit(camera, full_scale=4095)),
        (TypeError, "full_scale='4095'", lambda: linear.run(raw, full_scale="4095")),  # type: ignore[arg-type]
        (TypeError, "window=8", lambda: from_psf(psf, 100.0, window=8)),
        (argument, "ascend", lambda: from_psf(psf, -2.0)),
        (argument, "ascend", lambda: hadalens.write_tiff(tmp_path / "b", planes[:, None], distances_mm=[2.0, 1.0])),
        (hadalens.SizeError, "competing", lambda: hadalens.focus_stack(planes, [1.0, 2.0], competing=[True])),
        (argument, "for each of 4", lambda: hadalens.Plan(model, depths=[False, True])),
        (TypeError, "refine=True", lambda: hadalens.Plan(model, refine=True)),
        (TypeError, "dark=True", lambda: hadalens.Plan(model, dark=True)),
        (TypeError, "'gpu' or '0'", lambda: wrong.Plan(model, context=0)),
        (TypeError, "channel_axis=0.0", lambda: wrong.metrics.mse(raw, raw, channel_axis=0.0)),
        (argument, "NUL", lambda: hadalens.read_tiff(f"{frames[0]}\0.tif")),
        (argument, "sigma", lambda: hadalens.add_noise(scene, nan)),
        (argument, "timeout", lambda: linear.submit(raw).wait(nan)),
        (argument, "magnification", lambda: hadalens.Registration(magnification=0).size(4, 4)),
        (TypeError, r"Plan\.emitters", lambda: wrong.track_emitters([np.zeros(3)])),
        (argument, "'auto' is no response", lambda: hadalens.response.convert(raw, "auto", "linear")),
        (FileExistsError, "no folder", lambda: OmeZarrWriter(file, overwrite=True)),
    ]
    for kind, words, work in works:
        with pytest.raises(kind, match=words):
            work()
    assert list(tmp_path.iterdir()) == [file]
    expected = linear.run(raw).stack
    np.testing.assert_array_equal(linear.run(np.ma.masked_array(raw, False)).stack, expected)
    plan = hadalens.Plan(model, refine=np.int64(0), dark=np.float32(0.125), gamma=np.float64(1))  # type: ignore[arg-type]
    np.testing.assert_array_equal(plan.run(raw).stack, hadalens.Plan(model, refine=0, dark=0.125).run(raw).stack)
    some = hadalens.Plan(model, occupied=mask[0, 0, :4] | True, pixel_weights=~mask).run(raw)
    assert some.report.occupied == (True,) * 4
    assert hadalens.Plan(model, depths=[False, True, True, False]).stack_shape[0] == 2
    assert from_psf(psf, 100.0, window=np.array((8, 9))).info.window_cols == 9
    assert wrong.Dataset({100.0: zip([raw], [scene], strict=True)}).counts == (1,)
    assert hadalens.reconstruct_files(linear, frames[0], tmp_path, preview=False)[0].error is None


# shapes ---------------------------------------------------------------------------------------------------------------


def test_one_psf_will_do() -> None:
    """One measured PSF, grey or colour, with its distance: what most people have."""
    spot = np.zeros((24, 32), np.float32)
    spot[10:14, 12:20] = np.arange(32).reshape(4, 8)
    colour = np.stack([spot, spot / 2, spot / 3])
    for psf, channels, axis in ((spot, 1, None), (colour, 3, None), (np.moveaxis(colour, 0, -1), 3, -1)):
        expected = hadalens.Model.from_psf([psf], [250.0], channel_axis=axis)
        assert (expected.info.channels, expected.info.raw_cols) == (channels, 32)
        for distance in (250, 250.0, [250.0], np.array([250.0])):
            model = hadalens.Model.from_psf(psf, distance, channel_axis=axis)
            np.testing.assert_array_equal(model.otf, expected.otf)
    assert hadalens.Model.from_psf(colour, [100.0, 200.0, 300.0]).info.depths == 3  # three grey ones
    assert hadalens.Model.from_psf(spot[None], 250.0).info.channels == 1
    with pytest.raises(hadalens.SizeError, match="channel_axis=-1"):
        hadalens.Model.from_psf(np.moveaxis(colour, 0, -1), 250.0)


def test_channels_last_are_recognised(linear: hadalens.Plan, raw: Array, camera: Path, tmp_path: Path) -> None:
    """The commonest slip: the error says what to give."""
    last = np.moveaxis(raw, 0, -1)
    scene = hadalens.Dataset.scan(camera).read(0, 0)[1]
    simulator = hadalens.Simulator(hadalens.Camera.load(camera / "camera.json"))
    for work in (
        lambda: linear.run(last),
        lambda: list(linear.map([last])),
        lambda: linear.match(last),
        lambda: hadalens.metrics.psnr(last, last / 2),
        lambda: hadalens.metrics.sharpness(last),
        lambda: hadalens.save_png(tmp_path / "a.png", last),
        lambda: hadalens.write_tiff(tmp_path / "a.tif", last),
        lambda: hadalens.fit({100.0: [(last, last)] * 3}),
        lambda: hadalens.resize(last, 10, 10),
        lambda: simulator.render({0: np.moveaxis(scene, 0, -1)}),
        lambda: hadalens.Plan(linear.model, dark=last),
    ):
        with pytest.raises(hadalens.SizeError, match=r"last.*channel_axis=-1"):
            work()


def test_channel_axis_everywhere(raw: Array, camera: Path, tmp_path: Path) -> None:
    """Metrics, pictures, files and scenes take channels where they stand."""
    last, dim = np.moveaxis(raw, 0, -1), np.moveaxis(raw / 2, 0, -1)
    metrics = hadalens.metrics
    for metric in (metrics.mse, metrics.mae, metrics.psnr, metrics.ssim, metrics.authors_psnr, metrics.authors_ssim):
        assert metric(last, dim, channel_axis=-1) == metric(raw, raw / 2)
    assert metrics.sharpness(last, channel_axis=-1) == metrics.sharpness(raw)
    first = hadalens.save_png(tmp_path / "a.png", raw).read_bytes()
    assert hadalens.save_png(tmp_path / "b.png", last, channel_axis=-1).read_bytes() == first
    np.testing.assert_array_equal(
        hadalens.read_tiff(hadalens.write_tiff(tmp_path / "a.tif", last, channel_axis=-1), 0), raw
    )
    works: list[Callable[..., Array]] = [
        lambda image, **axis: hadalens.resize(image, 10, 10, **axis),
        lambda image, **axis: hadalens.fit_scene(image, 10, 10, **axis),
        lambda image, **axis: hadalens.crop(image, 1, 2, 10, 10, **axis),
        lambda image, **axis: hadalens.add_noise(image, 0.1, **axis),
        lambda image, **axis: hadalens.focus_stack([image, image], [100.0, 200.0], **axis)[0],
        lambda image, **axis: hadalens.Registration().apply(image, **axis),
    ]
    for work in works:
        np.testing.assert_array_equal(work(last, channel_axis=-1), work(raw))
    data = hadalens.Dataset.scan(camera)
    pairs = [data.read(0, pair) for pair in range(3)]
    turned = [[np.moveaxis(image, 0, -1) for image in images] for images in zip(*pairs, strict=True)]
    assert hadalens.register(*turned, channel_axis=-1) == hadalens.register(*zip(*pairs, strict=True))


# names and strings ----------------------------------------------------------------------------------------------------


def test_keywords_that_are_none_are_named(model: hadalens.Model, camera: Path, tmp_path: Path) -> None:
    """The error names the keyword, what it may be meant for, and what there is."""
    works: list[tuple[str, str, Callable[[dict[str, Any]], Any]]] = [
        ("step", "steps", lambda given: hadalens.Trainer(model, camera, **given)),
        ("step", "steps", lambda given: hadalens.train(camera, tmp_path / "a.model", model=model, **given)),
        ("regularization", "regularisation", lambda given: hadalens.Fitter([100.0], (8, 8), **given)),
        ("refin", "refine", lambda given: hadalens.Plan.estimate(model, **given)),
        ("refin", "refine", lambda given: hadalens.Plan(model, **given)),
        ("regularization", "regularisation", lambda given: hadalens.fit(camera, **given)),
        ("distance", "distances_mm", lambda given: hadalens.Model.from_psf(psfs=None, **given)),
        ("pair", "pairs", lambda given: hadalens.simulate("sim300", tmp_path, **given)),
        ("devise", "device", lambda given: hadalens.Context(**given)),
        ("row", "rows", lambda given: hadalens.Camera(**given)),
    ]
    for wrong, right, work in works:
        with pytest.raises(TypeError, match=f"'{wrong}'.*'{right}' meant.*there are "):
            work({wrong: 1})
    with pytest.raises(AttributeError, match="'rows' meant"):
        hadalens.Camera().row = 3
    for values in ({"refine": "many"}, {"refine": 2.5}, {"gamma": "bright"}, {"depths": 1}, {"occupied": np.int64(2)}):
        with pytest.raises(TypeError, match=f"{next(iter(values))}="):
            hadalens.Plan(model, **values)


def test_strings_stand_for_objects(model_file: Path, camera: Path, raw: Array, tmp_path: Path) -> None:
    """A model's file, a device's name and a camera's preset will do; what will not is a clear TypeError."""
    model = hadalens.Model.load(model_file)
    expected = hadalens.Plan(model, refine=0).run(raw).stack
    for given in (str(model_file), model_file):
        np.testing.assert_array_equal(hadalens.Plan(given, context="cpu", refine=0).run(raw).stack, expected)
        assert hadalens.Plan.estimate(given, context="0") == hadalens.Plan.estimate(model)
    hadalens.train(camera, tmp_path / "b.model", model=str(model_file), context="cpu", stage="filters", steps=1)
    assert hadalens.Trainer(model_file, camera, stage="filters", steps=1).steps == 1
    assert hadalens.Simulator("sim300").camera.rows == 300
    assert hadalens.register_dataset(str(camera))
    with pytest.raises(hadalens.DeviceChoiceError):
        hadalens.Plan(model, context="no such device")
    wrong: Any
    for wrong in (3, model):
        with pytest.raises(TypeError, match=r"hadalens.Context"):
            hadalens.Plan(model, context=wrong)
    for wrong in (None, raw, camera):
        with pytest.raises((TypeError, hadalens.FileError), match=r"hadalens.Model|ordinary file"):
            hadalens.Plan(wrong)
    with pytest.raises(TypeError, match=r"hadalens.Plan"):
        hadalens.reconstruct_files(str(model_file), [], tmp_path)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="read_tiff"):
        hadalens.Plan(model).run("frame.tif")


def test_files_that_are_missing_are_found_missing(tmp_path: Path) -> None:
    """What Python programs catch: FileNotFoundError with errno, also over the borders of processes."""
    for work in (hadalens.Model.load, hadalens.fit, hadalens.Plan, hadalens.read_tiff, hadalens.Camera.load):
        with pytest.raises(FileNotFoundError) as caught:
            work(tmp_path / "none")
        assert isinstance(caught.value, hadalens.FileMissingError)
        for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
            assert error.errno == errno.ENOENT
            assert "none" in str(error)
    with pytest.raises(hadalens.FileWriteError) as denied:
        hadalens.Camera().save(tmp_path / "no folder" / "camera.json")
    assert denied.value.errno == errno.ENOENT


@pytest.mark.parametrize(
    ("told", "here"),
    [
        ("compute fewer depths (options.depths), or use linear filters (options.refine 0)", ["(depths)", "refine=0"]),
        ("leave it out (options.enhance 0), or use another device", ["enhance=False"]),
        ("leave options.classic out, or take options.scene planes", ["classic", "scene='planes'"]),
        ("leave options.mosaic out, or make it with fit options.mosaic", ["leave mosaic out", "fit(mosaic=...)"]),
        ("such as options.mosaic rggb", ["mosaic='rggb'"]),
        ("bin it with options.downsample 4", ["downsample=4"]),
        ("fit (from a PSF: fit --psf PSF --frame FRAME)", ["Model.from_psf"]),
        ("go on with it (options.resume), or try options.at_once 1", ["(resume)", "at_once=1"]),
        ("more than the limits allow (options.limits pixels=N)", ["set_limits('pixels=N')"]),
        ("and skip made of HADA_SKIP_...", ["the words of skip"]),
    ],
)
def test_messages_speak_python(told: str, here: list[str]) -> None:
    """What the library calls by its name on the command line is called by its name here."""
    assert all(word in spoken(told) for word in here)
    assert not any(word in spoken(told) for word in ("--", "options.", "HADA_"))


def test_a_message_on_its_way_is_translated(linear: hadalens.Plan, raw: Array) -> None:
    """The whole way."""
    with pytest.raises(hadalens.ModelError, match=r"Model.from_psf") as caught:
        linear.run(raw[:, :-1])
    assert "--" not in str(caught.value)
    with pytest.raises(hadalens.ArgumentError, match="the words of skip"):
        hadalens.Plan(linear.model, max_error=2)


# learning from nothing ------------------------------------------------------------------------------------------------


def pairs_of(kind: str) -> list[tuple[Array, Array]]:
    """Return pairs that nothing can be learned from."""
    random = np.random.default_rng(5)

    def noise() -> Array:
        return random.random((48, 48)).astype(np.float32)

    flat = {"black": 0.0, "grey": 0.25, "nan": np.nan}
    frames = [noise() if kind in ("noise", "dark scenes") else np.full((48, 48), flat[kind]) for _ in range(4)]
    return [(frame, np.zeros((48, 48)) if kind == "dark scenes" else noise()) for frame in frames]


@pytest.mark.parametrize("kind", ["noise", "black", "grey", "dark scenes", "nan"])
@pytest.mark.parametrize("way", ["fit", "fitter"])
def test_useless_pairs_are_told(kind: str, way: str, caplog: pytest.LogCaptureFixture) -> None:
    """Noise makes a model with a warning; black frames, frames of one brightness and NaN make none."""
    pairs = pairs_of(kind)

    def learn() -> hadalens.Model:
        if way == "fit":
            return hadalens.fit({100.0: pairs}, boundary="circular")
        fitter = hadalens.Fitter([100.0], (48, 48))
        for raw, scene in pairs:
            fitter.add(0, raw, scene)
        return fitter.finish(show=lambda _, pair: pairs[pair])

    if kind == "noise":
        assert learn().info.depths == 1
        assert "of no use" in caplog.text
    else:
        with pytest.raises(
            hadalens.NotFiniteError if kind == "nan" else hadalens.DatasetError, match=r"NaN|brightness"
        ):
            learn()


def test_useful_pairs_are_not_warned_of(camera: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A fitter is silent about a camera that works."""
    data = hadalens.Dataset.scan(camera)
    fitter = hadalens.Fitter(data.distances_mm, (96, 128), window=(48, 48), channels=3, boundary="padded")
    for depth, count in enumerate(data.counts):
        for pair in range(count):
            fitter.add(depth, *data.read(depth, pair))
    fitter.finish(show=data.read)
    assert "of no use" not in caplog.text


# what is seen at the prompt -------------------------------------------------------------------------------------------


def test_members_are_real(model: hadalens.Model, camera: Path) -> None:
    """Completion and type checkers see the members of a camera; all of hada_camera can be read and set."""
    design = hadalens.Camera("sim300", lenses=30)
    there = {"lens_count": "lenses", "material_index": "refractive_index"}
    names = {name for name, _ in ffi.typeof("hada_camera").fields} - {"size"}
    assert {there.get(name, name) for name in dir(design)} >= names
    assert set(CameraMembers.__annotations__) == names
    assert (design.lens_count, design.material_index) == (30, design._c.refractive_index)
    for name in names - {"distances_mm", "depths"}:
        mine = next((here for here, theirs in there.items() if theirs == name), name)
        setattr(design, mine, getattr(design, mine))
    design.distances_mm = [100, 250.5]
    assert (design.depths, design.distances_mm) == (2, (100.0, 250.5))
    with pytest.raises(TypeError, match="rows="):
        design.rows = 2.5  # type: ignore[assignment]
    struct = {name for name, _ in ffi.typeof("hada_train_options").fields}
    assert struct - set(TrainOptions.__annotations__) == {
        "size",
        "stage",
        "net",
        "net_given",
        "augment",
        "communicator",
    }
    assert set(PlanOptions.__annotations__) == set(inspect.signature(hadalens.Plan).parameters) - {"model", "context"}
    chosen = set(inspect.signature(fit_options).parameters) - {"window", "others"}
    assert set(FitOptions.__annotations__) == chosen
    assert {"steps", "done", "validate"} <= set(dir(hadalens.Trainer(model, camera, stage="filters", steps=1)))


def test_private_names_do_not_leak() -> None:
    """`dir` lists what is for users."""
    for module in (hadalens, hadalens.metrics, hadalens.optics, hadalens.response):
        names = [name for name in dir(module) if not name.startswith("__")]
        assert not [
            name for name in names if name.startswith("_") or name in ("lib", "ffi", "np", "call", "text", "Any")
        ]
        assert not [name for name in names if name not in module.__all__]


def test_reprs_are_short(
    model: hadalens.Model, plan: hadalens.Plan, raw: Array, camera: Path, frames: list[Path]
) -> None:
    """One line says what it is."""
    result, learned, model = plan.run(raw), hadalens.fit(camera), plan.model
    things = {
        "Result": (result, "4 depths"),
        "Report": (result.report, "model"),
        "FitReport": (learned.fit_report, "dB"),
        "Model": (model, "96 x 128"),
        "Plan": (plan, "4 x 3 x 48 x 48"),
        "Context": (hadalens.Context.default(), ""),
        "Dataset": (hadalens.Dataset.scan(camera), "12 pairs"),
        "Fitter": (hadalens.Fitter([100.0], (8, 8)), "0 pairs"),
        "Trainer": (hadalens.Trainer(model, camera, stage="filters", steps=7), "of 7"),
        "Net": (hadalens.Net.unet("4|4", "4"), "3 to 3 channels"),
        "TiffReader": (hadalens.TiffReader(frames[0]), "1 frames"),
        "Job": (plan.submit(raw), "%"),
        "Simulator": (hadalens.Simulator("sim300"), "300"),
        "OpticsReport": (hadalens.optics.report(hadalens.Camera.load(camera / "camera.json")), "4 depths"),
    }
    for name, (thing, part) in things.items():
        shown = repr(thing)
        assert shown.startswith(f"<{name}")
        assert part in shown
        assert len(shown) < 300
        assert "\n" not in shown
    with hadalens.Plan(model) as closed:
        pass
    assert repr(closed) == "<Plan: closed>"


def test_notebooks_show_pictures_and_tables(plan: hadalens.Plan, raw: Array, camera: Path) -> None:
    """Results are pictures, models and reports tables."""
    result, learned = plan.run(raw), hadalens.fit(camera)
    if hadalens.pictures_available():
        assert (result._repr_png_() or b"").startswith(b"\x89PNG")
    optics = hadalens.optics.report(hadalens.Camera.load(camera / "camera.json"))
    assert learned.fit_report is not None
    for thing, part in (
        (plan.model, "refine steps"),
        (result.report, "occupied"),
        (learned.fit_report, "FilterScore"),
        (optics, "lateral mm"),
    ):
        shown = thing._repr_html_()
        assert shown.startswith("<table>")
        assert part in shown
        assert "&lt;" in shown


# what is not installed ------------------------------------------------------------------------------------------------

WITHOUT = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        root = name.partition(".")[0]
        if {}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Without())
"""
OTHERS = "root not in {'hadalens', 'numpy', 'cffi', '_cffi_backend'} and root not in sys.stdlib_module_names"


@pytest.mark.parametrize(
    ("package", "name", "code"),
    [
        ("torch", "torch", "import hadalens.torch"),
        ("deepinv", "deepinv", "import hadalens.deepinv"),
        ("dask", "dask", "import hadalens.dask"),
        ("zarr", "ome", "import hadalens.ome; hadalens.ome.OmeZarrWriter('/tmp/none.zarr')._create('', None, [])"),
        ("tifffile", "ome", "import hadalens.ome; hadalens.ome.write_ome_tiff('a.tif', None)"),
        ("h5py", "keras", "import hadalens.keras; hadalens.keras.import_filters(['a.h5'], [1.0])"),
    ],
)
def test_missing_packages_name_their_extra(package: str, name: str, code: str) -> None:
    """The error says what to install."""
    program = WITHOUT.format("root == sys.argv[1]") + code
    done = subprocess.run([sys.executable, "-c", program, package], text=True, capture_output=True, check=False)
    text = done.stderr.splitlines()[-1]
    assert f"hadalens[{name}]" in text
    assert package in text


@pytest.mark.parametrize(
    "page", ["README.md", "bindings/python/README.md", "docs/start/first-pictures.md", "docs/reference/python.md", ""]
)
def test_the_first_example_runs_after_a_plain_install(page: str, tmp_path: Path) -> None:
    """Nothing has to be there before, and no package but NumPy and cffi."""
    text = (Path(__file__).parents[2] / page).read_text() if page else (hadalens.__doc__ or "").replace(">>> ", "")
    lines = text.splitlines()
    block = itertools.takewhile(
        lambda line: line[:4].isspace() or not line, lines[lines.index("    import hadalens") :]
    )
    code = WITHOUT.format(OTHERS) + "\n".join(line[4:] for line in block)
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    assert (tmp_path / "camera" / "camera.json").exists()


# measuring time -------------------------------------------------------------------------------------------------------


def test_time_of_repeated_frames_is_warned_of(
    model: hadalens.Model, raw: Array, caplog: pytest.LogCaptureFixture
) -> None:
    """A frame that was just seen is not computed again: who times that is told, once, and not who times new frames."""
    plan = hadalens.Plan(model, refine=0)
    for factor in range(1, 6):
        plan.run(raw * np.float32(factor))
    assert "measure time" not in caplog.text
    for _ in range(9):
        plan.run(raw)
    assert caplog.text.count("measure time") == 1
    every = hadalens.Plan(model, refine=0, skip=())
    for _ in range(5):
        every.run(raw)
    assert caplog.text.count("measure time") == 1


def test_the_notebook_times_new_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every time in time-against-error is that of a frame that was computed."""
    pytest.importorskip("matplotlib").use("agg")
    cells = json.loads(next(page for page in NOTEBOOKS if page.stem == "time-against-error").read_text())["cells"]
    results: list[hadalens.Result] = []
    run = hadalens.Plan.run

    def watched(*given: Any, **more: Any) -> hadalens.Result:
        results.append(run(*given, **more))
        return results[-1]

    monkeypatch.setattr(hadalens.Plan, "run", watched)
    exec("\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"), {})
    assert len(results) >= 18
    assert not [result for result in results if result.report.skipped.frame]


@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_notebooks_are_stored_with_their_pictures(page: Path) -> None:
    """Whoever reads them sees results without running them, and nothing of the machine that made them."""
    cells = [cell for cell in json.loads(page.read_text())["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [output for output in outputs if output["output_type"] == "error" or "/tmp" in json.dumps(output)]
