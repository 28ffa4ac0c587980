"""Frames in flight."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Generator
from typing import Any, ClassVar

from . import errors
from ._native import Owner, busy, call, error_of, ffi, lib, word
from .result import Result, Results

# Seconds after which a wait for C lets Python look for signals: Ctrl-C is heard within these.
_HEARTBEAT = 0.1


class Job:
    """A frame in flight. Ask it, wait for it, or ``await`` it.

    Example:
        >>> job = plan.submit(raw)
        >>> job.progress
        0.25
        >>> result = job.result()

    """

    _all: ClassVar[weakref.WeakSet[Job]] = weakref.WeakSet()  # those that may still fill arrays
    _adding = threading.Lock()

    def __init__(self, plan: Owner, submit: Any, frame: Any, results: Results, kept: Any) -> None:
        """Jobs come from :meth:`Plan.submit`."""
        self._kept: Any = (frame, kept)  # C reads the frame in place
        self._results: Results | None = results
        self._result: Result | None = None
        self._lock = threading.Lock()
        # the result, the frame and the plan must outlive the C job
        self._owner = Owner("hada_job", lib.hada_job_destroy, plan, results, frame, kept)
        with Job._adding:
            for job in list(Job._all):
                others = job._results
                if others is not None and results.meets(others) and not job.done():
                    raise errors.StateError("out is being filled by another job: wait for it, or give each its own")
            call(submit, self._owner.pointer, plan.c, frame, results.c)
            Job._all.add(self)

    @property
    def state(self) -> str:
        """One of "waiting", "running", "done", "failed" or "cancelled"."""
        return word("hada_job_state", lib.hada_job_poll(self._owner.c))

    @property
    def progress(self) -> float:
        """Part done, 0 to 1; never falls."""
        return float(lib.hada_job_progress(self._owner.c))

    def __repr__(self) -> str:
        """Return state and progress."""
        return f"<Job: {self.state}, {self.progress:.0%}>"

    def done(self) -> bool:
        """Return whether it has ended, well or not."""
        return bool(lib.hada_job_poll(self._owner.c) >= lib.HADA_JOB_DONE)

    def cancel(self) -> None:
        """Ask the job to end; returns at once. One that was done stays done."""
        lib.hada_job_cancel(self._owner.c)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end, for `timeout` seconds at most; return whether it has come. Ctrl-C is heard meanwhile."""
        left = float("inf") if timeout is None else timeout
        if left != left:
            raise errors.ArgumentError("timeout=nan is no time")
        while True:
            if busy(lib.hada_job_wait_for, self._owner.c, min(_HEARTBEAT, left)) >= lib.HADA_JOB_DONE:
                return True
            left -= _HEARTBEAT
            if left <= 0:
                return False

    def result(self, timeout: float | None = None) -> Result:
        """Wait for the end and return the result.

        Raises:
            TimeoutError: it is not done after `timeout` seconds; it goes on.
            CancelledError: it was cancelled, or its plan closed.
            HadalensError: what it failed with.

        """
        if not self.wait(timeout):
            raise TimeoutError(f"the frame is not done after {timeout} seconds")
        failure = ffi.new("hada_error *")
        if busy(lib.hada_job_wait, self._owner.c, failure):
            raise error_of(failure)
        with self._lock:
            if self._result is None and self._results is not None:
                self._result = self._results.take()
                self._results = None
                self._kept = None
                Job._all.discard(self)
        assert self._result is not None
        return self._result

    def __await__(self) -> Generator[Any, None, Result]:
        """Wait in asyncio; cancelling the task cancels the job."""
        return self._wait_in_loop().__await__()

    async def _wait_in_loop(self) -> Result:
        import asyncio  # takes longer to import than all of this package

        try:
            await asyncio.get_running_loop().run_in_executor(None, self.wait)
        except asyncio.CancelledError:
            self.cancel()
            raise
        return self.result()
