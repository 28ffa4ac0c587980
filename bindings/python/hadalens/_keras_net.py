"""The U-net of the authors' Keras program as a net of ours."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._files import PathLike, extra, replaced
from ._keras_file import Array, read_layers

# The authors' U-net: widths of its convolutions on the way down, level by level, and up (bottom first).
DOWN = ((32, 32), (64,), (64,), (128,), (256,), (512, 256, 128))
UP = ((128,), (64,), (32,), (32,), ())
COLOURS = "rgb"
# Of Keras' batch norm; its momentum weighs what was, PyTorch's and ours what comes.
KERAS_EPS, KERAS_MOMENTUM = 1e-3, 0.01


@dataclass(frozen=True)
class Net:
    """A net as its list of layers (``docs/explanation/nets.md``) and its weights, by PyTorch's names and layouts."""

    description: dict[str, Any]
    weights: dict[str, Array]

    def save(self, path: PathLike) -> None:
        """Write a net's file (safetensors), which the library and :class:`hadalens.torch.Net` load."""
        with extra("keras"):
            from safetensors.numpy import save_file

        with replaced(path) as beside:
            save_file(self.weights, beside, metadata={"net": json.dumps(self.description)})


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
    layers = read_layers(file)
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
