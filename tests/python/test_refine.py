"""Refinement in plain PyTorch: the library's planes, gradients that are right, parameters that learn."""

from __future__ import annotations

from itertools import product
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest

torch = pytest.importorskip("torch")

from hadalens import _refinement  # noqa: E402
from hadalens.model import Boundary  # noqa: E402
from hadalens.torch import Refine  # noqa: E402

Array = npt.NDArray[Any]
TOLERANCE = 1e-5  # relative L2: single precision
rng = np.random.default_rng(5)
torch.manual_seed(5)


def made(boundary: Boundary, channels: int = 3, size: tuple[int, int] = (60, 74)) -> hadalens.Model:
    """Return a camera of three depths, from its point spread functions."""
    camera = hadalens.Camera("sim300")
    window = size[0] // 2, size[1] // 2
    camera.resize(size, window)
    camera.set_depths(100, 400, 3)
    camera.boundary = boundary
    psfs = np.repeat(np.asarray(camera.psf_stack()), channels, 1)
    return hadalens.Model.from_psf(psfs, camera.distances_mm, boundary=boundary, window=window, psf_dark=0.0)


def frame_of(model: hadalens.Model, depths: list[int]) -> Array:
    """Return a noisy frame of rectangles of several colours at some depths."""
    operator = hadalens.operators.Forward(model)
    planes = np.zeros(operator.planes_shape)
    for depth in depths:
        corner, colour = rng.integers(1, 9, 2), rng.uniform(0.2, 1, (planes.shape[1], 1, 1))
        planes[depth, :, corner[0] : corner[0] + 12, corner[1] : corner[1] + 15] = colour
    frame = operator(planes)
    noisy: Array = (frame + 0.01 * np.sqrt(np.mean(frame**2)) * rng.standard_normal(frame.shape)).astype(np.float32)
    return noisy


def of_library(model: hadalens.Model, frame: Array, depths: list[int], **options: Any) -> Array:
    """Return what a plan makes of it."""
    plan = hadalens.Plan(model, occupied=depths, dark=0.0, skip=(), **options)
    return np.asarray(plan.run(frame).stack[depths])


def check(refine: Any, frame: Array, truth: Array) -> None:
    """Compare in both precisions, in a batch whose second frame is brighter."""
    for kind in (torch.float32, torch.float64):
        frames = torch.from_numpy(np.stack([frame, 3 * frame])).to(kind)
        with torch.no_grad():
            planes = refine.to(kind)(frames)
        assert planes.dtype is kind
        for i, factor in enumerate((1, 3)):
            error = np.linalg.norm(planes[i].numpy() - factor * truth)
            assert error < TOLERANCE * factor * np.linalg.norm(truth)


@pytest.mark.parametrize("boundary", ["circular", "padded"])
@pytest.mark.parametrize("channels", [1, 3])
def test_planes_are_the_librarys(boundary: Boundary, channels: int) -> None:
    """One depth and several, with and without total variation, the learned regulariser and crosstalk."""
    model = made(boundary, channels)
    for depths, tv, ridge, steps in product(([1], [0, 2]), (0.0, 0.004), (0.0, 1.0), (1, 9)):
        frame = frame_of(model, depths)
        truth = of_library(model, frame, depths, refine=steps, refine_tv=tv, refine_ridge=ridge)
        check(Refine(model, steps=steps, depths=depths, tv=tv, ridge=ridge), frame, truth)
    frame = frame_of(model, [0, 1, 2])
    truth = of_library(model, frame, [0, 1, 2], refine=6, refine_tv=0.02, refine_colour=3.0, crosstalk=0.0)
    check(Refine(model, steps=6, tv=0.02, colour=3.0, crosstalk=0.0), frame, truth)


def test_planes_of_a_learned_camera(model: hadalens.Model, raw: Array) -> None:
    """With nothing but the model's own options."""
    info = model.info
    assert info.refine_steps > 0
    assert info.refine_tv > 0
    depths = list(range(info.depths))
    truth = of_library(model, raw, depths, refine=info.refine_steps, refine_tv=info.refine_tv)
    check(Refine(model), raw, truth)


def test_black_frames() -> None:
    """Black planes, and gradients that are numbers."""
    refine = Refine(made("circular"), steps=6, tv=0.004)
    frames = torch.zeros(1, *refine.operator.frame_shape, requires_grad=True)
    planes = refine(frames)
    planes.sum().backward()
    assert float(planes.detach().abs().max()) == 0
    assert bool(torch.isfinite(frames.grad).all())


@pytest.mark.parametrize("boundary", ["circular", "padded"])
def test_gradients(boundary: Boundary) -> None:
    """Gradcheck for the frame and the parameters; computing steps again gives the same."""
    model = made(boundary, size=(18, 22))
    frame = torch.from_numpy(frame_of(model, [0, 2])).double()[None]
    refine = Refine(model, steps=6, depths=[0, 2], tv=0.01, ridge=1.0).double()
    names = [name for name, _ in refine.named_parameters()]
    assert names == ["tv", "rho", "noise"]

    def run(frames: Any, *values: Any) -> Any:
        for name, value in zip(names, values, strict=True):
            delattr(refine, name)
            setattr(refine, name, value)
        return refine(frames).square().sum((2, 3, 4))

    values = [0.1 * torch.randn_like(p).requires_grad_() for p in refine.parameters()]
    assert [len(v) for v in values] == [3, 6, 3]
    assert torch.autograd.gradcheck(run, (frame.requires_grad_(), *values), atol=1e-6, rtol=1e-4, fast_mode=True)
    plain = torch.autograd.grad(run(frame, *values).sum(), (frame, *values))
    refine.checkpoint = True
    for one, other in zip(plain, torch.autograd.grad(run(frame, *values).sum(), (frame, *values)), strict=True):
        torch.testing.assert_close(one, other)


def test_projection_of_duals() -> None:
    """The nearest point of the ellipsoid, by its conditions; its gradient by gradcheck."""
    down, right = (3 * torch.randn(2, 3, 4, 5, dtype=torch.float64) for _ in range(2))
    for per in (1.0, 0.25):
        p, q = _refinement._shorten(down, right, per)
        mean = 3 * (p.mean(1).square() + q.mean(1).square())
        rest = (p.square() + q.square()).sum(1) - mean
        assert float((mean + per * rest).max()) < 1 + 1e-12
        assert float((mean + per * rest).median()) > 1 - 1e-12
        inputs = (down.clone().requires_grad_(), right.clone().requires_grad_())
        assert torch.autograd.gradcheck(lambda a, b, c=per: _refinement._shorten(a, b, c), inputs)


def test_learning_its_weights() -> None:
    """Of weights that are far too large, that of the last step is learned down."""
    model = made("circular", 1)
    operator = hadalens.operators.Forward(model)
    blocks = rng.random((4, 1, 6, 8)).repeat(5, 2).repeat(5, 3)[:, :, :30, :37]
    truth = torch.from_numpy(blocks.astype(np.float32))
    frames = hadalens.torch.Forward(operator)(torch.nn.functional.pad(truth[:, None], (0,) * 7 + (2,)))
    refine = Refine(model, steps=4, depths=[0], tv=0.3, ridge=0.0)
    optimizer = torch.optim.Adam(refine.parameters(), lr=0.3)
    losses = []
    for _ in range(15):
        loss = (refine(frames)[:, 0] - truth).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.6 * losses[0]
    assert refine.tv[-1].item() < 0


def test_what_does_not_fit_is_said(model: hadalens.Model) -> None:
    """Depths, weights, sizes."""
    with pytest.raises(ValueError, match="near to far"):
        Refine(model, depths=[1, 0])
    with pytest.raises(ValueError, match="near to far"):
        Refine(model, depths=[99])
    with pytest.raises(ValueError, match="steps"):
        Refine(model, steps=0)
    with pytest.raises(ValueError, match="total variation"):
        Refine(made("padded"), steps=3)
    with pytest.raises(ValueError, match="needed"):
        Refine(model)(torch.zeros(1, 2, 3, 4))
