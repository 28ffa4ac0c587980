"""What people get wrong gives no wrong result, no crash and no riddle."""

from __future__ import annotations

import copy as copying
import pickle
from collections.abc import Iterator
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
from hadalens._native import ffi

Array = npt.NDArray[Any]


@pytest.fixture(scope="module")
def linear(model: hadalens.Model) -> hadalens.Plan:
    """Return a plan that is quick."""
    return hadalens.Plan(model, refine=0)


# one buffer for many frames -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["f4", "u2"])
def test_map_may_be_given_one_buffer_again_and_again(dtype: str, linear: hadalens.Plan, raw: Array) -> None:
    """Cameras fill one buffer; every frame is right all the same."""
    scale = 1.0 if dtype == "f4" else 1000.0
    frames = [(raw * scale * (1 + i)).astype(dtype) for i in range(20)]
    buffer = np.empty_like(frames[0])

    def filled() -> Iterator[Array]:
        for frame in frames:
            buffer[:] = frame
            yield buffer

    for result, frame in zip(linear.map(filled()), frames, strict=True):
        np.testing.assert_array_equal(result.stack, linear.run(frame).stack)


def test_two_jobs_do_not_fill_one_array(model: hadalens.Model, raw: Array) -> None:
    """The second is refused while the first is at work, also for a part of the array; after that it is fine."""
    plan = hadalens.Plan(model, classic=hadalens.Classic("admm", iterations=10**7))
    planes = plan.stack_shape[0]
    room = np.zeros((planes + 1, *plan.stack_shape[1:]), np.float32)
    first = plan.submit(raw, room[:planes])
    with pytest.raises(hadalens.StateError, match="filled by another job"):
        plan.submit(raw, room[1:])
    with pytest.raises(hadalens.StateError, match="filled by another job"):
        hadalens.Plan(model, refine=0).run(raw, room[:planes])
    first.cancel()
    first.wait()
    hadalens.Plan(model, refine=0).run(raw, room[:planes])
    assert room[:planes].any()


# pickles from elsewhere -----------------------------------------------------------------------------------------------


def test_cameras_are_pickled_member_by_member() -> None:
    """All bits come back; what is no camera is refused, not copied into memory."""
    camera = hadalens.Camera("paper2022", rows=1000, pixel_pitch_mm=0.0034567890123456789)
    camera.set_depths(100, 600, 3)
    for copy in (pickle.loads(pickle.dumps(camera)), copying.deepcopy(camera)):
        assert bytes(ffi.buffer(copy._c)) == bytes(ffi.buffer(camera._c))
    with pytest.raises((AttributeError, TypeError)):
        hadalens.Camera.__new__(hadalens.Camera).__setstate__(b"\xff" * 100_000)
    restore, (kind, members) = camera.__reduce__()
    for wrong in ({"rows": "many"}, {"distances_mm": (1.0,) * 10_000}, {"mask": "fog"}, {"nothing": 1}):
        with pytest.raises((hadalens.ArgumentError, TypeError, AttributeError)):
            restore(kind, members | wrong)
