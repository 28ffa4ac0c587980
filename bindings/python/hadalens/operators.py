"""What a camera does to a scene, as a linear operator for other solvers: SciPy's, or your own.

The frame of planes x is A x = sum over depths of PSF * x, cropped to the sensor. PyTorch has it as
:class:`hadalens.torch.Forward` and :class:`hadalens.torch.Adjoint`.
"""

from __future__ import annotations

import os
from typing import Literal

import numpy as np
import numpy.typing as npt

from . import errors
from .model import Model, as_model

__all__ = ["Forward"]


class Forward:
    """The frame that a model says planes make, and its adjoint: plain NumPy, in double precision, without a device.

    It has what SciPy takes for a linear operator (``shape``, ``dtype``, ``matvec``, ``rmatvec``), so that
    ``scipy.sparse.linalg`` solves with it: vectors are planes (Z, C, Y, X) of the window, and frames (C, Y, X),
    flattened. Dark level and noise are not in it, and frames have all channels.

    Args:
        model: with transfer functions, or its file.
        support: where planes may be bright, which is their size: "window", or "frame".

    Raises:
        ModelError: the model has no transfer functions.

    Example:
        >>> A = hadalens.operators.Forward(model)
        >>> planes = scipy.sparse.linalg.lsmr(A, raw.ravel(), damp=0.1)[0].reshape(A.planes_shape)
        >>> residual = raw - A(planes)

    """

    def __init__(
        self, model: Model | str | os.PathLike[str], *, support: Literal["window", "frame"] = "window"
    ) -> None:
        """Take the transfer functions."""
        if support not in ("window", "frame"):
            raise errors.ArgumentError(f'support="{support}" is not known; there are "window" and "frame"')
        model = as_model(model)
        info, otf = model.info, model.otf
        if info.components > 1:
            raise errors.ModelError("the model's point spread functions vary over the field: take one of their mean")
        if otf is None:
            raise errors.ModelError("the model has no transfer functions, so it does not say what frames scenes make")
        #: Sizes of planes (Z, C, Y, X) and frames (C, Y, X), the grid of the transforms, and where the window stands.
        self.frame_shape = (info.channels, info.raw_rows, info.raw_cols)
        rows, cols = (info.window_rows, info.window_cols) if support == "window" else self.frame_shape[1:]
        self.planes_shape = (info.depths, info.channels, rows, cols)
        self.grid = (info.grid_rows, info.grid_cols)
        self.origin = ((info.raw_rows - rows) // 2, (info.raw_cols - cols) // 2)
        # the half spectrum of what is real: the adjoint is exact then
        self.otf: npt.NDArray[np.complex128] = np.fft.rfft2(np.fft.irfft2(otf.astype(np.complex128), s=self.grid))
        self.shape = (int(np.prod(self.frame_shape)), int(np.prod(self.planes_shape)))
        self.dtype = np.dtype(np.float64)

    def __call__(self, planes: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the frame (C, Y, X) of planes (Z, C, Y, X)."""
        given = np.asarray(planes, np.float64)
        if given.shape != self.planes_shape:
            raise errors.SizeError(f"planes of {given.shape}: {self.planes_shape} is needed")
        (top, left), (rows, cols) = self.origin, self.planes_shape[2:]
        wide = np.zeros((*self.planes_shape[:2], *self.grid))
        wide[..., top : top + rows, left : left + cols] = given
        light = np.fft.irfft2((self.otf * np.fft.rfft2(wide)).sum(0), s=self.grid)
        return np.ascontiguousarray(light[..., : self.frame_shape[1], : self.frame_shape[2]])

    def adjoint(self, frame: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the planes (Z, C, Y, X) that the transposed operator makes of a frame (C, Y, X)."""
        given = np.asarray(frame, np.float64)
        if given.shape != self.frame_shape:
            raise errors.SizeError(f"a frame of {given.shape}: {self.frame_shape} is needed")
        (top, left), (rows, cols) = self.origin, self.planes_shape[2:]
        wide = np.zeros((self.frame_shape[0], *self.grid))
        wide[..., : self.frame_shape[1], : self.frame_shape[2]] = given
        light = np.fft.irfft2(self.otf.conj() * np.fft.rfft2(wide), s=self.grid)
        return np.ascontiguousarray(light[..., top : top + rows, left : left + cols])

    def matvec(self, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the frame of planes, both flattened."""
        return self(np.reshape(x, self.planes_shape)).ravel()

    def rmatvec(self, y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the adjoint's planes of a frame, both flattened."""
        return self.adjoint(np.reshape(y, self.frame_shape)).ravel()
