"""Frames through a plan: the same bits as the C program, and the ways in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
import tifffile

Array = npt.NDArray[Any]


def test_bits_are_those_of_the_program(
    program: Any, model_file: Path, frames: list[Path], plan: hadalens.Plan, tmp_path: Path
) -> None:
    """What run gives is, bit for bit, what `hadalens reconstruct` writes."""
    program("reconstruct", *frames, "-m", model_file, "-o", tmp_path, "--no-preview")
    for frame in frames:
        result = plan.run(tifffile.imread(frame), channel_axis=-1)
        stack = tifffile.imread(tmp_path / f"{frame.stem}_stack.tif")
        np.testing.assert_array_equal(result.stack, stack.reshape(result.stack.shape))
        sharp = np.moveaxis(tifffile.imread(tmp_path / f"{frame.stem}_aif.tif"), -1, 0)
        np.testing.assert_array_equal(result.all_in_focus, sharp.reshape(result.all_in_focus.shape))
        np.testing.assert_array_equal(result.distance_map, tifffile.imread(tmp_path / f"{frame.stem}_depth.tif"))


def test_a_camera_belongs_to_its_frames(camera: Path, frames: list[Path], tmp_path: Path) -> None:
    """A turned point spread function is told, by the plan and by files."""
    psfs = hadalens.read_tiff(camera / "psf.tif").reshape(4, 1, 96, 128).repeat(3, axis=1)
    distances = hadalens.TiffReader(camera / "psf.tif").info.distances_mm
    raw = tifffile.imread(frames[0])
    turns: tuple[Literal["none", "180", "mirror", "flip"], ...] = ("none", "180", "mirror", "flip")
    for turn in turns:
        verdict = "belongs" if turn == "none" else "turned"
        model = hadalens.Model.from_psf(psfs, distances, boundary="circular", window=(48, 48), turn=turn)
        with hadalens.Plan(model) as plan:
            match = plan.match(raw, channel_axis=-1)
            assert (match.verdict, match.turn, match.magnification) == (verdict, turn, 1.0)
            assert (match.factor > 1.2) == (turn != "none")
            done = hadalens.reconstruct_files(plan, frames, tmp_path / turn, preview=False)
            assert [one.match for one in done] == [match, None]
            none = hadalens.reconstruct_files(plan, frames[:1], tmp_path / turn, preview=False, match="none")
            assert none[0].match is None


def test_flat_frames(tmp_path: Path) -> None:
    """A frame of an uneven sensor gives what one of an even sensor does."""
    small = hadalens.Camera("sim300", rows=64, cols=80, window_rows=24, window_cols=24, lenses=9, channels=1)
    small.set_depths(100, 100, 1)
    pairs, _ = hadalens.simulate(small, tmp_path / "camera", pairs=3, tests=1, test_depths=1)
    model = hadalens.fit(pairs)
    assert model.flat is None
    even = tifffile.imread(tmp_path / "camera/test/raw/test01.tif")
    across = np.linspace(-1, 1, 80)
    flat = np.tile(1.3 - 0.9 * across**2, (64, 1)).astype(np.float32)
    expected = hadalens.Plan(model).run(even).stack
    got = hadalens.Plan(model, flat_frame=flat).run(even * flat / flat.mean()).stack
    without = hadalens.Plan(model).run(even * flat / flat.mean()).stack
    size = np.linalg.norm(expected)
    assert np.linalg.norm(got - expected) < 0.1 * size < np.linalg.norm(without - expected)
    with pytest.raises(ValueError, match="flat_frame"):
        hadalens.Plan(model, flat_frame=flat[1:])


def test_mosaics(program: Any, tmp_path: Path) -> None:
    """A camera that is learned from pairs of mosaics takes frames of one channel; its program gives the same bits."""
    small = hadalens.Camera("sim300", rows=64, cols=80, window_rows=24, window_cols=24, lenses=9)
    small.set_depths(100, 100, 1)
    pairs, _ = hadalens.simulate(small, tmp_path / "camera", pairs=3, tests=1, test_depths=1, mosaic="gbrg")
    assert pairs.read(0, 0)[0].shape == (3, 64, 80)
    model = hadalens.fit(pairs)
    assert model.info.mosaic == "gbrg"
    frame = tmp_path / "camera/test/raw/test01.tif"
    raw = tifffile.imread(frame)
    assert raw.shape == (64, 80)
    np.testing.assert_array_equal(hadalens.fit(tmp_path / "camera", mosaic="gbrg").otf, model.otf)
    known = hadalens.Plan(model).run(raw).stack
    assert known.shape == (1, 3, 24, 24)
    np.testing.assert_array_equal(known, hadalens.Plan(model, mosaic="gbrg").run(raw).stack)
    assert not np.array_equal(known, hadalens.Plan(model, mosaic="rggb").run(raw).stack)
    model.save(tmp_path / "camera.model")
    program("reconstruct", frame, "-m", tmp_path / "camera.model", "-o", tmp_path, "--no-preview")
    np.testing.assert_array_equal(known, tifffile.imread(tmp_path / "test01_stack.tif").reshape(known.shape))
    with pytest.raises(hadalens.ModelError, match="mosaic='rggb'"):
        hadalens.Plan(model, mosaic="none").run(raw)
    arrays = hadalens.Dataset({100.0: [(raw, np.zeros((3, 24, 24), np.float32))]}, mosaic="gbrg")
    np.testing.assert_array_equal(arrays.read(0, 0)[0][1, ::2, ::2], raw[::2, ::2])
    fitter = hadalens.Fitter([100.0], (64, 80), window=(24, 24), channels=3, mosaic="gbrg")
    fitter.add(0, raw, pairs.read(0, 0)[1])
    assert fitter.finish().info.mosaic == "gbrg"


def test_downsample(tmp_path: Path) -> None:
    """A camera learned from binned pairs bins frames of the sensor: what arrays that were binned before give."""
    small = hadalens.Camera("sim300", rows=128, cols=160, window_rows=48, window_cols=48, lenses=9)
    small.set_depths(100, 100, 1)
    hadalens.simulate(small, tmp_path / "camera", pairs=3, tests=1, test_depths=1, mosaic="gbrg")
    pairs = hadalens.Dataset.scan(tmp_path / "camera", mosaic="gbrg", downsample=2)
    raw, scene = pairs.read(0, 0)
    assert (raw.shape, scene.shape) == ((3, 64, 80), (3, 24, 24))
    model = hadalens.fit(pairs)
    assert (model.info.downsample, model.info.sensor_mosaic, model.info.mosaic) == (2, "gbrg", "none")
    np.testing.assert_array_equal(hadalens.fit(tmp_path / "camera", mosaic="gbrg", downsample=2).otf, model.otf)
    frame = tifffile.imread(tmp_path / "camera/test/raw/test01.tif")
    binned = hadalens.downsample(frame, 2, mosaic="gbrg", keep_saturated=True)
    np.testing.assert_array_equal(binned[0], frame[1::2, ::2])
    np.testing.assert_allclose(binned[1], (frame[::2, ::2] + frame[1::2, 1::2]) / 2, rtol=1e-6)
    known = hadalens.Plan(model).run(frame).stack
    np.testing.assert_array_equal(known, hadalens.Plan(model).run(binned).stack)
    even = np.full((128, 160), 0.5, np.float32)
    told = hadalens.Plan(model, dark=0 * even, flat_frame=even, downsample=2, mosaic="gbrg")
    np.testing.assert_array_equal(known, told.run(frame).stack)
    with pytest.raises(hadalens.ModelError, match="128 x 160"):
        hadalens.Plan(model, downsample=1).run(frame)
    with pytest.raises(ValueError, match="even number"):
        hadalens.downsample(frame, 3, mosaic="gbrg")
    psf = tifffile.imread(tmp_path / "camera/psf.tif").reshape(128, 160)
    made = hadalens.Model.from_psf(hadalens.downsample(np.stack([psf] * 3), 2), 100.0, downsample=2, mosaic="gbrg")
    assert hadalens.Plan(made).run(frame).stack.shape == (1, 3, 64, 80)
    files = sorted((tmp_path / "camera").glob("z*/raw/*"))
    arrays = [(tifffile.imread(file), np.zeros((3, 48, 48), np.float32)) for file in files]
    fitter = hadalens.Fitter([100.0], (64, 80), window=(24, 24), channels=3, mosaic="gbrg", downsample=2)
    fitter.add(0, arrays[0][0], np.random.default_rng(1).random((3, 48, 48)))
    assert fitter.finish().info.sensor_mosaic == "gbrg"
    divided = hadalens.Dataset({100.0: arrays}, mosaic="gbrg", downsample=2, flat_frame=even, flat_dark=None)
    np.testing.assert_allclose(divided.read(0, 0)[0][1, 0, 0], arrays[0][0][[0, 1], [0, 1]].mean(), rtol=1e-5)


def test_exposures(tmp_path: Path) -> None:
    """Exposures of one scene become one frame with weights, from arrays and from files."""
    light = np.random.default_rng(3).random((1, 48, 60)) ** 2
    frames = [np.minimum(0.05 + length * light, 1).astype(np.float32) for length in (0.3, 4.0)]
    merged, weights, lengths, dark = hadalens.merge_exposures(*reversed(frames))
    np.testing.assert_allclose(merged, frames[0], atol=1e-5)
    np.testing.assert_allclose(lengths, (4 / 0.3, 1), rtol=1e-4)
    assert abs(dark - 0.05) < 1e-4
    np.testing.assert_allclose(weights[frames[1] > 0.995], 0.3 / 4.3, rtol=1e-4)
    for i, frame in enumerate(frames):
        tifffile.imwrite(tmp_path / f"{i}.tif", frame[0])
    loaded = hadalens.load_exposures(tmp_path / "1.tif", tmp_path / "0.tif")
    np.testing.assert_array_equal(loaded[0], merged)
    np.testing.assert_array_equal(loaded[1], weights)
    model = hadalens.Model.from_psf(np.eye(48, 60, dtype=np.float32)[::-1], 100.0, dark=dark)
    plan = hadalens.Plan(model, pixel_weights=weights)
    hadalens.reconstruct_files(plan, [tmp_path / "0.tif"], tmp_path, preview=False, frame=merged)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "0_aif.tif"), plan.run(merged).all_in_focus[0])
    with pytest.raises(hadalens.NumericError, match="same scene"):
        hadalens.merge_exposures(frames[0], 1 - frames[1])
    with pytest.raises(FileNotFoundError):
        hadalens.load_exposures(tmp_path / "2.tif")


def test_sequences(model: hadalens.Model, raw: npt.NDArray[Any]) -> None:
    """Frames of a warm plan go on from the one before, in fewer steps; those of others do not."""
    for warm in (False, True):
        plan = hadalens.Plan(model, warm_start=warm, scene="planes", skip=())
        first, second = plan.run(raw).report, plan.run(raw).report
        assert (first.warm_started, second.warm_started) == (False, warm)
        assert (first.gain, second.gain) == (0.0, 1.0 if warm else 0.0)
        assert second.refine_steps < first.refine_steps if warm else second.refine_steps == first.refine_steps


def test_emitters() -> None:
    """A point is found where it is; other scenes, and cameras of colours, are refused with a reason."""
    row, col = np.indices((64, 64))
    spots = [(30, 20, 1.0), (44, 40, 0.7), (18, 45, 0.5), (35, 33, 0.8)]
    psf = sum(light * np.exp(-((row - y) ** 2 + (col - x) ** 2) / 2.5) for y, x, light in spots)
    camera = hadalens.Model.from_psf(np.asarray(psf, np.float32)[None], [20.0], psf_dark=0.0)
    frame = np.roll(np.asarray(psf, np.float32), (3, -2), (0, 1))
    found = hadalens.Plan(camera, scene="volume").emitters(frame)
    assert len(found) == 1
    assert abs(found["y"][0] - 35) < 0.01
    assert abs(found["x"][0] - 30) < 0.01
    assert found["z"][0] == 0
    with pytest.raises(ValueError, match="volume"):
        hadalens.Plan(camera, scene="planes").emitters(frame)
    later = found.copy()
    later["x"] += 1.5
    table = hadalens.track_emitters([found, found[:0], later, np.concatenate([later, found])])
    assert table["track"].tolist() == [0, 0, 0, 1]
    assert table["frame"].tolist() == [0, 2, 3, 3]
    assert table["amplitude"][0] == found["amplitude"][0]
    with pytest.raises(ValueError, match="largest motion"):
        hadalens.track_emitters([], pixels=-1)
