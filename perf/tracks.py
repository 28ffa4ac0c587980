#!/usr/bin/env python3
"""Tracks of emitters whose places are known to 0.05 pixels and 0.15 depths: how often one is in another track than before.
  perf/tracks.py [--counts 50,150,400] [--seeds 10] [--frames 20]
A window of 96 x 96 pixels and 24 depths. Emitters move straight, to and fro, not at all, or a third each (mix), and go out
now and then; one in a hundred is missed, and as many are false. `nearest` joins pairs in the order of their distance.
Means over seeds. Needs NumPy and the Python package."""
import argparse

import hadalens
import numpy as np

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--counts", default="50,150,400")
parser.add_argument("--seeds", type=int, default=10)
parser.add_argument("--frames", type=int, default=20)
o = parser.parse_args()
WINDOW, DEPTHS, PIXELS, ALONG, GAP = 96, 24, 2.0, 2.5, 3
NAMES = "x y z distance_mm amplitude sd_x sd_y sd_z sd_amplitude residual".split()


def film_of(kind, count, rng):
    """For each frame places of the emitters and which one each is, -1: none."""
    low, high = np.array([2, 2, 0.5]), np.array([WINDOW - 3.0, WINDOW - 3.0, DEPTHS - 1.5])
    at, speed = rng.uniform(low, high, (count, 3)), rng.standard_normal((count, 3))
    speed *= rng.uniform(0.3, 1.5, (count, 1)) / np.linalg.norm(speed, axis=1, keepdims=True)
    how = np.arange(count) % 3 if kind == "mix" else np.full(count, ("straight", "to and fro", "still").index(kind))
    out = np.zeros(count, int)
    for _ in range(o.frames):
        out = np.where(out > 0, out - 1, np.where(rng.uniform(size=count) < 0.03, rng.integers(1, 4, count), 0))
        shown = rng.permutation(np.flatnonzero((out == 0) & (rng.uniform(size=count) > 0.01)))
        false = rng.uniform([0, 0, 0], [WINDOW, WINDOW, DEPTHS - 1], (rng.poisson(0.01 * count), 3))
        places = at[shown] + rng.standard_normal((len(shown), 3)) * [0.05, 0.05, 0.15]
        yield np.vstack([places, false]), np.concatenate([shown, np.full(len(false), -1)])
        at = at + (how == 0)[:, None] * speed + (how == 1)[:, None] * 0.4 * rng.standard_normal((count, 3))
        turn = (at < low) | (at > high)
        at, speed = np.clip(at, low, high), np.where(turn, -speed, speed)


def ours(places):
    frames = []
    for here in places:
        table = np.zeros(len(here), [(name, "f8") for name in NAMES])
        table["x"], table["y"], table["z"] = here.T
        table["amplitude"] = np.arange(len(here))  # which line it is
        table["sd_x"] = table["sd_y"] = 0.05
        table["sd_z"] = 0.15
        frames.append(table)
    tracks = [np.zeros(len(here), int) for here in places]
    for row in hadalens.track_emitters(frames, pixels=PIXELS, depths=ALONG, gap=GAP):
        tracks[row["frame"]][int(row["amplitude"])] = row["track"]
    return tracks


def nearest(places):
    live, count, tracks = [], 0, []
    for frame, here in enumerate(places):
        live = [one for one in live if frame - one[1] <= GAP + 1]
        ids, used = np.full(len(here), -1), set()
        pairs = []
        for k, (at, last, _) in enumerate(live):
            lateral, axial = np.hypot(*(here - at)[:, :2].T), abs(here[:, 2] - at[2])
            good = np.flatnonzero((lateral <= PIXELS * (frame - last)) & (axial <= ALONG * (frame - last)))
            pairs += [(lateral[i], k, i) for i in good]
        for _, k, i in sorted(pairs):
            if k not in used and ids[i] < 0:
                used.add(k)
                ids[i] = live[k][2]
                live[k] = (here[i], frame, live[k][2])
        for i in np.flatnonzero(ids < 0):
            ids[i] = count
            live.append((here[i], frame, count))
            count += 1
        tracks.append(ids)
    return tracks


def switches(tracks, truth):
    last, found = {}, 0
    for here, ids in zip(tracks, truth):
        for track, one in zip(here, ids):
            found += one >= 0 and last.get(one, track) != track
            last[one] = track
    return found


print("| motion | emitters | places in a film | switches | nearest: switches |\n|---|---|---|---|---|")
for kind in ("straight", "to and fro", "still", "mix"):
    for count in map(int, o.counts.split(",")):
        rows = []
        for seed in range(11, 11 + o.seeds):
            places, truth = zip(*film_of(kind, count, np.random.default_rng(seed)))
            rows.append((sum((ids >= 0).sum() for ids in truth), switches(ours(places), truth),
                         switches(nearest(places), truth)))
        print(f"| {kind} | {count} | " + " | ".join(f"{v:.1f}" for v in np.mean(rows, 0)) + " |", flush=True)
