"""The camera as a linear operator: what the simulator renders, exact adjoints, SciPy's and PyTorch's solvers."""

from __future__ import annotations

from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
from hadalens.operators import Forward

Array = npt.NDArray[Any]
rng = np.random.default_rng(2)


@pytest.fixture(scope="module", params=["circular", "padded"])
def design(request: pytest.FixtureRequest) -> hadalens.Camera:
    """Return a small camera whose window is not in the corner."""
    camera = hadalens.Camera("sim300")
    camera.resize((40, 54), (14, 21))
    camera.set_depths(100, 400, 3)
    camera.boundary = request.param
    return camera


@pytest.fixture(scope="module")
def operator(design: hadalens.Camera) -> Forward:
    """Return its operator."""
    psfs, window = design.psf_stack(), (design.window_rows, design.window_cols)
    model = hadalens.Model.from_psf(psfs, design.distances_mm, boundary=design.boundary, window=window, psf_dark=0.0)
    return Forward(model)


def test_frames_are_those_of_the_simulator(design: hadalens.Camera, operator: Forward) -> None:
    """The same scene casts the same frame."""
    planes = rng.random(operator.planes_shape).astype(np.float32)
    frame = hadalens.Simulator(design).render(dict(enumerate(planes)))
    assert np.linalg.norm(operator(planes) - frame) < 1e-5 * np.linalg.norm(frame)


def test_adjoint_is_exact(operator: Forward, model: hadalens.Model) -> None:
    """<A x, y> = <x, At y>, also of a camera that was learned."""
    for one in (operator, Forward(model)):
        x, y = rng.standard_normal(one.planes_shape), rng.standard_normal(one.frame_shape)
        left, right = np.vdot(one(x), y), np.vdot(x, one.adjoint(y))
        assert abs(left - right) < 1e-12 * np.linalg.norm(one(x)) * np.linalg.norm(y)


def test_what_does_not_fit_is_said(operator: Forward) -> None:
    """Sizes and models."""
    with pytest.raises(hadalens.SizeError, match="planes"):
        operator(np.zeros((1, 2, 3, 4)))
    with pytest.raises(hadalens.SizeError, match="frame"):
        operator.adjoint(np.zeros((1, 2, 3)))
    filters = np.ones((1, 1, 8, 5), np.complex64)
    with pytest.raises(hadalens.ModelError, match="transfer functions"):
        Forward(hadalens.Model.from_filters(filters, [100.0], (8, 8)))


def test_scipy_solves_with_it(operator: Forward) -> None:
    """LSMR finds planes that explain a frame."""
    linalg = pytest.importorskip("scipy.sparse.linalg")
    frame = operator(rng.random(operator.planes_shape))
    wrapped = linalg.aslinearoperator(operator)
    assert wrapped.shape == operator.shape
    found = linalg.lsmr(operator, frame.ravel(), maxiter=300, atol=1e-8, btol=1e-8)[0].reshape(operator.planes_shape)
    assert np.linalg.norm(operator(found) - frame) < 1e-2 * np.linalg.norm(frame)


def test_pytorch_has_the_same(operator: Forward) -> None:
    """Batches in single and double precision, gradients that gradcheck accepts, and learning through the operator."""
    torch = pytest.importorskip("torch")
    from hadalens.torch import Adjoint
    from hadalens.torch import Forward as Module

    x, y = rng.random((2, *operator.planes_shape)), rng.random((2, *operator.frame_shape))
    forward, adjoint = Module(operator), Adjoint(operator)
    for kind, tolerance in ((torch.float32, 1e-5), (torch.float64, 1e-12)):
        frames = forward.to(kind)(torch.from_numpy(x).to(kind)).numpy()
        planes = adjoint.to(kind)(torch.from_numpy(y).to(kind)).numpy()
        assert frames.dtype == planes.dtype == x.astype("f4" if kind is torch.float32 else "f8").dtype
        for i in range(2):
            assert np.linalg.norm(frames[i] - operator(x[i])) < tolerance * np.linalg.norm(frames[i])
            assert np.linalg.norm(planes[i] - operator.adjoint(y[i])) < tolerance * np.linalg.norm(planes[i])
    small = torch.from_numpy(x[:1]).requires_grad_()
    assert torch.autograd.gradcheck(lambda t: forward(t).sum((-2, -1)), (small,))
    assert torch.autograd.gradcheck(lambda t: adjoint(t).sum((-2, -1)), (torch.from_numpy(y[:1]).requires_grad_(),))
    grad = torch.autograd.grad(forward(small), small, torch.from_numpy(y[:1]))[0]
    np.testing.assert_allclose(grad.numpy(), adjoint(torch.from_numpy(y[:1])).numpy(), rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match="planes"):
        forward(torch.zeros(1, 2, 3))


def test_pytorch_has_the_linear_filters(design: hadalens.Camera, model: hadalens.Model) -> None:
    """The library's planes of a frame; gradients for frames and filters; filters that were learned on go back."""
    torch = pytest.importorskip("torch")
    from hadalens.torch import Linear

    psfs, window = design.psf_stack(), (design.window_rows, design.window_cols)
    made = hadalens.Model.from_psf(psfs, design.distances_mm, boundary=design.boundary, window=window, psf_dark=0.0)
    for one in (made, model):
        linear, info = Linear(one), one.info
        frame = rng.random((info.channels, info.raw_rows, info.raw_cols)).astype(np.float32)
        planes = hadalens.Plan(one, refine=0, dark=0.0, skip=()).run(frame).stack
        found = linear(torch.from_numpy(frame)[None]).detach().numpy()[0]
        assert np.linalg.norm(found - planes.reshape(found.shape)) < 1e-5 * np.linalg.norm(planes)
    linear = Linear(made).double()
    linear.clip = False
    frames = torch.from_numpy(frame_of(made)).requires_grad_()
    assert torch.autograd.gradcheck(lambda t: linear(t).sum((-2, -1)), (frames,))
    linear(frames).square().sum().backward()
    assert float(linear.filters.grad.abs().max()) > 0
    with pytest.raises(ValueError, match="needed"):
        linear(frames[..., 1:])
    info = made.info
    again = hadalens.Model.from_filters(
        torch.view_as_complex(linear.filters.detach().float()).numpy(),
        info.distances_mm,
        (info.raw_rows, info.raw_cols),
        window=window,
        boundary=design.boundary,
        grid=linear.grid,
    )
    np.testing.assert_allclose(again.filters, made.filters, rtol=1e-6)


def frame_of(model: hadalens.Model) -> Array:
    """Return a frame of noise, in a batch of one."""
    info = model.info
    return rng.random((1, info.channels, info.raw_rows, info.raw_cols))
