"""What comes of a frame: arrays of NumPy's that C has written into, and how it was done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Float32, address, copy_of, floats
from ._native import call, ffi, lib, record, span, words
from ._show import members, png, table


@dataclass(frozen=True)
class SkipReport:
    """What was not computed, and what that may have changed.

    Attributes:
        kinds: words of what saved something in this frame.
        bound: of the relative L2 change of the stack; 0: none.
        depths, channels: not computed.
        frame: the result is that of the frame before.
        frequencies: share of the spectrum that was not used.
        tiles: share of the net's tiles that was not computed.
        recomputed: a bound did not hold, and the frame was done again in full.

    """

    kinds: tuple[str, ...]
    bound: float
    depths: int
    channels: int
    frame: bool
    frequencies: float
    tiles: float
    recomputed: bool


@dataclass(frozen=True, repr=False)
class Report:
    """How a frame was reconstructed.

    Attributes:
        occupied: for each computed depth, whether the scene was found there.
        method: "model", or a classic method.
        scene: what the frame was taken for, "planes", "surface" or "volume".
        refine_steps: steps of refinement, or iterations of a classic method, that were done.
        refine_tv: weight of total variation in refinement, or in a classic method; 0: none.
        refine_tv_factor: where it was found from the frame, so many times more or less predicts held-out pixels 1 %
            worse; 0: not known.
        refine_tv_kept: whether it was found from an earlier frame of the plan, of the same noise and light.
        warm_started: whether refinement went on from the frame before.
        gain: then, how many times as bright as before the scene was found to be; 1: no change was followed. Else 0.
        residual_linear, residual: what the linear result, and the refined one, leave unexplained of the frame, as a
            share of it; NaN where not computed.
        dark: level taken off.
        stray_light: light of a lamp or through a gap in the housing: the mean of what was taken off; 0: none.
        repaired_pixels: NaN and infinite pixels that were replaced.
        bad_pixels: values far beyond those around them, which were left out.
        saturated_pixels: values at the frame's upper end, taken for "at least this".
        enhanced: planes that went through the model's net.
        seconds: of each stage, with "total".

    """

    occupied: tuple[bool, ...]
    method: str
    scene: str
    refine_steps: int
    refine_tv: float
    refine_tv_factor: float
    refine_tv_kept: bool
    warm_started: bool
    gain: float
    residual_linear: float
    residual: float
    dark: float
    stray_light: float
    repaired_pixels: int
    bad_pixels: int
    saturated_pixels: int
    enhanced: int
    seconds: dict[str, float]
    skipped: SkipReport

    def __repr__(self) -> str:
        """Return the most of it in a line."""
        there = ", ".join(str(depth) for depth, found in enumerate(self.occupied) if found)
        steps = f", {self.refine_steps} steps" * bool(self.refine_steps)
        return f"<Report: {self.method}, {self.scene} at {there or 'no depth'}{steps}, {self.seconds['total']:.3g} s>"

    def _repr_html_(self) -> str:
        return table(repr(self), [*members(self), *members(self.skipped)])


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What comes of a frame; arrays are NumPy's and stay as they are, whatever happens to the plan.

    Attributes:
        stack: refocused planes, float32 (Z, C, Y, X) in linear light, near to far, of the window's size.
        all_in_focus: float32 (C, Y, X).
        distance_map: float32 (Y, X) in millimetres, NaN where nothing is in focus.
        confidence: float32 (Y, X), 0 to 1: how sure the distance map is; None where the frame is no surface.
        distances_mm: float64 (Z,), of the planes.
        report: how it was done.

    """

    stack: Float32
    all_in_focus: Float32
    distance_map: Float32
    confidence: Float32 | None
    distances_mm: npt.NDArray[np.float64]
    report: Report

    def __repr__(self) -> str:
        """Return sizes in a line."""
        _, *size = self.stack.shape
        return f"<Result: {span(self.distances_mm.tolist())}, {' x '.join(map(str, size))}>"

    def _repr_png_(self) -> bytes | None:
        return png(self.all_in_focus)


def _skip_report(struct: Any) -> SkipReport:
    kinds = tuple(name for name, bit in words("hada_skip").items() if name != "all" and struct.kinds & bit)
    return record(SkipReport, struct[0], kinds=kinds)


_STAGES = ("total", "upload", "linear", "pursuit", "refine", "enhance", "focus", "download")


def _report(struct: Any, depths: int) -> Report:
    return record(
        Report,
        struct[0],
        occupied=tuple(bool(struct.occupied[z]) for z in range(depths)),
        seconds={stage: getattr(struct, f"seconds_{stage}") for stage in _STAGES},
        skipped=_skip_report(struct.skipped),
    )


class Results:
    """A hada_result that is written into arrays of NumPy's; `device`: what else must live as long."""

    device: Any = None

    def __init__(self, stack: Float32, all_in_focus: Float32, distance_map: Float32) -> None:
        """Let C write into these arrays."""
        self.stack, self.all_in_focus, self.distance_map = stack, all_in_focus, distance_map
        self.c = ffi.new("hada_result *")
        arrays = ffi.new("hada_result_arrays *")
        lib.hada_result_arrays_init(arrays)
        arrays.stack, arrays.stack_count = floats(stack), stack.size
        arrays.all_in_focus, arrays.all_in_focus_count = floats(all_in_focus), all_in_focus.size
        arrays.distance_map, arrays.distance_map_count = floats(distance_map), distance_map.size
        call(lib.hada_result_use, self.c, arrays)
        #: What is filled: (0, or the address of an OpenCL buffer; first byte, byte behind the last).
        self.filled = [
            (0, address(array), address(array) + array.nbytes) for array in (stack, all_in_focus, distance_map)
        ]

    def meets(self, other: Results) -> bool:
        """Return whether both fill the same memory."""
        return any(a[0] == b[0] and a[1] < b[2] and b[1] < a[2] for a in self.filled for b in other.filled)

    def take(self) -> Result:
        """What was computed."""
        sure = lib.hada_result_confidence(self.c)
        depths = self.c.depths
        distances = np.frombuffer(ffi.buffer(self.c.distances_mm, 8 * depths), np.float64).copy()
        return Result(
            self.stack,
            self.all_in_focus,
            self.distance_map,
            None if sure == ffi.NULL else copy_of(sure)[0],
            distances,
            _report(self.c.report, depths),
        )

    def __del__(self) -> None:
        """Let go of the arrays."""
        lib.hada_result_destroy(self.c)
