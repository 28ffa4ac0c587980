"""What notebooks show of results, models and reports."""

from __future__ import annotations

import dataclasses
import html
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from . import errors
from ._arrays import Float32, Image, NewImage
from ._native import AUTO, call, lib, path

_SIDE = 480  # pixels of a picture, at most


def png(image: Float32) -> bytes | None:
    """Return an image (C, Y, X) of linear light as PNG, made smaller where it is large; None without cairo."""
    given, made = Image(image), NewImage()
    rows, cols = image.shape[1:]
    shrink = max(rows, cols) / _SIDE
    if shrink > 1:
        call(lib.hada_image_resize, made.c, given.c, max(1, round(rows / shrink)), max(1, round(cols / shrink)))
        given = Image(made.array())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "image.png"
        try:
            call(lib.hada_png_save, path(file), given.c, AUTO, AUTO)
        except errors.UnsupportedError:
            return None
        return file.read_bytes()


def table(title: str, rows: Iterable[Sequence[Any]]) -> str:
    """Return a table as HTML."""
    lines = ("".join(f"<td>{html.escape(words(cell))}</td>" for cell in row) for row in rows)
    return f"<table><caption>{html.escape(title)}</caption>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def members(thing: Any) -> list[tuple[str, Any]]:
    """Return the members of a dataclass that are no dataclasses themselves."""
    pairs = [(field.name.replace("_", " "), getattr(thing, field.name)) for field in dataclasses.fields(thing)]
    return [(name, value) for name, value in pairs if not dataclasses.is_dataclass(value)]


def words(value: Any) -> str:
    """Return a value in few characters."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, tuple | list):
        return ", ".join(words(one) for one in value)
    if isinstance(value, dict):
        return ", ".join(f"{name} {words(one)}" for name, one in value.items())
    return str(value)
