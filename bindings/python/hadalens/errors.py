"""Errors: one class for each status of the C library, all of them :class:`HadalensError`.

Each is also the built-in exception that a Python program would expect: :class:`ValueError` for an argument,
:class:`OSError` for a file, :class:`MemoryError` where memory ran out.
"""

from __future__ import annotations

import enum


class Status(enum.IntEnum):
    """What a call of the C library ended with; numbers as in ``hadalens/status.h``."""

    OK = 0
    ARGUMENT = 1
    SIZE = 2
    STATE = 3
    UNSUPPORTED = 4
    CANCELLED = 5
    MEMORY = 20
    DEVICE_MEMORY = 21
    FILE_OPEN = 40
    FILE_READ = 41
    FILE_FORMAT = 42
    FILE_WRITE = 43
    NOT_FINITE = 60
    DATASET = 61
    MODEL = 62
    NO_DEVICE = 80
    DEVICE_CHOICE = 81
    DEVICE = 82
    BUILD = 83
    SELF_TEST = 84
    NUMERIC = 100


class HadalensError(Exception):
    """Something went wrong in the library; the message says what to do.

    Attributes:
        status: which kind of error, a :class:`Status`.
        code: the OpenCL error code, 0 where none.
        detail: longer material where there is any, such as the head of a compiler's log.

    Example:
        >>> try:
        ...     hadalens.Model.load("no such.model")
        ... except hadalens.HadalensError as error:
        ...     print(error.status.name)
        FILE_OPEN

    """

    status: Status = Status.OK

    def __init__(self, message: str, *, code: int = 0, detail: str = "") -> None:
        """Make the error of a message; its class says the status."""
        super().__init__(message)
        self.code = code
        self.detail = detail

    def __str__(self) -> str:
        """Return the message."""
        return str(self.args[0])

    def __reduce__(self) -> tuple[object, ...]:
        """Errors cross the borders of processes (Dask, multiprocessing) with all they say."""
        more = {name: getattr(self, name) for name in ("errno", "strerror") if hasattr(self, name)}
        return _rebuilt, (type(self), str(self), self.code, self.detail, more)


def _rebuilt(kind: type[HadalensError], message: str, code: int, detail: str, more: dict[str, object]) -> HadalensError:
    error = kind(message, code=code, detail=detail)
    for name, value in more.items():
        setattr(error, name, value)
    return error


class ArgumentError(HadalensError, ValueError):
    """An argument is out of range or missing."""

    status = Status.ARGUMENT


class SizeError(HadalensError, ValueError):
    """Sizes do not fit together."""

    status = Status.SIZE


class StateError(HadalensError, RuntimeError):
    """The call came at the wrong time, such as after ``close()``."""

    status = Status.STATE


class UnsupportedError(HadalensError, ValueError):
    """Valid, but not offered."""

    status = Status.UNSUPPORTED


class CancelledError(HadalensError):
    """Stopped on request."""

    status = Status.CANCELLED


class HostMemoryError(HadalensError, MemoryError):
    """The host's memory ran out."""

    status = Status.MEMORY


class DeviceMemoryError(HadalensError, MemoryError):
    """The device's memory ran out."""

    status = Status.DEVICE_MEMORY


class FileError(HadalensError, OSError):
    """A file could not be read or written: what the errors of files have in common; `errno` where it is known."""


class FileOpenError(FileError):
    """A file is missing or not readable."""

    status = Status.FILE_OPEN


class FileMissingError(FileOpenError, FileNotFoundError):
    """A file is not there."""


class FileReadError(FileError):
    """A file is truncated or damaged."""

    status = Status.FILE_READ


class FileFormatError(FileError, ValueError):
    """A file has not the format expected, or a part of it is not supported."""

    status = Status.FILE_FORMAT


class FileWriteError(FileError):
    """A file could not be written; nothing was left behind."""

    status = Status.FILE_WRITE


class NotFiniteError(HadalensError, ValueError):
    """An image holds NaN or infinite values."""

    status = Status.NOT_FINITE


class DatasetError(HadalensError, ValueError):
    """A data set is incomplete."""

    status = Status.DATASET


class ModelError(HadalensError, ValueError):
    """A model does not fit the frame or the request."""

    status = Status.MODEL


class DeviceError(HadalensError, RuntimeError):
    """A call of OpenCL failed; ``code`` says how."""

    status = Status.DEVICE


class NoDeviceError(DeviceError):
    """There is no OpenCL device on this machine; the message says what to install."""

    status = Status.NO_DEVICE


class DeviceChoiceError(DeviceError, ValueError):
    """The device asked for is not there."""

    status = Status.DEVICE_CHOICE


class BuildError(DeviceError):
    """A kernel could not be built or loaded; ``detail`` has the head of the compiler's log."""

    status = Status.BUILD


class SelfTestError(DeviceError):
    """A device computes wrong results."""

    status = Status.SELF_TEST


class NumericError(HadalensError, ArithmeticError):
    """A computation broke down."""

    status = Status.NUMERIC


#: The class of each status.
BY_STATUS: dict[Status, type[HadalensError]] = {
    kind.status: kind
    for kind in (
        ArgumentError,
        SizeError,
        StateError,
        UnsupportedError,
        CancelledError,
        HostMemoryError,
        DeviceMemoryError,
        FileOpenError,
        FileReadError,
        FileFormatError,
        FileWriteError,
        NotFiniteError,
        DatasetError,
        ModelError,
        DeviceError,
        NoDeviceError,
        DeviceChoiceError,
        BuildError,
        SelfTestError,
        NumericError,
    )
}
