"""The DiffuserCam layout, and folders of TIFF files, on small data sets made here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from hadalens import datasets

ROWS, COLS = 6, 8
rng = np.random.default_rng(16)


@pytest.fixture
def diffusercam(tmp_path: Path) -> Path:
    """Four frames of a small data set."""
    for folder in ("diffuser_images", "ground_truth_lensed"):
        (tmp_path / folder).mkdir()
        for name in ("im1", "im2", "im10", "im20"):
            np.save(tmp_path / folder / f"{name}.npy", rng.random((ROWS, COLS, 3), np.float32))
    (tmp_path / "dataset_train.csv").write_text("im10.jpg.tiff\nim2.jpg.tiff\n")
    (tmp_path / "dataset_test.csv").write_text("name\nim20.jpg.tiff\n\n")
    return tmp_path


def test_lists(diffusercam: Path, tmp_path: Path) -> None:
    """Lists, and slices, which are data sets; samples in a folder of their own."""
    assert datasets.DiffuserCam(diffusercam).names == ("im10", "im2")
    assert datasets.DiffuserCam(diffusercam, "test").names == ("im20",)
    pairs = datasets.DiffuserCam(diffusercam, "all")
    assert pairs.names == ("im1", "im2", "im10", "im20")
    part = pairs[1:3]
    assert isinstance(part, datasets.DiffuserCam)
    assert part.names == ("im2", "im10")
    assert np.array_equal(part[-1].raw, pairs[2].raw)
    assert len(list(part)) == 2
    for folder in ("diffuser", "lensed"):
        (tmp_path / "own/dataset" / folder).mkdir(parents=True)
        np.save(tmp_path / "own/dataset" / folder / "im3.npy", np.zeros((ROWS, COLS, 3), np.float32))
    assert datasets.DiffuserCam(tmp_path / "own", "all").names == ("im3",)


def test_upright_and_red_first(diffusercam: Path) -> None:
    """Upright and red first; integers become shares of full scale."""
    stored = np.zeros((ROWS, COLS, 3), np.float32)
    stored[0, 2, 2] = 1  # red, at the bottom of what one sees
    np.save(diffusercam / "ground_truth_lensed" / "im1.npy", stored)
    scene = datasets.DiffuserCam(diffusercam, "all")[0].scene
    assert scene.shape == (3, ROWS, COLS)
    assert scene.dtype == np.float32
    assert scene[0, ROWS - 1, 2] == 1
    assert scene.sum() == 1


def test_psf_is_averaged_to_the_frames_size(diffusercam: Path) -> None:
    """Psf is averaged to the frames size."""
    psf = np.zeros((3, 4 * ROWS, 4 * COLS), np.float32)
    psf[1, 0:4, 4:8] = 0.5  # at the top of the file: at the bottom of the upright frame
    tifffile.imwrite(diffusercam / "psf.tiff", np.moveaxis(psf, 0, -1), photometric="rgb")
    small = datasets.DiffuserCam(diffusercam).psf()
    assert small.shape == (3, ROWS, COLS)
    assert small[1, ROWS - 1, 1] == 0.5
    assert small.sum() == 0.5
    tifffile.imwrite(diffusercam / "psf.tiff", np.moveaxis(psf[:, 1:], 0, -1), photometric="rgb")
    with pytest.raises(ValueError, match="no multiple"):
        datasets.DiffuserCam(diffusercam).psf()


def test_what_is_wrong_is_said(diffusercam: Path, tmp_path: Path) -> None:
    """What is wrong is said."""
    with pytest.raises(FileNotFoundError, match="no DiffuserCam data set"):
        datasets.DiffuserCam(tmp_path / "diffuser_images")
    with pytest.raises(ValueError, match="not 'valid'"):
        datasets.DiffuserCam(diffusercam, "valid")  # type: ignore[arg-type]
    (diffusercam / "dataset_train.csv").write_text("im1.jpg.tiff\nim7.jpg.tiff\n")
    with pytest.raises(FileNotFoundError, match=r"im7, and there is no frame im7\.npy"):
        datasets.DiffuserCam(diffusercam)
    (diffusercam / "dataset_train.csv").write_text("name\n")
    with pytest.raises(ValueError, match="names no frame"):
        datasets.DiffuserCam(diffusercam)
    np.save(diffusercam / "diffuser_images" / "im1.npy", np.zeros((3, ROWS, COLS), np.float32))
    with pytest.raises(ValueError, match="not the"):
        datasets.DiffuserCam(diffusercam, "all")[0]


def test_folders(diffusercam: Path, tmp_path: Path) -> None:
    """Folders."""
    pairs = datasets.DiffuserCam(diffusercam)
    place = datasets.write_folder(pairs, tmp_path / "camera", 250.5)
    assert place == tmp_path / "camera" / "z250.5mm"
    assert sorted(path.name for path in (place / "raw").iterdir()) == ["im10.tif", "im2.tif"]
    for name, pair in zip(pairs.names, pairs, strict=True):
        assert np.array_equal(datasets._read(place / "raw" / f"{name}.tif"), pair.raw)
        assert np.array_equal(datasets._read(place / "scene" / f"{name}.tif"), pair.scene)
    with pytest.raises(FileExistsError):
        datasets.write_folder(pairs, tmp_path / "camera", 250.5)


def test_folders_of_arrays(tmp_path: Path) -> None:
    """Folders of arrays."""
    frames = rng.integers(0, 65535, (3, ROWS, COLS, 3), np.uint16)
    scenes = rng.random((3, ROWS, COLS, 3))
    place = datasets.write_folder(zip(frames, scenes, strict=True), tmp_path, 40, channel_axis=-1)
    raw = datasets._read(place / "raw" / "00002.tif")
    assert np.array_equal(raw, (np.moveaxis(frames[2], -1, 0) / 65535).astype(np.float32))
    with pytest.raises(ValueError, match="no pair"):
        datasets.write_folder([], tmp_path, 50)
    with pytest.raises(ValueError, match="zip"):
        datasets.write_folder(zip(frames, scenes, strict=True), tmp_path, 60, channel_axis=-1, names=["one"])
    with pytest.raises(TypeError, match="int64"):
        datasets.write_folder([(np.zeros((2, 2), np.int64), np.zeros((2, 2)))], tmp_path, 70)
    assert not list((tmp_path / "z70mm" / "raw").iterdir())


def picture(file: Path, array: np.ndarray) -> None:
    """Write a PNG or JPEG file."""
    pillow = pytest.importorskip("PIL.Image")
    file.parent.mkdir(parents=True, exist_ok=True)
    pillow.fromarray(array).save(file)


def test_two_folders(tmp_path: Path) -> None:
    """Pictures of the same names, whatever their files; the last are for the test."""
    for i in range(10):
        picture(tmp_path / "raw" / f"f{i}.png", np.full((4, 6, 3), 10 * i, np.uint8))
        (tmp_path / "scene").mkdir(exist_ok=True)
        np.save(tmp_path / "scene" / f"f{i}.npy", np.full((3, 5), i, np.float32))
    pairs = datasets.Folders(tmp_path / "raw", tmp_path / "scene", "train")
    assert pairs.names == tuple(f"f{i}" for i in range(8))
    assert datasets.Folders(tmp_path / "raw", tmp_path / "scene", "test", held_out=3).names == ("f7", "f8", "f9")
    assert pairs[3].raw.shape == (3, 4, 6)
    assert pairs[3].raw[0, 0, 0] == np.float32(30 / 255)
    assert pairs[3].scene.shape == (1, 3, 5)
    with pytest.raises(FileNotFoundError, match="same names"):
        datasets.Folders(tmp_path / "raw", tmp_path)


def test_multiwienernet(tmp_path: Path) -> None:
    """Cut as the authors cut; a fifth, the same one each time, is for the test."""
    for i in range(5):
        for folder in ("Train", "Target"):
            picture(tmp_path / folder / f"{i}.png", np.full((486, 648), i, np.uint8))
    train, test = (datasets.MultiWienerNet(tmp_path, split) for split in ("train", "test"))
    assert (len(train), len(test)) == (4, 1)
    assert sorted(train.names + test.names) == ["0", "1", "2", "3", "4"]
    assert train.names == datasets.MultiWienerNet(tmp_path, "train").names
    assert test[0].raw.shape == test[0].scene.shape == (1, 448, 640)


def test_parallel_lensless(tmp_path: Path) -> None:
    """Frames at the size of the scenes that are warped to this camera."""
    for i in (23, 24):
        for place, size in (
            (f"0-25k/rml/img_{i}_cam_1.tiff", (8, 12, 3)),
            (f"0-25k/diffusercam/img_{i}_cam_0.tiff", (8, 12, 3)),
            (f"4x_undistorted_GT2RML/warped_4x_undistorted_img_{i}_cam_2.tiff", (2, 3, 4)),
        ):
            (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
            tifffile.imwrite(tmp_path / place, np.full(size, i, np.uint8), photometric="rgb")
    assert datasets.ParallelLensless(tmp_path, "rml", "all").names == ("23", "24")
    assert datasets.ParallelLensless(tmp_path, "rml").names == ("23",)
    test = datasets.ParallelLensless(tmp_path, "rml", "test")
    assert test.names == ("24",)
    assert test[0].raw.shape == test[0].scene.shape == (3, 2, 3)
    assert np.allclose(test[0].raw, 24 / 255)
    with pytest.raises(FileNotFoundError, match="diffusercam"):
        datasets.ParallelLensless(tmp_path, "diffusercam")


def test_flatcam(tmp_path: Path) -> None:
    """Lists of paths; a mosaic of 16 bits, and a photograph of another size."""
    (tmp_path / "filenames").mkdir()
    for part in ("train", "val"):
        for kind, ending in (("meas", "png"), ("orig", "jpg")):
            names = [f"data/{kind}/{part}{i}.{ending}" for i in range(2)]
            (tmp_path / "filenames" / f"{part}_{kind}_ilsvrc_flatcam.txt").write_text("\n".join(names) + "\n")
            (tmp_path / "filenames" / f"{part}_{kind}_ilsvrc_flatcam_smaller.txt").write_text(names[0])
            for name in names:
                size, kind_of = ((16, 20), np.uint16) if kind == "meas" else ((50, 40, 3), np.uint8)
                picture(tmp_path / name, np.full(size, 200, kind_of))
    pairs = datasets.FlatCam(tmp_path, "test")
    assert pairs.mosaic == "bggr"
    assert pairs.names == ("data/meas/val0", "data/meas/val1")
    assert len(datasets.FlatCam(tmp_path, "all")) == 4
    assert pairs[0].raw.shape == (1, 16, 20)
    assert pairs[0].raw[0, 0, 0] == np.float32(200 / 65535)
    assert pairs[0].scene.shape == (3, 256, 256)
    place = datasets.write_folder(pairs, tmp_path / "camera")
    assert sorted(path.name for path in (place / "raw").iterdir()) == ["val0.tif", "val1.tif"]
    (tmp_path / "filenames" / "train_orig_ilsvrc_flatcam.txt").write_text("one")
    with pytest.raises(ValueError, match="2 and 1 lines"):
        datasets.FlatCam(tmp_path)
    with pytest.raises(FileNotFoundError, match="no list"):
        datasets.FlatCam(tmp_path / "data")


def test_hugging_face(tmp_path: Path) -> None:
    """Tables of pictures, several files and groups of rows, turned upright."""
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    rows = []
    for i in range(5):
        row = {}
        for kind in ("lensless", "lensed"):
            frame = np.zeros((4, 6, 3), np.uint8)
            frame[0, 0] = 51 * (i + 1)
            picture(tmp_path / f"{i}.png", frame)
            row[kind] = {"bytes": (tmp_path / f"{i}.png").read_bytes(), "path": f"{i}.png"}
        rows.append({**row, "mask_label": 7 + i})
    (tmp_path / "data").mkdir()
    for name, part in (("train-00000-of-00002", rows[:3]), ("train-00001-of-00002", rows[3:4]), ("test-0", rows[4:])):
        parquet.write_table(arrow.Table.from_pylist(part), tmp_path / "data" / f"{name}.parquet", row_group_size=2)
    train = datasets.HuggingFace(tmp_path)
    assert len(train) == 4
    assert [train.mask(i) for i in range(4)] == [7, 8, 9, 10]
    for i in range(4):
        assert train[i].raw[0, 3, 5] == train[i].scene[0, 0, 0] == np.float32(0.2 * (i + 1))
    assert len(train[1:3]) == 2
    assert train[1:3].mask(0) == 8
    flipped = datasets.HuggingFace(tmp_path, "test", turn="flip")
    assert flipped[0].raw[0, 3, 0] == 1
    assert len(datasets.HuggingFace(tmp_path, "all")) == 5
    with pytest.raises(FileNotFoundError, match="no tables"):
        datasets.HuggingFace(tmp_path / "nothing")
