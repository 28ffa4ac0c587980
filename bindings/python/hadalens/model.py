"""Models: a camera as data, learned from pairs or measured."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias

from . import errors
from ._arrays import Image
from ._native import Handle, Options, Owner, call, doubles, lib, path, record, value_of
from .device import Context, default

Form: TypeAlias = Literal["complex", "split", "matched", "wiener"]
Boundary: TypeAlias = Literal["circular", "padded"]


@dataclass(frozen=True)
class ModelInfo:
    """What a model is. Sizes in pixels, distances in millimetres, near to far.

    Attributes:
        raw_rows, raw_cols: size of the raw frames.
        grid_rows, grid_cols: grid of the transforms; larger than the frame with the boundary "padded".
        window_rows, window_cols: the scene, in the middle of the frame.
        dark: level taken off every pixel, full scale being 1; -1: each frame's own, estimated.
        noise: standard deviation of the frames' noise that the fit found, 0 where unknown.
        refine_steps: refinement that pays for this camera; 0: none does.
        scene_response: how the scenes that it was learned from stand for light.
        enhance: it holds a net that enhances refocused planes.

    """

    depths: int
    channels: int
    raw_rows: int
    raw_cols: int
    grid_rows: int
    grid_cols: int
    window_rows: int
    window_cols: int
    form: str
    boundary: str
    alpha: float
    dark: float
    noise: float
    refine_steps: int
    refine_rho: float
    refine_tv: float
    has_otf: bool
    half: bool
    enhance: bool
    enhance_rows: int
    enhance_cols: int
    bytes: int
    name: str
    scene_response: float
    refine_colour: float
    refine_share: float
    regularisation: float  # "lambda" in C
    distances_mm: tuple[float, ...]


class Model(Handle):
    """A camera, learned by :func:`hadalens.fit` or made from its point spread functions.

    A model does not change once it is there; any thread may use it, and it can be pickled.

    Example:
        >>> model = hadalens.Model.load("camera.model")
        >>> model.info.distances_mm
        (100.0, 137.5, 220.0, 600.0)

    """

    def __init__(self) -> None:
        """Models come from load, from_psf, fit and Trainer."""
        raise TypeError("make a model by Model.load, Model.from_psf, hadalens.fit or a Trainer")

    @classmethod
    def _new(cls, create: Any, *arguments: Any) -> Self:
        model = cls.__new__(cls)
        owner = Owner("hada_model", lib.hada_model_destroy)
        call(create, owner.pointer, *arguments)
        model._owner = owner
        return model

    @classmethod
    def _adopt(cls, pointer: Any) -> Self:
        """Take over a hada_model that C made."""
        model = cls.__new__(cls)
        model._owner = Owner("hada_model", lib.hada_model_destroy)
        model._owner.pointer[0] = pointer
        return model

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Self:
        """Return the model of a file (safetensors; docs/model-file.md).

        Raises:
            FileOpenError, FileReadError, FileFormatError: the file is missing, damaged, or no model.

        """
        return cls._new(lib.hada_model_load, path(name))

    def save(self, name: str | os.PathLike[str]) -> Path:
        """Write the model; the file is there whole or not at all. Returns its path.

        Raises:
            FileWriteError: it could not be written.

        """
        call(lib.hada_model_save, self._c, path(name))
        return Path(name)

    @classmethod
    def from_psf(
        cls,
        psfs: Any,
        distances_mm: Sequence[float],
        *,
        context: Context | None = None,
        form: Literal["matched", "wiener"] = "wiener",
        boundary: Boundary = "padded",
        window: tuple[int, int] | None = None,
        regularisation: float | None = None,
        psf_dark: float | None = None,
        dark: float | None = 0.0,
        refine_steps: int | None = None,
        refine_tv: float = 0.0,
        channel_axis: int | None = None,
    ) -> Self:
        """Return a model made from measured or designed point spread functions.

        Args:
            psfs: a sequence of images (Y, X) or (C, Y, X), or an array (Z, Y, X) or (Z, C, Y, X), one a depth, near to
                far, the optical axis at (rows // 2, columns // 2); dtypes as for :meth:`Plan.run`.
            distances_mm: of the depths, near to far.
            context: a device for the transforms.
            form: of the linear filters.
            boundary: "padded" for a sensor that crops what the optics cast, "circular" otherwise.
            window: rows and columns of the scene; None: the whole frame.
            regularisation: of the Wiener filter, relative to the mean power; None: chosen.
            psf_dark: taken off the point spread functions; None: estimated from their background.
            dark: of the frames to come; None: estimated from each.
            refine_steps: of refinement; None: chosen.
            refine_tv: weight of total variation in refinement.
            channel_axis: of each image, where it is not the first of three.

        Raises:
            SizeError, ArgumentError: sizes or values do not fit.

        Example:
            >>> model = hadalens.Model.from_psf([psf], [250.0], dark=None)

        """
        images = Image(*psfs, what="psfs", channel_axis=channel_axis)
        if len(images.arrays) != len(distances_mm):
            raise errors.SizeError(f"{len(images.arrays)} psfs and {len(distances_mm)} distances: one distance a psf")
        rows, cols = window or (None, None)
        options = Options(
            "hada_psf_options",
            form=form,
            boundary=boundary,
            window_rows=rows,
            window_cols=cols,
            psf_dark=psf_dark,
            dark=float(lib.HADA_AUTO) if dark is None else dark,
            refine_steps=refine_steps,
            refine_tv=refine_tv,
            **{"lambda": regularisation},
        )
        return cls._new(
            lib.hada_model_from_psf,
            default(context)._c,
            images.c,
            len(images.arrays),
            doubles(distances_mm),
            options.c,
        )

    @property
    def info(self) -> ModelInfo:
        """What the model is."""
        struct = lib.hada_model_get_info(self._c)[0]
        return record(
            ModelInfo,
            struct,
            regularisation=getattr(struct, "lambda"),
            distances_mm=tuple(struct.distances_mm[z] for z in range(struct.depths)),
        )

    def to_half(self) -> Model:
        """Return a copy with filters in half precision: a quarter less memory and traffic."""
        return Model._new(lib.hada_model_to_half, self._c)

    def with_form(self, form: Literal["matched", "wiener"], regularisation: float = 0.1) -> Model:
        """Return a copy with the fixed filters "matched" or "wiener" made from the transfer functions.

        Raises:
            ModelError: the model has no transfer functions.

        """
        return Model._new(lib.hada_model_with_form, self._c, value_of("hada_form", form, "form"), regularisation)

    def __reduce__(self) -> tuple[Any, ...]:
        """Models can be pickled, as the bytes of their file."""
        name = Path(self.info.name).name or "model"
        with tempfile.TemporaryDirectory() as folder:
            return _unpickle, (name, self.save(Path(folder) / name).read_bytes())

    def __repr__(self) -> str:
        """Return the model's name and sizes."""
        if self._owner is None:
            return "Model(closed)"
        info = self.info
        return (
            f"<Model {info.name or 'without a file'}: {info.depths} depths from {info.distances_mm[0]:g} to "
            f"{info.distances_mm[-1]:g} mm, {info.channels} x {info.raw_rows} x {info.raw_cols}, window "
            f"{info.window_rows} x {info.window_cols}>"
        )


def _unpickle(name: str, content: bytes) -> Model:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(content)
        return Model.load(file)
