"""Hadalens: from one raw frame of a lensless camera to a 3-D scene.

A stack of refocused images, an all-in-focus image and a distance map; and learning the camera, exactly and in seconds,
from a few pairs of raw frame and known scene per distance.

    >>> import hadalens
    >>> pairs, _ = hadalens.simulate("sim300", "camera", tests=1)      # in place of your captures
    >>> model = hadalens.fit(pairs)                    # or a folder of pairs, or arrays
    >>> raw = hadalens.read_tiff("camera/test/raw/test01.tif", 0)
    >>> result = hadalens.Plan(model).run(raw)         # a NumPy array, or anything that is one
    >>> result.stack, result.all_in_focus, result.distance_map
"""

from typing import TYPE_CHECKING, Any

from . import _native, response
from ._fit import fit
from ._fit_report import FilterScore, FitReport, OutsideScore, RefineScore, ResponseRow
from ._fitter import Fitter, find_boundary
from ._job import Job
from ._pairs import Dataset, load_dark, load_exposures, merge_exposures
from ._plan_options import Classic
from .device import Context, DeviceInfo, devices
from .errors import (
    ArgumentError,
    BuildError,
    CancelledError,
    DatasetError,
    DeviceChoiceError,
    DeviceError,
    DeviceMemoryError,
    FileError,
    FileFormatError,
    FileMissingError,
    FileOpenError,
    FileReadError,
    FileWriteError,
    HadalensError,
    HostMemoryError,
    ModelError,
    NoDeviceError,
    NotFiniteError,
    NumericError,
    SelfTestError,
    SizeError,
    StateError,
    Status,
    UnsupportedError,
)
from .files import (
    FileResult,
    Pace,
    TiffInfo,
    TiffReader,
    find_pace,
    limits,
    pictures_available,
    read_tiff,
    reconstruct_files,
    save_png,
    save_preview,
    set_headerless,
    set_limits,
    write_tiff,
)
from .model import Model, ModelInfo
from .net import Net, NetInfo, NetRunner
from .plan import CallCounts, KernelTime, Match, Plan, QueueInfo, track_emitters
from .result import Report, Result, SkipReport

if TYPE_CHECKING:
    from . import metrics, optics
    from ._camera import Camera
    from ._register import RegisteredDepth, Registration, register, register_dataset
    from ._scenes import add_noise, crop, downsample, fit_scene, part, procedural_scene, regions, relief, resize
    from ._simulate import Sensor, SimulateReport, Simulator, simulate, window_origin
    from ._train import TrainState, train
    from ._trainer import Augment, Step, Trainer, Validation
    from .focus import FocusReport, focus_stack

__version__ = _native.text(_native.lib.hada_version())

__all__ = [
    "ArgumentError",
    "Augment",
    "BuildError",
    "CallCounts",
    "Camera",
    "CancelledError",
    "Classic",
    "Context",
    "Dataset",
    "DatasetError",
    "DeviceChoiceError",
    "DeviceError",
    "DeviceInfo",
    "DeviceMemoryError",
    "FileError",
    "FileFormatError",
    "FileMissingError",
    "FileOpenError",
    "FileReadError",
    "FileResult",
    "FileWriteError",
    "FilterScore",
    "FitReport",
    "Fitter",
    "FocusReport",
    "HadalensError",
    "HostMemoryError",
    "Job",
    "KernelTime",
    "Match",
    "Model",
    "ModelError",
    "ModelInfo",
    "Net",
    "NetInfo",
    "NetRunner",
    "NoDeviceError",
    "NotFiniteError",
    "NumericError",
    "OutsideScore",
    "Pace",
    "Plan",
    "QueueInfo",
    "RefineScore",
    "RegisteredDepth",
    "Registration",
    "Report",
    "ResponseRow",
    "Result",
    "SelfTestError",
    "Sensor",
    "SimulateReport",
    "Simulator",
    "SizeError",
    "SkipReport",
    "StateError",
    "Status",
    "Step",
    "TiffInfo",
    "TiffReader",
    "TrainState",
    "Trainer",
    "UnsupportedError",
    "Validation",
    "add_noise",
    "crop",
    "devices",
    "downsample",
    "find_boundary",
    "find_pace",
    "fit",
    "fit_scene",
    "focus_stack",
    "limits",
    "load_dark",
    "load_exposures",
    "merge_exposures",
    "metrics",
    "optics",
    "part",
    "pictures_available",
    "procedural_scene",
    "read_tiff",
    "reconstruct_files",
    "regions",
    "register",
    "register_dataset",
    "relief",
    "resize",
    "response",
    "save_png",
    "save_preview",
    "set_headerless",
    "set_limits",
    "simulate",
    "track_emitters",
    "train",
    "window_origin",
    "write_tiff",
]

# What not every program needs is imported when it is first asked for: `import hadalens` takes a third less time.
_LATER = {
    None: ("metrics", "optics"),
    "_camera": ("Camera",),
    "_register": ("RegisteredDepth", "Registration", "register", "register_dataset"),
    "_scenes": (
        "add_noise",
        "crop",
        "downsample",
        "fit_scene",
        "part",
        "procedural_scene",
        "regions",
        "relief",
        "resize",
    ),
    "_simulate": ("Sensor", "SimulateReport", "Simulator", "simulate", "window_origin"),
    "_train": ("TrainState", "train"),
    "_trainer": ("Augment", "Step", "Trainer", "Validation"),
    "focus": ("FocusReport", "focus_stack"),
}
_PLACES = {name: place for place, names in _LATER.items() for name in names}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import what a name is part of."""
        import importlib

        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        place = _PLACES[name]
        module = importlib.import_module(f".{place or name}", __name__)
        found = globals()[name] = module if place is None else getattr(module, name)
        return found


def __dir__() -> list[str]:
    """Return the names for users."""
    return [*__all__, "__doc__", "__version__"]
