"""How values stand for light: linear, as sRGB, or by a power.

A response is a number: :data:`LINEAR`, :data:`SRGB`, or the power p of light = value**p.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import errors
from ._arrays import Float32, address, as_array, to_float
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


def convert(values: Any, source: float | str, target: float | str, *, full_scale: float | None = None) -> Float32:
    """Return a copy of values, float32, in another encoding.

    Args:
        values: an array of any shape; dtypes as for :meth:`Plan.run`, integers being divided by their full scale.
        source: the response of the values; one that is known, not "auto".
        target: the response wanted.
        full_scale: as for :meth:`Plan.run`.

    Example:
        >>> light = hadalens.response.convert(photograph, "srgb", "linear")

    """
    array = np.array(to_float(as_array(values, "values"), full_scale), copy=True)
    numbers = number(source), number(target)
    for given, found in zip((source, target), numbers, strict=True):
        if not is_known(found):
            raise errors.ArgumentError(f'{given!r} is no response to convert by: "linear", "srgb" or a power')
    lib.hada_response_convert(ffi.cast("float *", address(array)), array.size, *numbers)
    return array


def to_light(response: float | str, value: float) -> float:
    """Return the light of one value."""
    return float(convert(np.asarray([value], np.float64), response, LINEAR)[0])


def from_light(response: float | str, light: float) -> float:
    """Return the value that stands for a light."""
    return float(convert(np.asarray([light], np.float64), LINEAR, response)[0])
