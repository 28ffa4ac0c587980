#!/usr/bin/env python3
"""ADMM with total variation and FISTA here against the same in LenslessPiCam and in PyTorch: time per iteration, taking
turns in one run, and how far the results differ after the same iterations from the same start.
  perf/rivals.py [--bin FOLDER] [--size 270x480] [--rounds 5] [--iterations 20] [--threads 2] [--wide]
The camera is a random lens array, whose spots lie within 0.6 of the sensor's sides (--wide: a point spread function that
fills the sensor); the sensor crops the frame; colours are three. Needs PyTorch and tifffile; the package `lensless` where
it is installed."""
import argparse
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import tifffile
import torch

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "peers"))
import lensless_torch  # noqa: E402

MU = (1.0, 0.01, 0.001)  # of the splits of data, gradient and planes; the last two times the largest |OTF(0)|^2
TV = 1e-3


def camera(rows, cols, wide=False, seed=1):
    """PSF of unit brightness, frame, both (3, rows, cols). wide: the PSF fills the sensor."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :cols]
    psf = np.zeros((rows, cols))
    for _ in range(40):
        r, c = rows * (0.2 + 0.6 * random.random()), cols * (0.2 + 0.6 * random.random())
        psf += np.exp(-((y - r) ** 2 + (x - c) ** 2) / 2.0)
    if wide:
        psf = random.random((rows, cols)) ** 8
    psf = np.repeat((psf / psf.sum())[None], 3, 0)
    scene = np.zeros((3, rows, cols))
    for _ in range(30):
        r, c, size = random.integers(0, rows), random.integers(0, cols), random.integers(rows // 30, rows // 5)
        scene[:, r:r + size, c:c + size] = random.random((3, 1, 1))
    grid = (2 * rows, 2 * cols)
    frame = np.fft.irfft2(np.fft.rfft2(scene, s=grid) * np.fft.rfft2(psf, s=grid), s=grid)
    frame = frame[:, rows // 2:rows // 2 + rows, cols // 2:cols // 2 + cols]
    frame += 0.01 * frame.max() * random.standard_normal(frame.shape)
    return psf.astype(np.float32), np.maximum(frame, 0).astype(np.float32)


class Ours:
    """The command line; time per iteration from two runs of different length, without start and end."""

    def __init__(self, program, folder, name, psf, frame, threads):
        self.program, self.folder, self.name = program, folder, name
        self.environment = dict(os.environ, POCL_MAX_PTHREAD_COUNT=str(threads))
        last = lambda image: np.ascontiguousarray(np.moveaxis(image, 0, -1))
        tifffile.imwrite(f"{folder}/psf.tif", last(psf)[None], photometric="rgb")
        tifffile.imwrite(f"{folder}/frame.tif", last(frame), photometric="rgb")
        self.call("fit", "--psf", f"{folder}/psf.tif", "--distances", "100", "--psf-dark", "0", "--dark", "none", "-o",
                  f"{folder}/model")

    def call(self, *words):
        done = subprocess.run([self.program, *words], capture_output=True, text=True, env=self.environment)
        if done.returncode:
            sys.exit(done.stderr)
        return done.stdout

    def run(self, iterations):
        words = ["--mu", ",".join(map(str, MU)), "--tv", str(TV)] if self.name == "admm" else []
        text = self.call("reconstruct", f"{self.folder}/frame.tif", "-m", f"{self.folder}/model", "-o",
                         f"{self.folder}/out", "--method", self.name, "--iterations", str(iterations), "--no-preview",
                         "--json", *words)
        self.seconds = find(json.loads(text), "refine")
        return np.squeeze(tifffile.imread(f"{self.folder}/out/frame_stack.tif"))


def find(tree, key):
    """The first value of a key, at any depth."""
    below = tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ()
    if isinstance(tree, dict) and key in tree:
        return tree[key]
    return next((value for value in (find(part, key) for part in below) if value is not None), None)


def cpu_of_children():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def timed(peer, iterations):
    """Seconds an iteration: on the clock, and of both cores together."""
    if isinstance(peer, Ours):
        marks = []
        for count in (iterations, 9 * iterations):
            before = cpu_of_children()
            peer.run(count)
            marks.append((peer.seconds, cpu_of_children() - before))
        return tuple((b - a) / (8 * iterations) for a, b in zip(*marks))
    start, cpu = time.perf_counter(), time.process_time()
    peer.run(iterations)
    return (time.perf_counter() - start) / iterations, (time.process_time() - cpu) / iterations


def difference(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--bin", default=os.path.join(HERE, "../build/release/bindings/cli"))
    parser.add_argument("--size", default="270x480")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--iterations", type=int, default=20)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--wide", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    rows, cols = map(int, args.size.split("x"))
    psf, frame = camera(rows, cols, args.wide)
    otf0 = psf.sum((1, 2)).max()
    gain, brightness = otf0 ** 2, math.sqrt(np.mean(np.square(frame, dtype=np.float64)))
    # in the units of LenslessPiCam
    mu = {"mu1": MU[0], "mu2": MU[1] * MU[0] * gain, "mu3": MU[2] * MU[0] * gain, "tau": TV * otf0 * brightness}
    print("| method | grid | peer | peer, ms | here, ms | ratio (lowest to highest) | ratio of CPU time | results differ by |")
    print("|---|---|---|---|---|---|---|---|")
    for name in "admm", "fista":
        settings = mu if name == "admm" else {}
        with tempfile.TemporaryDirectory() as folder, torch.inference_mode():
            ours = Ours(os.path.join(args.bin, "hadalens"), folder, name, psf, frame, args.threads)
            grid = find(json.loads(ours.call("reconstruct", f"{folder}/frame.tif", "-m", f"{folder}/model", "-o",
                                             f"{folder}/out", "--no-preview", "--json")), "grid")
            grid = tuple(grid) if grid else good_grid(rows, cols)
            peers = {"PyTorch, written anew": lensless_torch.Lean(name, psf, frame, grid, **settings)}
            if lensless_torch.package(name):
                peers["LenslessPiCam"] = lensless_torch.Package(name, psf, frame, **settings)
            result = ours.run(args.iterations)
            for label, peer in peers.items():
                error = difference(result, peer.run(args.iterations))
                times = [(timed(peer, args.iterations), timed(ours, args.iterations)) for _ in range(args.rounds)]
                ratios = [a[0] / b[0] for a, b in times]
                theirs, here = (statistics.median(t[k][0] for t in times) for k in (0, 1))
                work = statistics.median(a[1] / b[1] for a, b in times)
                print(f"| {name} | {grid[0]}x{grid[1]}x3 | {label} | {1e3 * theirs:.1f} | {1e3 * here:.1f} | "
                      f"{statistics.median(ratios):.1f} ({min(ratios):.1f} to {max(ratios):.1f}) | {work:.1f} | "
                      f"{error:.1e} |",
                      flush=True)


def good_grid(rows, cols):
    """Grids of LenslessPiCam: the next length with no factor above 5."""
    from scipy.fft import next_fast_len
    return tuple(next_fast_len(2 * n - 1, real=True) for n in (rows, cols))


if __name__ == "__main__":
    main()
