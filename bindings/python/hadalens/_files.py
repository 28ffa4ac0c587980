"""Files that are whole or not there, and what optional modules import."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

PathLike: TypeAlias = str | os.PathLike[str]


@contextmanager
def replaced(path: PathLike) -> Iterator[Path]:
    """Give a file to write beside `path`, which takes its name when the block ends well and goes otherwise."""
    target = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    os.close(handle)
    beside = Path(name)
    try:
        yield beside
        umask = os.umask(0)
        os.umask(umask)
        beside.chmod(0o666 & ~umask)  # mkstemp's are the owner's alone
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Import the packages of an extra within this block: where one is missing, the error says what to install."""
    try:
        yield
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            f"{missing.name} is not installed: pip install 'hadalens[{name}]', or of the sources '.[{name}]'",
            name=missing.name,
        ) from missing
