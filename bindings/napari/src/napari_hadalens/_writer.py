"""Writes results as OME-Zarr."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hadalens
import numpy as np
from hadalens.ome import OmeZarrWriter

from ._layers import LayerData


def write(path: str, layers: list[LayerData]) -> list[str]:
    """Write the planes among layers, with the all-in-focus image and the distance map where these are there as well.

    What is missing is made of the planes. Of a sequence, every frame is written.

    Raises:
        ValueError: there are no planes, or several.

    """
    images = [(data, options) for data, options, kind in layers if kind == "image"]
    stacks = [options["metadata"] for _, options in images if "distances_mm" in options.get("metadata", {})]
    if len(stacks) != 1:
        raise ValueError(f"Choose the planes of one result: there are {len(stacks)} layers of such.")
    distances, light = stacks[0]["distances_mm"], stacks[0]["light"]
    sequence = light if light.ndim == 5 else light[np.newaxis]
    shape = (*sequence.shape[:1], *sequence.shape[2:])
    pictures = [options["metadata"]["light"] for _, options in images if "light" in options.get("metadata", {})]
    maps = [np.asarray(data) for data, options in images if not options.get("metadata", {}) and not options.get("rgb")]
    picture = _alike(pictures, shape)
    where = _alike(maps, (shape[0], *shape[2:]))
    with OmeZarrWriter(Path(path), overwrite=True) as writer:
        for time, stack in enumerate(sequence):
            sharp: Any = None if picture is None else picture[time]
            far: Any = None if where is None else where[time]
            if sharp is None or far is None:
                made = hadalens.focus_stack(stack, distances)
                sharp, far = made[0] if sharp is None else sharp, made[1] if far is None else far
            result: Any = SimpleNamespace(stack=stack, all_in_focus=sharp, distance_map=far, distances_mm=distances)
            writer.append(result)
    return [path]


def _alike(images: list[Any], shape: tuple[int, ...]) -> Any:
    """Return the image of this shape, its first axis being times; None where there is none."""
    found = [image.reshape(shape) for image in images if image.shape in (shape, shape[1:] if shape[0] == 1 else shape)]
    return found[0] if found else None
