#!/usr/bin/env python3
"""The Hadamard stage (one forward transform per channel, then every depth filtered and inverted in its window) against
the paper's authors' arithmetic in SciPy (peers/hadamard_scipy.py), in turns. Prints a Markdown table: medians over the
rounds in milliseconds a plane, and the median of the ratios round by round.
   perf/hadamard.py [--build build/release] [--rounds 5]"""
import argparse
import json
import pathlib
import subprocess
import sys

import numpy as np

here = pathlib.Path(__file__).resolve().parent
arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--build", default=str(here.parent / "build" / "release"))
arguments.add_argument("--rounds", type=int, default=5)
arguments = arguments.parse_args()

# name, rows, cols, window, depths, depths that SciPy computes a round
workloads = [("paper2022", 1376, 2064, 383, 14, 3), ("sim512", 512, 512, 192, 14, 14)]


def ours(op, shape):
    line = subprocess.run([f"{arguments.build}/tests/check/check", "--mode", "time", "--csv", "--op", op, "--shape", shape],
                          check=True, capture_output=True, text=True).stdout.splitlines()[-1]
    return float(line.split(",")[2])


print("| workload | Hadalens ms a plane | SciPy, authors' arithmetic | ratio | SciPy, half spectra, one forward | ratio |")
print("|---|---|---|---|---|---|")
for name, rows, cols, window, depths, few in workloads:
    planes, table = 3 * depths, []
    top, left = (rows - window) // 2, (cols - window) // 2
    for _ in range(arguments.rounds):
        forward = ours("fft_forward", f"r{rows}c{cols}b3")
        inverse = ours("fft_inverse", f"r{rows}c{cols}b{planes}p1s3y{top}x{left}h{window}w{window}")
        peer = json.loads(subprocess.run([sys.executable, here / "peers" / "hadamard_scipy.py", str(rows), str(cols), str(few)],
                                         check=True, capture_output=True, text=True).stdout)
        table.append(((forward + inverse) / planes, peer["full_ms"], peer["half_ms"]))
    table = np.array(table)
    mine, full, half = np.median(table, axis=0)
    print(f"| {name} | {mine:.2f} | {full:.1f} | {np.median(table[:, 1] / table[:, 0]):.1f} | {half:.2f} | "
          f"{np.median(table[:, 2] / table[:, 0]):.1f} |")
