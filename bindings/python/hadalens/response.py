"""How values stand for light: linear, as sRGB, or by a power.

A response is a number: :data:`LINEAR`, :data:`SRGB`, or the power p of light = value**p.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arrays import Float32, address, as_array
from ._native import Special, call, ffi, lib, text

__all__ = [
    "LINEAR",
    "SRGB",
    "convert",
    "from_light",
    "is_known",
    "name",
    "number",
    "to_light",
]


def __dir__() -> list[str]:
    """Return the names for users."""
    return __all__


LINEAR: float = lib.HADA_RESPONSE_LINEAR
SRGB: float = lib.HADA_RESPONSE_SRGB


def number(response: float | str) -> float:
    """Return the number of a response given by its word ("linear", "srgb", "auto", "2.2") or its number.

    Raises:
        ArgumentError: no such response.

    Example:
        >>> hadalens.response.number("srgb") == hadalens.response.SRGB
        True

    """
    out = ffi.new("double *")
    given = response if isinstance(response, str) else name(response)
    call(lib.hada_response_from_name, out, given.encode())
    return Special(out[0])


def name(response: float) -> str:
    """Return the word of a response."""
    room = ffi.new("char[]", lib.HADA_RESPONSE_NAME)
    lib.hada_response_name(room, response)
    return text(room)


def is_known(response: float) -> bool:
    """Return whether a number is a response."""
    return bool(lib.hada_response_is_known(response))


def convert(values: Any, source: float | str, target: float | str) -> Float32:
    """Return a copy of values, float32, in another encoding.

    Args:
        values: an array of any shape; dtypes as for :meth:`Plan.run`, integers being taken as they are.
        source: the response of the values.
        target: the response wanted.

    Example:
        >>> light = hadalens.response.convert(photograph / 255, "srgb", "linear")

    """
    array = np.array(as_array(values, "values"), np.float32, order="C", copy=True)
    pointer = ffi.cast("float *", address(array))
    lib.hada_response_convert(pointer, array.size, number(source), number(target))
    return array


def to_light(response: float | str, value: float) -> float:
    """Return the light of one value."""
    return float(convert(np.asarray([value]), response, LINEAR)[0])


def from_light(response: float | str, light: float) -> float:
    """Return the value that stands for a light."""
    return float(convert(np.asarray([light]), LINEAR, response)[0])
