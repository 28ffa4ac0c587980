"""Cameras as physics of deepinv: adjoint, proximal step, algorithms beside plain PyTorch, the library beside them."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import hadalens
import numpy as np
import pytest

torch = pytest.importorskip("torch")
deepinv = pytest.importorskip("deepinv")

from hadalens.deepinv import EachPlane, Engine, Lensless, TotalVariation  # noqa: E402
from hadalens.model import Boundary  # noqa: E402

SIGMA = 0.01
Support: TypeAlias = Literal["window", "frame"]


def made(boundary: Boundary, depths: int = 1) -> hadalens.Model:
    """Return a small colour camera from its point spread functions."""
    camera = hadalens.Camera("sim300")
    camera.resize((48, 64), (32, 40))
    camera.set_depths(100, 400, depths)
    psfs = np.repeat(np.asarray(camera.psf_stack()), 3, 1)
    return hadalens.Model.from_psf(psfs, camera.distances_mm, boundary=boundary, window=(32, 40), psf_dark=0.0)


def scene(shape: tuple[int, ...]) -> Any:
    """Return rectangles of several colours on black, in the middle."""
    image = torch.zeros(1, *shape)
    rows, cols = shape[-2:]
    image[..., rows // 4 : rows // 2, cols // 4 : cols // 2] = torch.tensor([0.9, 0.5, 0.2])[:, None, None]
    image[..., rows // 2 : 3 * rows // 4, cols // 2 : 3 * cols // 4] = torch.tensor([0.2, 0.4, 0.8])[:, None, None]
    return image


def psnr(a: Any, b: Any) -> float:
    """Return the PSNR, of a peak of 1."""
    return float(-10 * torch.log10((a - b).square().mean()))


@pytest.mark.parametrize("boundary", ["circular", "padded"])
@pytest.mark.parametrize("depths", [1, 3])
def test_adjoint(boundary: Boundary, depths: int) -> None:
    """<A x, y> = <x, At y>, by our numbers and by deepinv's test; sizes as deepinv has them."""
    model = made(boundary, depths)
    sizes: dict[Support, tuple[int, int]] = {"window": (32, 40), "frame": (48, 64)}
    for support, size in sizes.items():
        physics = Lensless(model, support=support)
        shape = (3, *size) if depths == 1 else (depths, 3, *size)
        x, y = torch.randn(2, *shape), torch.randn(2, 3, 48, 64)
        assert physics(x).shape == y.shape
        assert physics.A_adjoint(y).shape == x.shape
        difference = (physics.A(x) * y).sum() - (x * physics.A_adjoint(y)).sum()
        assert abs(difference) <= 1e-6 * physics.A(x).norm() * y.norm()
        assert physics.double().adjointness_test(x.double()) <= 1e-6
        assert physics.exact == (boundary == "circular" and support == "frame")
        norm = float(physics.compute_sqnorm(x[:1].double(), verbose=False, tol=1e-6)) ** 0.5
        assert norm < 1.001 * physics.norm
        assert norm > 0.7 * physics.norm


@pytest.mark.parametrize("depths", [1, 3])
def test_proximal_step(depths: int) -> None:
    """Where it is exact it is what many conjugate gradients find; a number for each frame; a start that is a number."""
    exact = Lensless(made("circular", depths), support="frame").double()
    y = torch.rand(2, 3, 48, 64, dtype=torch.float64)
    z = torch.rand_like(exact.A_adjoint(y))
    for gamma in (0.3, 20.0):
        found = exact.prox_l2(z, y, gamma)
        gradient = gamma * exact.A_adjoint(exact.A(found) - y) + found - z
        assert float(gradient.norm() / z.norm()) < 1e-10
    base = deepinv.physics.LinearPhysics.prox_l2(exact, z, y, 5.0, max_iter=300, tol=1e-9)
    torch.testing.assert_close(exact.prox_l2(z, y, 5.0), base, rtol=1e-5, atol=1e-5)
    each = exact.prox_l2(z, y, torch.tensor([0.3, 20.0]))
    torch.testing.assert_close(each[0], exact.prox_l2(z, y, 0.3)[0])
    torch.testing.assert_close(each[1], exact.prox_l2(z, y, 20.0)[1])
    torch.testing.assert_close(exact.prox_l2(None, y, 2.0), exact.prox_l2(torch.zeros_like(z), y, 2.0))
    assert float((exact.A(exact.A_dagger(y)) - y).norm() / y.norm()) < 1e-3


def test_proximal_step_of_a_sensor_that_crops() -> None:
    """That is deepinv's own, also of planes in a window."""
    kinds: dict[Boundary, Support] = {"padded": "frame", "circular": "window"}
    for boundary, support in kinds.items():
        physics = Lensless(made(boundary), support=support, max_iter=200, tol=1e-7).double()
        y = torch.rand(1, 3, 48, 64, dtype=torch.float64)
        z = torch.rand_like(physics.A_adjoint(y))
        found = physics.prox_l2(z, y, 2.0)
        gradient = 2.0 * physics.A_adjoint(physics.A(found) - y) + found - z
        assert float(gradient.norm() / z.norm()) < 1e-4


def plain_dpir(y: Any, otf: Any, denoiser: Any, sigma: float) -> Any:
    """Return what half quadratic splitting with DPIR's schedule makes of a frame, in plain PyTorch."""
    sigmas, steps, count = deepinv.optim.dpir.get_DPIR_params(sigma)
    spectrum = torch.fft.fft2(y)
    x = torch.fft.ifft2(otf.conj() * spectrum).real
    for i in range(count):
        step = float(steps[i])
        image = (torch.fft.fft2(x) + step * otf.conj() * spectrum) / (1 + step * otf.abs().square())
        x = denoiser(torch.fft.ifft2(image).real, sigmas[i])
    return x


def test_dpir_is_that_of_plain_pytorch() -> None:
    """DPIR with our physics, within 0.1 dB of the same in plain PyTorch."""
    model = made("circular")
    physics = Lensless(model, support="frame", noise_model=deepinv.physics.GaussianNoise(SIGMA))
    torch.manual_seed(1)
    truth = scene((3, 48, 64))
    y = physics(truth)
    dpir = deepinv.optim.DPIR(sigma=SIGMA, denoiser=TotalVariation(30))
    with torch.no_grad():
        ours = dpir(y, physics)
    assert model.otf is not None
    psf = np.fft.irfft2(model.otf[0], s=(48, 64))
    theirs = plain_dpir(y, torch.fft.fft2(torch.from_numpy(psf).float()), TotalVariation(30), SIGMA)
    assert abs(psnr(ours, truth) - psnr(theirs, truth)) < 0.1
    assert psnr(ours, theirs) > 50
    assert psnr(ours, truth) > psnr(physics.A_adjoint(y), truth) + 5


def test_unrolled_algorithm_learns() -> None:
    """Step sizes and a denoiser of unrolled gradient descent get gradients through the physics, with several planes."""
    physics = Lensless(made("padded", 2))
    truth = scene((2, 3, 32, 40))
    y = physics(truth)
    denoiser = EachPlane(deepinv.models.DnCNN(3, 3, depth=3, nf=8, pretrained=None))
    model = deepinv.unfolded.unfolded_builder(
        "PGD",
        params_algo={"stepsize": [0.5] * 3, "g_param": [0.05] * 3, "lambda": 1.0},
        trainable_params=["stepsize"],
        data_fidelity=deepinv.optim.L2(),
        prior=deepinv.optim.PnP(denoiser),
        max_iter=3,
    )
    loss = (model(y, physics) - truth).square().mean()
    loss.backward()
    gradients = {name: p.grad for name, p in model.named_parameters() if p.requires_grad}
    assert any("stepsize" in name for name in gradients)
    assert any("denoiser" in name for name in gradients)
    assert all(bool(torch.isfinite(g).all()) and float(g.abs().max()) > 0 for g in gradients.values())


def test_each_plane() -> None:
    """Planes are denoised one by one, with the noise of their frame."""
    seen = []

    class Note(deepinv.models.Denoiser):  # type: ignore[misc,name-defined]
        def forward(self, x: Any, sigma: Any, **_: Any) -> Any:
            seen.append((tuple(x.shape), sigma))
            return 2 * x

    planes = torch.rand(2, 3, 1, 4, 5)
    torch.testing.assert_close(EachPlane(Note())(planes, 0.1), 2 * planes)
    EachPlane(Note())(planes, torch.tensor([0.1, 0.2]))
    assert seen[0] == ((6, 1, 4, 5), 0.1)
    torch.testing.assert_close(seen[1][1], torch.tensor([0.1, 0.1, 0.1, 0.2, 0.2, 0.2]))


def test_engine_is_a_plan() -> None:
    """The library as a reconstructor: the plan's own planes, or its all-in-focus image."""
    for depths in (1, 2):
        model = made("circular", depths)
        physics = Lensless(model)
        y = torch.cat([physics(scene(physics.img_size)), 0.5 * physics(scene(physics.img_size).flip(-1))])
        engine = Engine(model, refine=5, refine_tv=0.002)
        planes = engine(y, physics)
        assert planes.shape == (2, *physics.img_size)
        for i in range(2):
            result = hadalens.Plan(model, dark=0.0, refine=5, refine_tv=0.002).run(y[i].numpy())
            np.testing.assert_array_equal(planes[i].numpy().reshape(result.stack.shape), result.stack)
        picture = Engine(model, all_in_focus=True, refine=5, refine_tv=0.002)(y.double())
        assert picture.dtype is torch.float64
        assert picture.shape == (2, 3, 32, 40)
