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
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._files import PathLike, replaced

__all__ = ["Imported", "Net", "import_filters", "import_model", "import_net"]

Array: TypeAlias = NDArray[np.float32]

# The authors' U-net: widths of its convolutions on the way down, level by level, and up (bottom first).
DOWN = ((32, 32), (64,), (64,), (128,), (256,), (512, 256, 128))
UP = ((128,), (64,), (32,), (32,), ())
COLOURS = "rgb"
# Of Keras' batch norm; its momentum weighs what was, PyTorch's and ours what comes.
KERAS_EPS, KERAS_MOMENTUM = 1e-3, 0.01


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


@dataclass(frozen=True)
class Net:
    """A net as its list of layers (``docs/nets.md``) and its weights, by PyTorch's names and layouts."""

    description: dict[str, Any]
    weights: dict[str, Array]

    def save(self, path: PathLike) -> None:
        """Write a net's file (safetensors), which the library and :class:`hadalens.torch.Net` load."""
        from safetensors.numpy import save_file

        with replaced(path) as beside:
            save_file(self.weights, beside, metadata={"net": json.dumps(self.description)})


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


def import_net(file: PathLike, *, size: tuple[int, int] = (256, 256)) -> Net:
    """Read the U-net of a ``fullgenerator`` or ``enhanceM`` file.

    Both forms that the authors have are read: one net shared by the colours (our preset ``paper``), and one for each of
    them, which becomes a net of three branches.

    Args:
        file: an HDF5 file that Keras wrote.
        size: of the images that the net is meant for: rows and columns, multiples of 32 as Keras needs them.

    Raises:
        ValueError: where the file's convolutions are not those of the authors' net, or `size` is no multiple of 32.

    """
    if size[0] % 32 or size[1] % 32 or min(size) <= 0:
        raise ValueError(f"the authors' net runs on multiples of 32 rows and columns, not on {size[0]} x {size[1]}")
    layers = _read_layers(file)
    convs = [layer for layer in layers if set(layer) == {"kernel", "bias"}]
    norms = [layer for layer in layers if set(layer) == {"gamma", "beta", "moving_mean", "moving_variance"}]
    names = _conv_names()
    if len(norms) != len(COLOURS) or len(convs) not in (len(names), len(names) * len(COLOURS)):
        raise ValueError(
            f"{file} has {len(convs)} convolutions and {len(norms)} batch norms; the authors' net has 14 or 42, and 3"
        )
    shared = len(convs) == len(names)
    weights: dict[str, Array] = {}
    for i, conv in enumerate(convs):
        colour, name = ("", names[i]) if shared else (f"{COLOURS[i % 3]}.", names[i // 3])
        kernel, bias = _convolution(name, conv, file)
        weights[f"{colour}{name}.weight"], weights[f"{colour}{name}.bias"] = kernel, bias
    for i, norm in enumerate(norms):
        name = f"norm.{i}" if shared else f"{COLOURS[i]}.norm"
        for ours, theirs in (
            ("weight", "gamma"),
            ("bias", "beta"),
            ("running_mean", "moving_mean"),
            ("running_var", "moving_variance"),
        ):
            weights[f"{name}.{ours}"] = _skip_first(norm[theirs], _from_below()["last"])
    if not shared:
        for i, colour in enumerate(COLOURS):  # a convolution of one pixel takes a colour out of the image
            weights[f"{colour}.take.weight"] = np.eye(3, dtype=np.float32)[i].reshape(1, 3, 1, 1)
    return Net(_describe_shared() if shared else _describe_branches(), weights)


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
    """What a model file says about itself (docs/model-file.md)."""
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


def _read_layers(path: PathLike) -> list[dict[str, Array]]:
    """Return the weights of each layer that has some, in the order in which the program made the layers.

    Keras numbers layers of a kind as they are made (conv2d_7), starting anywhere, and writes them in another order.
    """
    import h5py

    found: dict[str, dict[str, Array]] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            parts = name.split("/")
            found.setdefault(parts[0], {})[parts[-1].removesuffix(":0")] = np.asarray(item, np.float32)

    with h5py.File(path, "r") as file:
        weights = file.get("model_weights", file)
        if not isinstance(weights, h5py.Group) or "layer_names" not in weights.attrs:
            raise ValueError(
                f"{path} is not in the HDF5 format of Keras 2 (model.save or save_weights to a name in .h5)"
            )
        weights.visititems(visit)
    return [found[name] for name in sorted(found, key=_made)]


def _made(layer: str) -> tuple[str, int]:
    kind, _, number = layer.rpartition("_")
    return (kind, int(number)) if number.isdigit() else (layer, 0)


def _read_crop(path: PathLike) -> list[list[int]] | None:
    """Pixels that the file's cropping layers cut off: [[top, bottom], [left, right]]."""
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
    kernels = [layer["kernel"] for layer in _read_layers(path) if set(layer) == {"kernel"}]
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


# The authors' U-net. Where a level of the way up puts together what comes from below and its own skip, theirs stand in
# this order; ours has the skip first.


def _conv_names() -> list[str]:
    """In the order in which the authors' program makes them."""
    names = [f"down.{level}.{i}" for level, widths in enumerate(DOWN) for i in range(len(widths))]
    names += [f"up.{len(UP) - 1 - step}.{i}" for step, widths in enumerate(UP) for i in range(len(widths))]
    return [*names, "last"]


def _from_below() -> dict[str, int]:
    """Of the convolutions that take a concatenation: how many channels come from below."""
    below, taken = DOWN[-1][-1], {}
    for step, widths in enumerate(UP):
        taken[f"up.{len(UP) - 1 - step}.0" if widths else "last"] = below
        below = widths[-1] if widths else below
    return taken


def _skip_first(values: Array, below: int) -> Array:
    """Channels on the first axis in our order."""
    return np.ascontiguousarray(np.concatenate([values[below:], values[:below]]))


def _convolution(name: str, layer: dict[str, Array], path: PathLike) -> tuple[Array, Array]:
    shapes = _conv_shapes()
    kernel = layer["kernel"]
    if kernel.shape != shapes[name] or layer["bias"].shape != shapes[name][3:]:
        raise ValueError(
            f"{path}: a convolution ({name}) has the shape {kernel.shape}, the authors' has {shapes[name]}"
        )
    kernel = kernel.transpose(2, 3, 0, 1)  # input first
    below = _from_below().get(name)
    if below is not None:
        kernel = _skip_first(kernel, below)
    return np.ascontiguousarray(kernel.swapaxes(0, 1)), layer["bias"]


def _conv_shapes() -> dict[str, tuple[int, ...]]:
    """Rows, columns, channels in and out, as Keras has them."""
    shapes: dict[str, tuple[int, ...]] = {}
    width = 1
    for level, widths in enumerate(DOWN):
        for i, out in enumerate(widths):
            shapes[f"down.{level}.{i}"] = (3, 3, width, out)
            width = out
    for step, widths in enumerate(UP):
        level = len(UP) - 1 - step
        width += DOWN[level][-1]
        for i, out in enumerate(widths):
            shapes[f"up.{level}.{i}"] = (3, 3, width, out)
            width = out
    return shapes | {"last": (3, 3, width, 1)}


def _unet_layers(first: int, start: int, prefix: str) -> list[dict[str, Any]]:
    """The list of layers of the authors' U-net on layer `start`; its own are numbered from `first`."""
    layers: list[dict[str, Any]] = []
    skips = []

    def add(layer: str, **what: object) -> int:
        layers.append({"layer": layer, **what})
        return first + len(layers) - 1

    def conv(at: int, name: str, channels: int) -> int:
        return add("conv", name=prefix + name, **{"from": [at]}, channels=channels, activation="relu")

    at = start
    for level, widths in enumerate(DOWN):
        if level:
            at = add("pool", **{"from": [at]})
        for i, width in enumerate(widths):
            at = conv(at, f"down.{level}.{i}", width)
        skips.append(at)
    for step, widths in enumerate(UP):
        level = len(UP) - 1 - step
        at = add("resize", resize="linear", **{"from": [at]}, like=skips[level])
        at = add("concat", **{"from": [skips[level], at]})
        for i, width in enumerate(widths):
            at = conv(at, f"up.{level}.{i}", width)
    at = add("norm", name=prefix + "norm", **{"from": [at]}, eps=KERAS_EPS, momentum=KERAS_MOMENTUM)
    conv(at, "last", 1)
    return layers


def _describe_shared() -> dict[str, Any]:
    layers = [{"layer": "input", "channels": 1}, *_unet_layers(1, 0, "")]
    return {"format": "hadalens-net-1", "colours": len(COLOURS), "layers": layers}


def _describe_branches() -> dict[str, Any]:
    layers: list[dict[str, Any]] = [{"layer": "input", "channels": len(COLOURS)}]
    ends = []
    for colour in COLOURS:
        take = {"layer": "conv", "name": f"{colour}.take", "from": [0], "channels": 1, "kernel": 1, "pad": 0, "bias": 0}
        layers.append(take)
        layers += _unet_layers(len(layers), len(layers) - 1, f"{colour}.")
        ends.append(len(layers) - 1)
    layers.append({"layer": "concat", "from": ends})
    return {"format": "hadalens-net-1", "colours": 1, "layers": layers}
