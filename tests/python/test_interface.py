"""Nothing of the C interface is forgotten, and what is written twice is the same."""

from __future__ import annotations

import fnmatch
import inspect
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hadalens
import pytest
from hadalens import _native, errors
from hadalens._fit import fit_options
from hadalens._native import _preload_loader, ffi, lib, words

ROOT = Path(__file__).parents[2]


def c_functions() -> set[str]:
    """Return the names of the functions that the public headers declare."""
    found: set[str] = set()
    for header in (ROOT / "lib/include/hadalens").glob("*.h"):
        text = re.sub(r"/\*.*?\*/", "", header.read_text(), flags=re.S)
        found |= set(re.findall(r"(?:HADA_API|static inline)\s[^;{]*?\b(hada_\w+)\s*\(", text))
    return found


def defaults() -> set[str]:
    """Return the names of the functions that fill a struct with defaults, which a macro declares."""
    headers = (ROOT / "lib/include/hadalens").glob("*.h")
    return {f"{name}_init" for header in headers for name in re.findall(r"\bHADA_INIT\((hada_\w+)", header.read_text())}


def exceptions() -> list[str]:
    """Return the patterns of not_bound.txt; each says why."""
    patterns = []
    for line in (Path(__file__).parent / "not_bound.txt").read_text().splitlines():
        if not line.startswith("#"):
            pattern, reason = line.split(None, 1)
            assert reason.strip(), f"{pattern}: why?"
            patterns.append(pattern)
    return patterns


def used() -> set[str]:
    """Return the functions that the package calls."""
    return {
        name
        for file in (ROOT / "bindings/python/hadalens").glob("*.py")
        for name in re.findall(r"\blib\.(hada_\w+)", file.read_text())
    }


def test_every_function_can_be_called() -> None:
    """What the headers declare is in the extension module."""
    functions = c_functions()
    assert len(functions) > 200
    assert [name for name in functions if not hasattr(lib, name)] == []


def test_every_function_is_bound_or_excused() -> None:
    """The package calls it, or not_bound.txt says why not; nothing is excused that is called."""
    functions, called, excused = c_functions(), used(), exceptions()
    assert called <= functions | defaults()
    left = {name for name in functions - called if not any(fnmatch.fnmatch(name, one) for one in excused)}
    assert left == set()
    for pattern in excused:
        some = set(fnmatch.filter(functions, pattern))
        assert some, f"{pattern} excuses nothing"
        assert some - called, f"{pattern} excuses what is called"


def test_statuses_are_those_of_the_header() -> None:
    """Names and numbers agree, and each but OK has a class of its own."""
    assert {status.name.lower(): int(status) for status in errors.Status if status} == {
        name.removeprefix("error_"): value for name, value in words("hada_status").items() if value
    }
    assert set(errors.BY_STATUS) == set(errors.Status) - {errors.Status.OK}
    assert all(issubclass(kind, hadalens.HadalensError) for kind in errors.BY_STATUS.values())


def test_enumerations_have_words() -> None:
    """Words come from the headers."""
    assert words("hada_form")["wiener"] == lib.HADA_FORM_WIENER
    assert words("hada_skip")["all"] == lib.HADA_SKIP_ALL
    assert words("hada_turn") == {"none": 0, "mirror": 1, "flip": 2, "180": 3, "transpose": 4, "90": 5, "270": 6}
    assert words("hada_exposure") == {"auto": 0, "same": 1, "each": 2}


@pytest.mark.parametrize(
    ("kind", "struct", "left_out"),
    [
        (hadalens.DeviceInfo, "hada_device_info", set()),
        (hadalens.ModelInfo, "hada_model_info", {"lambda", "flat", "dark_frame"}),  # of Model
        (hadalens.SkipReport, "hada_skip_report", set()),
        (hadalens.Step, "hada_step_report", {"size"}),
        (hadalens.Validation, "hada_validation", {"size"}),
        (hadalens.NetInfo, "hada_net_info", set()),
        (hadalens.QueueInfo, "hada_queue_info", set()),
        (hadalens.Match, "hada_match", {"size"}),
        (hadalens.KernelTime, "hada_kernel_time", set()),
        (hadalens.CallCounts, "hada_call_counts", set()),
        (hadalens.FilterScore, "hada_fit_filter_score", {"lambda"}),
        (hadalens.OutsideScore, "hada_fit_outside_score", set()),
        (hadalens.RefineScore, "hada_fit_refine_score", set()),
        (hadalens.ResponseRow, "hada_survey_row", set()),
        (hadalens.Registration, "hada_registration", {"size"}),
        (hadalens.RegisteredDepth, "hada_registered_depth", set()),
        (hadalens.TiffInfo, "hada_tiff_info", {"distances"}),
        (hadalens.SimulateReport, "hada_simulate_report", {"size"}),
        (hadalens.FocusReport, "hada_focus_report", {"size"}),
        (hadalens.Augment, "hada_augment", {"size"}),
        (hadalens.Sensor, "hada_sensor", {"size", "gain"}),
        (hadalens.Classic, "hada_classic_options", {"size", "lambda"}),
        (hadalens.metrics.DepthScore, "hada_depth_score", {"size"}),
        (hadalens.metrics.ConfidenceScore, "hada_confidence_score", {"size"}),
        (hadalens.metrics.Evaluation, "hada_evaluation", {"size"}),
        (hadalens.optics.OpticsRow, "hada_optics_row", set()),
    ],
)
def test_records_have_every_member(kind: type, struct: str, left_out: set[str]) -> None:
    """A member that a struct gains is missed here."""
    members = {name for name, _ in ffi.typeof(struct).fields} - left_out
    assert members <= set(kind.__dataclass_fields__)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("function", "struct", "otherwise"),
    [
        # those that go by another name, or by another way; not_bound.txt tells of communicators
        (
            hadalens.fit,
            "hada_fit_options",
            {"depths", "channels", "distances_mm", "raw_rows", "raw_cols", "window_rows", "window_cols"}
            | {"lambda", "grid_rows", "grid_cols", "monitor", "communicator", "sums", "sensor_mosaic"}
            | {"find_dark", "find_colours"},
        ),
        (hadalens.fit, "hada_fit_task", {"fit", "merge_count", "monitor"}),
        (
            hadalens.Fitter,
            "hada_fit_options",
            {"depths", "raw_rows", "raw_cols", "window_rows", "window_cols", "lambda"}
            | {"grid_rows", "grid_cols", "monitor", "communicator", "sums", "sensor_mosaic"}
            | {"find_dark", "find_colours"},
        ),
        (
            hadalens.Model.from_psf,
            "hada_psf_options",
            {"lambda", "window_rows", "window_cols", "frame_rows", "frame_cols", "position_rows", "position_cols"},
        ),
        (
            hadalens.Plan,
            "hada_plan_options",
            {"depth_count", "occupied_list", "occupied_count", "dark_level", "dark_frame", "repair_not_finite"},
        ),
        # parts are in the device's name; the self-test is left out by nobody
        (hadalens.Context, "hada_context_options", {"part", "parts", "log", "log_user", "skip_self_test", "monitor"}),
        (hadalens.focus_stack, "hada_focus_options", set()),
        (
            hadalens.train,
            "hada_train_task",
            {"fit", "boundary", "user", "monitor"},  # fit() makes another model to begin with
        ),
        (hadalens.simulate, "hada_simulate_task", {"simulator", "monitor"}),
        (hadalens.Net.unet, "hada_unet_options", set()),
        (hadalens.optics.Wave, "hada_wave_options", {"monitor"}),
        (hadalens.reconstruct_files, "hada_files_task", {"user", "monitor", "communicator"}),
    ],
)
def test_options_have_every_member(function: Callable[..., Any], struct: str, otherwise: set[str]) -> None:
    """A member that a struct of options gains is missed here."""
    names = set(inspect.signature(function).parameters)
    if function is hadalens.Fitter:
        names |= set(inspect.signature(fit_options).parameters)
    members = {name for name, _ in ffi.typeof(struct).fields} - {"size"}
    assert members - names == otherwise


def test_defaults_are_those_of_the_library() -> None:
    """What Python states as a default is the C library's."""
    for options, struct in ((hadalens.Classic("fista"), "hada_classic_options"), (hadalens.Sensor(), "hada_sensor")):
        fresh = ffi.new(f"{struct} *")
        getattr(lib, f"{struct}_init")(fresh)
        given = options._options().c
        for name, field in ffi.typeof(struct).fields:
            if name not in ("method", "size") and field.type.kind != "pointer":
                assert getattr(given, name) == getattr(fresh, name), name


def test_all_names_are_there() -> None:
    """__all__ is whole."""
    assert [name for name in hadalens.__all__ if not hasattr(hadalens, name)] == []
    assert hadalens.__version__ == re.search(
        r'HADALENS_VERSION +"(.*)"', (ROOT / "lib/include/hadalens/base.h").read_text()
    ).group(1)  # type: ignore[union-attr]


def test_import_touches_no_device(tmp_path: Path) -> None:
    """Importing works where no driver is registered, and says what to install when one is needed."""
    code = "import hadalens\ntry: hadalens.devices()\nexcept hadalens.NoDeviceError as e: print(e.status.name, e)"
    empty = tmp_path / "vendors"
    empty.mkdir()
    text = subprocess.run(
        [sys.executable, "-c", code],
        env={"OCL_ICD_VENDORS": str(empty), "PATH": ""},
        check=True,
        text=True,
        capture_output=True,
    ).stdout
    assert text.startswith("NO_DEVICE ")
    assert "pocl-opencl-icd" in text
    assert "conda-forge" in text


def test_a_loader_that_a_package_brought_serves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the system has no OpenCL loader, one of conda or of another package is used."""
    with open("/proc/self/maps") as maps:
        loader = next(line.split()[-1] for line in maps if "libOpenCL" in line)
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert not _preload_loader()
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libOpenCL.so.1").symlink_to(loader)
    assert _preload_loader()
    monkeypatch.setattr(sys, "prefix", "nowhere")
    assert not _preload_loader()
    monkeypatch.setattr(_native, "__file__", str(tmp_path / "hadalens" / "_native.py"))
    (tmp_path / "hadalens" / "loader").mkdir(parents=True)
    (tmp_path / "hadalens" / "loader" / "libOpenCL.so.1").symlink_to(loader)
    assert _preload_loader()  # of a wheel that has one
    monkeypatch.undo()
    monkeypatch.setattr(sys, "prefix", "nowhere")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "site-packages")])
    (tmp_path / "site-packages" / "some.libs").mkdir(parents=True)
    (tmp_path / "site-packages" / "some.libs" / "libOpenCL-1234.so.1.0.0").symlink_to(loader)
    assert _preload_loader()


WITHOUT_LOADER = """
import sys

class NoLoader:
    def find_spec(self, name, path=None, target=None):
        if name == "hadalens._binding":
            raise ImportError("libOpenCL.so.1: cannot open shared object file: No such file or directory")

sys.meta_path.insert(0, NoLoader())
sys.prefix, sys.path = "nowhere", [path for path in sys.path if "numpy" not in path]
import glob
glob.glob = lambda pattern: []
try:
    import hadalens
except ImportError as error:
    print(error)
"""


def test_without_any_loader_the_message_says_what_to_install() -> None:
    """There is a loader to install, and a driver."""
    text = subprocess.run([sys.executable, "-c", WITHOUT_LOADER], check=True, text=True, capture_output=True).stdout
    for word in ("ocl-icd-libopencl1", "pocl-opencl-icd", "conda-forge"):
        assert word in text


def test_import_takes_little_cpu_time() -> None:
    """`import hadalens` after NumPy takes 100 ms of CPU time at most: the best of three."""
    code = "import numpy, time; t = time.process_time(); import hadalens; print(time.process_time() - t)"
    times = [float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(3)]
    assert min(times) <= 0.1
