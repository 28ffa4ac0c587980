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


def test_zarr_as_others_read_it(tmp_path: Path) -> None:
    """Zarr as others read it."""
    models = pytest.importorskip("ome_zarr_models.v05")
    zarr = pytest.importorskip("zarr", "3.0")
    result = Result()
    ome.write_ome_zarr(tmp_path / "a.zarr", result)
    for name in ("", "all_in_focus", "distance_map"):
        image = models.Image.from_zarr(zarr.open_group(tmp_path / "a.zarr" / name, mode="r"))
        assert image.ome_attributes.version == "0.5"


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
