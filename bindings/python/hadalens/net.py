"""Nets that enhance images: lists of layers with their weights, and running them on a device."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

from ._arrays import Float32, Image, NewImage
from ._native import Handle, Options, Owner, call, expect, ffi, lib, loaded, path, record, saved, text
from .device import Device, default


@dataclass(frozen=True)
class NetInfo:
    """What a net is.

    Attributes:
        channels, out_channels: of the images that it takes and gives.
        shared: a net of one channel, run on each channel by itself.
        parameters: tensors.
        trained: values that training changes.
        values: with the running statistics of batch norms.

    """

    channels: int
    out_channels: int
    shared: bool
    layers: int
    parameters: int
    trained: int
    values: int


class Net(Handle):
    """A net: a list of layers and their weights, by PyTorch's names (docs/explanation/nets.md).

    Example:
        >>> net = hadalens.Net.preset("compact", channels=3, seed=1)
        >>> better = hadalens.NetRunner(net, 120, 120).run(image)

    """

    def __init__(self, description: str, *, seed: int = 0) -> None:
        """Make a net from its description (JSON), with random weights."""
        self._make(lib.hada_net_create, description.encode(), seed)

    def _make(self, create: Any, *arguments: Any) -> None:
        owner = Owner("hada_net", lib.hada_net_destroy)
        call(create, owner.pointer, *arguments)
        self._owner = owner

    @classmethod
    def _new(cls, create: Any, *arguments: Any) -> Self:
        net = cls.__new__(cls)
        net._make(create, *arguments)
        return net

    @classmethod
    def _of(cls, owner: Owner) -> Self:
        net = cls.__new__(cls)
        net._owner = owner
        return net

    @classmethod
    def _copy(cls, pointer: Any) -> Self:
        """Return a copy of a net that something else owns."""
        with tempfile.TemporaryDirectory() as folder:
            name = path(Path(folder) / "net")
            call(lib.hada_net_save, pointer, name)
            return cls._new(lib.hada_net_load, name)

    @classmethod
    def preset(cls, name: Literal["compact", "paper"], channels: int = 3, *, seed: int = 0) -> Self:
        """Return a new net of a preset, with random weights: "compact", or "paper" (Tian and Yang 2022)."""
        return cls._new(lib.hada_net_create_preset, name.encode(), channels, seed)

    @classmethod
    def unet(
        cls,
        down: str,
        up: str,
        *,
        channels: int = 3,
        out_channels: int | None = None,
        shared: bool = False,
        up_by: Literal["linear", "nearest", "transposed"] = "linear",
        last_kernel: int = 1,
        last_relu: bool = False,
        last_norm: bool = False,
        seed: int = 0,
    ) -> Self:
        """Return a U-net of any widths.

        Args:
            down: widths of the convolutions of each level, top to bottom: "16,16|32,32|64,64".
            up: those on the way up, bottom to top, one level less: "32,32|16,16".
            channels, out_channels: of the images.
            shared: one net of one channel for all channels.
            up_by: how images grow.
            last_kernel: 1 or 3.
            last_relu, last_norm: ReLU after, batch norm before the last convolution.
            seed: of the weights.

        """
        options = Options(
            "hada_unet_options",
            channels=channels,
            out_channels=channels if out_channels is None else out_channels,
            shared=shared,
            down=down,
            up=up,
            up_by=up_by,
            last_kernel=last_kernel,
            last_relu=last_relu,
            last_norm=last_norm,
        )
        return cls._new(lib.hada_net_create_unet, options.c, seed)

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Self:
        """Return the net of a safetensors file."""
        return cls._new(lib.hada_net_load, path(name))

    def save(self, name: str | os.PathLike[str]) -> Path:
        """Write a safetensors file: weights by PyTorch's names and layouts. Returns its path."""
        call(lib.hada_net_save, self._c, path(name))
        return Path(name)

    def load_weights(self, name: str | os.PathLike[str], prefix: str = "") -> None:
        """Take over the weights of a safetensors file by their names, each with `prefix` in front.

        Raises:
            ModelError: one is missing or has another shape; the net is unchanged.

        """
        call(lib.hada_net_load_weights, self._c, path(name), prefix.encode())

    @property
    def info(self) -> NetInfo:
        """What the net is."""
        return record(NetInfo, lib.hada_net_get_info(self._c)[0])

    @property
    def description(self) -> str:
        """The list of layers, JSON."""
        out = ffi.new("char **")
        call(lib.hada_net_describe, self._c, out)
        words = text(out[0])
        lib.hada_memory_destroy(out)
        return words

    def _shown(self) -> str:
        info = self.info
        return f"{info.channels} to {info.out_channels} channels, {info.layers} layers, {info.values} values"

    def bytes(self, rows: int, cols: int, *, context: Device | None = None) -> int:
        """Return the device memory that running it on images of a size takes."""
        out = ffi.new("uint64_t *")
        call(lib.hada_net_bytes, default(context)._c, self._c, rows, cols, out)
        return int(out[0])

    def __reduce__(self) -> tuple[Any, ...]:
        """Nets can be pickled, as the bytes of their file."""
        return loaded, (Net, saved(self))


class NetRunner(Handle):
    """A net made ready for images of one size on a device; used by one thread at a time.

    Args:
        net: its weights are copied.
        rows, cols: of the images.
        context: a device; None: :meth:`Context.default`.

    """

    def __init__(self, net: Net, rows: int, cols: int, *, context: Device | None = None) -> None:
        """Take room on the device."""
        used, net = default(context), expect(net, Net, "net")
        owner = Owner("hada_net_runner", lib.hada_net_runner_destroy, used._own, net._own)
        call(lib.hada_net_runner_create, owner.pointer, used._c, net._c, rows, cols)
        self._owner = owner

    def run(self, image: Any, *, channel_axis: int | None = None) -> Float32:
        """Return what the net makes of an image: float32 (C, Y, X)."""
        given, made = Image(image, channel_axis=channel_axis), NewImage()
        call(lib.hada_net_run, self._c, given.c, made.c)
        return made.array()
