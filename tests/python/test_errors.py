"""Every status: what makes it, which class it is, and that it says what to do."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
from hadalens import errors
from hadalens._native import error_of, ffi

Array = npt.NDArray[Any]


def fails(kind: type[hadalens.HadalensError], also: type[BaseException], work: Any, *given: Any) -> Any:
    """Check that work raises this error, which is also a built-in one; return it."""
    with pytest.raises(kind) as caught:
        work(*given)
    assert isinstance(caught.value, also)
    assert type(caught.value) is kind
    assert len(str(caught.value)) > 10
    return caught.value


def test_calls(plan: hadalens.Plan, raw: Array) -> None:
    """A value out of range, sizes that do not fit, the wrong time, a frame of another camera, a device that is none."""
    fails(errors.ArgumentError, ValueError, lambda: hadalens.Plan(plan.model, gamma=-1.0))
    fails(errors.SizeError, ValueError, hadalens.metrics.mse, np.zeros((4, 5)), np.zeros((5, 4)))
    fails(errors.StateError, RuntimeError, plan.kernel_times)
    fails(errors.ModelError, ValueError, plan.run, raw[:, :-1])
    error = fails(errors.DeviceChoiceError, ValueError, hadalens.Context, "no such device")
    assert isinstance(error, hadalens.DeviceError)


def test_unsupported() -> None:
    """Valid, but not offered: surfaces between the depths of point spread functions that were given."""
    camera = hadalens.Camera("sim300")
    simulator = hadalens.Simulator(camera, psf=np.ones((camera.depths, camera.rows, camera.cols), np.float32))
    window = (camera.window_rows, camera.window_cols)
    surface = (np.ones(window, np.float32), np.full(window, 200.0, np.float32))
    fails(errors.UnsupportedError, ValueError, simulator.render_reliefs, [surface])


MEMORY = """
import resource, sys, numpy, hadalens
numpy.ones(10)
limit = 3 << 30
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    hadalens.resize(numpy.ones((4, 4), numpy.float32), 60000, 60000)
except hadalens.HostMemoryError as error:
    assert isinstance(error, MemoryError)
    print(error.status.name)
"""


def test_memory() -> None:
    """The host has too little."""
    out = subprocess.run([sys.executable, "-c", MEMORY], check=True, text=True, capture_output=True).stdout
    assert out == "MEMORY\n"


def test_device_memory() -> None:
    """The device has too little: refused before anything is taken."""
    net = hadalens.Net.preset("compact", 3)
    error = fails(errors.DeviceMemoryError, MemoryError, hadalens.NetRunner, net, 16000, 16000)
    assert "smaller" in str(error)


def test_files(tmp_path: Path, model_file: Path, model: hadalens.Model) -> None:
    """Missing, truncated, of another kind, and not to be written."""
    error = fails(errors.FileMissingError, FileNotFoundError, hadalens.Model.load, tmp_path / "no such.model")
    assert isinstance(error, errors.FileOpenError)
    assert "no such.model" in str(error)
    content = model_file.read_bytes()
    (tmp_path / "short.model").write_bytes(content[: len(content) // 2])
    fails(errors.FileReadError, OSError, hadalens.Model.load, tmp_path / "short.model")
    (tmp_path / "text.tif").write_text("not a picture\n" * 10)
    error = fails(errors.FileFormatError, OSError, hadalens.read_tiff, tmp_path / "text.tif")
    assert isinstance(error, ValueError)
    fails(errors.FileWriteError, OSError, model.save, tmp_path / "no folder" / "a.model")


def test_not_finite(plan: hadalens.Plan, raw: Array) -> None:
    """NaN in a frame."""
    spoilt = raw.copy()
    spoilt[0, 3, 4] = np.nan
    fails(errors.NotFiniteError, ValueError, plan.run, spoilt)
    assert hadalens.Plan(plan.model, repair=True).run(spoilt).report.repaired_pixels == 1


def test_dataset(tmp_path: Path) -> None:
    """A folder that is none, and nothing at all."""
    fails(errors.DatasetError, ValueError, hadalens.Dataset.scan, tmp_path)
    fails(errors.DatasetError, ValueError, hadalens.Dataset, {})


def test_build(tmp_path: Path, raw: Array, model: hadalens.Model) -> None:
    """A folder of binaries that lacks what is needed: nothing is compiled in its place."""
    folder = hadalens.Context().save_programs(tmp_path / "binaries")
    for file in folder.iterdir():
        if file.suffix != ".txt" and "fft" in file.name:
            file.unlink()

    def work() -> None:
        hadalens.Plan(model, context=hadalens.Context(binaries=folder)).run(raw)

    fails(errors.BuildError, RuntimeError, work)


def test_numeric(raw: Array) -> None:
    """Values whose squares leave single precision."""
    fitter = hadalens.Fitter([100.0], (96, 128), window=(48, 48), channels=3)
    fails(errors.NumericError, ArithmeticError, fitter.add, 0, raw * np.float32(1e30), raw)
    assert fitter.pairs == (0,)


@pytest.mark.parametrize("status", [status for status in errors.Status if status])
def test_records_become_exceptions(status: errors.Status) -> None:
    """What C says comes through: those that no test above can make as well (a device that fails or lies)."""
    record = ffi.new("hada_error *", {"status": int(status), "cl_code": -5, "message": b"what", "detail": b"log"})
    error = error_of(record)
    assert error.status is status
    assert type(error) is errors.BY_STATUS[status]
    assert str(error).startswith("what")
    assert (error.code, error.detail) == (-5, "log")


def test_errors_of_callbacks_come_first(camera: Path) -> None:
    """What a callback raises stops the work and is what the caller sees."""

    def progress(what: str, done: int, total: int, note: str | None) -> None:  # noqa: ARG001
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        hadalens.fit(camera, progress=progress)


def test_errors_of_readers_come_first() -> None:
    """What reading a pair raises is what the caller sees."""

    def read() -> Array:
        raise LookupError("no such picture")

    with pytest.raises(LookupError, match="no such picture"):
        hadalens.fit({100.0: [(read, read)] * 3})
