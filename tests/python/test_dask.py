"""Frames in blocks on threads and on a cluster: the bits of a plan, one plan a process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
import tifffile

da = pytest.importorskip("dask.array")
pytest.importorskip("distributed")

import dask  # noqa: E402
import hadalens.dask as hd  # noqa: E402


@pytest.fixture(scope="module")
def sequence(frames: list[Path]) -> npt.NDArray[Any]:
    """Return five frames, (T, Y, X, C)."""
    two = [tifffile.imread(frame) for frame in frames]
    return np.stack([two[0], two[1], two[0] * 0.5, two[1] * 0.7, two[0]])


@pytest.fixture(scope="module")
def want(plan: hadalens.Plan, sequence: npt.NDArray[Any]) -> list[hadalens.Result]:
    """Return what a plan makes of them."""
    return [plan.run(frame, channel_axis=-1) for frame in sequence]


def check(results: hd.Frames, want: list[hadalens.Result]) -> None:
    """Compare all of the results, bit for bit."""
    got = dask.compute(results.stack, results.all_in_focus, results.distance_map)
    for name, array in zip(("stack", "all_in_focus", "distance_map"), got, strict=True):
        np.testing.assert_array_equal(array, np.stack([getattr(result, name) for result in want]))
    assert results.distances_mm == tuple(want[0].distances_mm)


def test_threads(sequence: npt.NDArray[Any], model: hadalens.Model, want: list[hadalens.Result]) -> None:
    """Threads share one plan; several results of a frame are one reconstruction."""
    results = hd.reconstruct(da.from_array(sequence, chunks=(2, 50, 50, 1)), model, channel_axis=-1)
    assert results.stack.shape == (5, *want[0].stack.shape)
    assert results.stack.chunks[0] == (2, 2, 1)
    with dask.config.set(scheduler="threads", num_workers=2):
        check(results, want)
    kept = hd._kept
    frames = da.from_array(sequence[:1], chunks=((0, 1), 96, 128, 3))  # a block without frames
    results = hd.reconstruct(frames, model, channel_axis=-1)
    results.distance_map.compute(scheduler="threads")
    assert hd._kept is kept, "the same call made another plan"


def test_a_cluster_of_two_workers(
    sequence: npt.NDArray[Any], model: hadalens.Model, want: list[hadalens.Result]
) -> None:
    """Each worker has its own device, here the halves of a CPU, and one plan."""
    from distributed import Client, LocalCluster

    def plans() -> tuple[int, str]:
        assert hd._kept is not None
        return os.getpid(), hd._kept[0].split()[-1]

    dask.config.set({"distributed.worker.daemon": False})
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        frames = da.from_array(sequence, chunks=(1, -1, -1, -1))
        results = hd.reconstruct(frames, model, channel_axis=-1, devices=["0:1/2", "0:2/2"])
        check(results, want)
        kept = client.run(plans)
    assert len({process for process, _ in kept.values()}) == 2
    assert {device for _, device in kept.values()} == {"0:1/2", "0:2/2"}


def test_the_example(model_file: Path, plan: hadalens.Plan, frames: list[Path], tmp_path: Path) -> None:
    """examples/dask_cluster.py writes what a plan makes of the files."""
    example = Path(__file__).parents[2] / "examples" / "dask_cluster.py"
    subprocess.run([sys.executable, example, model_file, tmp_path / "out", *frames], check=True, cwd=tmp_path)
    want = [plan.run(tifffile.imread(frame), channel_axis=-1) for frame in frames]
    sharp, where = (hadalens.read_tiff(tmp_path / "out" / f"{name}.tif") for name in ("all_in_focus", "distance_map"))
    np.testing.assert_array_equal(sharp, np.stack([result.all_in_focus for result in want]))
    np.testing.assert_array_equal(where[:, 0], np.stack([result.distance_map for result in want]))


def test_what_is_wrong_is_said(model: hadalens.Model) -> None:
    """No frames; an order that blocks do not keep; frames of another size, once they are computed."""
    with pytest.raises(ValueError, match="warm_start"):
        hd.reconstruct(np.zeros((1, 3, 96, 128)), model, warm_start=True)
    with pytest.raises(ValueError, match="frames are"):
        hd.reconstruct(np.zeros((5, 5)), model)
    results = hd.reconstruct(np.zeros((1, 3, 5, 5), np.float32), model)
    with pytest.raises(hadalens.HadalensError, match="5"):
        results.all_in_focus.compute(scheduler="threads")
