"""Reads models (their point spread functions), what ``hadalens reconstruct`` writes, and OME-Zarr of Hadalens."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from hadalens._files import extra
from numpy.typing import NDArray

from ._layers import LayerData, image_layer, map_layers, stack_layer, stacked_layers, white_of

Reader = Callable[[str | Sequence[str]], list[LayerData]]


def get_reader(path: str | Sequence[str]) -> Reader | None:
    """Return the reader of these files; None where they are not ours."""
    paths = [path] if isinstance(path, str) else list(path)
    return read if paths and all(_is_ours(Path(one)) for one in paths) else None


def read(path: str | Sequence[str]) -> list[LayerData]:
    """Return the layers of files."""
    paths = [path] if isinstance(path, str) else path
    return [layer for one in map(Path, paths) for layer in _kind(one)(one)]


def _kind(path: Path) -> Callable[[Path], list[LayerData]]:
    return _zarr if path.is_dir() else _model if _is_model(path) else _picture


def _is_ours(path: Path) -> bool:
    try:
        if path.is_dir():
            return "hadalens" in json.loads((path / "zarr.json").read_text()).get("attributes", {})
        return _is_model(path) or "hadalens" in _lines(path)
    except (OSError, ValueError):  # missing, or no TIFF file
        return False


def _header(path: Path) -> dict[str, str]:
    """Return the metadata of a safetensors file; none for other files."""
    with open(path, "rb") as file:
        size = int.from_bytes(file.read(8), "little")
        if size > path.stat().st_size:
            return {}
        try:
            found = json.loads(file.read(size)).get("__metadata__", {})
        except (ValueError, AttributeError):
            return {}
    return dict(found)


def _is_model(path: Path) -> bool:
    return path.suffix in (".model", ".safetensors") and _header(path).get("format") == "hadalens-model"


def _model(path: Path) -> list[LayerData]:
    """Return the point spread functions, the optical axis in the middle; without them, the filters the same way."""
    from safetensors.numpy import load_file

    tensors = load_file(path)
    rows, cols = (int(size) for size in _header(path)["grid"].split("x"))
    half = tensors["otf" if "otf" in tensors else "filter"].astype(np.float32).view(np.complex64)[..., 0]
    psf = np.fft.fftshift(np.fft.irfft2(half, s=(rows, cols)), axes=(-2, -1)).astype(np.float32)
    kind = "point spread functions" if "otf" in tensors else "filters"
    data, options, layer = stack_layer(psf, [float(d) for d in tensors["distances_mm"]], f"{path.stem}: {kind}")
    options["metadata"] |= {"hadalens_model": str(path)}
    return [(data, options, layer)]


def _lines(path: Path) -> dict[str, str]:
    """Return the lines KEY=VALUE of a TIFF file's description, keys in small letters."""
    with tifffile.TiffFile(path) as file:
        return {
            key.lower(): value
            for key, _, value in (line.partition("=") for line in file.pages[0].description.splitlines())
        }


def _picture(path: Path) -> list[LayerData]:
    lines = _lines(path)
    with tifffile.TiffFile(path) as file:
        image, pages, colours = file.asarray(), len(file.pages), file.pages[0].samplesperpixel
    scale = float(lines.get("value_scale", 1))
    if image.dtype.kind == "u":
        image = image * np.float32(scale / float(lines.get("full_scale", np.iinfo(image.dtype).max)))
    image = image.astype(np.float32)
    name, _, kind = path.stem.rpartition("_")
    if kind in ("depth", "aif"):
        image = image.reshape(*([pages] if pages > 1 else []), *image.shape[-3 if colours > 1 else -2 :])
    if kind == "depth":
        return map_layers(image, _distances_beside(path.with_name(f"{name}_stack.tif"), image), f"{name}: distances")
    if kind == "aif":
        planes = np.moveaxis(image, -1, -3) if colours > 1 else image[..., np.newaxis, :, :]
        return [image_layer(planes, f"{name}: all in focus")]
    distances = [float(distance) for distance in lines["distances_mm"].split(",")]
    channels = int(lines.get("channels", 1))
    rows, cols = image.shape[-2:]
    planes = _without_one_time(image.reshape(-1, len(distances), channels, rows, cols))
    return [stack_layer(planes, distances, f"{name}: planes", white_of(planes))]


def _without_one_time(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a sequence, or what it holds where that is one frame."""
    return image[0] if len(image) == 1 else image


def _zarr(path: Path) -> list[LayerData]:
    """Return what :class:`hadalens.ome.OmeZarrWriter` wrote."""
    with extra("ome"):
        import zarr

    group: Any = zarr.open_group(path, mode="r")
    distances = [float(distance) for distance in group.attrs["hadalens"]["distances_mm"]]
    planes, picture, where = (
        _without_one_time(np.asarray(group[one])) for one in ("0", "all_in_focus/0", "distance_map/0")
    )
    return stacked_layers(np.moveaxis(planes, -4, -3), picture, where, distances, path.stem)


def _distances_beside(stack: Path, distance_map: NDArray[np.float32]) -> list[float]:
    """Return the distances of the stack that belongs to a map, so that both stand on the same axis."""
    if stack.exists():
        return [float(distance) for distance in _lines(stack)["distances_mm"].split(",")]
    known = distance_map[np.isfinite(distance_map)]
    return [float(known.min()), float(known.max())] if len(known) else [0.0, 1.0]
