"""Results as OME-Zarr and OME-TIFF: what microscopists' software opens.

OME-TIFF stores the exact distances along z (``PositionZ``). OME-Zarr 0.5 has a single step: here the mean step, from
the nearest distance on. The exact distances are stored as the array ``z`` (a coordinate for xarray) and the attribute
``hadalens.distances_mm``, and ``hadalens.even`` says whether all steps are equal. With ``resample`` planes are made at
equal steps instead, so that every viewer is right.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from ._files import PathLike, extra, replaced

__all__ = [
    "OmeZarr",
    "OmeZarrWriter",
    "Written",
    "even_planes",
    "is_even",
    "mean_step",
    "read_ome_zarr",
    "write_ome_tiff",
    "write_ome_zarr",
]

# Steps that differ by less than this share of their mean are equal: distances are rarely typed more exactly.
EVEN = 1e-3
CHUNK = 1024  # rows and columns of a chunk at most: 4 MiB
SMALL = 256  # rows or columns of the last level of a pyramid, at most, where nobody says how many levels
MOST = 1000  # planes that resampling makes, at most
Resample: TypeAlias = Literal["none", "nearest", "linear"]
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


def even_planes(
    stack: NDArray[np.float32], distances_mm: Sequence[float], method: Literal["nearest", "linear"] = "linear"
) -> tuple[NDArray[np.float32], tuple[float, ...]]:
    """Return planes (Z, ...) at equal steps, and their distances.

    The step is the smallest one between neighbours, or slightly less, so that the first and last plane keep their
    distances. "nearest" repeats planes, "linear" blends the two neighbours. Each plane keeps its brightness, so that
    the sum of all planes grows about as their number.

    Raises:
        ValueError: more than 1000 planes would be needed.

    Example:
        >>> planes, distances = hadalens.ome.even_planes(result.stack, result.distances_mm)

    """
    given = np.asarray(distances_mm, float)
    if len(given) < 3 or is_even(list(given)):
        return stack, tuple(map(float, given))
    count = int(np.ceil((given[-1] - given[0]) / np.diff(given).min() - EVEN)) + 1
    if count > MOST:
        raise ValueError(
            f"{count} planes would be needed for steps of {np.diff(given).min():g} mm: write them as they are"
        )
    distances = np.linspace(given[0], given[-1], count)
    place = np.interp(distances, given, np.arange(len(given)))
    if method == "nearest":
        nearest = np.abs(distances[:, None] - given).argmin(1)
        return np.ascontiguousarray(stack[nearest]), tuple(map(float, distances))
    below = np.minimum(place.astype(int), len(given) - 2)
    share = (place - below).astype(np.float32).reshape(-1, *(1,) * (stack.ndim - 1))
    return (1 - share) * stack[below] + share * stack[below + 1], tuple(map(float, distances))


def _halved(image: NDArray[np.float32], known: bool) -> NDArray[np.float32]:
    """Return an image of half the rows and columns: means of light, the first known value of distances."""
    rows, cols = image.shape[-2] // 2, image.shape[-1] // 2
    blocks = image[..., : 2 * rows, : 2 * cols].reshape(*image.shape[:-2], rows, 2, cols, 2)
    if not known:
        return np.asarray(blocks.mean((-3, -1), dtype=np.float64), np.float32)
    values = np.moveaxis(blocks, -3, -2).reshape(*image.shape[:-2], rows, cols, 4)
    first = np.isfinite(values).argmax(-1)[..., None]
    return np.ascontiguousarray(np.take_along_axis(values, first, -1)[..., 0])


class OmeZarrWriter:
    """Results, one after the other, as the times of one OME-Zarr 0.5 image.

    The group holds the stack ``(T, C, Z, Y, X)`` and, as images of their own in groups of these names, ``all_in_focus``
    ``(T, C, Y, X)`` and ``distance_map`` ``(T, Y, X)`` in millimetres. Each is a pyramid: levels have half the rows and
    columns of the one before. Memory stays that of one result. The folder takes its name when the writer is closed;
    what was there before stays until then, and if something fails.

    Args:
        path: of the folder, ``NAME.zarr`` by custom.
        pixel_um: size of a pixel in the scene, where it is known.
        seconds: between frames, where it is known.
        overwrite: replace what is there.
        levels: of the pyramids; None: until rows or columns are 256 at most.
        resample: planes at equal steps in place of uneven ones (:func:`even_planes`): "nearest" or "linear".

    Example:
        >>> with hadalens.ome.OmeZarrWriter("film.zarr", seconds=0.1) as writer:
        ...     for result in plan.map(frames):
        ...         writer.append(result)

    """

    def __init__(
        self,
        path: PathLike,
        *,
        pixel_um: float | None = None,
        seconds: float | None = None,
        overwrite: bool = False,
        levels: int | None = None,
        resample: Resample = "none",
    ) -> None:
        """Check the name, and make a folder beside it."""
        self.path = Path(path)
        if self.path.exists() and not overwrite:
            raise FileExistsError(f"{path} is there already: give it another name, or overwrite=True")
        if self.path.exists() and (self.path.is_symlink() or not self.path.is_dir()):
            raise FileExistsError(f"{path} is no folder, as OME-Zarr is: remove it, or give another name")
        self.times = 0
        if resample not in ("none", "nearest", "linear"):
            raise ValueError(f'resample is "none", "nearest" or "linear", not {resample!r}')
        if levels is not None and levels < 1:
            raise ValueError(f"levels={levels}: one at least is needed")
        self._pixel_um, self._seconds = pixel_um, seconds
        self._levels, self._resample = levels, resample
        self._arrays: dict[str, list[Any]] = {}
        self._work: Path | None = Path(tempfile.mkdtemp(prefix=f".{self.path.name}-", dir=self.path.parent))

    def append(self, result: Reconstruction) -> None:
        """Write a result as the next time.

        Raises:
            ValueError: where it has another shape than those before, or the writer is closed.

        """
        if self._work is None:
            raise ValueError("the writer is closed")
        stack, distances = result.stack, tuple(float(d) for d in result.distances_mm)
        if self._resample != "none":
            stack, distances = even_planes(stack, distances, self._resample)
        images = {
            "": np.moveaxis(stack, 0, 1),
            "all_in_focus": result.all_in_focus,
            "distance_map": np.reshape(result.distance_map, result.all_in_focus.shape[-2:]),
        }
        for name, image in images.items():
            if not self.times:
                self._arrays[name] = self._create(name, image, list(distances))
            if self._arrays[name][0].shape[1:] != image.shape:
                raise ValueError(
                    f"a result of {image.shape} does not fit those before, of {self._arrays[name][0].shape[1:]}"
                )
        for name, image in images.items():
            for level, array in enumerate(self._arrays[name]):
                image = _halved(image, name == "distance_map") if level else image
                array.resize((self.times + 1, *image.shape))
                array[self.times] = image
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

    def _count(self, rows: int, cols: int) -> int:
        """How many levels there are, the last one with a pixel at least."""
        levels, least = 1, SMALL if self._levels is None else 1
        while min(rows, cols) > least and (self._levels is None or levels < self._levels):
            rows, cols, levels = rows // 2, cols // 2, levels + 1
        return levels

    def _create(self, name: str, image: NDArray[np.float32], distances: list[float]) -> list[Any]:
        with extra("ome"):
            import zarr

        assert self._work is not None
        axes = {4: "tczyx", 3: "tcyx", 2: "tyx"}[image.ndim]
        group = zarr.open_group(self._work / name, mode="a", zarr_format=3)
        arrays = []
        for level in range(self._count(*image.shape[-2:])):
            shape = (*image.shape[:-2], *(size >> level for size in image.shape[-2:]))
            chunks = (*(1,) * (image.ndim - 1), *(min(size, CHUNK) for size in shape[-2:]))
            arrays.append(
                group.create_array(
                    str(level), shape=(0, *shape), chunks=chunks, dtype="float32", dimension_names=list(axes)
                )
            )
        if "z" in axes:
            z = group.create_array("z", shape=(len(distances),), dtype="float64", dimension_names=["z"])
            z[:] = distances
            z.attrs["units"] = "mm"
        label = f"{self.path.stem}{' ' if name else ''}{name.replace('_', ' ')}"
        group.attrs["ome"] = self._metadata(axes, label, distances, len(image) if axes[1] == "c" else 0, len(arrays))
        group.attrs["hadalens"] = {
            "distances_mm": distances,
            "even": is_even(distances),
            "resampled": self._resample,
            "values": "millimetres, NaN where unknown" if name == "distance_map" else "light, linear",
        }
        return arrays

    def _metadata(self, axes: str, label: str, distances: list[float], channels: int, levels: int) -> dict[str, Any]:
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
        datasets = []
        for level in range(levels):
            # the middle of a level's first pixel is that of a block of pixels
            factors = [2.0**level if axis in "yx" else 1.0 for axis in axes]
            moves = [
                {"type": "scale", "scale": [s * f for s, f in zip(scale, factors, strict=True)]},
                {
                    "type": "translation",
                    "translation": [t + s * (f - 1) / 2 for t, s, f in zip(start, scale, factors, strict=True)],
                },
            ]
            datasets.append({"path": str(level), "coordinateTransformations": moves})
        images: dict[str, Any] = {"name": label, "axes": described, "datasets": datasets}
        if levels > 1:
            images["type"] = "first known value" if "c" not in axes else "mean"
        ome: dict[str, Any] = {"version": "0.5", "multiscales": [images]}
        if channels == len(COLOURS):
            window = {"min": 0.0, "max": 1.0, "start": 0.0, "end": 1.0}
            ome["omero"] = {
                "channels": [
                    {"label": name, "color": colour, "window": window, "active": True} for name, colour in COLOURS
                ]
            }
        return ome


@dataclass(frozen=True)
class Written:
    """A result that was read back from an OME-Zarr image; what the file does not hold is None.

    Attributes:
        stack: planes (Z, C, Y, X), linear light.
        distances_mm: of the planes.

    """

    stack: NDArray[np.float32]
    distances_mm: tuple[float, ...]
    all_in_focus: NDArray[np.float32] | None
    distance_map: NDArray[np.float32] | None


class OmeZarr(Sequence[Written]):
    """An OME-Zarr image, read back: a result for each time, which is read when it is asked for.

    Images of other programs, of versions 0.4 and 0.5, can be read as well: axes that they lack have one place, and
    distances follow from scale and translation.

    Args:
        path: of the folder.
        level: of the pyramid; 0: the whole image.

    Attributes:
        pixel_um: size of a pixel of this level in the scene; None: not known.
        seconds: between times; None: not known.
        levels: how many there are.

    Raises:
        ValueError: the folder is no OME-Zarr image, or has no such level.

    Example:
        >>> film = hadalens.ome.OmeZarr("film.zarr")
        >>> film[0].stack, film[0].distances_mm, len(film)

    """

    def __init__(self, path: PathLike, level: int = 0) -> None:
        """Read the metadata."""
        with extra("ome"):
            import zarr

        group: Any = zarr.open_group(Path(path), mode="r")
        attributes = dict(group.attrs)
        found = attributes.get("ome", attributes).get("multiscales")
        if not found:
            raise ValueError(f"{path} is no OME-Zarr image: it has no multiscales")
        image = found[0]
        self.levels = len(image["datasets"])
        if not 0 <= level < self.levels:
            raise ValueError(f"level={level}: {path} has levels 0 to {self.levels - 1}")
        axes: list[dict[str, str]] = image["axes"]
        self._axes = "".join(axis["name"] for axis in axes)
        if set(self._axes) - set("tczyx") or not {"y", "x"} <= set(self._axes):
            raise ValueError(f"{path} has the axes {self._axes}: y and x are needed, t, c and z possible")
        dataset = image["datasets"][level]
        self._array = group[dataset["path"]]
        scale, start = [1.0] * len(axes), [0.0] * len(axes)
        for move in [*dataset.get("coordinateTransformations", []), *image.get("coordinateTransformations", [])]:
            if move["type"] == "scale":
                scale = [a * b for a, b in zip(scale, move["scale"], strict=True)]
                start = [a * b for a, b in zip(start, move["scale"], strict=True)]
            elif move["type"] == "translation":
                start = [a + b for a, b in zip(start, move["translation"], strict=True)]
        units = {axis["name"]: axis.get("unit") for axis in axes}
        steps = dict(zip(self._axes, scale, strict=True))
        self.pixel_um = _in(units["x"], steps["x"], _MICROMETRES)
        self.seconds = _in(units.get("t"), steps.get("t", 1.0), _SECONDS)
        ours = attributes.get("hadalens", {})
        if "distances_mm" in ours:
            self.distances_mm = tuple(map(float, ours["distances_mm"]))
        elif "z" in self._axes:
            z = self._axes.index("z")
            per = (_in(units["z"], 1.0, _MICROMETRES) or 1000.0) / 1000.0
            self.distances_mm = tuple(per * (start[z] + scale[z] * i) for i in range(self._array.shape[z]))
        else:
            self.distances_mm = (0.0,)
        self._others = {}
        for name in ("all_in_focus", "distance_map"):
            if "distances_mm" in ours and name in group and str(level) in group[name]:
                self._others[name] = group[name][str(level)]

    def __len__(self) -> int:
        """Return the number of times."""
        return int(self._array.shape[self._axes.index("t")]) if "t" in self._axes else 1

    @overload
    def __getitem__(self, index: int) -> Written: ...
    @overload
    def __getitem__(self, index: slice) -> list[Written]: ...
    def __getitem__(self, index: int | slice) -> Written | list[Written]:
        """Read the result of a time; a slice is a list of results."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        time = range(len(self))[index]
        place = tuple(time if axis == "t" else slice(None) for axis in self._axes)
        image = np.asarray(self._array[place], np.float32)
        left = self._axes.replace("t", "")
        image = np.transpose(image, [left.index(axis) for axis in "zcyx" if axis in left])
        for at, axis in enumerate("zc"):
            image = image if axis in left else np.expand_dims(image, at)
        others = {name: np.asarray(array[time]) for name, array in self._others.items()}
        return Written(
            np.ascontiguousarray(image),
            self.distances_mm,
            others.get("all_in_focus"),
            others.get("distance_map"),
        )


_MICROMETRES = {"nanometer": 1e-3, "micrometer": 1.0, "millimeter": 1e3, "centimeter": 1e4, "meter": 1e6}
_SECONDS = {"microsecond": 1e-6, "millisecond": 1e-3, "second": 1.0, "minute": 60.0, "hour": 3600.0}


def _in(unit: str | None, value: float, units: dict[str, float]) -> float | None:
    return value * units[unit] if unit in units else None


def read_ome_zarr(path: PathLike, time: int = 0, *, level: int = 0) -> Written:
    """Return one result of an OME-Zarr image; see :class:`OmeZarr`.

    Example:
        >>> stack = hadalens.ome.read_ome_zarr("scene.zarr").stack

    """
    return OmeZarr(path, level)[time]


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
