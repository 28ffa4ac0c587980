"""Pairs of raw frame and known scene, as people keep them on disk.

:class:`DiffuserCam` reads the layout of the DiffuserCam Lensless Mirflickr data set (Monakhova et al., Optics Express
27(20), 28075 (2019)); :func:`write_folder` turns any pairs into the folders of TIFF files that the command line and
:func:`hadalens.fit` read. Arrays are float32, ``(C, Y, X)``, RGB and upright.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import Image, NewImage, as_array, planes_first, to_float
from ._files import PathLike
from ._native import call, ffi, lib, path

__all__ = ["DiffuserCam", "Pair", "write_folder"]

# Folders of frames and of scenes: those of the whole data set, and of the samples that its authors publish.
FOLDERS = (("diffuser_images", "ground_truth_lensed"), ("diffuser", "lensed"))


class Pair(NamedTuple):
    """A raw frame and the scene that it was taken of, both ``(C, Y, X)``."""

    raw: NDArray[np.float32]
    scene: NDArray[np.float32]


class DiffuserCam(Sequence[Pair]):
    """Pairs in the layout of the DiffuserCam Lensless Mirflickr data set.

    The folder holds ``diffuser_images/NAME.npy`` and ``ground_truth_lensed/NAME.npy`` (or ``diffuser`` and ``lensed``;
    they may stand in a folder ``dataset``), lists ``dataset_train.csv`` and ``dataset_test.csv`` with a name in the
    first column of each line, and ``psf.tiff``. Its arrays are ``(Y, X, C)``, blue first and upside down; pairs come
    out upright, as ``(C, Y, X)`` with red first. Nothing but names is read before a pair is asked for.

    Args:
        folder: where the data set is.
        split: ``"train"`` or ``"test"``: the names of that list, in its order; ``"all"``: every frame that is there, by
            number.

    Raises:
        FileNotFoundError: where folders, the list, or a frame that it names are missing.
        ValueError: where a list names nothing, or ``split`` is none of the three.

    Example:
        >>> pairs = hadalens.datasets.DiffuserCam("DiffuserCam", "train")[:200]
        >>> model = hadalens.fit({250.0: pairs})

    """

    def __init__(self, folder: PathLike, split: str = "train") -> None:
        """Read names."""
        self.folder = Path(folder)
        self._raw, self._scene = _find_folders(self.folder)
        there = {path.stem for path in self._raw.glob("*.npy")}
        if split == "all":
            self.names: tuple[str, ...] = tuple(sorted(there, key=_natural))
        elif split in ("train", "test"):
            self.names = _listed(self.folder / f"dataset_{split}.csv", there)
        else:
            raise ValueError(f'split is "train", "test" or "all", not {split!r}')

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> Pair: ...
    @overload
    def __getitem__(self, index: slice) -> DiffuserCam: ...
    def __getitem__(self, index: int | slice) -> Pair | DiffuserCam:
        """Read a pair; a slice is a data set of some of the pairs."""
        if isinstance(index, slice):
            part = object.__new__(DiffuserCam)
            part.folder, part._raw, part._scene = self.folder, self._raw, self._scene
            part.names = self.names[index]
            return part
        name = self.names[index]
        return Pair(_upright(self._raw / f"{name}.npy"), _upright(self._scene / f"{name}.npy"))

    def psf(self) -> NDArray[np.float32]:
        """The measured point spread function, upright, ``(C, Y, X)``.

        It was taken with more pixels than the frames that are kept: blocks of pixels are averaged until it has the
        frames' size.

        Raises:
            ValueError: where its size is no multiple of the frames'.

        """
        # the light that a PSF gathers does not depend on the order of its channels: this file is RGB already
        psf = _read(self.folder / "psf.tiff")[:, ::-1]
        rows, cols = np.load(self._raw / f"{self.names[0]}.npy", mmap_mode="r").shape[:2]
        down, across = psf.shape[1] // rows, psf.shape[2] // cols
        if psf.shape[1:] != (down * rows, across * cols) or not down or not across:
            raise ValueError(
                f"psf.tiff has {psf.shape[1]} x {psf.shape[2]} pixels: no multiple of the frames' {rows} x {cols}"
            )
        blocks = psf.reshape(len(psf), rows, down, cols, across)
        return np.ascontiguousarray(blocks.mean(axis=(2, 4), dtype=np.float64).astype(np.float32))


def write_folder(
    pairs: Iterable[tuple[ArrayLike, ArrayLike]],
    folder: PathLike,
    distance_mm: float = 0.0,
    *,
    names: Iterable[str] | None = None,
    channel_axis: int | None = None,
) -> Path:
    """Write pairs as the folders of TIFF files that ``hadalens fit`` and :func:`hadalens.fit` read.

    The pairs become ``folder/z<distance>mm/raw/NAME.tif`` and ``.../scene/NAME.tif``, float32 with the same values.
    One call writes one distance; call it again for the next. Pairs are taken one after the other.

    Args:
        pairs: raw frames and scenes: ``(Y, X)``, ``(C, Y, X)``, or with ``channel_axis=-1`` ``(Y, X, C)``. Integers are
            divided by their full scale.
        folder: the data set, made where it is not there.
        distance_mm: where the scenes stood.
        channel_axis: where the channels stand, where that is not first.
        names: a name for each pair, without ending. Without it, the names of a :class:`DiffuserCam`, else numbers.

    Returns:
        The folder of the distance.

    Raises:
        FileExistsError: where the distance has files already.
        ValueError: where there is no pair, or ``names`` has another number of names.

    Example:
        >>> hadalens.datasets.write_folder(zip(frames, scenes), "camera", 250)

    """
    place = Path(folder) / f"z{distance_mm:.12g}mm"
    raws, scenes = place / "raw", place / "scene"
    if any(raws.glob("*")) or any(scenes.glob("*")):
        raise FileExistsError(f"{place} holds files already; choose another folder, or remove it")
    if names is None:
        names = pairs.names if isinstance(pairs, DiffuserCam) else _numbers()
        strict = isinstance(pairs, DiffuserCam)
    else:
        strict = True
    count = 0
    for (raw, scene), name in zip(pairs, names, strict=strict):
        raws.mkdir(parents=True, exist_ok=True)
        scenes.mkdir(parents=True, exist_ok=True)
        for image, where, what in ((raw, raws, "raw"), (scene, scenes, "scene")):
            _write(where / f"{name}.tif", Image(image, what=what, channel_axis=channel_axis))
        count += 1
    if not count:
        raise ValueError("there is no pair to write")
    return place


def _read(file: Path) -> NDArray[np.float32]:
    """Return the image of a TIFF file, (C, Y, X)."""
    image = NewImage()
    call(lib.hada_tiff_load, path(file), 0, image.c)
    return image.array()


def _write(file: Path, image: Image) -> None:
    call(lib.hada_tiff_save, path(file), image.c, ffi.NULL)


def _numbers() -> Iterator[str]:
    number = 0
    while True:
        yield f"{number:05d}"
        number += 1


def _natural(name: str) -> list[tuple[int, str]]:
    """Sorts im2 before im10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _find_folders(folder: Path) -> tuple[Path, Path]:
    for base in (folder, folder / "dataset"):
        for raw, scene in FOLDERS:
            if (base / raw).is_dir() and (base / scene).is_dir():
                return base / raw, base / scene
    raise FileNotFoundError(
        f"{folder} is no DiffuserCam data set: it has neither diffuser_images and ground_truth_lensed, nor diffuser "
        "and lensed"
    )


def _listed(path: Path, there: set[str]) -> tuple[str, ...]:
    """Return the names of a list.

    Lines say NAME.jpg.tiff or the like, whatever the files are now; a first line that names no file is a heading.
    """
    with open(path, newline="", encoding="utf-8") as file:
        rows = [row[0].strip() for row in csv.reader(file) if row and row[0].strip()]
    names = [Path(row).name.split(".")[0] for row in rows]
    if names and names[0] not in there:
        del names[0]
    for name in names:
        if name not in there:
            raise FileNotFoundError(f"{path.name} names {name}, and there is no frame {name}.npy")
    if not names:
        raise ValueError(f"{path} names no frame")
    return tuple(names)


def _upright(path: Path) -> NDArray[np.float32]:
    image = np.load(path, allow_pickle=False)
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"{path} holds an array of {image.shape}, not the (rows, columns, 3) of this data set")
    return to_float(planes_first(as_array(image[::-1, :, ::-1], path.name), -1, path.name))
