"""Frames through a plan: the same bits as the C program, and the ways in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import tifffile

Array = npt.NDArray[Any]


def test_bits_are_those_of_the_program(
    program: Any, model_file: Path, frames: list[Path], plan: hadalens.Plan, tmp_path: Path
) -> None:
    """What run gives is, bit for bit, what `hadalens reconstruct` writes."""
    program("reconstruct", *frames, "-m", model_file, "-o", tmp_path, "--no-preview")
    for frame in frames:
        result = plan.run(tifffile.imread(frame), channel_axis=-1)
        stack = tifffile.imread(tmp_path / f"{frame.stem}_stack.tif")
        np.testing.assert_array_equal(result.stack, stack.reshape(result.stack.shape))
        sharp = np.moveaxis(tifffile.imread(tmp_path / f"{frame.stem}_aif.tif"), -1, 0)
        np.testing.assert_array_equal(result.all_in_focus, sharp.reshape(result.all_in_focus.shape))
        np.testing.assert_array_equal(result.distance_map, tifffile.imread(tmp_path / f"{frame.stem}_depth.tif"))
