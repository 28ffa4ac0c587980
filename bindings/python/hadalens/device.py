"""Devices, and contexts: work on a device."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

from ._native import Handle, Options, Owner, call, expect, ffi, lib, named, open_devices, path, record, value_of, word


@dataclass(frozen=True)
class DeviceInfo:
    """What matters about an OpenCL device.

    Attributes:
        index: its number in the list, as ``Context(device="0")`` takes it.
        kind: "cpu", "gpu", "accelerator" or "other".
        memory_bytes, max_allocation_bytes, local_memory_bytes: sizes in bytes.
        quirks: in words, what the library does differently there, and why.

    """

    index: int
    kind: str
    name: str
    vendor: str
    driver: str
    version: str
    platform: str
    compute_units: int
    clock_mhz: int
    memory_bytes: int
    max_allocation_bytes: int
    local_memory_bytes: int
    max_work_group: int
    alignment_bytes: int
    has_compiler: bool
    has_local_memory: bool
    has_double: bool
    has_half_arithmetic: bool
    unified_memory: bool
    max_sub_devices: int
    part: int
    parts: int
    quirks: str


def _info(struct: Any) -> DeviceInfo:
    return record(DeviceInfo, struct, kind=word("hada_device_kind", struct.kind))


def devices() -> list[DeviceInfo]:
    """Return all OpenCL devices of this machine, in the order of their index.

    Raises:
        NoDeviceError: there is none; the message says what to install.

    Example:
        >>> for device in hadalens.devices():
        ...     print(device.index, device.name, device.memory_bytes // 2**20, "MiB")

    """
    open_devices()
    found = Owner("hada_device_list", lib.hada_device_list_destroy)
    call(lib.hada_device_list_create, found.pointer)
    return [_info(lib.hada_device_list_get(found.c, index)) for index in range(lib.hada_device_list_count(found.c))]


class Context(Handle):
    """A device made ready for work; it is checked with known answers first.

    What takes a context also works without one: then it is :meth:`Context.default`, on the device that the library
    chooses. Any thread may use a context.

    Args:
        device: an index ("0"), a kind ("cpu", "gpu", "accelerator"), a part of a name, or a part of a device
            ("0:1/2", one half of the first). None: the environment variable HADALENS_DEVICE, else the first GPU, else
            the first accelerator that has its binaries, else the first CPU.
        binaries: folder of offline binaries made by :meth:`save_programs`; then nothing is compiled.
        cache: folder of compiled programs; "" for none. None: HADALENS_CACHE, else in ~/.cache.
        tuning: a file of tuning choices; None: HADALENS_TUNING, else none.
        log_level: "warning" (default), "info" or "trace": what goes to the logger "hadalens".
        shape: of kernels: "lanes" (vectors in one work-item) or "groups" (work-groups with local memory); None:
            HADALENS_SHAPE, else groups on GPUs and lanes elsewhere.

    Raises:
        NoDeviceError: no device is there; the message says what to install.
        DeviceChoiceError: the device asked for is not there.
        SelfTestError: the device computes wrong results.

    Example:
        >>> context = hadalens.Context("gpu")
        >>> plan = hadalens.Plan(model, context=context)

    """

    _opened: ClassVar[dict[str | None, Context]] = {}  # by the device's name; None: the default
    _lock = threading.Lock()

    @named
    def __init__(
        self,
        device: str | int | None = None,
        *,
        binaries: str | os.PathLike[str] | None = None,
        cache: str | os.PathLike[str] | None = None,
        tuning: str | os.PathLike[str] | None = None,
        log_level: str = "warning",
        shape: Literal["lanes", "groups"] | None = None,
    ) -> None:
        """Open the device."""
        options = _options(None if device is None else str(device), binaries, cache, tuning, log_level)
        if shape is not None:
            options.set(shape=value_of("hada_kernel_shape", shape, "shape"))
        self._open(lib.hada_context_create, options)

    def _open(self, create: Any, options: Options, *given: Any) -> None:
        open_devices()
        owner = Owner("hada_context", lib.hada_context_destroy, options)
        call(create, owner.pointer, *given, options.c)
        self._owner = owner

    @classmethod
    def default(cls) -> Context:
        """Return the context of this process on the device that the library chooses; opened when first asked for."""
        return cls._of(None)

    @classmethod
    def _of(cls, device: str | None) -> Context:
        """Return the context of this process on a device, opened when first asked for."""
        open_devices()  # before the lock, which a fork may have left locked
        with cls._lock:
            if device not in cls._opened or cls._opened[device]._owner is None:
                cls._opened[device] = cls(device)
            return cls._opened[device]

    @classmethod
    def adopt(cls, context: Any, device: Any = None) -> Context:
        """Return a context on an OpenCL context of the program's own, such as a ``pyopencl.Context``.

        Args:
            context: a ``pyopencl.Context``, or the address of a cl_context.
            device: a ``pyopencl.Device`` of it, or an address; None: the first of the context's.

        Raises:
            DeviceChoiceError: the device is none of the context's.

        Example:
            >>> context = hadalens.Context.adopt(pyopencl.create_some_context())

        """
        if device is None:
            device = context.devices[0]
        options = _options(None, None, None, None, "warning")
        options.kept += [context, device]
        new = cls.__new__(cls)
        new._open(
            lib.hada_context_adopt,
            options,
            ffi.cast("cl_context", address_of(context)),
            ffi.cast("cl_device_id", address_of(device)),
        )
        return new

    @property
    def device(self) -> DeviceInfo:
        """The device."""
        return _info(lib.hada_context_device(self._c))

    @property
    def _figures(self) -> Any:
        info = ffi.new("hada_context_info *", {"size": ffi.sizeof("hada_context_info")})
        call(lib.hada_context_get_info, self._c, info)
        return info

    @property
    def shape(self) -> str:
        """The shape that kernels take on the device: "lanes" or "groups"; both compute the same, to rounding."""
        return word("hada_kernel_shape", self._figures.shape)

    @property
    def bytes(self) -> int:
        """Bytes of device memory that the context holds now."""
        return int(self._figures.bytes)

    @property
    def peak_bytes(self) -> int:
        """The most bytes it held since it was opened, or since :meth:`reset_peak`."""
        return int(self._figures.peak_bytes)

    def reset_peak(self) -> None:
        """Begin to look for the peak anew."""
        lib.hada_context_reset_peak(self._c)

    @property
    def programs_compiled(self) -> int:
        """Number of programs that were compiled from source so far."""
        return int(self._figures.programs_compiled)

    @property
    def programs_loaded(self) -> int:
        """Number of programs that were loaded as binaries so far."""
        return int(self._figures.programs_loaded)

    @property
    def cl_context(self) -> int:
        """The address of the cl_context, for ``pyopencl.Context.from_int_ptr``."""
        return int(ffi.cast("uintptr_t", lib.hada_context_cl_context(self._c)))

    @property
    def cl_device(self) -> int:
        """The address of the cl_device_id, for ``pyopencl.Device.from_int_ptr``."""
        return int(ffi.cast("uintptr_t", lib.hada_context_cl_device(self._c)))

    def save_programs(self, folder: str | os.PathLike[str]) -> Path:
        """Compile every kernel for this device and write the binaries into a folder, for ``Context(binaries=...)``."""
        call(lib.hada_programs_save, self._c, path(folder), ffi.NULL)
        return Path(folder)

    def peaks(self) -> tuple[float, float]:
        """Measure what the device could do at best: bytes per second of a copy, float32 operations per second."""
        copy, flops = ffi.new("double *"), ffi.new("double *")
        call(lib.hada_device_peaks, self._c, copy, flops)
        return copy[0], flops[0]

    def call_costs(self) -> tuple[float, float, float]:
        """Measure what calls cost: seconds of a launch and of a wait, bytes per second of a write to the device."""
        launch, wait, write = ffi.new("double *"), ffi.new("double *"), ffi.new("double *")
        call(lib.hada_device_call_costs, self._c, launch, wait, write)
        return launch[0], wait[0], write[0]

    def _shown(self) -> str:
        return self.device.name

    def __reduce__(self) -> tuple[Any, ...]:
        """Contexts stay in their process."""
        raise TypeError("a Context cannot be pickled: open one in each process (Context.default())")


#: A context, or a device's name as :class:`Context` takes it, whose context is opened when first asked for.
Device: TypeAlias = Context | str


def _options(device: str | None, binaries: Any, cache: Any, tuning: Any, log_level: str) -> Options:
    return Options(
        "hada_context_options",
        device=device,
        binaries=binaries,
        cache=cache,
        tuning=tuning,
        log=lib.py_log_function,
        log_level=log_level,
    )


def address_of(thing: Any) -> int:
    """Return the address of an OpenCL object: of pyopencl's, or as a number."""
    if isinstance(thing, int):
        return thing
    try:
        return int(thing.int_ptr)
    except AttributeError:
        raise TypeError(f"{type(thing).__name__} is no OpenCL object: pyopencl's, or an address, is needed") from None


def default(context: Device | None) -> Context:
    """Return the context, that of a device's name, or the process's own."""
    if context is None or isinstance(context, str):
        return Context._of(context)
    return expect(context, Context, "context", "or a device's name, such as 'gpu' or '0',")


def contexts(given: Device | Sequence[Device] | None) -> list[Context]:
    """Return what :func:`default` makes of one, or of several."""
    if given is None or isinstance(given, str | Context) or not isinstance(given, Sequence):
        return [default(given)]
    return [default(one) for one in given]
