"""Pairs of raw frame and known scene, as people keep them on disk.

Each class reads one layout of files: :class:`DiffuserCam` (DiffuserCam Lensless Mirflickr; Monakhova et al., Optics
Express 27(20), 28075 (2019)), :class:`MultiWienerNet` (Yanny et al., Optica 9(1), 96 (2022)), :class:`ParallelLensless`
(two lensless cameras and one with a lens, https://waller-lab.github.io/parallel-lensless-dataset), :class:`FlatCam`
(Khan et al., ICCV 2019), :class:`HuggingFace` (DigiCam, TapeCam and others of LenslessPiCam), and :class:`Folders` any
two folders of pictures. Nothing but names is read before a pair is asked for. :func:`write_folder` turns any pairs into
the folders of TIFF files that the command line and :func:`hadalens.fit` read. Arrays are float32, ``(C, Y, X)``, RGB
and upright, values as the files have them: whether they stand for light, ``fit`` finds.
"""

from __future__ import annotations

import copy
import csv
import io
import random
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import Image, NewImage, as_array, planes_first, to_float
from ._files import PathLike, extra
from ._native import call, ffi, lib, path

__all__ = [
    "DiffuserCam",
    "FlatCam",
    "Folders",
    "HuggingFace",
    "MultiWienerNet",
    "Pair",
    "Pairs",
    "ParallelLensless",
    "write_folder",
]

Split: TypeAlias = Literal["train", "test", "all"]

# Folders of frames and of scenes: those of the whole data set, and of the samples that its authors publish.
FOLDERS = (("diffuser_images", "ground_truth_lensed"), ("diffuser", "lensed"))


class Pair(NamedTuple):
    """A raw frame and the scene that it was taken of, both ``(C, Y, X)``."""

    raw: NDArray[np.float32]
    scene: NDArray[np.float32]


class Pairs(Sequence[Pair]):
    """What all layouts have: names, and pairs that are read when they are asked for.

    Attributes:
        names: of the pairs, without ending.
        mosaic: pattern of the colour filter mosaic of frames that have one channel; "none": they have none.

    """

    names: tuple[str, ...]
    mosaic: str = "none"

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> Pair: ...
    @overload
    def __getitem__(self, index: slice) -> Self: ...
    def __getitem__(self, index: int | slice) -> Pair | Self:
        """Read a pair; a slice is a data set of some of the pairs."""
        if isinstance(index, slice):
            part = copy.copy(self)
            part.names = self.names[index]
            return part
        return self._pair(self.names[index])

    def _pair(self, name: str) -> Pair:
        raise NotImplementedError


class DiffuserCam(Pairs):
    """Pairs in the layout of the DiffuserCam Lensless Mirflickr data set.

    The folder holds ``diffuser_images/NAME.npy`` and ``ground_truth_lensed/NAME.npy`` (or ``diffuser`` and ``lensed``;
    they may stand in a folder ``dataset``), lists ``dataset_train.csv`` and ``dataset_test.csv`` with a name in the
    first column of each line, and ``psf.tiff``. Its arrays are ``(Y, X, C)``, blue first and upside down; pairs come
    out upright, as ``(C, Y, X)`` with red first.

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

    def __init__(self, folder: PathLike, split: Split = "train") -> None:
        """Read names."""
        self.folder = Path(folder)
        self._raw, self._scene = _find_folders(self.folder)
        there = {path.stem for path in self._raw.glob("*.npy")}
        if _known(split) == "all":
            self.names = tuple(sorted(there, key=_natural))
        else:
            self.names = _listed(self.folder / f"dataset_{split}.csv", there)

    def _pair(self, name: str) -> Pair:
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
        return _binned(psf, np.load(self._raw / f"{self.names[0]}.npy", mmap_mode="r").shape[:2], "psf.tiff")


class Folders(Pairs):
    """Pairs of two folders of pictures, a frame and its scene with the same name.

    Pictures are TIFF, NumPy (``.npy``), PNG and JPEG files, the last two by Pillow (extra ``datasets``). Names are
    sorted by their numbers; the last of them are those of the test.

    Args:
        raws, scenes: the folders.
        split: which pairs.
        held_out: the number of pairs for the test, or their share.

    Raises:
        FileNotFoundError: no frame has a scene.

    Example:
        >>> pairs = hadalens.datasets.Folders("captures", "displayed", "train")

    """

    def __init__(self, raws: PathLike, scenes: PathLike, split: Split = "all", *, held_out: float = 0.2) -> None:
        """Read names."""
        self._raws, self._scenes = _pictures(Path(raws)), _pictures(Path(scenes))
        names = sorted(self._raws.keys() & self._scenes.keys(), key=_natural)
        if not names:
            raise FileNotFoundError(f"{raws} and {scenes} hold no pictures of the same names")
        self.names = _part(self._shuffled(names), split, held_out)

    def _shuffled(self, names: list[str]) -> list[str]:
        return names

    def _pair(self, name: str) -> Pair:
        return Pair(_picture(self._raws[name]), _picture(self._scenes[name]))


class MultiWienerNet(Folders):
    """Pairs in the layout of the MultiWienerNet's simulated two-dimensional data: grey pictures of 486 x 648 pixels.

    The folder holds frames in ``Train`` and scenes in ``Target``. Pairs are cut as the authors cut them, to rows 18 to
    466 and columns 4 to 644. A fifth is for the test, after a shuffle with the authors' seed; they shuffle the order in
    which their disk lists the files, so theirs is another fifth.

    Args:
        folder: where the data set is.
        split: which pairs.
        raws, scenes: names of the two folders.

    """

    def __init__(
        self, folder: PathLike, split: Split = "train", *, raws: str = "Train", scenes: str = "Target"
    ) -> None:
        """Read names."""
        super().__init__(Path(folder) / raws, Path(folder) / scenes, split)

    def _shuffled(self, names: list[str]) -> list[str]:
        random.Random(8).shuffle(names)
        return names

    def _pair(self, name: str) -> Pair:
        raw, scene = super()._pair(name)
        return Pair(raw[:, 18:466, 4:644], scene[:, 18:466, 4:644])


class ParallelLensless(Pairs):
    """Pairs in the layout of the Parallel Lensless Dataset: one of its two lensless cameras, and one with a lens.

    The folder holds ``rml/img_N_cam_1.tiff`` or ``diffusercam/img_N_cam_0.tiff`` (or ``diffuser``), of 1200 x 1920
    pixels, and in another folder scenes that are smaller, without distortion, and warped to where this camera sees
    them: ``warped_4x_undistorted_img_N_cam_2.tiff``, in a folder whose name ends in ``GT2RML`` or ``GT2DC``. Frames are
    averaged over blocks of pixels to the scenes' size. The authors publish no lists; here the numbers 24, 49, 74 and so
    on are for the test.

    Args:
        folder: where the data set is.
        imager: the camera.
        split: which pairs.

    Attributes:
        view: rows and columns of the scene at 300 x 480 pixels that the authors compare.

    Raises:
        FileNotFoundError: frames or scenes are missing.

    """

    def __init__(
        self, folder: PathLike, imager: Literal["rml", "diffusercam"] = "diffusercam", split: Split = "train"
    ) -> None:
        """Read names."""
        rml = imager == "rml"
        self.view = (slice(36, 266), slice(133, 363)) if rml else (slice(23, 280), slice(112, 369))
        raw = r"(rml)/img_(\d+)_cam_1\.tiff?$" if rml else r"(diffuser\w*)/img_(\d+)_cam_0\.tiff?$"
        scene = rf"GT2{'RML' if rml else 'DC'}[^/]*/warped_(\d+)x_undistorted_img_(\d+)_cam_2\.tiff?$"
        files = sorted(Path(folder).rglob("*.tif*"))
        self._raws = {match[2]: file for file in files if (match := re.search(raw, file.as_posix()))}
        self._scenes = {match[2]: file for file in files if (match := re.search(scene, file.as_posix()))}
        names = sorted(self._raws.keys() & self._scenes.keys(), key=int)
        if not names:
            raise FileNotFoundError(f"{folder} holds no frames of {imager} with scenes that are warped to it")
        chosen = _known(split)
        self.names = tuple(n for n in names if chosen == "all" or (int(n) % 25 == 24) == (chosen == "test"))

    def _pair(self, name: str) -> Pair:
        raw, scene = _picture(self._raws[name]), _picture(self._scenes[name])[:3]
        return Pair(_binned(raw, scene.shape[1:], self._raws[name].name), scene)


class FlatCam(Pairs):
    """Pairs in the layout of FlatNet's FlatCam captures: frames with a mosaic, and photographs that a display showed.

    The folder holds lists, ``train_meas*.txt`` and ``train_orig*.txt``, ``val_meas*.txt`` and ``val_orig*.txt`` (or in
    ``filenames``), whose lines are paths below the folder: frames of 1024 x 1280 pixels of 16 bits with the mosaic B G
    / G R and a large dark level, and photographs, which come out as 256 x 256 pixels. The validation's lists are for
    the test. Where the display stood in a frame, ``hadalens.register`` finds. Needs the extra ``datasets``.

    Args:
        folder: where the data set is.
        split: which pairs.

    Raises:
        FileNotFoundError: a list is missing.
        ValueError: two lists have different lengths.

    """

    mosaic = "bggr"

    def __init__(self, folder: PathLike, split: Split = "train") -> None:
        """Read the lists."""
        self.folder = Path(folder)
        wanted = {"train": ["train"], "test": ["val"], "all": ["train", "val"]}[_known(split)]
        self._files: dict[str, tuple[Path, Path]] = {}
        for part in wanted:
            raws, scenes = (_lines(self.folder, f"{part}_{kind}*") for kind in ("meas", "orig"))
            if len(raws) != len(scenes):
                raise ValueError(f"the lists {part}_meas and {part}_orig have {len(raws)} and {len(scenes)} lines")
            self._files |= {
                str(Path(raw).with_suffix("")): (Path(raw), Path(s)) for raw, s in zip(raws, scenes, strict=True)
            }
        self.names = tuple(self._files)

    def _pair(self, name: str) -> Pair:
        raw, scene = (self.folder / file for file in self._files[name])
        return Pair(_picture(raw), _picture(scene, (256, 256)))


class HuggingFace(Pairs):
    """Pairs in the layout of LenslessPiCam's data sets on Hugging Face: DigiCam, TapeCam, DiffuserCam and others.

    The folder holds ``train-*.parquet`` and ``test-*.parquet`` (or in ``data``), tables with pictures in the columns
    ``lensless`` and ``lensed``, and of many masks with ``mask_label``. Scenes are as they were displayed, of another
    size and place than in the frame: ``hadalens.register`` finds where. Needs the extra ``datasets``.

    Args:
        folder: where the data set is.
        split: which tables.
        turn: how frames are turned upright: "180" for DigiCam, "flip" (top to bottom) for DiffuserCam.

    Raises:
        FileNotFoundError: there are no such tables.

    """

    def __init__(
        self, folder: PathLike, split: Split = "train", *, turn: Literal["none", "180", "flip"] = "180"
    ) -> None:
        """Read the tables' sizes."""
        with extra("datasets"):
            from pyarrow import parquet

        wanted = ["train", "test"] if _known(split) == "all" else [split]
        files = [file for part in wanted for file in sorted(Path(folder).rglob(f"{part}-*.parquet"))]
        if not files:
            raise FileNotFoundError(f"{folder} holds no tables {wanted[0]}-*.parquet")
        self._turn = turn
        self._places: dict[str, tuple[Path, int, int]] = {}
        self._labels: dict[str, int] = {}
        self._last: tuple[Any, Any] = None, None
        for file in files:
            table = parquet.ParquetFile(file)
            masks = "mask_label" in table.schema_arrow.names
            labels = table.read(columns=["mask_label"])["mask_label"].to_pylist() if masks else None
            row = 0
            for group in range(table.num_row_groups):
                for i in range(table.metadata.row_group(group).num_rows):
                    name = f"{len(self._places):05d}"
                    self._places[name] = (file, group, i)
                    if labels is not None:
                        self._labels[name] = labels[row]
                    row += 1
        self.names = tuple(self._places)

    def mask(self, index: int) -> int | None:
        """Return the number of the mask that a frame was taken with, where there are several."""
        label: int | None = self._labels.get(self.names[index])
        return label

    def _pair(self, name: str) -> Pair:
        from pyarrow import parquet

        file, group, i = self._places[name]
        if self._last[0] != (file, group):  # rows that follow each other stand in the same group
            self._last = (file, group), parquet.ParquetFile(file).read_row_group(group, columns=["lensless", "lensed"])
        row = self._last[1].slice(i, 1).to_pylist()[0]
        raw, scene = (_decoded(row[kind]["bytes"]) for kind in ("lensless", "lensed"))
        turned = raw[:, ::-1, ::-1] if self._turn == "180" else raw[:, ::-1] if self._turn == "flip" else raw
        return Pair(np.ascontiguousarray(turned), scene)


def write_folder(
    pairs: Iterable[tuple[ArrayLike, ArrayLike]],
    folder: PathLike,
    distance_mm: float = 0.0,
    *,
    names: Iterable[str] | None = None,
    channel_axis: int | None = None,
    full_scale: float | None = None,
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
        full_scale: of the raw frames, as for :meth:`hadalens.Plan.run`.
        names: a name for each pair, without ending. Without it, the names of :class:`Pairs`, else numbers.

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
        names = (Path(n).name for n in pairs.names) if isinstance(pairs, Pairs) else _numbers()
        strict = isinstance(pairs, Pairs)
    else:
        strict = True
    count = 0
    for (raw, scene), name in zip(pairs, names, strict=strict):
        raws.mkdir(parents=True, exist_ok=True)
        scenes.mkdir(parents=True, exist_ok=True)
        for image, where, what, scale in ((raw, raws, "raw", full_scale), (scene, scenes, "scene", None)):
            _write(where / f"{name}.tif", Image(image, what=what, channel_axis=channel_axis, full_scale=scale))
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


def _known(split: str) -> str:
    if split not in ("train", "test", "all"):
        raise ValueError(f'split is "train", "test" or "all", not {split!r}')
    return split


def _part(names: list[str], split: str, held_out: float) -> tuple[str, ...]:
    """Return the names of a split: the last ones are held out."""
    count = int(held_out) if held_out >= 1 else int(len(names) * held_out)
    last = len(names) - count
    return tuple({"train": names[:last], "test": names[last:], "all": names}[_known(split)])


def _pictures(folder: Path) -> dict[str, Path]:
    """Return the pictures of a folder by their names."""
    endings = {".tif", ".tiff", ".npy", ".png", ".jpg", ".jpeg"}
    return {file.stem: file for file in folder.glob("*") if file.suffix.lower() in endings}


def _lines(folder: Path, pattern: str) -> list[str]:
    """Return the lines of the list whose name matches; of several the shortest name."""
    found = sorted([*folder.glob(pattern), *(folder / "filenames").glob(pattern)], key=lambda file: len(file.name))
    if not found:
        raise FileNotFoundError(f"{folder} holds no list {pattern}.txt")
    return [line.strip() for line in found[0].read_text(encoding="utf-8").splitlines() if line.strip()]


def _picture(file: Path, size: tuple[int, int] | None = None) -> NDArray[np.float32]:
    """Return a picture (C, Y, X); integers as shares of full scale."""
    ending = file.suffix.lower()
    if ending in (".tif", ".tiff"):
        return _read(file)
    if ending == ".npy":
        array = as_array(np.load(file, allow_pickle=False), file.name)
        return to_float(planes_first(array, -1 if array.ndim == 3 else None, file.name))
    return _decoded(file.read_bytes(), size)


def _decoded(data: bytes, size: tuple[int, int] | None = None) -> NDArray[np.float32]:
    """Return the picture of a PNG or JPEG file, of these rows and columns."""
    with extra("datasets"):
        from PIL import Image as Pillow

    with Pillow.open(io.BytesIO(data)) as picture:
        picture.load()
    deep: Any = picture if picture.mode.startswith("I") else picture.convert("L" if picture.mode == "1" else "RGB")
    if picture.mode == "L":
        deep = picture
    if size is not None:
        deep = deep.resize(size[::-1], Pillow.Resampling.BILINEAR)
    array = np.asarray(deep)
    if array.dtype == np.int32:  # how Pillow holds 16 bits in some versions
        array = array.astype(np.uint16)
    return to_float(planes_first(as_array(array, "picture"), -1 if array.ndim == 3 else None, "picture"))


def _binned(image: NDArray[np.float32], size: tuple[int, ...], name: str) -> NDArray[np.float32]:
    """Return the image at that size, each pixel the mean of a block."""
    down, across = image.shape[1] // size[0], image.shape[2] // size[1]
    if not down or not across or image.shape[1:] != (down * size[0], across * size[1]):
        raise ValueError(f"{name} has {image.shape[1]} x {image.shape[2]} pixels: no multiple of {size[0]} x {size[1]}")
    blocks = image.reshape(len(image), size[0], down, size[1], across)
    return np.ascontiguousarray(blocks.mean(axis=(2, 4), dtype=np.float64).astype(np.float32))
