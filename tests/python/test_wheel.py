"""The wheel: one for all Pythons from 3.11 on, with the library inside and without an OpenCL loader."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel() -> Path:
    """Return the wheel that environment.sh made."""
    found = sorted((Path(sys.prefix) / "wheel").glob("hadalens-*.whl"))
    if not found:
        pytest.skip("environment.sh makes the wheel")
    return found[-1]


def test_one_wheel_serves_every_python(wheel: Path) -> None:
    """Its tag says so, and abi3audit finds nothing beyond the stable ABI of 3.11."""
    assert "-cp311-abi3-" in wheel.name
    subprocess.run([sys.executable, "-m", "abi3audit", "--strict", str(wheel)], check=True)


def test_what_is_inside(wheel: Path) -> None:
    """The extension module with the library in it, types, and no loader of OpenCL's."""
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    files = {Path(name).name for name in names}
    assert {"_binding.abi3.so", "_binding.pyi", "py.typed", "__init__.py"} <= files
    assert not [name for name in names if "OpenCL" in name or name.endswith((".c", ".h"))]
    modules = {file.name for file in (ROOT / "bindings/python/hadalens").glob("*.py")}
    assert modules <= files
