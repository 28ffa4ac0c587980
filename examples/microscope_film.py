#!/usr/bin/env python3
"""What a miniature microscope with 24 small lenses would record: the stack of a bead, and a film.

    python3 microscope_film.py FOLDER

FOLDER/psf.npy: the bead at 20 depths, 2.00 to 2.95 mm from the lenses. FOLDER/film.npy: 24 frames of 30 cells that
flash up and fade, and of 6 beads that swim. FOLDER/truth.csv: where all of them are. Python alone is enough.
"""

from __future__ import annotations

import math
import random
import struct
import sys
from pathlib import Path

SIZE, DEPTHS, FRAMES = 128, 20, 24
NEAR, STEP, MASK = 2.0, 0.05, 1.0  # mm: the first depth, from one to the next, from the lenses to the sensor
CELLS, BEADS, NOISE = 30, 6, 0.02
Frame = list[list[float]]


def add_spot(frame: Frame, y: float, x: float, light: float) -> None:
    """Add a spot of the standard deviation 1.2 pixels."""
    for row in range(max(0, int(y) - 5), min(SIZE, int(y) + 7)):
        for col in range(max(0, int(x) - 5), min(SIZE, int(x) + 7)):
            frame[row][col] += light * math.exp(-((row - y) ** 2 + (col - x) ** 2) / 2.88)


def add_point(frame: Frame, lenses: list[tuple[float, float]], at: tuple[float, float, float], light: float) -> None:
    """Add a point at column, row and depth: a spot for each lens, farther from the middle the nearer the point is."""
    x, y, z = at
    scale = (1 + MASK / (NEAR + STEP * z)) / (1 + MASK / NEAR)
    for down, along in lenses:
        add_spot(frame, y + scale * down, x + scale * along, light)


def save(path: Path, frames: list[Frame], unit: float) -> None:
    """Write an array of three dimensions as NumPy does."""
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({len(frames)}, {SIZE}, {SIZE}), }}"
    header += " " * (63 - (len(header) + 10) % 64) + "\n"
    with path.open("wb") as file:
        file.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode())
        for frame in frames:
            for row in frame:
                file.write(struct.pack(f"<{SIZE}f", *(value / unit for value in row)))


def new() -> Frame:
    """Return a dark frame."""
    return [[0.0] * SIZE for _ in range(SIZE)]


def main() -> None:
    """Write the files."""
    folder, pick = Path(sys.argv[1]), random.Random(4)
    lenses = [(pick.uniform(-38, 38), pick.uniform(-38, 38)) for _ in range(24)]
    stack = [new() for _ in range(DEPTHS)]
    for depth, frame in enumerate(stack):
        add_point(frame, lenses, (SIZE / 2, SIZE / 2, depth), 1.0)
    save(folder / "psf.npy", stack, max(map(max, stack[0])))

    border = 20.0  # the window of 96 x 96 pixels, and 4 pixels less
    places = [
        (pick.uniform(border, SIZE - border), pick.uniform(border, SIZE - border), pick.uniform(1, DEPTHS - 2))
        for _ in range(CELLS + BEADS)
    ]
    speeds = [(0.0, 0.0, 0.0)] * CELLS + [(pick.uniform(-1, 1), pick.uniform(-1, 1), 0.1) for _ in range(BEADS)]
    rest = [pick.uniform(0.5, 1.0) for _ in places]
    flash = [0.0 for _ in places]
    film = []
    with (folder / "truth.csv").open("w") as truth:
        truth.write("track,frame,x,y,z,amplitude\n")
        for number in range(FRAMES):
            frame = new()
            for k, (start, speed) in enumerate(zip(places, speeds, strict=True)):
                flash[k] = 0.7 * flash[k] + float(k < CELLS and pick.random() < 0.06)
                x, y, z = (a + number * b for a, b in zip(start, speed, strict=True))
                if not (border - 4 < x < SIZE - border + 4 and border - 4 < y < SIZE - border + 4):
                    continue  # a bead has left
                light = rest[k] * (1 + 2 * flash[k])
                add_point(frame, lenses, (x, y, z), light)
                truth.write(f"{k},{number},{x - 16:.3f},{y - 16:.3f},{z:.3f},{light:.4f}\n")
            film.append(frame)
    unit = max(max(row) for frame in film for row in frame)
    for frame in film:
        for line in frame:
            for col in range(SIZE):
                line[col] += NOISE * unit * pick.gauss(0, 1)
    save(folder / "film.npy", film, unit)


if __name__ == "__main__":
    main()
