"""The wheel: one for all Pythons from 3.11 on, with the library inside and without an OpenCL loader."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
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


@pytest.fixture(scope="module")
def portable(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel of manylinux.sh, from the objects of the other one."""
    pytest.importorskip("auditwheel")
    folder = tmp_path_factory.mktemp("wheel")
    objects = Path(sys.prefix) / "build"
    subprocess.run(
        [ROOT / "bindings/python/manylinux.sh", folder, "--config-settings", f"build-dir={objects}"],
        env={**os.environ, "PYTHON": sys.executable},
        check=True,
    )
    assert wheel.exists()
    return next(folder.glob("*.whl"))


def test_a_wheel_for_other_machines(portable: Path, tmp_path: Path) -> None:
    """What it links to is inside; OpenCL's loader is asked of the system, and works; a second one is bundled."""
    assert "-cp311-abi3-manylinux_" in portable.name
    with zipfile.ZipFile(portable) as file:
        names = file.namelist()
        file.extractall(tmp_path / "site")
    assert [name for name in names if "OpenCL" in name] == ["hadalens/loader/libOpenCL.so.1"]
    assert "hadalens/loader/LICENSE" in names
    assert any(name.startswith("hadalens.libs/libclFFT") for name in names)
    code = "import sys; sys.path.insert(0, sys.argv[1]); import hadalens; hadalens.devices(); print(hadalens.__file__)"
    code += "; print(*{line.split()[-1] for line in open('/proc/self/maps') if 'libOpenCL' in line})"
    text = subprocess.check_output([sys.executable, "-c", code, str(tmp_path / "site")], text=True)
    here, loader = text.splitlines()
    assert here.startswith(str(tmp_path))
    assert str(tmp_path) not in loader


def test_what_is_inside(wheel: Path) -> None:
    """The extension module with the library in it, types, the weights that PyTorch reads, and no loader of OpenCL's."""
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    files = {Path(name).name for name in names}
    assert {"_binding.abi3.so", "_binding.pyi", "py.typed", "__init__.py"} <= files
    assert not [name for name in names if "OpenCL" in name or name.endswith(".c")]
    assert [name for name in names if name.endswith(".h")] == ["hadalens/data/shared_ridge_weights.h"]
    modules = {file.name for file in (ROOT / "bindings/python/hadalens").glob("*.py")}
    assert modules <= files


def test_a_build_names_all_that_is_missing(tmp_path: Path) -> None:
    """Once, with a line to copy for each way of installing; before, one package a try."""
    defines = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["scikit-build"]["cmake"]["define"]
    given = [f"-D{name}={value}" for name, value in defines.items()]
    nothing = {**os.environ, "PKG_CONFIG_LIBDIR": str(tmp_path), "PKG_CONFIG_PATH": ""}

    given += [f"-DPython3_EXECUTABLE={sys.executable}", f"-DCMAKE_FIND_ROOT_PATH={tmp_path}"]
    given += ["-DCMAKE_FIND_ROOT_PATH_MODE_INCLUDE=ONLY", f"-B{tmp_path / 'build'}", f"-S{ROOT}"]
    done = subprocess.run(["cmake", *given], env=nothing, text=True, capture_output=True, check=False)
    assert done.returncode
    told = " ".join(done.stderr.split())
    for words in (
        "apt install ocl-icd-opencl-dev libtiff-dev libjansson-dev libxxhash-dev libclfft-dev",
        "dnf install ocl-icd-devel opencl-headers libtiff-devel jansson-devel xxhash-devel clfft-devel",
        "brew install opencl-icd-loader opencl-headers libtiff jansson xxhash clfft",
        "conda install -c conda-forge khronos-opencl-icd-loader opencl-headers libtiff jansson xxhash clfft",
    ):
        assert words in told
