"""What Keras writes: weights of layers in HDF5 files."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._files import PathLike, extra

Array: TypeAlias = NDArray[np.float32]


def read_layers(path: PathLike) -> list[dict[str, Array]]:
    """Return the weights of each layer that has some, in the order in which the program made the layers.

    Keras numbers layers of a kind as they are made (conv2d_7), starting anywhere, and writes them in another order.
    """
    with extra("keras"):
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
