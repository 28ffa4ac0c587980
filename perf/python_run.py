#!/usr/bin/env python3
"""What a frame costs in Python beyond C: Plan.run against hada_plan_run on the same plan, in turns.

python_run.py [ROUNDS]: in the environment of tests/python/environment.sh; prints the least and medians in milliseconds.
"""

import statistics
import subprocess
import sys
import time

import numpy as np

import hadalens
from hadalens._arrays import Pixels
from hadalens._native import call, ffi, lib


def through_c(plan: hadalens.Plan, raw: np.ndarray):
    """Return a function that runs a frame as a C program would: one call, arrays of C's used again."""
    pixels, result = Pixels(raw, None, None), ffi.new("hada_result *")
    return lambda: call(lib.hada_plan_run_pixels, plan._c, pixels.c, result)


def in_turns(ways: dict, rounds: int) -> dict:
    """Return the wall times and processor times of each way, in milliseconds."""
    times = {name: ([], []) for name in ways}
    for _ in range(rounds):
        for name, work in ways.items():
            wall, cpu = time.perf_counter(), time.thread_time()
            work()
            times[name][0].append(1e3 * (time.perf_counter() - wall))
            times[name][1].append(1e3 * (time.thread_time() - cpu))
    return times


def main(rounds: int) -> None:
    """Measure a small camera, of which the frame itself takes little."""
    psf = np.zeros((1, 1, 64, 64), np.float32)
    psf[..., 32, 32] = 1
    model = hadalens.Model.from_psf(psf, [100.0], refine_steps=0, psf_dark=0.0)
    plan = hadalens.Plan(model, refine=0, skip=())
    raw = np.random.default_rng(1).random((64, 64), np.float32)
    out = plan.run(raw)
    ways = {"C": through_c(plan, raw), "run": lambda: plan.run(raw), "run(out=)": lambda: plan.run(raw, out=out)}
    for work in ways.values():
        work()
    times = in_turns(ways, rounds)
    for name, (wall, cpu) in times.items():
        over = statistics.median(a - b for a, b in zip(wall, times["C"][0]))
        least = min(wall) - min(times["C"][0])
        print(f"{name:10} {min(wall):8.3f} ms wall at least, {least:+.3f} over C; median {statistics.median(wall):.3f}, "
              f"{over:+.3f}; caller's processor time {statistics.median(cpu):.3f}")  # fmt: skip
    code = "import numpy, time; t = time.process_time(); import hadalens; print(time.process_time() - t)"
    starts = [float(subprocess.check_output([sys.executable, "-c", code])) for _ in range(25)]
    print(f"import hadalens after numpy: {1e3 * min(starts):.0f} ms of the processor's time at least, median "
          f"{1e3 * statistics.median(starts):.0f}")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
