"""What the choices of a fit were made from."""

from __future__ import annotations

from dataclasses import dataclass

from ._show import members, table


@dataclass(frozen=True)
class FilterScore:
    """Alpha and regularisation ("lambda") of filters that were compared; PSNR of held-out pairs in dB, peak 1.

    Attributes:
        psnr_single: only the pair's depth is occupied.
        psnr_double: one other depth is occupied as well; NaN for one depth.
        chosen: the model takes it.

    """

    alpha: float
    regularisation: float
    psnr_single: float
    psnr_double: float
    chosen: bool


@dataclass(frozen=True)
class OutsideScore:
    """A weight of the error outside the window that was compared."""

    outside: float
    psnr: float
    chosen: bool


@dataclass(frozen=True)
class RefineScore:
    """Refinement that was compared: first numbers of steps (0: linear filters), then weights of total variation."""

    steps: int
    rho: float
    tv: float
    psnr_single: float
    psnr_double: float
    chosen: bool


@dataclass(frozen=True)
class ResponseRow:
    """A response of the scenes that was compared: the share of held-out frames that it leaves unexplained."""

    response: float
    unexplained: float
    unexplained_apart: float
    chosen: bool


@dataclass(frozen=True, repr=False)
class FitReport:
    """What the choices of a fit were made from.

    Attributes:
        filters, outside, refinement: what was compared on held-out pairs.
        pairs: in the sums of each depth.
        response: how the scenes stand for light, as :mod:`hadalens.response` has it; None: the pairs were not asked.
        responses: what was compared for it.
        exposed_apart: the frames of a depth were exposed differently.
        left_out: (depth, pair) of pairs that were left out, for they contradict the others.

    """

    filters: tuple[FilterScore, ...]
    outside: tuple[OutsideScore, ...]
    refinement: tuple[RefineScore, ...]
    pairs: tuple[int, ...]
    response: float | None
    responses: tuple[ResponseRow, ...]
    exposed_apart: bool
    left_out: tuple[tuple[int, int], ...] = ()

    def __repr__(self) -> str:
        """Return the most of it in a line."""
        best = [f"{one.psnr_single:.1f} dB" for one in self.filters if one.chosen]
        refined = [f"refined {one.psnr_single:.1f} dB" for one in self.refinement if one.chosen]
        return f"<FitReport: {', '.join([f'{sum(self.pairs)} pairs', *best[:1], *refined[-1:]])}>"

    def _repr_html_(self) -> str:
        compared = [one for rows in (self.filters, self.outside, self.refinement, self.responses) for one in rows]
        return table(
            repr(self), [(type(one).__name__, *(cell for pair in members(one) for cell in pair)) for one in compared]
        )
