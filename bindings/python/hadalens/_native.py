"""The C library as Python calls it: loading, errors, options, objects that own C memory, progress."""

from __future__ import annotations

import atexit
import dataclasses
import errno
import functools
import glob
import inspect
import itertools
import logging
import math
import numbers
import os
import re
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

import numpy as np

from . import errors

log = logging.getLogger("hadalens")

#: What to install where OpenCL finds nothing to compute on.
INSTALL = (
    "On Debian and Ubuntu: apt install pocl-opencl-icd. With conda: conda install -c conda-forge pocl. From PyPI: "
    "pip install pocl-binary-distribution. GPUs: the driver of their vendor."
)


def _preload_loader() -> bool:
    """Load an OpenCL loader that is no system library, where the system has none.

    The library asks for libOpenCL.so.1 by that name, so one that is in the process already serves: of conda, of
    packages that bring one, or (in wheels that manylinux.sh made) of this package. The system's is first, for it knows
    the drivers that are registered there.
    """
    import ctypes

    sites = [path for path in sys.path if path.endswith("-packages")]
    places = [os.path.join(sys.prefix, "lib", "libOpenCL.so.1")]
    places += [found for site in sites for found in sorted(glob.glob(os.path.join(site, "*.libs", "libOpenCL*.so*")))]
    places += [found for site in sites for found in sorted(glob.glob(os.path.join(site, "*", "libOpenCL.so*")))]
    places.append(os.path.join(os.path.dirname(__file__), "loader", "libOpenCL.so.1"))
    for place in places:
        if os.path.exists(place):
            try:
                ctypes.CDLL(place, mode=ctypes.RTLD_GLOBAL)
            except OSError:
                continue
            return True
    return False


try:
    from . import _binding
except ImportError as error:
    if "libOpenCL" not in str(error):
        raise
    if not _preload_loader():
        raise ImportError(
            "No OpenCL loader (libOpenCL.so.1) was found. On Debian and Ubuntu: apt install ocl-icd-libopencl1. "
            "With conda: conda install -c conda-forge ocl-icd. " + INSTALL
        ) from error
    from . import _binding

ffi = _binding.ffi
lib = _binding.lib


class Special(float):
    """A number below 0 that has a meaning, such as "chosen by the library"; those of users are checked."""


AUTO = Special(lib.HADA_AUTO)

#: Called as progress(what, done, total, note): `done` of `total` `what` are done; `total` 0: not known beforehand.
Progress = Callable[[str, int, int, str | None], None]


def text(pointer: Any) -> str:
    """Return a C string, "" for NULL."""
    return "" if pointer == ffi.NULL else str(ffi.string(pointer).decode("utf-8", "replace"))


def error_of(record: Any) -> errors.HadalensError:
    """Return the exception that a filled hada_error stands for."""
    status = errors.Status(record.status)
    message = spoken(text(record.message)) or status.name
    if status is errors.Status.NO_DEVICE:
        message = f"{message} {INSTALL}"
    kind = errors.BY_STATUS[status]
    if not issubclass(kind, OSError):
        return kind(message, code=int(record.cl_code), detail=text(record.detail))
    number = next((code for code in errno.errorcode if f": {os.strerror(code)}" in message), None)
    if status is errors.Status.FILE_OPEN and number == errno.ENOENT:
        kind = errors.FileMissingError
    failed = kind(message, code=int(record.cl_code), detail=text(record.detail))
    if number is not None and isinstance(failed, OSError):
        failed.errno, failed.strerror = number, os.strerror(number)
    return failed


# What messages call by its name on the command line or in C, and what it is here.
_SPOKEN = (
    (r"'hadalens devices --save-binaries FOLDER'", "Context.save_programs(folder)"),
    (r"fit --psf PSF --frame FRAME", "Model.from_psf(psf, distance_mm, frame=raw.shape[-2:])"),
    (r"fit options\.([a-z_]+)( \d+)?", r"fit(\1=...)"),
    (r"options\.(limits) (\w+=N)", r"set_limits('\2')"),
    (r"options\.headerless HxW:PIXELS", "set_headerless('HxW:PIXELS')"),
    (r"options\.headerless", "set_headerless"),
    (r"options\.enhance 0", "enhance=False"),
    (r"options\.device", "context"),
    (r"options\.repair_not_finite", "repair=True"),
    (r"options\.mosaic ([a-z]{4})\b", r"mosaic='\1'"),
    (r"options\.scene (planes|volume)", r"scene='\1'"),
    (r"options\.([a-z_]+) (\d[\d.]*)", r"\1=\2"),
    (r"options\.([a-z_]+)", r"\1"),
    (r"HADA_([A-Z]+)_\.\.\.", lambda found: f"the words of {found[1].lower()}"),
)


def spoken(message: str) -> str:
    """Return a message of the library in Python's words."""
    if "--" in message or "options." in message or "HADA_" in message:
        for pattern, word_here in _SPOKEN:
            message = re.sub(pattern, word_here, message)
    return message


# The end of Python: objects are destroyed, so other threads (daemons) must not be at work in C, nor begin.
_busy: list[None] = []  # one for each call that runs
_ending: int | None = None  # the thread that ends Python
_PATIENCE = 30.0  # seconds for calls that cannot be stopped, such as compiling


def busy(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a C function that may take long: the end of Python waits for it. The GIL is free meanwhile."""
    stay_if_ending()
    _busy.append(None)
    try:
        return function(*arguments)
    finally:
        _busy.pop()
        stay_if_ending()


def stay_if_ending() -> None:
    """Let a thread rest for ever where another one ends Python."""
    if _ending is not None and _ending != threading.get_ident():
        threading.Event().wait()


def _end() -> None:
    """Stop what runs in other threads, and wait for it."""
    global _ending
    _ending = threading.get_ident()
    until = time.monotonic() + _PATIENCE
    while _busy and time.monotonic() < until:
        time.sleep(0.005)


weakref.finalize(log, int)  # so that what finalize does at the end is registered, and thus runs after this:
atexit.register(_end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_busy.clear)


def call(function: Callable[..., int], *arguments: Any) -> None:
    """Call a C function whose last argument is a hada_error, and raise what it says."""
    failure = ffi.new("hada_error *")
    status = busy(function, *arguments, failure)
    if status:
        failure.status = status  # a callback that raised leaves the record empty
        raise error_of(failure)


def path(name: str | os.PathLike[str]) -> bytes:
    """Return a path as C takes it."""
    encoded = os.fsencode(name)
    if b"\0" in encoded:
        raise errors.ArgumentError(f"{name!r} holds a NUL character, which no path does")
    return encoded


def paths(names: Any) -> list[Any]:
    """Return C strings of some paths; one alone will do."""
    several: Any = [names] if isinstance(names, str | bytes | os.PathLike) else names
    return [ffi.new("char[]", path(name)) for name in several]


def brief(thing: Any) -> str:
    """Return what `repr` says, in a few characters."""
    return " ".join(f"{thing!r:.60}".split())


def two(given: Any, what: str, otherwise: tuple[Any, Any] = (None, None)) -> tuple[Any, Any]:
    """Return two numbers, such as rows and columns; None stands for `otherwise`."""
    if given is None:
        return otherwise
    try:
        first, second = given
    except (TypeError, ValueError):
        raise TypeError(f"{what}={brief(given)}: two numbers are needed") from None
    return first, second


def ascending(distances_mm: Any) -> list[float]:
    """Return distances in millimetres, checked as data sets' are."""
    found = [float(distance) for distance in np.atleast_1d(distances_mm)]
    if found != [0.0] and not all(0 < b - a < math.inf for a, b in itertools.pairwise([0.0, *found])):
        raise errors.ArgumentError(f"distances_mm={found}: they are above 0 and ascend, near to far")
    return found


K = TypeVar("K")


def expect(thing: Any, kind: type[K], what: str, others: str = "") -> K:
    """Return a thing that is of a kind; TypeError otherwise."""
    if not isinstance(thing, kind):
        raise TypeError(f"{what}={thing!r:.80}: a hadalens.{kind.__name__} {others}".rstrip() + " is needed")
    return thing


def meant(name: str, known: Iterable[str]) -> str:
    """Return what a name that is none may be meant for, and all that there are, in words."""
    import difflib

    names = sorted(known)
    near = difflib.get_close_matches(name, names, 1)
    return "".join(f"; is {one!r} meant? " for one in near) + f"{'' if near else '; '}there are {', '.join(names)}"


def check_names(given: Iterable[str], known: Iterable[str], what: str) -> None:
    """Raise TypeError for a keyword that is none."""
    for name in given:
        if name not in known:
            raise TypeError(f"{what} takes no keyword {name!r}{meant(name, known)}")


P = ParamSpec("P")
V = TypeVar("V")


def named(function: Callable[P, V]) -> Callable[P, V]:
    """Let a function that is called with a keyword that is none say what it may be meant for, and what there are."""

    @functools.wraps(function)
    def call_it(*given: P.args, **more: P.kwargs) -> V:
        try:
            return function(*given, **more)
        except TypeError as error:
            wrong = re.search(r"unexpected keyword argument '(\w+)'", str(error))
            if wrong is None or (error.__traceback__ and error.__traceback__.tb_next):  # from within
                raise
            known = inspect.signature(function).parameters.keys() - {"self", "cls"}
            raise TypeError(f"{error}{meant(wrong[1], known)}") from None

    return call_it


# words of enumerations ------------------------------------------------------------------------------------------------


@functools.cache
def words(enumeration: str) -> Mapping[str, int]:
    """Return the members of a C enumeration by their words: HADA_FORM_COMPLEX is "complex"."""
    members = {tuple(name.split("_")): value for name, value in ffi.typeof(enumeration).relements.items()}
    alike = (len(set(parts)) == 1 for parts in zip(*members, strict=False))
    common = sum(1 for _ in itertools.takewhile(bool, alike))
    named = {"_".join(parts[common:]).lower(): value for parts, value in members.items()}
    return dict(sorted(named.items(), key=lambda one: one[1]))


@functools.cache
def word(enumeration: str, value: int) -> str:
    """Return the word of a value of a C enumeration."""
    for name, number in words(enumeration).items():
        if number == value:
            return name
    return str(value)


def value_of(enumeration: str, name: str, what: str) -> int:
    """Return the value of a word; ValueError lists what there is."""
    found = words(enumeration).get(name)
    if found is None:
        raise errors.ArgumentError(f"{what}={name!r} is not known: one of {', '.join(words(enumeration))}")
    return found


# What C sees behind a pointer lives as long as the pointer, whoever still holds the Python object that made it.
_ties: weakref.WeakKeyDictionary[Any, Any] = weakref.WeakKeyDictionary()


def tie(pointer: Any, things: Any) -> Any:
    """Keep things alive as long as a pointer that cffi owns; return the pointer."""
    _ties[pointer] = things
    return pointer


# options and reports --------------------------------------------------------------------------------------------------


@functools.cache
def members(struct: str) -> dict[str, Any]:
    """Return the members of a C struct by their names."""
    return dict(ffi.typeof(struct).fields)


#: Options that may be below 0.
_SIGNED = (
    *("shift_rows", "shift_cols", "rotation_deg", "offset_row", "offset_col"),
    *("explained", "explained_otherwise"),  # of a registration
)
#: Options that have another name here than in C.
_NAMES = {"lambda": "regularisation", "repair_not_finite": "repair"}


def checked(name: str, value: Any) -> Any:
    """Return a number; ArgumentError where it is below 0 or NaN."""
    if isinstance(value, Special):
        return value
    if value != value or (value < 0 and name not in _SIGNED):
        raise errors.ArgumentError(f"{name}={value} is not possible: it is 0 or more; None stands for the default")
    return value


class Options:
    """A C struct of options with what its pointers point to: `c` is the pointer to hand over."""

    def __init__(self, struct: str, *arguments: Any, **given: Any) -> None:
        """Set the defaults by the struct's own init, then what is given and not None."""
        self.kept: list[Any] = []
        self.c = tie(ffi.new(f"{struct} *"), self.kept)
        getattr(lib, f"{struct}_init")(self.c, *arguments)
        self._fields = members(struct)
        if given:
            self.set(**given)

    def set(self, **given: Any) -> None:
        """Set members; None leaves one as it is."""
        for name, value in given.items():
            if value is not None:
                self._set(name, self._fields[name].type, value)

    def _set(self, name: str, kind: Any, value: Any) -> None:
        if kind.kind == "enum" and isinstance(value, str):
            value = value_of(kind.cname.removeprefix("enum "), value, name)
        elif kind.kind == "pointer" and isinstance(value, Options):
            self.kept.append(value)
            value = value.c
        elif kind.kind == "pointer" and not isinstance(value, ffi.CData):
            value = self._pointed(kind, value)
        elif isinstance(value, bool | np.bool_) and kind.cname == "int" and getattr(self.c, name) in (0, 1):
            value = int(value)  # a flag, which is 0 or 1 as it comes; what counts is not
        elif kind.kind == "primitive":
            value = c_number(_NAMES.get(name, name), kind, value)
        setattr(self.c, name, value)

    def _pointed(self, kind: Any, value: Any) -> Any:
        item = kind.item.cname
        if isinstance(value, str | os.PathLike):
            made = ffi.new("char[]", path(value))
        else:
            made = ffi.new(f"{item}[]", list(value))
        self.kept.append(made)
        return made


def c_number(name: str, kind: Any, value: Any) -> Any:
    """Return a number as a C member takes it."""
    whole = kind.cname not in ("double", "float")
    if isinstance(value, Special):
        return int(value) if whole else float(value)
    number = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not number or (whole and not isinstance(value, numbers.Integral)):
        raise TypeError(f"{name}={brief(value)}: a {'whole ' * whole}number is needed")
    try:
        return ffi.new(f"{kind.cname} *", checked(name, value))[0]
    except OverflowError:
        raise errors.ArgumentError(f"{name}={value} is too large") from None


R = TypeVar("R")


def record(kind: type[R], struct: Any, /, **others: Any) -> R:
    """Return a dataclass whose fields are those of a C struct of the same names; `others` are given as they are."""
    takers = _takers(kind, ffi.typeof(struct))  # type: ignore[arg-type]
    values = {name: take(getattr(struct, name)) for name, take in takers if name not in others}
    return kind(**values, **others)


@functools.cache
def _takers(kind: type, struct: Any) -> list[tuple[str, Callable[[Any], Any]]]:
    """Return how each field of a dataclass is made from the member of its name."""
    if struct.kind == "pointer":
        struct = struct.item
    types = {name: field.type for name, field in struct.fields}
    return [(field.name, _taker(types.get(field.name), str(field.type))) for field in dataclasses.fields(kind)]


def _taker(member: Any, annotation: str) -> Callable[[Any], Any]:
    if member is None:
        return _as_it_is
    if member.kind == "enum":
        return functools.partial(word, member.cname.removeprefix("enum "))
    if member.kind in ("pointer", "array") and member.item.cname in ("char", "char const"):
        return text
    return bool if annotation == "bool" else _as_it_is


def _as_it_is(value: Any) -> Any:
    return value


# objects that own C memory --------------------------------------------------------------------------------------------


class Owner:
    """A C object, destroyed when nobody holds it any more; what it was made from lives as long."""

    def __init__(self, kind: str, destroy: Callable[[Any], None], *parents: Any) -> None:
        """Make room for the pointer, which a create function fills through `pointer`."""
        self.pointer = ffi.new(f"{kind} **")
        self.process = os.getpid()
        self.on_device = kind == "hada_context" or _any_on_device(parents)
        weakref.finalize(self, _destroy, destroy, self.pointer, parents, self.process)

    @property
    def c(self) -> Any:
        """The C pointer."""
        if self.on_device:
            check_process(self.process)
        stay_if_ending()
        return self.pointer[0]


def _any_on_device(things: Iterable[Any]) -> bool:
    return any(
        _any_on_device(one) if isinstance(one, list | tuple) else isinstance(one, Owner) and one.on_device
        for one in things
    )


_opener: int | None = None  # the process that asked OpenCL for devices first


def open_devices() -> None:
    """Note that this process uses OpenCL; StateError where a parent did so before it forked."""
    global _opener
    _opener = _opener or os.getpid()
    check_process(_opener)


def check_process(process: int) -> None:
    """Raise StateError in a child of a process that used OpenCL: threads of drivers are missing there."""
    if process != os.getpid():
        raise errors.StateError(
            f"process {process} used OpenCL before it forked, and drivers do not survive that: its child, process "
            f"{os.getpid()}, would wait for ever; start children by multiprocessing.get_context('spawn') or "
            "'forkserver', or let the parent open no device before it forks"
        )


def _destroy(destroy: Callable[[Any], None], pointer: Any, _parents: Any, process: int) -> None:
    # in a child of fork() the threads are gone that would have to end; calls that cannot be stopped use what they use
    if pointer[0] != ffi.NULL and process == os.getpid() and not (_ending and _busy):
        destroy(pointer)


class Handle:
    """A Python object that stands for a C object. ``close()`` gives its memory back, and so does ``with``.

    Without either, that happens when Python drops the object. After ``close()`` every use is a :class:`StateError`.
    """

    _owner: Owner | None = None

    @property
    def _c(self) -> Any:
        return self._own.c

    @property
    def _own(self) -> Owner:
        if self._owner is None:
            raise errors.StateError(f"this {type(self).__name__} is closed")
        return self._owner

    def _shown(self) -> str:
        """Return what `repr` says beside the name of the class."""
        return ""

    def __repr__(self) -> str:
        """Return what the object is, in a line."""
        name = type(self).__name__
        if self._owner is None:
            return f"<{name}: closed>"
        shown = self._shown()
        return f"<{name}{': ' * bool(shown)}{shown}>"

    def close(self) -> None:
        """Give the memory back; once is enough, and again is fine. What was made from it keeps what it needs."""
        self._owner = None

    def __enter__(self) -> Self:
        """Return the object itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()


def saved(thing: Any, name: str = "file") -> bytes:
    """Return the bytes of the file that `thing.save` writes: how objects are pickled."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        thing.save(file)
        return file.read_bytes()


def loaded(kind: Any, content: bytes, name: str = "file") -> Any:
    """Return what `kind.load` makes of a file of these bytes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(content)
        return kind.load(file)


def span(distances_mm: Sequence[float]) -> str:
    """Return how many depths there are, and where, in words."""
    if len(distances_mm) == 1:
        return f"1 depth at {distances_mm[0]:g} mm" if distances_mm[0] else "1 depth"
    return f"{len(distances_mm)} depths from {distances_mm[0]:g} to {distances_mm[-1]:g} mm"


# callbacks ------------------------------------------------------------------------------------------------------------


class Caller:
    """What C hands back to Python: the error that a callback raised is kept here and raised when C has returned."""

    def __init__(self) -> None:
        """Make the handle that goes through C as `user`."""
        self.error: BaseException | None = None
        self.user = ffi.new_handle(self)

    def run(self, function: Callable[..., int], *arguments: Any) -> None:
        """Call C as :func:`call` does; what a callback raised comes first."""
        try:
            call(function, *arguments)
        except errors.HadalensError as failed:
            if self.error is not None:
                raise self.error from failed
            raise
        if self.error is not None:
            raise self.error


def keep_error(_kind: Any, value: BaseException, trace: TracebackType | None) -> None:
    """For ffi.def_extern(onerror=...): keep what a callback raised with its Caller."""
    while trace is not None:
        user = trace.tb_frame.f_locals.get("user")
        if user is not None:
            caller = ffi.from_handle(user)
            if caller.error is None:
                caller.error = value
            return
        trace = trace.tb_next


class Monitor(Caller):
    """A hada_monitor: progress to a function or to tqdm, messages to the logger "hadalens", Ctrl-C and errors stop."""

    def __init__(self, progress: Progress | bool | None) -> None:
        """`progress`: a function, True for tqdm's bars (where it is installed), None or False for none."""
        super().__init__()
        self.progress: Progress | None = (_bars() if progress is True else None) if not callable(progress) else progress
        self.options = Options("hada_monitor", user=self.user)
        self.c = self.options.c
        self.c.progress = lib.py_monitor_progress
        self.c.message = lib.py_monitor_message
        self.c.cancelled = lib.py_monitor_cancelled


def _bars() -> Progress | None:
    """Return a progress function that shows tqdm's bars; None where tqdm is not installed."""
    try:
        from tqdm.auto import tqdm
    except ImportError:
        log.warning("progress=True shows nothing without tqdm: pip install 'hadalens[progress]'")
        return None
    bars: dict[str, Any] = {}

    def show(what: str, done: int, total: int, note: str | None) -> None:
        if not what:
            for bar in bars.values():
                bar.close()
            bars.clear()
            return
        bar = bars.setdefault(what, None)
        if bar is None:
            bar = bars[what] = tqdm(desc=what, total=total or None)
        if note:
            bar.set_postfix_str(note, refresh=False)
        bar.update(done - bar.n)

    return show


@ffi.def_extern(onerror=keep_error)  # type: ignore[untyped-decorator]
def py_monitor_progress(user: Any, what: Any, done: int, total: int, note: Any) -> None:
    """Pass progress on; `what` is "" where a stretch of work ends."""
    monitor = ffi.from_handle(user)
    if monitor.progress is not None:
        monitor.progress(text(what), done, total, text(note) or None)


_MESSAGE_LEVELS = {1: logging.WARNING, 2: logging.INFO, 3: logging.DEBUG}  # of hada_message
_LOG_LEVELS = {1: logging.WARNING, 2: logging.INFO, 3: logging.DEBUG}  # of hada_log_level


@ffi.def_extern(onerror=keep_error)  # type: ignore[untyped-decorator]
def py_monitor_message(user: Any, kind: int, message: Any) -> None:  # noqa: ARG001 (keep_error reads it)
    """Log a message."""
    log.log(_MESSAGE_LEVELS.get(kind, logging.DEBUG), "%s", spoken(text(message)))


@ffi.def_extern(error=1, onerror=keep_error)  # type: ignore[untyped-decorator]
def py_monitor_cancelled(user: Any) -> int:
    """Stop once a callback raised, and at Python's end; a Ctrl-C of this moment is raised here and kept like that."""
    return int(ffi.from_handle(user).error is not None or _ending is not None)


@ffi.def_extern()  # type: ignore[untyped-decorator]
def py_log_function(_user: Any, level: int, message: Any) -> None:
    """Log what a context tells."""
    log.log(_LOG_LEVELS.get(level, logging.DEBUG), "%s", spoken(text(message)))


def doubles(values: Iterable[float]) -> Any:
    """Return a C array of doubles."""
    return ffi.new("double[]", [float(value) for value in values])
