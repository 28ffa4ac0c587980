"""The steps of refinement in plain PyTorch (docs/explanation/refinement.md); the numbers are those of lib/refine."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from importlib import resources

import numpy as np
import numpy.typing as npt

from ._files import extra
from .model import ModelInfo

with extra("torch"):
    import torch
    import torch.nn.functional as F  # noqa: N812  PyTorch's own habit
    from torch import Tensor

TV_STEPS, TV_LENGTH = 6, 0.22
MOST_RIDGE_STEPS = 3
CROSSTALK = 0.12
FAINT = 1e-30  # mean squares below this are those of a black frame
NEWTON = 6  # rounds; three are exact in single precision


@dataclass(frozen=True)
class Schedule:
    """What each step is done with; rho in units of |OTF|², `noise` in units of the frame's root mean square.

    mu is the weight of the split at the frame of a sensor that crops.
    """

    mu: float
    rho: tuple[float, ...]
    relaxation: tuple[float, ...]
    ridge_rho: tuple[float, ...]
    noise: float


def schedule(info: ModelInfo, gain: float, tv: float, ridge: float, depths: int, steps: int) -> Schedule:
    """Return what the library does with so many depths and steps, of which the last have the learned regulariser."""
    cropped = info.boundary == "padded"
    last = min(MOST_RIDGE_STEPS, steps // 2) if ridge > 0 and tv > 0 else 0
    usual = 1e-3 if tv <= 0 else 3e-3 if cropped else 3.5e-3
    most = info.refine_rho if (tv > 0) == (info.refine_tv > 0) else usual
    first, growth, relaxed = 0.0, 1.0, 1.6
    if tv > 0 and depths == 1:
        first, relaxed = 2e-4, 1.9
        most *= 6.0 if cropped else 8.0
        growth = max((most / first) ** (1 / ((0.8 if cropped else 0.5) * steps)), 1.0)
    elif tv > 0 and cropped:
        first, growth = 1e-3, 1.25
    if info.refine_tv < 0 < tv:  # of a point spread function alone: no fit has chosen rho
        most = min(max(100.0 * tv, 3e-4), max(3e-2, tv))
        first = min(first, most)
    rho = [gain * (min(most, first * growth**k) if first > 0 else most) for k in range(steps - last)]
    parting = 7 if tv > 0 and depths > 1 else 0
    relaxation = [1.0, *(1.95 if k < parting else relaxed for k in range(1, steps - last))]
    end = 0.1 if depths == 1 else 0.25
    weight = tv / 0.0026
    noise = ridge * 0.16 * math.sqrt(0.1 / end) * weight**0.37 / math.sqrt(gain)
    mu = 0.3 if cropped and tv > 0 and depths == 1 else 1.0
    return Schedule(mu, tuple(rho), tuple(relaxation[: len(rho)]), (gain * end * weight**0.6,) * last, noise)


def _primal(w: Tensor, down: Tensor, right: Tensor, theta: Tensor) -> Tensor:
    """max(0, w + theta div p); p is 0 in the last row of `down` and the last column of `right`."""
    down, right = down[..., :-1, :], right[..., :-1]
    div = F.pad(down, (0, 0, 0, 1)) - F.pad(down, (0, 0, 1, 0)) + F.pad(right, (0, 1)) - F.pad(right, (1, 0))
    return (w + theta * div).relu()


def _shorten(down: Tensor, right: Tensor, per: float) -> tuple[Tensor, Tensor]:
    """Return the nearest point with |mean over channels|² + per |rest|² <= 1; gradients are those of the exact one."""
    channels = down.shape[-3]
    mean_down, mean_right = down.mean(-3, keepdim=True), right.mean(-3, keepdim=True)
    rest_down, rest_right = down - mean_down, right - mean_right
    mean = channels * (mean_down.square() + mean_right.square())
    rest = (rest_down.square() + rest_right.square()).sum(-3, keepdim=True)
    beyond = mean + per * rest > 1
    with torch.no_grad():  # Newton's method on 1 / |p| = 1
        mu = torch.where(beyond, (mean + per * rest).sqrt() - 1, torch.zeros_like(mean))
        for _ in range(NEWTON):
            energy, slope = _energy(mean, rest, mu, per)
            mu = torch.where(beyond, (mu + energy / slope.clamp(min=FAINT) * (energy.sqrt() - 1)).clamp(min=0), mu)
        slope = torch.where(beyond, _energy(mean, rest, mu, per)[1], torch.ones_like(mu))
    energy = torch.where(beyond, _energy(mean, rest, mu, per)[0], torch.ones_like(mu))
    mu = mu + energy / slope * (energy.sqrt() - 1)  # one round more, which has the derivatives
    of_mean, of_rest = 1 / (1 + mu), 1 / (1 + per * mu)
    return of_mean * mean_down + of_rest * rest_down, of_mean * mean_right + of_rest * rest_right


def _energy(mean: Tensor, rest: Tensor, mu: Tensor, per: float) -> tuple[Tensor, Tensor]:
    a, b = mean / (1 + mu) ** 2, per * rest / (1 + per * mu) ** 2
    return a + b, a / (1 + mu) + per * b / (1 + per * mu)


def total_variation(w: Tensor, duals: Tensor, theta: Tensor, colour: float) -> tuple[Tensor, Tensor]:
    """Return the proximal step of planes (..., C, Y, X), and the duals (2, ..., C, Y, X) for the next one."""
    down, right = duals
    per = 1 / colour**2 if w.shape[-3] > 1 else 1.0
    for _ in range(TV_STEPS):
        u = _primal(w, down, right, theta)
        down = down + TV_LENGTH / theta * F.pad(u[..., 1:, :] - u[..., :-1, :], (0, 0, 0, 1))
        right = right + TV_LENGTH / theta * F.pad(u[..., 1:] - u[..., :-1], (0, 1))
        down, right = _shorten(down, right, per)
    return _primal(w, down, right, theta), torch.stack([down, right])


def _ridge_tables() -> dict[str, npt.NDArray[np.float64]]:
    """Return the learned regulariser's numbers, of the file that the library's kernels include."""
    text = (resources.files(__package__) / "data" / "shared_ridge_weights.h").read_text(encoding="ascii")
    found = re.findall(r"float hada_ridge_(\w+)\[[^\]]*\] = \{([^}]*)\}", text)
    numbers = {name: np.array([float(n) for n in re.findall(r"(\S+)f,", inside)]) for name, inside in found}
    steps = len(numbers["length"])
    tables = {name: numbers[name].reshape(steps, -1) for name in ("in", "share", "length", "momentum")}
    for name, channels in (("colour", 3), ("grey", 1)):  # [four filters][channel, row, column][one of the four]
        blocks = numbers[name].reshape(steps, -1, channels, 5, 5, 4)
        tables[name] = np.moveaxis(blocks, -1, 2).reshape(steps, -1, channels, 5, 5)
    return tables


RIDGE = _ridge_tables()


def ridge(planes: Tensor, noise: Tensor) -> Tensor:
    """Return the learned regulariser's proximal step of planes (N, Z, C, Y, X); noise (N, 1, 1, 1, 1)."""
    tables = {name: torch.from_numpy(table).to(planes) for name, table in RIDGE.items()}
    seen = 3 if planes.shape[2] == 3 else 1
    given = planes.reshape(-1, seen, *planes.shape[-2:])
    level = noise.expand(*planes.shape[:3], 1, 1).reshape(-1, seen, 1, 1)[:, :1]
    filters = tables["colour" if seen == 3 else "grey"]
    now = before = given
    for step in range(len(filters)):
        gradient = now - given
        if min(planes.shape[-2:]) >= filters.shape[-1]:
            each = tables["in"][step, :, None, None] / level
            t = each * F.conv2d(now, filters[step])
            shaped = tables["share"][step, :, None, None] / each * t / (1 + t * t)
            gradient = gradient + F.conv_transpose2d(shaped, filters[step])
        moved = tables["momentum"][step] * (now - before)
        now, before = now - tables["length"][step] * gradient + moved, now
    return now.relu().reshape(planes.shape)


def fade(planes: Tensor, share: float) -> Tensor:
    """Return planes (N, Z, C, Y, X) whose light, where they are dark beside another, is that other's."""
    light = 25 * F.avg_pool2d(planes.sum(2), 5, stride=1, padding=2)
    most, brightest = light.max(1, keepdim=True)
    power = (light / most.clamp(min=FAINT)) ** 4
    kept = planes * ((1 + share**4) * power / (power + share**4))[:, :, None]
    own = torch.arange(planes.shape[1], device=planes.device)[:, None, None] == brightest
    return kept + own[:, :, None] * (planes - kept).sum(1, keepdim=True)
