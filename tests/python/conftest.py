"""What tests share: a small camera, learned once, and the C program that results are compared with."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest
import tifffile

Run = Callable[..., str]


@pytest.fixture(scope="session")
def program() -> Run:
    """Run the C program with these arguments; the text that it prints."""
    name = os.environ.get("HADALENS_PROGRAM") or str(Path(__file__).parents[2] / "build/release/bindings/cli/hadalens")
    if not Path(name).exists():
        pytest.skip(f"{name} is not built: HADALENS_PROGRAM says where the program is")

    def run(*arguments: str | Path) -> str:
        return subprocess.run([name, *map(str, arguments)], check=True, text=True, capture_output=True).stdout

    return run


@pytest.fixture(scope="session")
def camera(program: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small camera's pairs, with two test frames."""
    folder = tmp_path_factory.mktemp("data") / "camera"
    size = ["--size", "96x128", "--window", "48x48"]
    program("simulate", "--preset", "sim300", *size, "--pairs", "3", "--test", "2", "-o", folder)
    return folder


@pytest.fixture(scope="session")
def model_file(program: Run, camera: Path) -> Path:
    """Return the file of the camera's model."""
    file = camera.parent / "camera.model"
    program("fit", camera, "-o", file)
    return file


@pytest.fixture(scope="session")
def model(model_file: Path) -> hadalens.Model:
    """Return the camera's model."""
    return hadalens.Model.load(model_file)


@pytest.fixture(scope="session")
def plan(model: hadalens.Model) -> hadalens.Plan:
    """Return a plan of the model, as it comes."""
    return hadalens.Plan(model)


@pytest.fixture(scope="session")
def frames(camera: Path) -> list[Path]:
    """Return the files of the test frames."""
    return sorted((camera / "test" / "raw").glob("*.tif"))


@pytest.fixture(scope="session")
def raw(frames: list[Path]) -> npt.NDArray[Any]:
    """Return a test frame, (C, Y, X) of float32."""
    return np.ascontiguousarray(np.moveaxis(tifffile.imread(frames[0]), -1, 0))
