#!/usr/bin/env python3
"""The Hadamard stage (one forward transform per channel, then every depth filtered and inverted in its window) against
the paper's authors' arithmetic in SciPy (peers/hadamard_scipy.py), in turns; also in a band of the frequencies. Prints a
Markdown table: medians over the rounds in milliseconds a plane, and the median of the ratios round by round.
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

# name, rows, cols, window, depths, depths that SciPy computes a round, bands: 0.668 is what survives resizing the
# window of 383 x 383 to the 256 x 256 of the paper's enhancement net
workloads = [("paper2022", 1376, 2064, 383, 14, 3, (1, 0.668)), ("sim512", 512, 512, 192, 14, 14, (1, 0.668))]


def ours(op, shape):
    line = subprocess.run([f"{arguments.build}/tests/check/check", "--mode", "time", "--csv", "--op", op, "--shape", shape],
                          check=True, capture_output=True, text=True).stdout.splitlines()[-1]
    return float(line.split(",")[2])


def peer(rows, cols, depths):
    line = subprocess.run([sys.executable, here / "peers" / "hadamard_scipy.py", str(rows), str(cols), str(depths)],
                          check=True, capture_output=True, text=True).stdout
    return json.loads(line)


print("| workload | band | Hadalens ms a plane | SciPy, authors' arithmetic | ratio | SciPy, half spectra, one forward | ratio |")
print("|---|---|---|---|---|---|---|")
for name, rows, cols, window, depths, few, bands in workloads:
    planes, tables = 3 * depths, {band: [] for band in bands}
    top, left = (rows - window) // 2, (cols - window) // 2
    for _ in range(arguments.rounds):
        scipy = peer(rows, cols, few)
        for band in bands:
            forward = ours("fft_forward", f"r{rows}c{cols}b3")
            limit = "" if band == 1 else f"m{int(band * (rows // 2))}n{int(band * (cols // 2))}"
            inverse = ours("fft_inverse", f"r{rows}c{cols}b{planes}p1s3y{top}x{left}h{window}w{window}{limit}")
            tables[band].append(((forward + inverse) / planes, scipy["full_ms"], scipy["half_ms"]))
    for band in bands:
        table = np.array(tables[band])
        mine, full, half = np.median(table, axis=0)
        print(f"| {name} | {band} | {mine:.2f} | {full:.1f} | {np.median(table[:, 1] / table[:, 0]):.1f} | {half:.2f} | "
              f"{np.median(table[:, 2] / table[:, 0]):.1f} |")
