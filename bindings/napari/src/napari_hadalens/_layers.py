"""Results as napari's layers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from hadalens.ome import is_even, mean_step
from numpy.typing import NDArray

LayerData: TypeAlias = tuple[Any, dict[str, Any], str]
Array: TypeAlias = NDArray[np.float32]

# Pictures are shown as sRGB of light / white, a percentile, so that few bright pixels do not darken the rest.
WHITE = 99.9


def image_layer(image: Array, name: str, white: float | None = None, **options: Any) -> LayerData:
    """Return a layer of light ``(..., C, Y, X)``.

    Of three channels it shows colours as a display wants them, of one the values; its metadata hold the light itself.
    """
    if white is None:
        white = white_of(image)
    options["metadata"] = options.get("metadata", {}) | {"light": image}
    if image.shape[-3] != 3:
        options |= {"contrast_limits": (0.0, white), "gamma": 1 / 2.2}
        return image[..., 0, :, :], {"name": name, **options}, "image"
    options["metadata"]["values"] = f"sRGB of light / {white:.6g}"
    return np.moveaxis(to_display(image / np.float32(white)), -3, -1), {"name": name, "rgb": True, **options}, "image"


def white_of(image: Array) -> float:
    """Return the light that is shown as white."""
    return max(float(np.percentile(image, WHITE)), 1e-12)


def to_display(light: Array) -> Array:
    """Encode light as sRGB (IEC 61966-2-1)."""
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** np.float32(1 / 2.4) - np.float32(0.055))


def depth_axis(distances: Sequence[float]) -> tuple[dict[str, Any], str]:
    """Return scale and start of the axis of depths, and its label.

    Even distances are the scale, in millimetres. Of others the axis counts depths, and its label says which they are.
    """
    if is_even(distances):
        return {"scale": mean_step(distances), "translate": distances[0]}, "distance (mm)"
    return {"scale": 1.0, "translate": 0.0}, "depth: " + ", ".join(f"{i} = {d:g} mm" for i, d in enumerate(distances))


def stack_layer(stack: Array, distances: Sequence[float], name: str, white: float | None = None) -> LayerData:
    """Return a layer of refocused planes ``(Z, C, Y, X)``, or of a sequence of such."""
    axis, label = depth_axis(distances)
    frames = stack.ndim - 4
    return image_layer(
        stack,
        name,
        white,
        scale=(*(1.0,) * frames, axis["scale"], 1.0, 1.0),
        translate=(*(0.0,) * frames, axis["translate"], 0.0, 0.0),
        axis_labels=(*("frame",) * frames, label, "row", "column"),
        metadata={"distances_mm": list(distances)},
    )


def map_layers(distance_map: Array, distances: Sequence[float], name: str) -> list[LayerData]:
    """Return the distance map as an image, and of one frame as a surface that stands among the planes of the stack."""
    limits = (float(min(distances)), float(max(distances)) + (len(distances) == 1))
    look = {"colormap": "viridis", "contrast_limits": limits, "visible": False}
    layers: list[LayerData] = [(distance_map, {"name": name, **look}, "image")]
    surface = surface_of(distance_map, distances) if distance_map.ndim == 2 else None
    if surface is not None:
        layers.append((surface, {"name": f"{name}, surface", "shading": "none", **look}, "surface"))
    return layers


def surface_of(distance_map: Array, distances: Sequence[float]) -> tuple[Array, NDArray[np.int32], Array] | None:
    """Return vertices (z, row, column), triangles and distances; None where nowhere three neighbours are known."""
    rows, cols = distance_map.shape
    z = distance_map
    if not is_even(distances):  # the axis counts depths
        z = np.interp(distance_map, distances, np.arange(len(distances))).astype(np.float32)
    row, col = np.indices((rows, cols), np.float32)
    corner = np.arange(rows * cols, dtype=np.int32).reshape(rows, cols)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel(), corner[1:, :-1].ravel(), corner[1:, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    known = np.isfinite(distance_map).ravel()
    faces = faces[known[faces].all(axis=1)]
    if not len(faces):
        return None
    used, faces = np.unique(faces, return_inverse=True)
    vertices = np.stack([z.ravel(), row.ravel(), col.ravel()], 1)[used].astype(np.float32)
    return vertices, faces.reshape(-1, 3).astype(np.int32), distance_map.ravel()[used].astype(np.float32)


def result_layers(result: Any, name: str) -> list[LayerData]:
    """Return the layers of a :class:`hadalens.Result`; the map of a single depth says nothing and is left out."""
    distances = [float(distance) for distance in result.distances_mm]
    return stacked_layers(result.stack, result.all_in_focus, result.distance_map, distances, name)


def stacked_layers(
    stack: Array, picture: Array, distance_map: Array, distances: Sequence[float], name: str
) -> list[LayerData]:
    """Return the layers of a result, or of a sequence of results, each with one axis more."""
    white = white_of(picture)
    return [
        stack_layer(stack, distances, f"{name}: planes", white),
        *(map_layers(distance_map, distances, f"{name}: distances") if len(distances) > 1 else []),
        image_layer(picture, f"{name}: all in focus", white),
    ]
