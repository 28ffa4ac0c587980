"""What a plan is told: its options, and the methods of others."""

from __future__ import annotations

import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypedDict

import numpy as np

from . import errors
from ._arrays import Image, Mosaic, scale_of
from ._native import Options, Special, lib, value_of

Method: TypeAlias = Literal["wiener", "rl", "fista", "admm"]
Skip: TypeAlias = Literal["prune", "depths", "frequencies", "half", "channels", "frames", "tiles"]


@dataclass(frozen=True)
class Classic:
    """One of the iterative methods that others use, in place of the model's filters and refinement.

    Attributes:
        method: "wiener", "rl" (Richardson-Lucy), "fista" or "admm"; docs/explanation/mathematics.md.
        iterations: at most.
        stop: ends when the planes' relative change is below it twice running; 0: never.
        seconds: ends after so much time, which makes the result depend on it; 0: never.
        prior: "auto", "none", "tv", "wavelet" or "haar".
        weight: of the prior; None: for total variation of FISTA and ADMM found from each frame (without `seconds`),
            else the method's own.
        support: where planes may be bright: "auto", "window" or "grid".
        regularisation: of Wiener, noise in units of the mean power.

    """

    method: Method
    iterations: int = 100
    stop: float = 0.0
    seconds: float = 0.0
    prior: Literal["auto", "none", "tv", "wavelet", "haar"] = "auto"
    weight: float | None = None
    support: Literal["auto", "window", "grid"] = "auto"
    regularisation: float = 0.1
    accelerate: bool = True
    step: float = 1.0
    inner: int = 5
    levels: int = 3
    mu1: float | None = None
    mu2: float | None = None
    mu3: float | None = None

    def _options(self) -> Options:
        given = {name: value for name, value in vars(self).items() if name != "regularisation"}
        return Options("hada_classic_options", **given, **{"lambda": self.regularisation})


class PlanOptions(TypedDict, total=False):
    """What :class:`Plan` takes, by keyword."""

    depths: Sequence[int] | None
    occupied: Literal["auto", "all"] | Sequence[int]
    scene: Literal["auto", "planes", "surface", "volume"]
    refine: int | None
    refine_tv: float | Literal["frame"] | None
    refine_colour: float | None
    refine_ridge: float | None
    crosstalk: float | None
    dark: Any
    pixel_weights: Any
    flat_frame: Any
    mosaic: Literal["auto"] | Mosaic
    support: Literal["auto", "window", "grid"]
    repair: bool
    enhance: bool
    classic: Classic | Method | None
    gamma: float
    max_error: float
    skip: Iterable[Skip] | None
    band: float
    half: bool
    batch: int | None
    queues: int | None
    downsample: int | None
    warm_start: bool
    full_scale: float | None


def indices(name: str, given: Any, depths: int) -> list[int]:
    """Return indices of depths; a mask, true or false for each of all depths, stands for those where it is true."""
    if isinstance(given, numbers.Integral | str):
        raise TypeError(f"{name}={given!r}: a list of depths is needed, such as [0]")
    found = list(given)
    marks = [isinstance(one, bool | np.bool_) for one in found]
    if not any(marks):
        return found
    if not all(marks) or len(marks) != depths:
        raise errors.ArgumentError(f"{name}={found}: indices of depths, or one of True and False for each of {depths}")
    return [index for index, one in enumerate(found) if one]


def plan_options(
    model_depths: int,
    *,
    depths: Sequence[int] | None = None,
    occupied: str | Sequence[int] = "auto",
    repair: bool | None = None,
    dark: Any = None,
    pixel_weights: Any = None,
    flat_frame: Any = None,
    classic: Classic | Method | None = None,
    skip: Iterable[Skip] | None = None,
    refine_tv: float | str | None = None,
    full_scale: float | None = None,
    **others: Any,
) -> Options:
    """Return hada_plan_options of what a plan for a model of so many depths takes."""
    if depths is not None:
        depths = indices("depths", depths, model_depths)
    scale_of(full_scale)
    options = Options(
        "hada_plan_options",
        depths=depths,
        depth_count=None if depths is None else len(depths),
        repair_not_finite=repair,
        refine_tv=Special(lib.HADA_REFINE_TV_FRAME) if refine_tv == "frame" else refine_tv,
        **others,
    )
    if isinstance(occupied, str):
        options.set(occupied=occupied)
    else:
        listed = indices("occupied", occupied, model_depths)
        options.set(occupied="list", occupied_list=listed, occupied_count=len(listed))
    _set_dark(options, dark, full_scale)
    for name, array in (("pixel_weights", pixel_weights), ("flat_frame", flat_frame)):
        if array is not None:
            image = Image(array, what=name, full_scale=full_scale, light=name == "flat_frame")
            options.kept.append(image)
            options.set(**{name: image.c})
    if classic is not None:
        options.set(classic=(classic if isinstance(classic, Classic) else Classic(classic))._options())
    if skip is not None:
        options.c.skip = sum({value_of("hada_skip", kind, "skip") for kind in skip})
    return options


def _set_dark(options: Options, dark: Any, full_scale: float | None) -> None:
    if dark is None:
        return
    if isinstance(dark, str):
        options.set(dark=dark)
    elif isinstance(dark, bool):
        raise TypeError(f'dark={dark}: "auto", a level from 0 (nothing) to 1, or a dark frame is needed')
    elif isinstance(dark, numbers.Real):
        level = float(dark)
        if not 0 <= level <= 1:
            raise errors.ArgumentError(f"dark={dark} is not possible: a level is from 0 to 1, full scale being 1")
        options.set(dark="level", dark_level=level)
    else:
        frame = Image(dark, what="dark", full_scale=full_scale)
        options.kept.append(frame)
        options.set(dark="frame", dark_frame=frame.c)
