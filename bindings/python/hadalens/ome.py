"""Results as OME-Zarr and OME-TIFF: what microscopists' software opens.

Distances along z stand exactly where a format has a place for them (``PositionZ`` of OME-TIFF; the attribute
``hadalens.distances_mm`` of OME-Zarr). A scale knows one step alone: it is the mean step, and starts at the nearest
distance; ``hadalens.even`` says whether all steps are equal.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ._files import PathLike, extra, replaced

__all__ = ["OmeZarrWriter", "is_even", "mean_step", "write_ome_tiff", "write_ome_zarr"]

# Steps that differ by less than this share of their mean are equal: distances are rarely typed more exactly.
EVEN = 1e-3
CHUNK = 1024  # rows and columns of a chunk at most: 4 MiB
COLOURS = (("red", "FF0000"), ("green", "00FF00"), ("blue", "0000FF"))


class Reconstruction(Protocol):
    """What is written: :class:`hadalens.Result`, or anything with these members."""

    @property
    def stack(self) -> NDArray[np.float32]:
        """Planes (Z, C, Y, X)."""

    @property
    def all_in_focus(self) -> NDArray[np.float32]:
        """Image (C, Y, X)."""

    @property
    def distance_map(self) -> NDArray[np.float32]:
        """(Y, X), millimetres, NaN where unknown."""

    @property
    def distances_mm(self) -> Any:
        """Of the planes, (Z,)."""


def mean_step(distances_mm: Sequence[float]) -> float:
    """Mean distance between neighbours; 1 where there is one distance alone."""
    return (distances_mm[-1] - distances_mm[0]) / (len(distances_mm) - 1) if len(distances_mm) > 1 else 1.0


def is_even(distances_mm: Sequence[float]) -> bool:
    """Whether all steps between neighbours are equal, so that a scale tells every distance."""
    steps = np.diff(np.asarray(distances_mm, float))
    return bool(len(steps) == 0 or np.all(np.abs(steps - steps.mean()) <= EVEN * abs(steps.mean())))


class OmeZarrWriter:
    """Results, one after the other, as the times of one OME-Zarr 0.5 image.

    The group holds the stack ``(T, C, Z, Y, X)`` and, as images of their own in groups of these names, ``all_in_focus``
    ``(T, C, Y, X)`` and ``distance_map`` ``(T, Y, X)`` in millimetres. Memory stays that of one result. The folder
    takes its name when the writer is closed; what was there before stays until then, and if something fails.

    Args:
        path: of the folder, ``NAME.zarr`` by custom.
        pixel_um: size of a pixel in the scene, where it is known.
        seconds: between frames, where it is known.
        overwrite: replace what is there.

    Example:
        >>> with hadalens.ome.OmeZarrWriter("film.zarr", seconds=0.1) as writer:
        ...     for result in plan.map(frames):
        ...         writer.append(result)

    """

    def __init__(
        self, path: PathLike, *, pixel_um: float | None = None, seconds: float | None = None, overwrite: bool = False
    ) -> None:
        """Check the name, and make a folder beside it."""
        self.path = Path(path)
        if self.path.exists() and not overwrite:
            raise FileExistsError(f"{path} is there already: give it another name, or overwrite=True")
        self.times = 0
        self._pixel_um, self._seconds = pixel_um, seconds
        self._arrays: dict[str, Any] = {}
        self._work: Path | None = Path(tempfile.mkdtemp(prefix=f".{self.path.name}-", dir=self.path.parent))

    def append(self, result: Reconstruction) -> None:
        """Write a result as the next time.

        Raises:
            ValueError: where it has another shape than those before, or the writer is closed.

        """
        if self._work is None:
            raise ValueError("the writer is closed")
        images = {
            "": np.moveaxis(result.stack, 0, 1),
            "all_in_focus": result.all_in_focus,
            "distance_map": np.reshape(result.distance_map, result.all_in_focus.shape[-2:]),
        }
        for name, image in images.items():
            if not self.times:
                self._arrays[name] = self._create(name, image, [float(d) for d in result.distances_mm])
            if self._arrays[name].shape[1:] != image.shape:
                raise ValueError(
                    f"a result of {image.shape} does not fit those before, of {self._arrays[name].shape[1:]}"
                )
        for name, image in images.items():
            self._arrays[name].resize((self.times + 1, *image.shape))
            self._arrays[name][self.times] = image
        self.times += 1

    def close(self) -> None:
        """Give the folder its name. A writer without results leaves nothing."""
        work, self._work = self._work, None
        if work is None:
            return
        if not self.times:
            shutil.rmtree(work)
            return
        umask = os.umask(0)
        os.umask(umask)
        work.chmod(0o777 & ~umask)  # mkdtemp's are the owner's alone
        if self.path.exists():
            shutil.rmtree(self.path)
        work.replace(self.path)

    def __enter__(self) -> OmeZarrWriter:
        """Return the writer."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close, or leave nothing where something failed."""
        if kind is None:
            self.close()
        elif self._work is not None:
            shutil.rmtree(self._work)
            self._work = None

    def _create(self, name: str, image: NDArray[np.float32], distances: list[float]) -> Any:
        with extra("ome"):
            import zarr

        assert self._work is not None
        axes = {4: "tczyx", 3: "tcyx", 2: "tyx"}[image.ndim]
        group = zarr.open_group(self._work / name, mode="a", zarr_format=3)
        chunks = (*(1,) * (image.ndim - 1), *(min(size, CHUNK) for size in image.shape[-2:]))
        array = group.create_array(
            "0", shape=(0, *image.shape), chunks=chunks, dtype="float32", dimension_names=list(axes)
        )
        label = f"{self.path.stem}{' ' if name else ''}{name.replace('_', ' ')}"
        group.attrs["ome"] = self._metadata(axes, label, distances, len(image) if axes[1] == "c" else 0)
        group.attrs["hadalens"] = {
            "distances_mm": distances,
            "even": is_even(distances),
            "values": "millimetres, NaN where unknown" if name == "distance_map" else "light, linear",
        }
        return array

    def _metadata(self, axes: str, label: str, distances: list[float], channels: int) -> dict[str, Any]:
        described: list[dict[str, str]] = []
        scale, start = [], []
        for axis in axes:
            kind = {"t": "time", "c": "channel"}.get(axis, "space")
            unit, step, first = None, 1.0, 0.0
            if axis == "t" and self._seconds:
                unit, step = "second", self._seconds
            elif axis == "z":
                unit, step, first = "millimeter", mean_step(distances), distances[0]
            elif axis in "yx" and self._pixel_um:
                unit, step = "micrometer", self._pixel_um
            described.append({"name": axis, "type": kind} | ({"unit": unit} if unit else {}))
            scale.append(step)
            start.append(first)
        moves = [{"type": "scale", "scale": scale}, {"type": "translation", "translation": start}]
        images = {"name": label, "axes": described, "datasets": [{"path": "0", "coordinateTransformations": moves}]}
        ome: dict[str, Any] = {"version": "0.5", "multiscales": [images]}
        if channels == len(COLOURS):
            window = {"min": 0.0, "max": 1.0, "start": 0.0, "end": 1.0}
            ome["omero"] = {
                "channels": [
                    {"label": name, "color": colour, "window": window, "active": True} for name, colour in COLOURS
                ]
            }
        return ome


def write_ome_zarr(path: PathLike, result: Reconstruction, **options: Any) -> None:
    """Write one result as an OME-Zarr 0.5 image with one time; see :class:`OmeZarrWriter` for its layout and options.

    Example:
        >>> hadalens.ome.write_ome_zarr("scene.zarr", plan.run(raw), pixel_um=3.4)

    """
    with OmeZarrWriter(path, **options) as writer:
        writer.append(result)


def write_ome_tiff(path: PathLike, result: Reconstruction, *, pixel_um: float | None = None) -> None:
    """Write a stack as OME-TIFF, with the exact distance of every plane as its ``PositionZ``.

    The stacks that the command line writes are ImageJ hyperstacks and hold the same OME-XML in ImageJ's Info; this file
    has it where OME's readers look for it first, and ImageJ opens it with Bio-Formats.

    Args:
        path: ``NAME.ome.tif`` by custom.
        result: its stack is written, ``(Z, C, Y, X)``, float32.
        pixel_um: size of a pixel in the scene, where it is known.

    Example:
        >>> hadalens.ome.write_ome_tiff("scene.ome.tif", plan.run(raw))

    """
    with extra("ome"):
        import tifffile

    distances = [float(d) for d in result.distances_mm]
    channels = result.stack.shape[1]
    positions = [distance for distance in distances for _ in range(channels)]
    metadata: dict[str, Any] = {
        "axes": "ZCYX",
        "PhysicalSizeZ": mean_step(distances),
        "PhysicalSizeZUnit": "mm",
        "Plane": {"PositionZ": positions, "PositionZUnit": ["mm"] * len(positions)},
    }
    if pixel_um:
        metadata |= {f"PhysicalSize{axis}": pixel_um for axis in "XY"}
        metadata |= {f"PhysicalSize{axis}Unit": "µm" for axis in "XY"}
    if channels == len(COLOURS):
        metadata["Channel"] = {"Name": [name for name, _ in COLOURS]}
    with replaced(path) as beside:
        tifffile.imwrite(beside, result.stack, ome=True, photometric="minisblack", metadata=metadata)
