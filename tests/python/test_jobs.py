"""Frames in flight: order, waiting, cancelling, asyncio, threads, and Python beside C."""

from __future__ import annotations

import asyncio
import copy as copying
import ctypes
import gc
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest

Array = npt.NDArray[Any]


@pytest.fixture(scope="module")
def slow(model: hadalens.Model) -> hadalens.Plan:
    """Return a plan whose frames take minutes."""
    return hadalens.Plan(model, classic=hadalens.Classic("admm", iterations=10**7))


def test_submit_gives_what_run_gives(plan: hadalens.Plan, raw: Array) -> None:
    """A job is a run that does not wait."""
    job = plan.submit(raw)
    result = job.result()
    assert job.done()
    assert job.state == "done"
    assert job.progress == 1.0
    assert job.result() is result
    np.testing.assert_array_equal(result.stack, plan.run(raw).stack)


def test_map_keeps_order(model: hadalens.Model, raw: Array) -> None:
    """Results come in the order of the frames, also from two queues, and no more frames are taken than needed."""
    plan = hadalens.Plan(model, refine=0, queues=2)
    taken = 0

    def frames() -> Iterator[Array]:
        nonlocal taken
        for factor in range(1, 13):
            taken += 1
            yield raw * np.float32(factor)

    sums, ahead = [], 0
    for count, result in enumerate(plan.map(frames()), 1):
        ahead = max(ahead, taken - count)
        sums.append(float(result.all_in_focus.sum()))
    assert sums == sorted(sums)
    assert len(sums) == 12
    assert ahead <= 4


def test_map_can_be_left(plan: hadalens.Plan, raw: Array) -> None:
    """Breaking off cancels what is in flight; the plan goes on."""
    for _ in plan.map([raw] * 10):
        break
    assert plan.run(raw).report.method == "model"


def second() -> float:
    """Return a second of all cores.

    What has to end soon is held to the processor's time of this process: by the clock, others may be at work meanwhile.
    """
    return float(os.cpu_count() or 1)


def test_cancel(slow: hadalens.Plan, raw: Array) -> None:
    """A cancelled job ends within a second, and says so."""
    job = slow.submit(raw)
    assert not job.wait(0.2)
    with pytest.raises(TimeoutError):
        job.result(timeout=0.1)
    start = time.process_time()
    job.cancel()
    with pytest.raises(hadalens.CancelledError):
        job.result()
    assert time.process_time() - start < second()
    assert job.state == "cancelled"


def test_cancel_what_nothing_waits_for(model: hadalens.Model, raw: Array) -> None:
    """Refinement looks at nothing on its way, and is not far ahead of the device all the same."""
    job = hadalens.Plan(model, refine=10**6, scene="planes").submit(raw)
    assert not job.wait(1.0)
    start = time.process_time()
    job.cancel()
    with pytest.raises(hadalens.CancelledError):
        job.result()
    assert time.process_time() - start < second()


def test_closing_the_plan_leaves_its_jobs(model: hadalens.Model, raw: Array) -> None:
    """A job keeps its plan's memory until it has ended."""
    plan = hadalens.Plan(model)
    job = plan.submit(raw)
    plan.close()
    assert job.result().stack.shape == (4, 3, 48, 48)
    with pytest.raises(hadalens.StateError, match="closed"):
        plan.run(raw)


def test_await(plan: hadalens.Plan, slow: hadalens.Plan, raw: Array) -> None:
    """Jobs are awaitable, and the loop goes on meanwhile."""

    async def main() -> tuple[hadalens.Result, hadalens.Result]:
        waiting = asyncio.ensure_future(slow.submit(raw)._wait_in_loop())
        first, second = await asyncio.gather(plan.submit(raw), plan.submit(raw / 2))
        for _ in range(5):
            await asyncio.sleep(0.001)
        assert not waiting.done()
        waiting.cancel()
        return first, second

    first, second = asyncio.run(main())
    np.testing.assert_array_equal(first.stack, plan.run(raw).stack)
    np.testing.assert_array_equal(second.stack, plan.run(raw / 2).stack)


def test_cancelling_the_task_cancels_the_job(slow: hadalens.Plan, raw: Array) -> None:
    """Asyncio's way of stopping works."""

    async def main() -> hadalens.Job:
        job = slow.submit(raw)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(job, 0.2)
        return job

    job = asyncio.run(main())
    start = time.process_time()
    with pytest.raises(hadalens.CancelledError):
        job.result()
    assert time.process_time() - start < second()
    assert job.state == "cancelled"


def test_threads_may_share_a_plan(plan: hadalens.Plan, raw: Array) -> None:
    """Frames from several threads give what one gives."""
    expected = [plan.run(raw * np.float32(i)).stack for i in range(1, 5)]
    got: dict[int, Array] = {}

    def work(index: int) -> None:
        got[index] = plan.run(raw * np.float32(index + 1)).stack

    threads = [threading.Thread(target=work, args=(index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for index in range(4):
        np.testing.assert_array_equal(got[index], expected[index])


CTRL_C = """
import signal, sys, time, numpy, hadalens
model = hadalens.Model.load(sys.argv[1])
what = sys.argv[2]
if what == "run":
    plan = hadalens.Plan(model, classic=hadalens.Classic("admm", iterations=10**7))
    def work(): plan.run(numpy.ones((3, 96, 128), numpy.float32))
elif what == "fit":
    def work():
        while True: hadalens.fit(sys.argv[3])
elif what == "pace":
    frames = [sys.argv[3] + f"/test/raw/test0{i}.tif" for i in (1, 2)]
    def work(): hadalens.find_pace(model, frames, 1, refine=10**6, scene="planes")
elif what == "train":
    net = hadalens.Net.unet("4|4", "4")
    def work(): hadalens.train(sys.argv[3], sys.argv[4], model=model, net=net, batch=1, steps=10**6, restart=True)
try:
    print("ready", flush=True)
    work()
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


def used(process: int) -> float:
    """Return the seconds of the processor that a process has used."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("what", ["run", "fit", "pace", "train"])
def test_ctrl_c(what: str, model_file: Path, camera: Path, tmp_path: Path) -> None:
    """Ctrl-C is heard, and the process ends within seconds of its own accord."""
    code = [sys.executable, "-c", CTRL_C, str(model_file), what, str(camera), str(tmp_path / "out.model")]
    with subprocess.Popen(code, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(1.0)
        start = used(process.pid)
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
        assert os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT) is not None
        assert used(process.pid) - start < 2 * second()  # with the end of Python
        assert process.wait() == 0


DAEMON = """
import sys, threading, time, numpy, hadalens
model = hadalens.Model.load(sys.argv[1])
net = hadalens.Net.unet("4|4", "4")
plan = hadalens.Plan(model)
trainer = hadalens.Trainer(model, sys.argv[3], net=net, batch=1, steps=10**6)
def run(): plan.run(numpy.random.rand(3, 96, 128))
def fit(): hadalens.fit(sys.argv[3])
def step(): trainer.step()
def train(): hadalens.train(sys.argv[3], sys.argv[4], model=model, net=net, batch=1, steps=10**6, restart=True)
def work():
    while True: globals()[sys.argv[2]]()
threading.Thread(target=work, daemon=True).start()
time.sleep(0.5)
"""


@pytest.mark.parametrize("what", ["run", "fit", "step", "train"])
def test_python_may_end_beside_a_daemon_thread(what: str, model_file: Path, camera: Path, tmp_path: Path) -> None:
    """What a daemon thread has begun is stopped, and its memory is not taken away below it: no crash, no complaint."""
    code = [sys.executable, "-c", DAEMON, str(model_file), what, str(camera), str(tmp_path / "out.model")]
    done = subprocess.run(code, text=True, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("what", ["finish", "learn", "register"])
def test_ctrl_c_ends_what_asks_nothing_else(what: str, camera: Path) -> None:
    """C is stopped where it takes long and calls nothing of Python's: the ends of fits, passes, registration."""
    data = hadalens.Dataset.scan(camera)
    pairs = [data.read(0, pair) for pair in range(3)]
    fitter = hadalens.Fitter([100.0], (96, 128), window=(48, 48), channels=3, boundary="padded")
    for raw, scene in pairs:
        fitter.add(0, raw, scene)
        fitter.score(0, raw, scene)
    work: dict[str, Callable[[], Any]] = {
        "finish": fitter.finish,
        "learn": lambda: fitter.finish(lambda _, pair: pairs[pair]),
        "register": lambda: hadalens.register(*zip(*pairs, strict=True)),
    }

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    def again() -> None:
        while True:
            work[what]()

    def stopped() -> BaseException | None:
        """Return what the interrupt came from: nothing where Python was at work between two calls.

        It comes again where it is lost, as Python ignores what a finaliser raises.
        """
        signal.setitimer(signal.ITIMER_REAL, 0.5, 0.5)
        with pytest.raises(KeyboardInterrupt) as caught:
            again()
        signal.setitimer(signal.ITIMER_REAL, 0)
        return caught.value.__cause__

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        cause = next((cause for cause in (stopped() for _ in range(60)) if cause), None)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert isinstance(cause, hadalens.CancelledError)
    assert fitter.finish().info.depths == 1  # it goes on


def shares_of_a_thread(work: Any) -> tuple[float, float]:
    """Return the shares of the time in which another Python thread, which only counts, ran, and waited for a core.

    The kernel counts both; what is missing is waiting for the GIL.
    """
    begun, ended, shares = threading.Event(), threading.Event(), [0.0, 0.0]

    def seconds() -> Array:
        words = Path(f"/proc/self/task/{threading.get_native_id()}/schedstat").read_text().split()
        return np.array([*map(int, words[:2]), 0]) / 1e9 + [0, 0, time.monotonic()]

    def count() -> None:
        start = seconds()
        begun.set()
        while not ended.is_set():
            pass
        ran, waited, took = seconds() - start
        shares[:] = [ran / took, waited / took]

    thread = threading.Thread(target=count)
    thread.start()
    begun.wait()
    work()
    ended.set()
    thread.join()
    return shares[0], shares[1]


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="the kernel does not count waiting")
def test_python_goes_on_while_c_works(slow: hadalens.Plan, raw: Array) -> None:
    """Another Python thread keeps 80 % of its rate while a frame is run; beside one that keeps the GIL it does not."""

    def compute() -> None:
        job = slow.submit(raw)
        job.wait(1.5)
        job.cancel()

    def hold() -> None:
        ctypes.PyDLL(None).usleep(1_000_000)

    assert sum(shares_of_a_thread(compute)) >= 0.8
    ran, waited = shares_of_a_thread(hold)
    assert ran < 0.1
    if waited < 0.5:  # else whoever looks for the GIL waits for a core more than for anything else
        assert ran + waited < 0.8


def resident() -> int:
    """Return the bytes that the process holds."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def test_memory_does_not_grow(model: hadalens.Model, raw: Array) -> None:
    """A thousand frames leave nothing behind, on the host and on the device."""
    context = hadalens.Context()
    plan = hadalens.Plan(model, context=context, refine=0, occupied="all")
    frames = [raw, raw / 2]
    for index in range(200):
        plan.run(frames[index % 2])
    gc.collect()
    host, device = resident(), context.bytes
    for index in range(1000):
        plan.run(frames[index % 2])
    gc.collect()
    assert context.bytes == device
    assert resident() - host < 4 << 20


def test_objects_give_their_memory_back(model: hadalens.Model, raw: Array) -> None:
    """Plans that are dropped or closed free the device; what is closed twice is fine."""
    context = hadalens.Context()
    before = context.bytes
    with hadalens.Plan(model, context=context) as plan:
        plan.run(raw)
        assert context.bytes > before
    plan.close()
    gc.collect()
    assert context.bytes == before
    plan = hadalens.Plan(model, context=context)
    context.close()  # the plan keeps what it needs
    assert plan.run(raw).stack.size
    with pytest.raises(hadalens.StateError):
        _ = context.device


def test_pickling(model: hadalens.Model, plan: hadalens.Plan, raw: Array) -> None:
    """Models cross borders of processes with the same bits; plans and contexts say what to do instead."""
    learned = hadalens.fit({100.0: [(raw, raw[:, 24:72, 40:88])] * 2}, leave_one_out=False)
    copy = pickle.loads(pickle.dumps(model))
    assert copy.info == copying.deepcopy(model).info == model.info  # with its name
    assert pickle.loads(pickle.dumps(copying.copy(learned))).fit_report == learned.fit_report is not None
    np.testing.assert_array_equal(copy.filters, model.filters)
    np.testing.assert_array_equal(hadalens.Plan(copy).run(raw).stack, plan.run(raw).stack)
    for thing in (plan, hadalens.Context.default()):
        with pytest.raises(TypeError, match="process"):
            pickle.dumps(thing)
    error = pickle.loads(pickle.dumps(hadalens.FileOpenError("gone", code=3, detail="more")))
    assert (str(error), error.code, error.detail) == ("gone", 3, "more")


def test_a_child_of_fork_is_told(model: hadalens.Model, plan: hadalens.Plan, raw: Array) -> None:
    """What works on a device would wait for ever in a child: it is refused. Models can be used."""
    job, context = plan.submit(raw), hadalens.Context.default()
    work: list[Callable[[], Any]] = [
        lambda: plan.run(raw),
        job.result,
        lambda: hadalens.Plan(model),
        lambda: context.device,
        hadalens.Context,
        hadalens.devices,
    ]
    child = os.fork()
    if not child:
        told = 0
        for one in work:
            try:
                one()
            except hadalens.StateError as error:
                told += f"process {os.getppid()}" in str(error) and "spawn" in str(error)
        os._exit(told if model.info.depths == 4 and model.filters.size else 99)
    until = time.monotonic() + 20
    while not (ended := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < until:
        time.sleep(0.01)
    if not ended[0]:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert ended[0], "the child hangs"
    assert os.waitstatus_to_exitcode(ended[1]) == len(work)
    assert job.result().stack.size
    assert hadalens.Context.default() is context
