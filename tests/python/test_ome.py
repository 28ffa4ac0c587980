"""OME-Zarr and OME-TIFF, read back by other software."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hadalens import ome

rng = np.random.default_rng(5)


@dataclass
class Result:
    """What is written of a result, made of numbers."""

    distances_mm: tuple[float, ...] = (100.0, 150.0, 250.0)
    stack: npt.NDArray[Any] = field(default_factory=lambda: rng.random((3, 3, 8, 10), np.float32))
    all_in_focus: npt.NDArray[Any] = field(default_factory=lambda: rng.random((3, 8, 10), np.float32))
    distance_map: npt.NDArray[Any] = field(
        default_factory=lambda: np.where(rng.random((8, 10)) < 0.2, np.nan, 150).astype("f4")
    )


def test_steps() -> None:
    """Steps."""
    assert ome.is_even([100, 150, 200])
    assert ome.is_even([100])
    assert ome.is_even([100, 200])
    assert not ome.is_even([100, 150, 250])
    assert ome.mean_step([100, 150, 250]) == 75
    assert ome.mean_step([7]) == 1


def test_zarr_of_times(tmp_path: Path) -> None:
    """Zarr of times."""
    zarr = pytest.importorskip("zarr", "3.0")
    results = [Result(), Result()]
    with ome.OmeZarrWriter(tmp_path / "film.zarr", pixel_um=2.5, seconds=0.1) as writer:
        for result in results:
            writer.append(result)
    group = zarr.open_group(tmp_path / "film.zarr", mode="r")
    for time, result in enumerate(results):
        assert np.array_equal(group["0"][time], result.stack.transpose(1, 0, 2, 3))
        assert np.array_equal(group["all_in_focus/0"][time], result.all_in_focus)
        assert np.array_equal(group["distance_map/0"][time], result.distance_map, equal_nan=True)
    assert group.attrs["hadalens"]["distances_mm"] == [100, 150, 250]
    assert group.attrs["hadalens"]["even"] is False
    images = group.attrs["ome"]["multiscales"][0]
    assert [axis["name"] for axis in images["axes"]] == list("tczyx")
    assert [axis.get("unit") for axis in images["axes"]] == ["second", None, "millimeter", "micrometer", "micrometer"]
    scale, start = images["datasets"][0]["coordinateTransformations"]
    assert scale["scale"] == [0.1, 1, 75, 2.5, 2.5]
    assert start["translation"] == [0, 0, 100, 0, 0]
    assert [path.name for path in tmp_path.iterdir()] == ["film.zarr"]


def test_zarr_in_the_reader_of_ome(tmp_path: Path) -> None:
    """The package ome-zarr reads the stack."""
    pytest.importorskip("zarr", "3.0")
    reader = pytest.importorskip("ome_zarr.reader")
    result = Result()
    ome.write_ome_zarr(tmp_path / "a.zarr", result)
    from ome_zarr.io import parse_url

    (node, *_) = reader.Reader(parse_url(str(tmp_path / "a.zarr")))()
    assert np.array_equal(np.asarray(node.data[0])[0], result.stack.transpose(1, 0, 2, 3))


def test_zarr_is_whole_or_not_there(tmp_path: Path) -> None:
    """Zarr is whole or not there."""
    pytest.importorskip("zarr", "3.0")
    path = tmp_path / "a.zarr"

    def cut_off() -> None:
        with ome.OmeZarrWriter(path) as writer:
            writer.append(Result())
            raise RuntimeError("cut")

    with pytest.raises(RuntimeError, match="cut"):
        cut_off()
    with ome.OmeZarrWriter(path):
        pass
    assert not list(tmp_path.iterdir())
    ome.write_ome_zarr(path, Result())
    with pytest.raises(FileExistsError):
        ome.write_ome_zarr(path, Result())
    small = Result(stack=np.zeros((3, 1, 8, 10), "f4"), all_in_focus=np.zeros((1, 8, 10), "f4"))
    with ome.OmeZarrWriter(path, overwrite=True) as writer:
        writer.append(Result())
        with pytest.raises(ValueError, match="does not fit"):
            writer.append(small)
    with pytest.raises(ValueError, match="closed"):
        writer.append(Result())


def test_uneven_distances(tmp_path: Path) -> None:
    """A coordinate beside the image, or planes at equal steps that keep the first and the last."""
    zarr = pytest.importorskip("zarr", "3.0")
    result = Result()
    ome.write_ome_zarr(tmp_path / "a.zarr", result)
    z = zarr.open_group(tmp_path / "a.zarr", mode="r")["z"]
    assert z.metadata.dimension_names == ("z",)
    assert list(z[:]) == [100, 150, 250]
    planes, distances = ome.even_planes(result.stack, result.distances_mm)
    assert distances == (100, 150, 200, 250)
    np.testing.assert_allclose(planes[2], (result.stack[1] + result.stack[2]) / 2, rtol=1e-6)
    assert np.array_equal(planes[[0, 1, 3]], result.stack)
    planes, _ = ome.even_planes(result.stack, result.distances_mm, "nearest")
    assert np.array_equal(planes, result.stack[[0, 1, 1, 2]])
    same, distances = ome.even_planes(result.stack, (1.0, 2.0, 3.0))
    assert same is result.stack
    with pytest.raises(ValueError, match="planes would be needed"):
        ome.even_planes(result.stack, (100.0, 100.01, 250.0))
    ome.write_ome_zarr(tmp_path / "b.zarr", result, resample="linear")
    group = zarr.open_group(tmp_path / "b.zarr", mode="r")
    assert group["0"].shape == (1, 3, 4, 8, 10)
    moves = group.attrs["ome"]["multiscales"][0]["datasets"][0]["coordinateTransformations"]
    assert moves[0]["scale"] == [1, 1, 50, 1, 1]
    assert group.attrs["hadalens"]["even"] is True
    with pytest.raises(ValueError, match="resample"):
        ome.OmeZarrWriter(tmp_path / "c.zarr", resample="cubic")  # type: ignore[arg-type]


def test_pyramid(tmp_path: Path) -> None:
    """Levels of half the size, their places, means of light, and distances that somebody measured."""
    zarr = pytest.importorskip("zarr", "3.0")
    models = pytest.importorskip("ome_zarr_models.v05")
    result = Result()
    result.distance_map[:2, :2] = [[np.nan, 7], [8, 9]]
    result.distance_map[:2, 2:4] = np.nan
    ome.write_ome_zarr(tmp_path / "a.zarr", result, levels=3, pixel_um=2.0)
    group = zarr.open_group(tmp_path / "a.zarr", mode="r")
    assert [group[str(level)].shape[-2:] for level in range(3)] == [(8, 10), (4, 5), (2, 2)]
    first = group["1"][0, 1, 2, 0, 0]
    np.testing.assert_allclose(first, result.stack[2, 1, :2, :2].mean(), rtol=1e-6)
    small = group["distance_map/1"][0]
    assert small[0, 0] == 7
    assert np.isnan(small[0, 1])
    moves = group.attrs["ome"]["multiscales"][0]["datasets"][2]["coordinateTransformations"]
    assert moves[0]["scale"] == [1, 1, 75, 8, 8]
    assert moves[1]["translation"] == [0, 0, 100, 3, 3]
    for name in ("", "all_in_focus", "distance_map"):
        image = models.Image.from_zarr(zarr.open_group(tmp_path / "a.zarr" / name, mode="r"))
        assert image.ome_attributes.version == "0.5"
    big = Result(stack=np.zeros((3, 1, 600, 700), "f4"), all_in_focus=np.zeros((1, 600, 700), "f4"))
    big.distance_map = np.zeros((600, 700), "f4")
    ome.write_ome_zarr(tmp_path / "b.zarr", big)
    assert ome.OmeZarr(tmp_path / "b.zarr").levels == 3
    with pytest.raises(ValueError, match="levels"):
        ome.OmeZarrWriter(tmp_path / "c.zarr", levels=0)


def test_reading_back(tmp_path: Path) -> None:
    """Every number comes back, also of levels; images of others have what they say."""
    zarr = pytest.importorskip("zarr", "3.0")
    results = [Result(), Result()]
    with ome.OmeZarrWriter(tmp_path / "film.zarr", pixel_um=2.5, seconds=0.1, levels=2) as writer:
        for result in results:
            writer.append(result)
    film = ome.OmeZarr(tmp_path / "film.zarr")
    assert (len(film), film.levels, film.pixel_um, film.seconds) == (2, 2, 2.5, 0.1)
    assert film.distances_mm == (100, 150, 250)
    for read, result in zip(film, results, strict=True):
        assert np.array_equal(read.stack, result.stack)
        assert read.all_in_focus is not None
        assert np.array_equal(read.all_in_focus, result.all_in_focus)
        assert read.distance_map is not None
        assert np.array_equal(read.distance_map, result.distance_map, equal_nan=True)
    assert np.array_equal(film[-1].stack, film[0:2][1].stack)
    small = ome.read_ome_zarr(tmp_path / "film.zarr", 1, level=1)
    assert small.stack.shape == (3, 3, 4, 5)
    assert ome.OmeZarr(tmp_path / "film.zarr", 1).pixel_um == 5
    with pytest.raises(IndexError):
        film[2]
    with pytest.raises(ValueError, match="level"):
        ome.OmeZarr(tmp_path / "film.zarr", 2)
    other = zarr.open_group(tmp_path / "other.zarr", mode="w", zarr_format=2)  # of version 0.4
    other.create_array("s0", shape=(4, 5, 6), dtype="uint8")[:] = np.arange(120, dtype=np.uint8).reshape(4, 5, 6)
    with pytest.raises(ValueError, match="multiscales"):
        ome.OmeZarr(tmp_path / "other.zarr")
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    moves = [{"type": "scale", "scale": [500.0, 0.5, 0.5]}, {"type": "translation", "translation": [2000.0, 0, 0]}]
    other.attrs["multiscales"] = [{"axes": axes, "datasets": [{"path": "s0", "coordinateTransformations": moves}]}]
    theirs = ome.OmeZarr(tmp_path / "other.zarr")
    assert (len(theirs), theirs.pixel_um, theirs.seconds) == (1, 0.5, None)
    assert theirs.distances_mm == (2, 2.5, 3, 3.5)
    assert theirs[0].stack.shape == (4, 1, 5, 6)
    assert theirs[0].stack[3, 0, 4, 5] == 119
    assert theirs[0].all_in_focus is None


def test_tiff(tmp_path: Path) -> None:
    """Tiff."""
    tifffile = pytest.importorskip("tifffile")
    result = Result()
    ome.write_ome_tiff(tmp_path / "a.ome.tif", result, pixel_um=2.5)
    with tifffile.TiffFile(tmp_path / "a.ome.tif") as file:
        assert file.is_ome
        assert file.series[0].axes == "ZCYX"
        assert np.array_equal(file.asarray(), result.stack)
        root = ET.fromstring(file.ome_metadata)
    space = {"ome": "http://www.openmicroscopy.org/Schemas/OME/2016-06"}
    pixels = root.find(".//ome:Pixels", space)
    assert pixels is not None
    assert (pixels.get("PhysicalSizeZ"), pixels.get("PhysicalSizeZUnit"), pixels.get("PhysicalSizeX")) == (
        "75.0",
        "mm",
        "2.5",
    )
    for plane in root.findall(".//ome:Plane", space):
        assert float(plane.get("PositionZ", "nan")) == result.distances_mm[int(plane.get("TheZ", "-1"))]
        assert plane.get("PositionZUnit") == "mm"
    assert len(root.findall(".//ome:Plane", space)) == 9
