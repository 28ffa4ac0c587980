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


def test_lists(diffusercam: Path) -> None:
    """Lists."""
    assert datasets.DiffuserCam(diffusercam).names == ("im10", "im2")
    assert datasets.DiffuserCam(diffusercam, "test").names == ("im20",)
    assert datasets.DiffuserCam(diffusercam, "all").names == ("im1", "im2", "im10", "im20")


def test_upright_and_red_first(diffusercam: Path) -> None:
    """Upright and red first."""
    stored = np.zeros((ROWS, COLS, 3), np.float32)
    stored[0, 2, 2] = 1  # red, at the bottom of what one sees
    np.save(diffusercam / "ground_truth_lensed" / "im1.npy", stored)
    scene = datasets.DiffuserCam(diffusercam, "all")[0].scene
    assert scene.shape == (3, ROWS, COLS)
    assert scene.dtype == np.float32
    assert scene[0, ROWS - 1, 2] == 1
    assert scene.sum() == 1


def test_slices_are_data_sets(diffusercam: Path) -> None:
    """Slices are data sets."""
    pairs = datasets.DiffuserCam(diffusercam, "all")
    part = pairs[1:3]
    assert isinstance(part, datasets.DiffuserCam)
    assert part.names == ("im2", "im10")
    assert np.array_equal(part[-1].raw, pairs[2].raw)
    assert len(list(part)) == 2


def test_integers_become_shares_of_full_scale(diffusercam: Path) -> None:
    """Integers become shares of full scale."""
    np.save(diffusercam / "diffuser_images" / "im1.npy", np.full((ROWS, COLS, 3), 51, np.uint8))
    assert np.all(datasets.DiffuserCam(diffusercam, "all")[0].raw == np.float32(0.2))


def test_samples_in_a_folder_of_their_own(tmp_path: Path) -> None:
    """Samples in a folder of their own."""
    for folder in ("diffuser", "lensed"):
        (tmp_path / "dataset" / folder).mkdir(parents=True)
        np.save(tmp_path / "dataset" / folder / "im3.npy", np.zeros((ROWS, COLS, 3), np.float32))
    assert datasets.DiffuserCam(tmp_path, "all").names == ("im3",)


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
        datasets.DiffuserCam(diffusercam, "valid")
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
