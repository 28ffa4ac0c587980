"""What surrounds a reconstruction: simulation, optics, registration, metrics, files."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest

Array = npt.NDArray[Any]


@pytest.fixture(scope="module")
def design() -> hadalens.Camera:
    """Return a small camera by design."""
    camera = hadalens.Camera("sim300")
    camera.resize((96, 128), (48, 48))
    return camera


def test_devices() -> None:
    """There is one, and a context is on it."""
    found = hadalens.devices()
    assert found
    context = hadalens.Context.default()
    assert context.device in found
    assert context.programs_compiled + context.programs_loaded >= 0
    for shape in ("lanes", "groups"):
        assert hadalens.Context(shape=shape).shape == shape
    with pytest.raises(ValueError, match="lanes, groups"):
        hadalens.Context(shape="rows")  # type: ignore[arg-type]
    context.reset_peak()
    assert context.peak_bytes >= context.bytes >= 0


def test_camera(design: hadalens.Camera, tmp_path: Path) -> None:
    """Members by name, files, pickles, and what follows from them."""
    assert (design.rows, design.cols, design.window_rows) == (96, 128, 48)
    assert design.mask == "mla"
    assert len(design.distances_mm) == design.depths == 4
    design.save(tmp_path / "camera.json")
    for copy in (hadalens.Camera.load(tmp_path / "camera.json"), pickle.loads(pickle.dumps(design))):
        assert copy.distances_mm == pytest.approx(design.distances_mm)
        np.testing.assert_allclose(copy.psf(200.0), design.psf(200.0), atol=1e-7)
    other = hadalens.Camera("sim512", channels=1, boundary="padded", distances_mm=[100.0, 200.0])
    assert (other.channels, other.boundary, other.distances_mm) == (1, "padded", (100.0, 200.0))
    other.set_depths(100.0, 600.0, 3)
    assert other.distances_mm[-1] == pytest.approx(600.0)
    other.set_mask("aperture")
    assert other.mask == "aperture"
    other.check()
    with pytest.raises(AttributeError):
        other.colour = 3
    with pytest.raises(AttributeError):
        _ = other.colour  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="sim512"):
        hadalens.Camera("no such preset")
    design.set_fill_factor(design.fill_factor)
    assert design.lenses().shape[1] == 2
    assert design.mask_map(20, 20)[0].shape == (20, 20)
    assert design.psf_stack().shape == (4, 1, 96, 128)
    assert design.magnification(100.0) > 1
    assert design.defocus_pixels(100.0) >= 0
    assert design.refractive_index(500.0) > 1
    assert design.focal_length(587.6) == pytest.approx(design.focal_length_mm, rel=1e-4)
    assert len(design.parallax(100.0, 200.0, 1.0, 1.0)) == 2
    assert hadalens.window_origin(96, 48) == 24


def test_simulator(design: hadalens.Camera) -> None:
    """Light adds up; a sensor makes integers; surfaces and opaque planes render."""
    simulator = hadalens.Simulator(design)
    scene = hadalens.procedural_scene(48, 48, seed=2)
    near, far = simulator.render({0: scene}), simulator.render({3: scene})
    both = simulator.render({0: scene, 3: scene})
    np.testing.assert_allclose(both, near + far, atol=1e-5 * both.max())
    hidden = simulator.render({0: scene * 0, 3: scene}, opacity={0: np.ones((48, 48))})
    assert hidden.sum() < 0.2 * far.sum()
    flat = np.full((48, 48), design.distances_mm[3])
    surface = simulator.render_reliefs([(scene, flat)])
    np.testing.assert_allclose(surface, far, atol=0.01 * far.max())
    sensor = hadalens.Sensor(exposure=simulator.white_exposure(0.9), full_well=10000, bits=12)
    levels = simulator.expose(near, sensor, seed=1) * 4095
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-3)
    assert simulator.psf(0).shape == (1, 96, 128)
    assert simulator.camera.rows == 96
    noisy = hadalens.add_noise(scene, 0.1, seed=1)
    assert np.std(noisy - scene) == pytest.approx(0.1, rel=0.1)


def test_temporaries_live_as_long_as_c_needs_them() -> None:
    """Arrays that are converted on the way are not freed before C has read them."""
    mask = np.zeros((64, 64), bool)
    mask[:7] = True
    a, b = np.random.default_rng(5).random((2, 64, 64))
    expected = np.mean((a[:7].astype(np.float32).astype(float) - b[:7].astype(np.float32)) ** 2)
    for _ in range(50):
        junk = [np.full((64, 64), index, np.float32) for index in range(4)]
        assert hadalens.metrics.mse(a, b, mask=mask) == pytest.approx(expected, rel=1e-9)
        np.testing.assert_array_equal(hadalens.fit_scene(a, 64, 64)[0], a.astype(np.float32))
        del junk


def test_scenes() -> None:
    """Scenes and their parts."""
    scene = hadalens.procedural_scene(40, 60)
    labels = hadalens.regions(3, 40, 60, seed=1)
    assert set(np.unique(labels)) == {0, 1, 2}
    parts = sum(hadalens.part(scene, labels, label) for label in range(3))
    np.testing.assert_array_equal(parts, scene)
    assert hadalens.fit_scene(scene, 20, 20).shape == (3, 20, 20)
    assert hadalens.resize(scene, 20, 30).shape == (3, 20, 30)
    np.testing.assert_array_equal(hadalens.crop(scene, 1, 2, 5, 6), scene[:, 1:6, 2:8])
    slant = hadalens.relief("slant", 20, 20)
    assert (slant.min(), slant.max()) == (pytest.approx(0, abs=0.05), pytest.approx(1, abs=0.05))


def test_simulate_writes_a_data_set(design: hadalens.Camera, tmp_path: Path) -> None:
    """As the command does it."""
    pairs, report = hadalens.simulate(design, tmp_path / "camera", pairs=2, tests=1)
    assert report.pairs == 2
    assert len(pairs) == 8
    assert (tmp_path / "camera" / "test" / "raw").is_dir()


def test_optics(design: hadalens.Camera, tmp_path: Path) -> None:
    """What a camera resolves, by its design and by waves."""
    report = hadalens.optics.report(design)
    assert [row.distance_mm for row in report.rows] == list(design.distances_mm)
    assert report.correlation.shape == (4, 4)
    np.testing.assert_allclose(np.diag(report.correlation), 1, atol=1e-4)
    written = hadalens.optics.write_report(design, tmp_path / "optics")
    assert written.rows[0].spot_pixels == report.rows[0].spot_pixels
    assert (tmp_path / "optics" / "depths.csv").exists()
    psf = hadalens.optics.Wave(design).psf(200.0)
    assert psf.shape == (3, 96, 128)
    assert psf.sum() == pytest.approx(3, rel=0.1)


def test_registrations_turn_both_ways() -> None:
    """Turns and offsets may be below 0; the opposite ones bring a scene back."""
    scene = np.zeros((1, 40, 50), np.float32)
    scene[:, 10:30, 15:35] = 1
    there = hadalens.Registration(rotation_deg=-3.0, offset_row=-2.0, offset_col=1.5).apply(scene, (40, 50))
    mirrored = hadalens.Registration(rotation_deg=3.0, offset_row=-2.0, offset_col=-1.5).apply(
        scene[..., ::-1], (40, 50)
    )
    np.testing.assert_allclose(there, mirrored[..., ::-1], atol=1e-3)
    assert abs(there - scene).max() > 0.5


def test_register(camera: Path, design: hadalens.Camera, tmp_path: Path) -> None:
    """Scenes that were turned upside down are found; a data set that is upright is left."""
    data = hadalens.Dataset.scan(camera)
    raws, scenes = zip(*(data.read(0, pair) for pair in range(3)), strict=True)
    found = hadalens.register(raws, [scene[:, ::-1, ::-1] for scene in scenes])
    assert (found.mirrored, found.quarter_turns) == (False, 2)
    assert found.magnification == pytest.approx(1, abs=0.03)
    exact = hadalens.Registration(quarter_turns=2)
    np.testing.assert_array_equal(exact.apply(scenes[0][:, ::-1, ::-1]), scenes[0])
    assert exact.size(10, 20) == (10, 20)
    depths = hadalens.register_dataset(data)
    assert len(depths) == design.depths
    assert depths[0].found.quarter_turns == 0
    turned = tmp_path / "turned" / "z0mm"
    for folder in ("raw", "scene"):
        (turned / folder).mkdir(parents=True)
    for pair, (raw, scene) in enumerate(zip(raws, scenes, strict=True)):
        np.save(turned / "raw" / f"{pair}.npy", np.moveaxis(raw, 0, -1))
        np.save(turned / "scene" / f"{pair}.npy", np.moveaxis(scene[:, ::-1, ::-1], 0, -1))
    upside_down = hadalens.Dataset.scan(turned.parent)
    assert upside_down.read(0, 1)[1].shape == scenes[1].shape
    applied = hadalens.register_dataset(upside_down, place=True)[0].applied
    np.testing.assert_array_equal(upside_down.read(0, 1)[1], applied.apply(scenes[1][:, ::-1, ::-1]))
    with pytest.raises(hadalens.HadalensError, match="apply the transforms"):
        hadalens.register_dataset({0.0: list(zip(raws, scenes, strict=True))}, place=True)


def test_metrics() -> None:
    """The yardsticks, by their definitions."""
    random = np.random.default_rng(3)
    a, b = random.random((2, 3, 32, 32), np.float32)
    error = np.mean((a.astype(float) - b) ** 2)
    assert hadalens.metrics.mse(a, b) == pytest.approx(error)
    assert hadalens.metrics.mae(a, b) == pytest.approx(np.mean(np.abs(a.astype(float) - b)))
    assert hadalens.metrics.psnr(a, b) == pytest.approx(-10 * np.log10(error))
    assert hadalens.metrics.ssim(a, a) == pytest.approx(1)
    assert hadalens.metrics.authors_psnr(a, b) > 0
    assert hadalens.metrics.authors_ssim(a, b) < 1
    assert hadalens.metrics.sharpness(a) > hadalens.metrics.sharpness(a * 0.5)
    mask = np.zeros((32, 32), bool)
    mask[:4] = True
    assert hadalens.metrics.mse(a, b, mask=mask) == pytest.approx(np.mean((a[:, :4].astype(float) - b[:, :4]) ** 2))
    truth = np.full((32, 32), 100.0, np.float32)
    truth[:, 16:] = 200.0
    distances = [100.0, 200.0, 400.0]
    score = hadalens.metrics.depth(truth, truth, distances)
    assert (score.coverage, score.within, score.mean_steps) == (1, 1, 0)
    for kind in (np.uint16, np.int64):  # millimetres are no pixels
        assert hadalens.metrics.depth(truth.astype(kind), truth, distances) == score
    assert hadalens.metrics.depth_confidence(truth + 1, truth, truth).half_error == pytest.approx(1)
    parts = hadalens.metrics.depth_parts(truth.astype(np.uint16), distances)
    assert parts[0, 16] == 2
    assert parts[0, 0] == 1
    nearer = hadalens.metrics.depth_nearer(truth, np.full_like(truth, 400), np.full_like(truth, 380), distances)
    assert (nearer == 400).all()
    assert hadalens.metrics.depth_index(distances, 200.0) == 1
    assert hadalens.metrics.depth_distance(distances, 1.0) == 200


def test_steps_that_keep_up(model: hadalens.Model, frames: list[Path]) -> None:
    """All steps keep up with a slow camera, one is what is left for one that is too fast."""
    pace = hadalens.find_pace(model, frames, 1e-3, scene="planes")
    assert (pace.refine, pace.change) == (None, 0.0)
    assert pace.seconds == pace.seconds_whole > 0
    pace = hadalens.find_pace(model, frames, 1e6, scene="planes", warm_start=True)
    assert pace.refine == 1
    assert 0.001 < pace.change < 1
    with pytest.raises(hadalens.ArgumentError, match="two frames"):
        hadalens.find_pace(model, frames[:1], 1.0)
    with pytest.raises(hadalens.ArgumentError, match="frames a second"):
        hadalens.find_pace(model, frames, 0.0)


def test_evaluate_and_files(
    model: hadalens.Model, plan: hadalens.Plan, frames: list[Path], camera: Path, tmp_path: Path
) -> None:
    """Files are reconstructed as by the command, and compared."""
    seen: list[tuple[str, int]] = []
    spoilt = tmp_path / "spoilt.tif"
    spoilt.write_text("no picture")
    done = hadalens.reconstruct_files(
        plan, [*frames, spoilt], tmp_path / "out", preview=False, tell=lambda path, frame: seen.append((path, frame))
    )
    assert [one.error is None for one in done] == [True, True, False]
    assert isinstance(done[2].error, OSError)
    assert len(seen) >= 2
    again = hadalens.reconstruct_files(plan, frames, tmp_path / "out", preview=False, resume=True)
    assert [(one.there, one.outputs) for one in again] == [(True, ())] * len(frames)
    stack = hadalens.read_tiff(tmp_path / "out" / f"{frames[0].stem}_stack.tif")
    np.testing.assert_array_equal(stack, plan.run(hadalens.read_tiff(frames[0], 0)).stack)
    np.save(tmp_path / "array.npy", hadalens.read_tiff(frames[0], 0))  # (channels, rows, cols)
    assert hadalens.reconstruct_files(plan, [tmp_path / "array.npy"], tmp_path / "out", preview=False)[0].error is None
    np.testing.assert_array_equal(stack, hadalens.read_tiff(tmp_path / "out" / "array_stack.tif"))
    hadalens.reconstruct_files(plan, frames[:1], tmp_path / "arrays", preview=False, format="numpy")
    array = np.load(tmp_path / "arrays" / f"{frames[0].stem}_stack.npy")
    expected = plan.run(hadalens.read_tiff(frames[0], 0)).stack
    np.testing.assert_array_equal(array, np.moveaxis(expected, 1, -1)[np.newaxis])
    rows = hadalens.metrics.evaluate(tmp_path / "out", camera / "test" / "truth")
    assert {row.what for row in rows} >= {"stack", "map"}
    assert all(np.isfinite(row.psnr) for row in rows if row.what == "stack")
    assert model.info.depths == 4


def test_tiff(plan: hadalens.Plan, raw: Array, tmp_path: Path) -> None:
    """Metadata come back."""
    result = plan.run(raw)
    file = hadalens.write_tiff(
        tmp_path / "stack.tif", result.stack, distances_mm=result.distances_mm, pixel_um=6.5, encoding="srgb"
    )
    np.testing.assert_array_equal(hadalens.read_tiff(file), result.stack)
    with hadalens.TiffReader(file) as reader:
        info = reader.info
        assert len(reader) == info.frames == 4
        np.testing.assert_array_equal(reader.read(2), result.stack[2])
    assert info.distances_mm == pytest.approx(tuple(result.distances_mm))
    assert info.encoding == hadalens.response.SRGB
    assert info.pixel_width_um == pytest.approx(6.5)
    hadalens.write_tiff(tmp_path / "small.tif", result.all_in_focus, bits=16, compress=True)
    np.testing.assert_allclose(
        hadalens.read_tiff(tmp_path / "small.tif", 0), np.clip(result.all_in_focus, 0, 1), atol=1e-5
    )
    with pytest.raises(hadalens.SizeError):
        hadalens.write_tiff(tmp_path / "no.tif", result.stack, distances_mm=[1.0])
    assert not (tmp_path / "no.tif").exists()
    level = hadalens.load_dark(file)
    assert level[0].shape == result.stack.shape[1:]
    small = hadalens.load_dark(tmp_path / "small.tif", full_scale=4095)[0]
    np.testing.assert_allclose(small, np.clip(result.all_in_focus, 0, 1) * 65535 / 4095, atol=2e-4)


def test_pictures(plan: hadalens.Plan, raw: Array, tmp_path: Path) -> None:
    """Pictures to look at, where cairo is."""
    if not hadalens.pictures_available():
        with pytest.raises(hadalens.UnsupportedError):
            hadalens.save_png(tmp_path / "a.png", raw)
        return
    result = plan.run(raw)
    for file in (
        hadalens.save_preview(tmp_path / "sheet.png", result, raw=raw, title="a frame"),
        hadalens.save_png(tmp_path / "a.png", result.all_in_focus),
    ):
        assert file.read_bytes().startswith(b"\x89PNG")


def test_responses() -> None:
    """Words and numbers, there and back."""
    assert hadalens.response.number("linear") == hadalens.response.LINEAR
    assert hadalens.response.name(2.2) == "2.2"
    assert hadalens.response.is_known(2.2)
    assert not hadalens.response.is_known(100)
    values = np.linspace(0, 1, 11)
    light = hadalens.response.convert(values, "srgb", "linear")
    np.testing.assert_allclose(hadalens.response.convert(light, "linear", "srgb"), values, atol=1e-6)
    assert hadalens.response.convert(np.array([51], np.uint8), "srgb", "linear") == pytest.approx([0.033105], rel=1e-3)
    assert hadalens.response.to_light(2.0, 0.5) == pytest.approx(0.25)
    assert hadalens.response.to_light("srgb", 1) == 1
    assert hadalens.response.from_light("2", 0.25) == pytest.approx(0.5)
    with pytest.raises(ValueError, match="srgb"):
        hadalens.response.number("log")


def test_limits() -> None:
    """Budgets of this process."""
    before = hadalens.limits()
    hadalens.set_limits("pages=7")
    assert hadalens.limits() == before | {"pages": 7}
    hadalens.set_limits(None)
    assert hadalens.limits() == before


def test_headerless(tmp_path: Path) -> None:
    """Frames without a header."""
    frames = np.arange(2 * 3 * 5, dtype="<u2").reshape(2, 3, 5)
    (tmp_path / "frames.raw").write_bytes(frames.tobytes())
    with pytest.raises(hadalens.HadalensError, match="set_headerless"):
        hadalens.read_tiff(tmp_path / "frames.raw")
    hadalens.set_headerless("3x5:u12")
    np.testing.assert_allclose(np.squeeze(hadalens.read_tiff(tmp_path / "frames.raw")), frames / 4095, rtol=1e-6)
    hadalens.set_headerless(None)
    with pytest.raises(hadalens.HadalensError, match="not understood"):
        hadalens.set_headerless("3x5")


def test_focus(plan: hadalens.Plan, raw: Array) -> None:
    """The focus step by itself."""
    result = hadalens.Plan(plan.model, refine=0, occupied="all").run(raw)
    sharp, distances, report = hadalens.focus_stack(result.stack, list(result.distances_mm))
    np.testing.assert_array_equal(sharp, result.all_in_focus)
    np.testing.assert_array_equal(distances, result.distance_map)
    assert 0 <= report.coverage <= 1


def test_plans_tell(model: hadalens.Model, raw: Array) -> None:
    """Memory, queues, kernels."""
    plan = hadalens.Plan(model, refine=0)
    device, host = hadalens.Plan.estimate(model, refine=0)
    assert device > 0
    assert host >= 0
    held, apart = plan.memory
    assert 0 < held <= apart
    plan.profile()
    plan.run(raw)
    assert plan.queues[0].frames == 1
    times = plan.kernel_times()
    assert any(row.stage == "linear" for row in times)
    calls = plan.calls()
    assert calls.launches >= len(times) / 2
    assert calls.bytes_up >= raw.size * 4
    plan.profile(False)
    assert plan.run(raw).distances_mm.shape == (4,)


def test_plan_options(model: hadalens.Model, raw: Array) -> None:
    """Options reach the library."""
    some = hadalens.Plan(model, depths=[0, 2], refine=0, skip=()).run(raw)
    assert some.stack.shape[0] == 2
    assert some.report.skipped.kinds == ()
    listed = hadalens.Plan(model, occupied=[1]).run(raw)
    assert listed.report.occupied == (False, True, False, False)
    dark = hadalens.Plan(model, dark=np.full(raw.shape, 0.01)).run(raw)
    level = hadalens.Plan(model, dark=0.004).run(raw)
    assert level.report.dark == 0.004
    assert not np.array_equal(dark.stack, level.stack)
    for method in ("wiener", "rl", "fista", "admm"):
        classic = hadalens.Classic(method, iterations=2)
        assert hadalens.Plan(model, classic=classic).run(raw).report.method == method
    surface = hadalens.Plan(model, scene="surface").run(raw)
    assert surface.report.scene == "surface"
    assert surface.confidence is not None
    assert surface.confidence.shape == surface.distance_map.shape


def test_opencl_of_the_program(model: hadalens.Model, raw: Array) -> None:
    """Contexts, queues and frames of pyopencl's."""
    cl = pytest.importorskip("pyopencl")
    arrays = pytest.importorskip("pyopencl.array")
    theirs = cl.create_some_context(interactive=False)
    plan = hadalens.Plan(model, context=hadalens.Context.adopt(theirs))
    with cl.CommandQueue(theirs) as queue:
        frame = arrays.to_device(queue, raw)
        expected = plan.run(raw).stack
        np.testing.assert_array_equal(plan.run(frame).stack, expected)
        np.testing.assert_array_equal(plan.run(frame.data).stack, expected)
        stack = arrays.zeros(queue, plan.stack_shape, np.float32)
        assert plan.run(frame, out=stack).stack.any()
        np.testing.assert_array_equal(stack.get(), expected)
        with pytest.raises(hadalens.SizeError):
            plan.run(frame, out=stack[:1])
        with pytest.raises(hadalens.SizeError):
            plan.run(frame[:2])


def test_addresses_of_opencl(model: hadalens.Model) -> None:
    """A context on another's objects works without pyopencl."""
    mine = hadalens.Context()
    other = hadalens.Context.adopt(mine.cl_context, mine.cl_device)
    assert other.cl_context == mine.cl_context
    assert other.device == mine.device
    plan = hadalens.Plan(model, context=other)
    assert isinstance(plan.cl_queue(), int)
    with pytest.raises(TypeError):
        hadalens.Context.adopt("context", "device")
