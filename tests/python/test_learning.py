"""Learning: fit, Fitter, data sets, training; the same bits as the C program."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
from hadalens import operators

Array = npt.NDArray[Any]
Pairs = dict[float, list[tuple[Array, Array]]]


@pytest.fixture(scope="module")
def data(camera: Path) -> hadalens.Dataset:
    """Return the camera's data set."""
    return hadalens.Dataset.scan(camera)


@pytest.fixture(scope="module")
def arrays(data: hadalens.Dataset) -> Pairs:
    """Return its pairs in memory."""
    return {
        distance: [data.read(depth, pair) for pair in range(data.counts[depth])]
        for depth, distance in enumerate(data.distances_mm)
    }


def same(a: hadalens.Model, b: hadalens.Model) -> bool:
    """Return whether two models are the same bits."""
    assert a.otf is not None
    return np.array_equal(a.filters, b.filters) and np.array_equal(a.otf, b.otf)  # type: ignore[arg-type]


def test_fit_is_that_of_the_program(camera: Path, model: hadalens.Model) -> None:
    """A folder gives what `hadalens fit` gives, and progress is reported."""
    told: list[tuple[str, int, int]] = []
    learned = hadalens.fit(camera, progress=lambda what, done, total, _: told.append((what, done, total)))
    assert same(learned, model)
    assert ("pairs", 12, 12) in told
    report = learned.fit_report
    assert report is not None
    assert report.pairs == (3, 3, 3, 3)
    assert sum(row.chosen for row in report.filters) == 1
    assert report.refinement[0].steps == 0
    assert report.response is not None


def test_a_fit_goes_on(camera: Path, model: hadalens.Model, tmp_path: Path) -> None:
    """A fit that was broken off goes on from what it saved, and gives the same bits."""
    pairs = 0

    def stop(what: str, done: int, *_: Any) -> None:
        nonlocal pairs
        pairs += what == "pairs" and done > 0
        if pairs == 7:
            raise InterruptedError

    sums = tmp_path / "camera.sums"
    with pytest.raises(InterruptedError):
        hadalens.fit(camera, save_sums=sums, resume=True, save_seconds=0.0, progress=stop)
    (saved,) = tmp_path.iterdir()
    content = saved.read_bytes()
    saved.write_bytes(b"no sums")
    with pytest.raises(hadalens.FileError):  # it is read
        hadalens.fit(camera, save_sums=sums, resume=True)
    saved.write_bytes(content)
    assert same(hadalens.fit(camera, save_sums=sums, resume=True), model)


def test_bars(camera: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """progress=True shows tqdm's bars, where it is installed."""
    pytest.importorskip("tqdm")
    hadalens.fit(camera, progress=True)
    assert "12/12" in capsys.readouterr().err


def test_pairs_of_arrays_are_those_of_files(arrays: Pairs, camera: Path, model: hadalens.Model) -> None:
    """Arrays give the same bits as the files; files by name and functions do as well."""
    learned = hadalens.fit(arrays, boundary="circular")
    assert same(learned, model)
    flat = [(distance, lambda raw=raw: raw, scene) for distance, some in arrays.items() for raw, scene in some]
    assert same(hadalens.fit(flat, boundary="circular"), model)
    files = {
        float(folder.name[1:-2]): list(
            zip(sorted((folder / "raw").glob("*.tif")), sorted((folder / "scene").glob("*.tif")), strict=True)
        )
        for folder in camera.glob("z*mm")
    }
    assert sorted(files) == pytest.approx(sorted(arrays), rel=1e-3)


def test_dataset(data: hadalens.Dataset, arrays: Pairs) -> None:
    """What a data set tells."""
    assert len(data) == 12
    assert data.counts == (3, 3, 3, 3)
    raw, scene = data.read(1, 2)
    assert (raw.shape, scene.shape) == ((3, 96, 128), (3, 48, 48))
    assert data.names(1, 2)[0].endswith(".tif")
    learn, held = data.split(1)
    assert (learn.counts, held.counts) == ((2,) * 4, (1,) * 4)
    held_raw, _ = held.read(1, 0)
    np.testing.assert_array_equal(held_raw, raw)
    mine = hadalens.Dataset(arrays)
    np.testing.assert_array_equal(mine.split(1)[1].read(1, 0)[0], raw)
    with pytest.raises(IndexError):
        data.read(1, 3)


def test_npy_files_and_channel_axis(arrays: Pairs, tmp_path: Path) -> None:
    """Pairs may be .npy files, and (Y, X, C)."""
    raw, scene = next(iter(arrays.values()))[0]
    np.save(tmp_path / "raw.npy", np.moveaxis(raw, 0, -1))
    data = hadalens.Dataset([(100.0, tmp_path / "raw.npy", np.moveaxis(scene, 0, -1))], channel_axis=-1)
    back = data.read(0, 0)
    np.testing.assert_array_equal(back[0], raw)
    np.testing.assert_array_equal(back[1], scene)


def test_pairs_of_12_bits(arrays: Pairs, tmp_path: Path) -> None:
    """Raw frames of 12 bits in uint16, as arrays and files, are learned like the same light; scenes have their own."""
    distance = min(arrays)
    counts = [((raw.clip(0, 1) * 4095).round().astype(np.uint16), scene) for raw, scene in arrays[distance]]
    light = [(raw / np.float32(4095), scene) for raw, scene in counts]
    given: dict[str, Any] = {"boundary": "circular", "leave_one_out": False}
    learned = hadalens.fit({distance: counts}, full_scale=4095, **given)
    assert same(learned, hadalens.fit({distance: light}, **given))
    hadalens.write_tiff(tmp_path / "a.tif", counts[0][0] / np.float32(65535), bits=16)
    pairs = [(distance, tmp_path / "a.tif", scene) for _, scene in counts]
    np.testing.assert_allclose(hadalens.Dataset(pairs, full_scale=4095).read(0, 0)[0], light[0][0], atol=1e-6)
    for scale, some in ((4095, counts), (None, light)):
        fitter = hadalens.Fitter([distance], (96, 128), window=(48, 48), channels=3, full_scale=scale, **given)
        fitter.add(0, *some[0])
        learned, before = fitter.finish(), learned
    assert same(learned, before)


def test_fitter(arrays: Pairs, tmp_path: Path) -> None:
    """Pair by pair; sums that are saved and merged give the same bits."""
    distances = sorted(arrays)
    size: dict[str, Any] = {"window": (48, 48), "channels": 3}
    whole = hadalens.Fitter(distances, (96, 128), **size)
    parts = [hadalens.Fitter(distances, (96, 128), **size) for _ in range(2)]
    for depth, distance in enumerate(distances):
        for pair, (raw, scene) in enumerate(arrays[distance]):
            whole.add(depth, raw, scene)
            parts[pair % 2].add(depth, raw, scene)
    assert whole.pairs == (3, 3, 3, 3)
    assert whole.bytes > 0
    for index, part in enumerate(parts):
        part.save_sums(tmp_path / f"{index}.sums")
    merged = hadalens.Fitter.from_sums(tmp_path / "0.sums", depths=4)
    merged.load_sums(tmp_path / "1.sums")
    assert merged.pairs == whole.pairs
    assert hadalens.fit(None, merge=tmp_path / "0.sums", leave_one_out=False).info.depths == 4
    model = whole.finish()
    np.testing.assert_allclose(merged.finish().filters, model.filters, atol=1e-4)
    whole.score(0, *arrays[distances[0]][0])
    report = whole.finish().fit_report
    assert report is not None
    assert len(report.filters) == 10
    shown: list[tuple[int, int]] = []

    def show(depth: int, pair: int) -> tuple[Array, Array]:
        shown.append((depth, pair))
        return arrays[distances[depth]][pair]

    judged = whole.finish(show)
    assert judged.fit_report is not None
    assert shown
    assert judged.info.depths == 4


def test_ridge(arrays: Pairs, raw: Array) -> None:
    """The strength of the learned regulariser that fits and plans are given is that of the model and of the planes."""
    distance = min(arrays)
    given = {"boundary": "circular", "refine_steps": 4, "refine_tv": 0.003}
    models = [
        hadalens.fit({distance: arrays[distance]}, refine_ridge=strength, **given)  # type: ignore[arg-type]
        for strength in (0.0, 1.6, None)
    ]
    assert [model.info.refine_ridge for model in models] == [0.0, 1.6, 1.0]
    with pytest.raises(ValueError, match="regulariser"):
        hadalens.fit({distance: arrays[distance]}, refine_ridge=101.0)
    plain, smooth = (hadalens.Plan(model).run(raw).stack for model in models[:2])
    assert not np.array_equal(plain, smooth)
    np.testing.assert_array_equal(hadalens.Plan(models[0], refine_ridge=1.6).run(raw).stack, smooth)
    np.testing.assert_array_equal(hadalens.Plan(models[1], refine_ridge=0.0).run(raw).stack, plain)


def test_fitter_of_a_sensor_that_crops(arrays: Pairs) -> None:
    """The further passes show pairs again; what showing raises comes through."""
    distance = min(arrays)
    fitter = hadalens.Fitter([distance], (96, 128), window=(48, 48), channels=3, boundary="padded", crop_passes=3)
    for raw, scene in arrays[distance]:
        fitter.add(0, raw, scene)
    assert fitter.finish(lambda _, pair: arrays[distance][pair]).info.boundary == "padded"

    def broken(depth: int, pair: int) -> tuple[Array, Array]:
        raise LookupError(f"{depth}, {pair}")

    with pytest.raises(LookupError):
        fitter.finish(broken)


def test_boundary_is_found(data: hadalens.Dataset) -> None:
    """The simulated camera keeps its light."""
    boundary, grid = hadalens.find_boundary(data)
    assert boundary in ("circular", "padded")
    assert (grid is None) == (boundary == "circular")


def test_models_from_arrays(model: hadalens.Model, raw: Array, tmp_path: Path) -> None:
    """Filters and transfer functions come out and go in; files, half precision and baselines."""
    info = model.info
    again = hadalens.Model.from_filters(model.filters, info.distances_mm, (96, 128), otf=model.otf, window=(48, 48))
    assert same(again, model)
    linear = hadalens.Plan(model, refine=0).run(raw).stack
    np.testing.assert_array_equal(hadalens.Plan(again, refine=0).run(raw).stack, linear)
    with pytest.raises(hadalens.SizeError, match="shape"):
        hadalens.Model.from_filters(model.filters[..., :-1], info.distances_mm, (96, 128), window=(48, 48))
    half = model.to_half()
    assert half.info.half
    assert half.info.bytes < info.bytes
    assert np.abs(half.filters - model.filters).max() <= 2e-3 * np.abs(model.filters).max()
    assert model.with_form("wiener").info.form == "wiener"
    with pytest.raises(ValueError, match="read-only"):
        model.filters[0] = 0
    filters = again.filters
    again.close()
    np.testing.assert_array_equal(filters, model.filters)  # the array keeps the model's memory
    assert model.save(tmp_path / "a.model").stat().st_size > info.bytes / 2
    assert same(hadalens.Model.load(tmp_path / "a.model"), model)


def test_model_from_psf(camera: Path) -> None:
    """Point spread functions of a file and of arrays make the same model."""
    psfs = hadalens.read_tiff(camera / "psf.tif")
    distances = hadalens.TiffReader(camera / "psf.tif").info.distances_mm
    model = hadalens.Model.from_psf(psfs, distances)
    assert same(model, hadalens.Model.from_psf_file(camera / "psf.tif"))
    assert model.info.form == "wiener"
    psf = model.psf
    assert psf is not None
    assert psf.shape[-2:] == (model.info.grid_rows, model.info.grid_cols)
    with pytest.raises(hadalens.SizeError):
        hadalens.Model.from_psf(psfs, distances[:-1])


def test_colours_that_a_sensor_mixes(arrays: Pairs, model: hadalens.Model, raw: Array) -> None:
    """A matrix is found in the pairs, kept by models, and undone in frames."""
    matrix = np.array([[0.75, 0.2, 0.05], [0.15, 0.65, 0.2], [0.05, 0.25, 0.7]])

    def mixed(frame: Array) -> Array:
        return np.asarray(np.einsum("ck,kyx->cyx", matrix, frame), np.float32)

    pairs = {distance: [(mixed(frame), scene) for frame, scene in of] for distance, of in arrays.items()}
    learned = hadalens.fit(pairs)
    assert np.abs(np.array(learned.info.colour_matrix) - matrix).max() < 0.03
    planes = hadalens.Plan(learned).run(mixed(raw)).stack
    usual = hadalens.Plan(model).run(raw).stack
    assert np.linalg.norm(planes - usual) < 0.1 * np.linalg.norm(usual)
    assert hadalens.fit(pairs, colour_matrix=None, leave_one_out=False).info.colour_matrix is None
    told = hadalens.fit(pairs, colour_matrix=matrix, leave_one_out=False)
    assert told.info.colour_matrix == tuple(tuple(row) for row in matrix.tolist())
    psf = np.zeros((3, 8, 8), np.float32)
    psf[:, 4, 4] = 1
    assert hadalens.Model.from_psf([psf], [100.0], colour_matrix=matrix).info.colour_matrix == told.info.colour_matrix
    with pytest.raises(hadalens.SizeError, match="colour_matrix"):
        hadalens.fit(pairs, colour_matrix=matrix[:2])
    with pytest.raises(hadalens.ArgumentError, match="auto"):
        hadalens.fit(pairs, colour_matrix="found")


def test_frames_that_are_encoded(arrays: Pairs, tmp_path: Path) -> None:
    """Encoded frames in files are found, or said to be; the model keeps it."""
    for distance, pairs in arrays.items():
        for number, (frame, scene) in enumerate(pairs):
            for kind, image in ("raw", np.maximum(frame, 0) ** (1 / 2.2)), ("scene", scene):
                folder = tmp_path / f"z{distance:g}mm" / kind
                folder.mkdir(parents=True, exist_ok=True)
                hadalens.write_tiff(folder / f"{number}.tif", image, bits=8 if kind == "raw" else 32)
    assert hadalens.fit(tmp_path).info.frame_encoding == -2  # sRGB, which a power of 2.2 resembles
    told = hadalens.fit(tmp_path, frame_encoding=2.2, leave_one_out=False)
    opened = hadalens.fit(hadalens.Dataset.scan(tmp_path, frame_encoding=2.2), leave_one_out=False)
    linear = hadalens.fit(tmp_path, frame_encoding="linear", leave_one_out=False)
    assert told.info.frame_encoding == opened.info.frame_encoding == 2.2
    assert linear.info.frame_encoding == 0
    assert same(told, opened)
    assert not same(told, linear)


def test_functions_that_vary_over_the_field(tmp_path: Path) -> None:
    """Components of measured point spread functions, from arrays and files alike; what they are; a better picture."""
    design = hadalens.Camera("sim300", channels=1, boundary="padded", distances_mm=(100.0, 300.0))
    design.resize((96, 104), (40, 40))
    simulator = hadalens.Simulator(design, field_varying=0.6)
    places = np.array([(row, col) for row in (-20, -7, 6, 19) for col in (-20, -7, 6, 19)])
    psfs = np.array([[simulator.psf_at(z, *map(int, place)) for place in places] for z in range(2)])
    camera = hadalens.Model.from_psf(psfs, design.distances_mm, positions=places, components=6, window=(40, 40))
    single = hadalens.Model.from_psf(psfs, design.distances_mm, positions=places, components=1, window=(40, 40))
    assert camera.info.components == 6
    assert camera.info.lost < camera.info.lost_single / 5
    assert single.components is None
    parts = camera.components
    assert parts is not None
    otf, weights, singular = parts
    assert (otf.shape[:3], weights.shape, singular.shape) == ((2, 6, 1), (2, 6, 40, 40), (2, 16))
    hadalens.simulate(design, tmp_path / "data", pairs=1, field_varying=0.6, field_psfs=4)
    file = hadalens.Model.from_psf_file(tmp_path / "data/field", window=(40, 40), components=6)
    np.testing.assert_allclose(file.info.lost, camera.info.lost, rtol=1e-3)
    scene = np.zeros((40, 40), np.float32)
    scene[5:14, 20:36] = scene[25:35, 4:18] = 1.0
    raw = simulator.render({0: scene})
    left = []
    for one in (camera, single):
        with hadalens.Plan(one, classic=hadalens.Classic("rl", iterations=60)) as plan:
            left.append(plan.run(raw).report.residual)
    assert left[0] < 0.7 * left[1]
    with pytest.raises(hadalens.ModelError, match="vary over the field"):
        hadalens.Plan(camera)
    with pytest.raises(hadalens.ModelError, match="vary over the field"):
        operators.Forward(camera)
    with pytest.raises(hadalens.SizeError, match="positions"):
        hadalens.Model.from_psf(psfs[:, :9], design.distances_mm, positions=places, window=(40, 40))


def test_trainer(model: hadalens.Model, data: hadalens.Dataset, tmp_path: Path) -> None:
    """Steps, validation, checkpoints that go on with the same bits, and what comes of it."""
    net = hadalens.Net.unet("4|4", "4", channels=3)
    learn, held = data.split(1)

    def make() -> hadalens.Trainer:
        return hadalens.Trainer(
            model, learn, held_out=held, net=net, steps=4, batch=2, compose=0.0, augment=hadalens.Augment(noise=0.01)
        )

    trainer = make()
    assert len(trainer) == 4
    assert trainer.options["stage"] == "enhance"
    first = [trainer.step() for _ in range(2)]
    assert [step.step for step in first] == [1, 2]
    trainer.save(tmp_path / "checkpoint")
    rest = list(trainer)
    assert trainer.done == 4
    assert trainer.seen == 8
    other = make().load(tmp_path / "checkpoint")
    assert [step.loss for step in other] == [step.loss for step in rest]
    found = trainer.validate()
    assert found.pairs == 4
    assert np.isfinite(found.psnr)
    shown = trainer.show(0)
    assert [image.shape for image in shown] == [(3, 96, 128), (3, 48, 48), (3, 48, 48), (3, 48, 48)]
    better = trainer.model()
    assert better.info.enhance
    assert better.enhance is not None
    assert better.enhance.info == trainer.net().info
    assert trainer.first_net() is not None
    assert better.with_enhance(None).info.enhance is False
    assert hadalens.Trainer.bytes(model, net=net, batch=2) > 0


def test_training_as_the_command_does(model: hadalens.Model, arrays: Pairs, tmp_path: Path) -> None:
    """The log, the callback and the file."""
    events: list[str] = []
    file = hadalens.train(
        arrays,
        tmp_path / "better.model",
        model=model,
        net=hadalens.Net.unet("4|4", "4", channels=3),
        steps=2,
        batch=2,
        compose=0.0,
        validate_every=1,
        tell=lambda state: events.append(state.event),
    )
    assert hadalens.Model.load(file).info.enhance
    assert events[0] == "begins"
    assert events[-1] == "ends"
    assert "validated" in events
    assert (tmp_path / "better.model.log" / "losses.csv").exists()


def test_nets(tmp_path: Path) -> None:
    """Nets: files, weights, description, running."""
    net = hadalens.Net.preset("compact", 1, seed=3)
    again = hadalens.Net.load(net.save(tmp_path / "net"))
    assert again.info == net.info
    assert again.description == net.description
    image = np.random.default_rng(1).random((32, 40), np.float32)
    expected = hadalens.NetRunner(net, 32, 40).run(image)
    assert expected.shape == (1, 32, 40)
    np.testing.assert_array_equal(hadalens.NetRunner(again, 32, 40).run(image), expected)
    fresh = hadalens.Net(net.description, seed=5)
    fresh.load_weights(tmp_path / "net")
    np.testing.assert_array_equal(hadalens.NetRunner(fresh, 32, 40).run(image), expected)
    assert net.bytes(32, 40) > 0


def test_ctrl_c_while_a_pair_is_read_leaves_the_checkpoint(model: hadalens.Model, camera: Path, tmp_path: Path) -> None:
    """Training goes on from the very step, wherever Ctrl-C came; a second one stops at once."""
    data = hadalens.Dataset.scan(camera)
    stops = 0

    def read(depth: int, pair: int, which: int) -> Array:
        nonlocal stops
        if stops:
            stops -= 1
            raise KeyboardInterrupt
        return data.read(depth, pair)[which]

    pairs = {
        distance: [(partial(read, z, pair, 0), partial(read, z, pair, 1)) for pair in range(data.counts[z])]
        for z, distance in enumerate(data.distances_mm)
    }

    net = hadalens.Net.unet("4|4", "4")

    def train(**options: Any) -> Path:
        file = tmp_path / "a.model"
        return hadalens.train(pairs, file, model=model, net=net, batch=1, steps=10, tell=tell, **options)

    begins = 1

    def tell(state: hadalens.TrainState) -> None:
        nonlocal stops
        if state.event == "begins":
            stops = begins

    checkpoint = tmp_path / "a.model.log" / "checkpoint.safetensors"
    with pytest.raises(KeyboardInterrupt):
        train()
    assert checkpoint.exists()
    checkpoint.unlink()
    begins = 2
    with pytest.raises(KeyboardInterrupt):
        train(restart=True)
    begins = 1
    with pytest.raises(KeyboardInterrupt):
        train(restart=True)
    begins = 0
    assert hadalens.Model.load(train(resume=True)).enhance is not None
