"""Weights of the authors' camera, as their Keras program saved them, as a model of ours.

F. Tian and W. Yang, "Learned lensless 3D camera", Optics Express 30(19), 34479 (2022). Their program saves one file of
Hadamard filters (``reconM``) for each distance, and one of the whole way with the net behind it (``fullgenerator``),
in Keras' HDF5 format (``.h5``).

What their filters do, and how a model of ours does the same: a filter has two real arrays ``k0, k1`` of the frame's
size and gives ``|fftshift(ifft2(fft2(raw) * conj(k0 + i k1)))|``, cropped. The shift and the crop are a phase, which
the filter takes in. The modulus makes the filter's own phase arbitrary, and only the part of it with Hermitian symmetry
makes real images: so the filter is turned by the phase that leaves most in that part, and the rest is left out.
:attr:`Imported.real_share` says how much of its energy was kept; what differs otherwise is listed in
:func:`import_model`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._files import PathLike, extra, replaced
from ._keras_file import Array, read_layers
from ._keras_net import Net, import_net

__all__ = ["Imported", "Net", "import_filters", "import_model", "import_net"]


@dataclass(frozen=True)
class Imported:
    """What became of filters: see :func:`import_filters`.

    Attributes:
        filters: ``(depth, channel, rows, cols / 2 + 1)``, complex64: the filters on the half spectrum, as models hold
            them.
        raw: rows and columns of the frames.
        window: rows and columns of the images that the filters make.
        distances_mm: ascending.
        real_share: ``(depth, channel)``: share of each filter's energy that makes a real image. The rest, which the
            authors' modulus would add to it, is left out. A filter that was trained long enough for its images to look
            right is near 1 where frames have light.

    """

    filters: NDArray[np.complex64]
    raw: tuple[int, int]
    window: tuple[int, int]
    distances_mm: tuple[float, ...]
    real_share: NDArray[np.float64]


def import_filters(
    files: Sequence[PathLike],
    distances_mm: Sequence[float],
    *,
    shifts: Sequence[tuple[int, int]] | None = None,
    window: tuple[int, int] | None = None,
) -> Imported:
    """Read the Hadamard filters of ``reconM`` files, one for each distance.

    Args:
        files: hDF5 files that Keras wrote (``model.save`` or ``save_weights``), with one Hadamard layer for each
            colour.
        distances_mm: where the scenes stood that each file was trained on.
        shifts: rows and columns by which the images of each file are to be moved, where the distances do not lie on one
            axis (the authors' ``ofs.mat``).
        window: rows and columns of the images, in the middle of the frame. Without it, the crop that the file tells;
            the whole frame where it tells none.

    Raises:
        ValueError: where a file has no filters, or others than the first one; where there is not one distance for each
            file, or two are the same.

    """
    if not files or len(files) != len(distances_mm) or len(set(distances_mm)) != len(distances_mm):
        raise ValueError("there must be one distance for each file, and no two the same")
    if shifts is not None and len(shifts) != len(files):
        raise ValueError("there must be one shift for each file")
    order = sorted(range(len(files)), key=lambda i: distances_mm[i])
    filters: list[NDArray[np.complex64]] = []
    shares: list[list[float]] = []
    raw: tuple[int, int] | None = None
    size: tuple[int, int] | None = None
    for i in order:
        kernels, crop = _read_filters(files[i]), _read_crop(files[i])
        if raw not in (None, kernels.shape[2:]) or (filters and len(kernels) != len(filters[0])):
            raise ValueError(
                f"{files[i]}: its filters have another size or other colours than those of the other files"
            )
        raw = (kernels.shape[2], kernels.shape[3])
        top, left, own = _window(raw, crop, window)
        if size not in (None, own):
            raise ValueError(f"{files[i]} is cropped otherwise than the other files; say window=(rows, cols)")
        size = own
        down, across = shifts[i] if shifts else (0, 0)
        offset = ((raw[0] - own[0]) // 2 - top + down, (raw[1] - own[1]) // 2 - left + across)
        halves = [_half_spectrum(kernel, offset) for kernel in kernels]
        filters.append(np.stack([half for half, _ in halves]))
        shares.append([share for _, share in halves])
    assert raw is not None
    assert size is not None
    return Imported(np.stack(filters), raw, size, tuple(float(distances_mm[i]) for i in order), np.array(shares))


def import_model(
    path: PathLike,
    files: Sequence[PathLike],
    distances_mm: Sequence[float],
    *,
    net: PathLike | None = None,
    net_size: tuple[int, int] = (256, 256),
    shifts: Sequence[tuple[int, int]] | None = None,
    window: tuple[int, int] | None = None,
) -> Imported:
    """Write a model file of the authors' filters, with their net behind them where `net` names its file.

    The model reconstructs with these filters; having no transfer functions, it has no refinement. What differs from the
    authors' program: images are real instead of moduli (see above); planes are resized to the net's size and back
    bilinearly, where theirs are bicubic; they are not divided by their maximum.

    Args:
        path: the model file.
        files: of filters, with `distances_mm`, `shifts` and `window` as for :func:`import_filters`.
        distances_mm: of the files.
        net: the file of the net.
        net_size: at which it runs.
        shifts: of the files.
        window: of the images.

    Returns:
        The filters.

    Example:
        >>> files = [f"reconM_{i}.h5" for i in range(1, 15)]
        >>> distances = [100, 130, 160, 190, 220, 250, 280, 310, 350, 400, 450, 500, 550, 600]
        >>> hadalens.keras.import_model("paper.model", files, distances, net="fullgenerator.h5")
        >>> plan = hadalens.Plan(hadalens.Model.load("paper.model"))

    """
    from safetensors.numpy import save_file

    imported = import_filters(files, distances_mm, shifts=shifts, window=window)
    if imported.filters.shape[1] not in (1, 3):
        raise ValueError("a model has one channel or three")
    tensors: dict[str, NDArray[Any]] = {
        "distances_mm": np.array(imported.distances_mm, np.float64),
        "filter": imported.filters.view(np.float32).reshape(*imported.filters.shape, 2),
    }
    metadata = _metadata(imported)
    if net is not None:
        enhance = import_net(net, size=net_size)
        metadata |= {"enhance": json.dumps(enhance.description), "enhance_size": f"{net_size[0]}x{net_size[1]}"}
        tensors |= {f"enhance.{name}": value for name, value in enhance.weights.items()}
    with replaced(path) as beside:
        save_file(tensors, beside, metadata=metadata)
    return imported


def _metadata(imported: Imported) -> dict[str, str]:
    """What a model file says about itself (docs/reference/files.md)."""
    raw = "{}x{}".format(*imported.raw)
    return {
        "format": "hadalens-model",
        "version": "1",
        "library": "hadalens.keras",
        "form": "complex",
        "boundary": "circular",
        "raw": raw,
        "grid": raw,
        "window": "{}x{}".format(*imported.window),
        "scene_response": "linear",
        **dict.fromkeys(("alpha", "lambda", "dark", "noise", "refine_steps", "refine_rho"), "0"),
        "axes": "filter: [depth, channel, ky, kx, re/im], kx from 0 to grid_cols/2 (half spectrum); depths near to far",
        "transform": "forward unnormalised, inverse divided by grid_rows*grid_cols",
        "geometry": "the window stands in the frame at (raw - window)/2, rounded down",
        "use": "scene = inverse(filter * forward(raw - dark)) in the window",
        "psf_axis": "none: the model has no transfer functions",
        "intensity": "as the frames had it that the filters were trained on",
    }


# What Keras wrote.


def _read_crop(path: PathLike) -> list[list[int]] | None:
    """Pixels that the file's cropping layers cut off: [[top, bottom], [left, right]]."""
    with extra("keras"):
        import h5py

    with h5py.File(path, "r") as file:
        config = file.attrs.get("model_config")
    if config is None:
        return None
    for layer in json.loads(config)["config"]["layers"]:
        if layer["class_name"] == "Cropping2D":
            crop: list[list[int]] = layer["config"]["cropping"]
            return crop
    return None


def _read_filters(path: PathLike) -> Array:
    """Return the filters, (colour, 2, rows, cols)."""
    kernels = [layer["kernel"] for layer in read_layers(path) if set(layer) == {"kernel"}]
    kernels = [kernel[..., 0] for kernel in kernels if kernel.ndim == 4 and len(kernel) == 2 and kernel.shape[3] == 1]
    if not kernels or len({kernel.shape for kernel in kernels}) != 1:
        raise ValueError(f"{path} has no Hadamard filters, or filters of different sizes")
    return np.stack(kernels)


def _window(
    raw: tuple[int, int], crop: list[list[int]] | None, window: tuple[int, int] | None
) -> tuple[int, int, tuple[int, int]]:
    """Top, left and size of what is cut from the frame."""
    if window is not None:
        return (raw[0] - window[0]) // 2, (raw[1] - window[1]) // 2, window
    if crop is None:
        return 0, 0, raw
    (top, bottom), (left, right) = crop
    return top, left, (raw[0] - top - bottom, raw[1] - left - right)


def _half_spectrum(kernel: Array, offset: tuple[int, int]) -> tuple[NDArray[np.complex64], float]:
    """The filter on the half spectrum, and the share of its energy that makes a real image."""
    rows, cols = kernel.shape[1:]
    down, across = rows // 2 + offset[0], cols // 2 + offset[1]  # the first: their fftshift
    phase = np.exp(-2j * np.pi * np.fft.fftfreq(rows) * down)[:, None] * np.exp(
        -2j * np.pi * np.fft.fftfreq(cols) * across
    )
    full = (kernel[0] - 1j * kernel[1].astype(np.float64)) * phase
    mirrored = np.roll(full[::-1, ::-1], 1, axis=(0, 1))  # of -k
    # The energy of the Hermitian part of e^(i t) W is (sum |W|^2 + Re e^(2 i t) sum W(k) W(-k)) / 2.
    turn = np.exp(-0.5j * np.angle(np.sum(full * mirrored)))
    even = (turn * full + np.conj(turn * mirrored)) / 2
    if even[0, 0].real < 0:  # of two phases that do as well, the one that leaves light positive
        even = -even
    energy = np.sum(np.abs(full) ** 2)
    share = float(np.sum(np.abs(even) ** 2) / energy) if energy > 0 else 1.0
    return even[:, : cols // 2 + 1].astype(np.complex64), share
