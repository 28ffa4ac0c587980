"""Hadalens: from one raw frame of a lensless camera to a 3-D scene.

A stack of refocused images, an all-in-focus image and a distance map; and learning the camera, exactly and in seconds,
from a few pairs of raw frame and known scene per distance.

    >>> import hadalens
    >>> model = hadalens.fit("camera")                 # a folder of pairs
    >>> result = hadalens.Plan(model).run(raw)         # a NumPy array, or anything that is one
    >>> result.stack, result.all_in_focus, result.distance_map
"""

from ._native import lib, text
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
from .model import Model, ModelInfo
from .plan import Classic, Job, Plan, Report, Result, SkipReport

__version__ = text(lib.hada_version())

__all__ = [
    "ArgumentError",
    "BuildError",
    "CancelledError",
    "Classic",
    "Context",
    "DatasetError",
    "DeviceChoiceError",
    "DeviceError",
    "DeviceInfo",
    "DeviceMemoryError",
    "FileError",
    "FileFormatError",
    "FileOpenError",
    "FileReadError",
    "FileWriteError",
    "HadalensError",
    "HostMemoryError",
    "Job",
    "Model",
    "ModelError",
    "ModelInfo",
    "NoDeviceError",
    "NotFiniteError",
    "NumericError",
    "Plan",
    "Report",
    "Result",
    "SelfTestError",
    "SizeError",
    "SkipReport",
    "StateError",
    "Status",
    "UnsupportedError",
    "devices",
]
