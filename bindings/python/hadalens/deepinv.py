"""Cameras as physics of deepinv (https://deepinv.github.io), and this library as one of its reconstructors.

With :class:`Lensless` deepinv's algorithms (plug-and-play, unrolled, diffusion) reconstruct frames of a camera.
"""

from __future__ import annotations

from typing import Any, Literal

from . import operators
from ._files import PathLike, extra
from .model import Model
from .plan import Plan

with extra("deepinv"):
    import deepinv
    from torch import Tensor, as_tensor, fft, from_numpy, full_like, stack, view_as_complex

    from . import torch

__all__ = ["EachPlane", "Engine", "Lensless", "TotalVariation"]


class Lensless(deepinv.physics.LinearPhysics):  # type: ignore[misc]  # which is Any to the type checker
    """The frame ``(N, C, Y, X)`` that a camera records of planes ``(N, Z, C, Y, X)``, of one depth ``(N, C, Y, X)``.

    Plain PyTorch: any device, with gradients, no OpenCL. The adjoint is exact. So is ``prox_l2``, in one step for each
    frequency, where the planes cover the whole grid: circular cameras with ``support="frame"`` (or a window as large
    as the frame), of any number of depths; otherwise it is deepinv's own, by conjugate gradients. Frames are above
    their dark level. Step sizes of deepinv are for operators of norm 1; this one's is at most
    :attr:`norm`, if no value of the point spread functions is below zero.

    Args:
        model: a :class:`hadalens.Model` with transfer functions, its file, or a :class:`hadalens.operators.Forward`.
        support: where planes may be bright, which is their size: "window", or "frame".
        options: of ``deepinv.physics.LinearPhysics``: ``noise_model``, ``max_iter``, ``tol``, ...

    Example:
        >>> physics = hadalens.deepinv.Lensless("camera.model", support="frame")
        >>> dpir = deepinv.optim.DPIR(sigma=0.02)
        >>> picture = dpir(frames, physics)

    """

    def __init__(
        self,
        model: operators.Forward | Model | PathLike,
        *,
        support: Literal["window", "frame"] = "window",
        **options: Any,
    ) -> None:
        """Take the transfer functions."""
        if not isinstance(model, operators.Forward):
            model = operators.Forward(model, support=support)
        shape = model.planes_shape
        super().__init__(img_size=shape if shape[0] > 1 else shape[1:], **options)
        self.camera = torch.Forward(model)
        #: 1: prox_l2 is exact.
        self.exact = model.frame_shape[1:] == model.grid == shape[2:]
        #: The largest gain at frequency 0.
        self.norm = float((abs(model.otf[..., 0, 0]) ** 2).sum(0).max() ** 0.5)

    def A(self, x: Tensor, **_: Any) -> Tensor:  # noqa: N802  deepinv's name
        """Return the frames of planes, without noise."""
        return self.camera(x)

    def A_adjoint(self, y: Tensor, **_: Any) -> Tensor:  # noqa: N802
        """Return the planes that the transposed operator makes of frames."""
        planes = self.camera._planes(y)
        return planes if planes.shape[1] > 1 else planes[:, 0]

    def prox_l2(self, z: Tensor | float | None, y: Tensor, gamma: float | Tensor, **options: Any) -> Tensor:
        """Return the x of the least ``gamma / 2 |A x - y|² + 1/2 |x - z|²``.

        Args:
            z: planes, or what all their values are; None: 0.
            y: frames.
            gamma: a number, or one of each frame.
            options: of deepinv's, where it is not exact.

        """
        if not self.exact:
            return super().prox_l2(z, y, gamma, **options)
        start = z if isinstance(z, Tensor) else full_like(self.A_adjoint(y), 0.0 if z is None else z)
        step = as_tensor(gamma, dtype=y.dtype, device=y.device).reshape(-1, 1, 1, 1)
        otf = view_as_complex(self.camera.otf)
        planes = fft.rfft2(start if start.ndim == 5 else start[:, None])
        error = fft.rfft2(y) - (otf * planes).sum(1)
        power = (otf.real.square() + otf.imag.square()).sum(0)
        found = planes + otf.conj() * (step * error / (1 + step * power))[:, None]
        return fft.irfft2(found, s=self.camera.operator.grid).reshape(start.shape)

    def A_dagger(self, y: Tensor, **options: Any) -> Tensor:  # noqa: N802
        """Return planes of the least ``|A x - y|``."""
        return self.prox_l2(0.0, y, 1e8) if self.exact else super().A_dagger(y, **options)


class EachPlane(deepinv.models.Denoiser):  # type: ignore[misc]
    """A denoiser of images ``(N, C, Y, X)`` for planes ``(N, Z, C, Y, X)``: it takes each plane alone.

    Example:
        >>> prior = deepinv.optim.PnP(hadalens.deepinv.EachPlane(deepinv.models.DRUNet()))

    """

    def __init__(self, denoiser: Any) -> None:
        """Take the denoiser."""
        super().__init__()
        self.denoiser = denoiser

    def forward(self, x: Tensor, sigma: float | Tensor, **options: Any) -> Tensor:
        """Return denoised planes."""
        if isinstance(sigma, Tensor) and sigma.numel() > 1:
            sigma = sigma.reshape(-1).repeat_interleave(x.shape[1])
        return self.denoiser(x.flatten(0, 1), sigma, **options).reshape(x.shape)


class TotalVariation(deepinv.models.Denoiser):  # type: ignore[misc]
    """Total variation as a denoiser that needs no weights, for deepinv's algorithms: the same whatever came before.

    Args:
        steps: of deepinv's ``TVDenoiser``, at most.

    Example:
        >>> dpir = deepinv.optim.DPIR(sigma=0.02, denoiser=hadalens.deepinv.TotalVariation())

    """

    def __init__(self, steps: int = 100) -> None:
        """Take the number of steps."""
        super().__init__()
        self.steps = steps

    def forward(self, x: Tensor, sigma: float | Tensor, **_: Any) -> Tensor:
        """Return denoised images; of several levels of noise the first one counts."""
        return deepinv.models.TVDenoiser(n_it_max=self.steps)(x, ths=0.5 * float(as_tensor(sigma).reshape(-1)[0]))


class Engine(deepinv.models.Reconstructor):  # type: ignore[misc]
    """This library as a reconstructor of deepinv: frames ``(N, C, Y, X)`` become planes, or all-in-focus images.

    Each frame goes through a :class:`hadalens.Plan`, on its OpenCL device, without gradients; for these there is
    :class:`hadalens.torch.Refine`. Planes are ``(N, Z, C, Y, X)`` of the window, of one depth ``(N, C, Y, X)``.

    Args:
        model: a model, or its file.
        all_in_focus: one image ``(N, C, Y, X)`` of each frame in place of its planes.
        options: of the plan. ``dark`` is 0.0 unless given: physics know of no dark level.

    Example:
        >>> engine = hadalens.deepinv.Engine("camera.model")
        >>> planes = engine(physics(x), physics)

    """

    def __init__(self, model: Model | PathLike, *, all_in_focus: bool = False, **options: Any) -> None:
        """Make the plan."""
        super().__init__()
        self.plan = Plan(model, **{"dark": 0.0, **options})
        self.all_in_focus = all_in_focus

    def forward(self, y: Tensor, physics: Any = None, **_: Any) -> Tensor:  # noqa: ARG002  deepinv's signature
        """Return what the plan makes of the frames."""
        found = []
        for frame in y.detach().cpu().float():
            result = self.plan.run(frame.contiguous().numpy())
            image = result.all_in_focus if self.all_in_focus else result.stack
            found.append(from_numpy(image.copy()))
        planes = stack(found).to(y)
        return planes[:, 0] if planes.ndim == 5 and planes.shape[1] == 1 else planes
