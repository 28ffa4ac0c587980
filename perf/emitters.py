#!/usr/bin/env python3
"""Emitters at random places between the pixels and depths of cameras that are known by a PSF stack: what `reconstruct
--emitters` finds, beside the maxima of Richardson-Lucy's volume at the threshold that suits them best.
  perf/emitters.py [--cameras lenses,focus,diffuser] [--depths 40,24] [--counts 100,300,800] [--noise 0.02] [--seeds 3,4]
                   [--size 160] [--window 160] [--frames 1] [--drift 0] [--recentre] [--keep FOLDER] [--build build/release]
                   [--tissue] [--photons 0] [--haze 0] [--ways WORDS/WORDS...]
lenses: 24 random lenses; focus: the same, whose spots widen away from the middle depth; diffuser: caustics. Emitters
have 0.5 to 1.5 of the mean light. An emitter is found within 2 pixels and 2.5 depths; means over seeds. --frames: films
of so many frames, whose emitters move straight, to and fro, or not at all, a third each, and go out now and then; what
their tracks are worth, beside those of the nearest emitters. --drift: the bead of the stack wanders by so many pixels
a depth (standard deviation of each step, rows and columns), which `fit --recentre` takes off; found places are
compared beside a shift and a slant of the whole volume, of which the stack says nothing. --tissue: --counts are numbers
of blurred vessels; PSNR of the volume for any factor of its brightness, of Richardson-Lucy's best number of iterations,
which nobody knows without the truth, and of what --ways says of `reconstruct`; times of one frame over that of 100
iterations. --photons: noise as of so many at the brightest value, beside --noise. --haze: a smooth background of
so much of the brightest value. Needs NumPy, SciPy and tifffile."""
import argparse
import csv
import json
import pathlib
import subprocess
import tempfile
import time

import numpy as np
import tifffile
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter, uniform_filter
from scipy.optimize import linear_sum_assignment
from scipy.signal import fftconvolve
from scipy.special import erf

here = pathlib.Path(__file__).resolve().parent
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=str(here.parent / "build" / "release"))
parser.add_argument("--cameras", default="lenses,focus,diffuser")
parser.add_argument("--depths", default="40,24")
parser.add_argument("--counts", default="100,300,800")
parser.add_argument("--seeds", default="3,4")
parser.add_argument("--noise", type=float, default=0.02)
parser.add_argument("--size", type=int, default=160)
parser.add_argument("--window", type=int, default=160)
parser.add_argument("--frames", type=int, default=1)
parser.add_argument("--drift", type=float, default=0)
parser.add_argument("--recentre", action="store_true")
parser.add_argument("--tissue", action="store_true")
parser.add_argument("--photons", type=float, default=0)
parser.add_argument("--haze", type=float, default=0)
parser.add_argument("--ways", default="/--scene volume/--occupied all --scene planes")
parser.add_argument("--keep", default="")
o = parser.parse_args()
hadalens = f"{o.build}/bindings/cli/hadalens"
NEAREST, FARTHEST, MASK = 2.0, 4.0, 1.0  # mm
PIXELS, DEPTHS = 2.0, 2.5                # an emitter is found within


def between(inside, ends):
    """Share of a Gaussian's light in pixels around `ends`."""
    return 0.5 * (erf((ends + 0.5) / inside) - erf((ends - 0.5) / inside))


class Lenses:
    def __init__(self, rng, defocus):
        self.at = rng.uniform(-0.31, 0.31, (24, 2)) * o.size
        self.light = rng.uniform(0.5, 1.0, 24)
        self.light /= self.light.sum()
        self.defocus = defocus

    def point(self, y, x, scale, part):
        """The frame of a point at (y, x); scale: of its shadow; part: from 0 for the nearest depth to 1."""
        sigma = np.sqrt(2) * (0.85 + self.defocus * abs(part - 0.5))
        axis = np.arange(o.size)
        frame = np.zeros((o.size, o.size))
        for (dy, dx), light in zip(self.at, self.light):
            frame += light * np.outer(between(sigma, axis - y - scale * dy), between(sigma, axis - x - scale * dx))
        return frame


class Diffuser:
    FINE = 4

    def __init__(self, rng):
        """Rays of a smooth random surface."""
        n = o.size * self.FINE
        surface = gaussian_filter(rng.standard_normal((n, n)), 7 * self.FINE, mode="wrap")
        down, along = np.gradient(surface)
        strength = 5.5 * self.FINE / np.sqrt((down ** 2).mean())
        y, x = np.indices((n, n))
        inside = np.hypot(y - n / 2, x - n / 2) < 0.3 * n
        pattern, _, _ = np.histogram2d((y + strength * down)[inside], (x + strength * along)[inside], n,
                                       [[0, n], [0, n]])
        self.pattern = gaussian_filter(pattern, 0.7 * self.FINE)
        self.pattern /= self.pattern.sum()

    def point(self, y, x, scale, _):
        n, fine = o.size * self.FINE, 3
        axis = (np.arange(o.size * fine) + 0.5) / fine - 0.5
        rows = (axis - y) / scale * self.FINE + n / 2
        cols = (axis - x) / scale * self.FINE + n / 2
        grid = np.meshgrid(rows, cols, indexing="ij")
        values = map_coordinates(self.pattern, grid, order=1) * (self.FINE / scale) ** 2 / fine ** 2
        return values.reshape(o.size, fine, o.size, fine).sum((1, 3))


def camera_of(kind, rng):
    return Diffuser(rng) if kind == "diffuser" else Lenses(rng, 1.6 if kind == "focus" else 0.0)


def optics_at(z, depths):
    """Distance in mm, the scale of shadows and the place in the range of a depth that is counted from 0."""
    part = z / (depths - 1)
    inverse = 1 / NEAREST + (1 / FARTHEST - 1 / NEAREST) * part
    return 1 / inverse, (1 + MASK * inverse) / (1 + MASK / NEAREST), part


def match(found, truth, wider=1.0):
    """Pairs within the gate, as many and as near as there are."""
    if not len(found) or not len(truth):
        return np.zeros((0, 2), int)
    off = found[:, None, :3] - truth[None, :, :3]
    pixels, depths = np.hypot(off[..., 0], off[..., 1]), abs(off[..., 2])
    cost = np.where((pixels <= wider * PIXELS) & (depths <= DEPTHS), (pixels / PIXELS) ** 2 + (depths / DEPTHS) ** 2, 1e3)
    pairs = np.array(linear_sum_assignment(cost)).T
    return pairs[cost[pairs[:, 0], pairs[:, 1]] < 1e3]


def score(found, truth):
    pairs = match(found, truth)
    a, b = found[pairs[:, 0]], truth[pairs[:, 1]]
    return {"f1": 2 * len(pairs) / (len(found) + len(truth)),
            "recall": len(pairs) / len(truth), "precision": len(pairs) / max(1, len(found)),
            "lateral": np.sqrt(((a[:, :2] - b[:, :2]) ** 2).sum(1).mean()) if len(pairs) else np.nan,
            "axial": np.sqrt(((a[:, 2] - b[:, 2]) ** 2).mean()) if len(pairs) else np.nan}, pairs


def align(found, truth, depths):
    """Takes a shift and a slant of the whole volume off, of which a stack alone says nothing."""
    for wider in (3.0, 2.0, 1.0):
        pairs = match(found, truth, wider)
        law = np.column_stack([np.ones(len(found)), 1 / optics_at(found[:, 2], depths)[0]])
        off = found[pairs[:, 0], :2] - truth[pairs[:, 1], :2]
        found[:, :2] -= law @ np.linalg.lstsq(law[pairs[:, 0]], off, rcond=None)[0]


def maxima(volume):
    """Maxima over 3 x 3 x 3 voxels with the light of their neighbourhood, at its centre."""
    light = uniform_filter(volume, 3, mode="constant") * 27
    z, y, x = np.nonzero((volume == maximum_filter(volume, 3)) & (volume > 1e-4 * volume.max()))
    out = []
    for place in zip(z, y, x):
        cut = tuple(slice(max(0, k - 1), k + 2) for k in place)
        centre = [(np.indices(volume[cut].shape)[a] * volume[cut]).sum() / volume[cut].sum() + cut[a].start
                  for a in range(3)]
        out.append((centre[2], centre[1], centre[0], light[place]))
    return np.array(out).reshape(-1, 4)


def best_maxima(volume, truth):
    """At the threshold with the best F1, which nobody knows without the truth."""
    all_of_them = maxima(volume)
    limits = np.quantile(all_of_them[:, 3], np.linspace(0, 0.995, 60))
    return max((score(all_of_them[all_of_them[:, 3] >= limit], truth)[0] for limit in limits), key=lambda s: s["f1"])


def run(*words):
    return subprocess.run([str(w) for w in words], check=True, capture_output=True, text=True).stdout


def table(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    names = ["x", "y", "z", "amplitude", "sd_x", "sd_y", "sd_z", "sd_amplitude"]
    return np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, len(names))


def fit_camera(folder, kind, depths, seed):
    """The camera and the light of its PSF; the model is m.model."""
    rng = np.random.default_rng(seed)
    camera = camera_of(kind, rng)
    axis = o.size // 2
    places = [optics_at(z, depths) for z in range(depths)]
    wander = o.drift * np.random.default_rng(seed + 50).standard_normal((depths, 2)).cumsum(0)
    psf = np.array([camera.point(axis + off[0], axis + off[1], scale, part) for (_, scale, part), off in zip(places, wander)])
    tifffile.imwrite(folder / "psf.tif", (psf / psf.max()).astype(np.float32))
    run(hadalens, "fit", "--psf", folder / "psf.tif", "--distances", ",".join(f"{p[0]:.9g}" for p in places), "--psf-dark",
        0, "--window", f"{o.window}x{o.window}", "-o", folder / "m.model", *(["--recentre"] if o.recentre else []))
    return camera, psf[0].sum()


def trial(folder, kind, depths, count, seed):
    camera, psf_light = fit_camera(folder, kind, depths, seed)
    rng = np.random.default_rng(1000 * seed + count)
    truth = np.column_stack([rng.uniform(1, o.window - 2, (count, 2)), rng.uniform(0, depths - 1, count),
                             rng.uniform(0.5, 1.5, count)])
    margin = (o.size - o.window) // 2
    frame = np.zeros((o.size, o.size))
    for x, y, z, light in truth:
        _, scale, part = optics_at(z, depths)
        frame += light * camera.point(margin + y, margin + x, scale, part)
    unit = frame.max()
    frame = frame / unit + o.noise * rng.standard_normal(frame.shape)
    truth[:, 3] *= psf_light / unit
    tifffile.imwrite(folder / "frame.tif", frame.astype(np.float32))
    with open(folder / "truth.csv", "w") as file:
        file.write("frame,x,y,z,amplitude\n" + "".join(f"0,{x},{y},{z},{a}\n" for x, y, z, a in truth))
    started = time.perf_counter()
    said = json.loads(run(hadalens, "reconstruct", folder / "frame.tif", "-m", folder / "m.model", "-o", folder / "out",
                          "--emitters", "--no-preview", "--json"))["files"][0]
    whole = time.perf_counter() - started
    volume = tifffile.imread(folder / "out" / "frame_stack.tif").reshape(depths, o.window, o.window)
    found = table(folder / "out" / "frame_emitters.csv")
    if o.drift:
        align(found, truth, depths)
    ours, pairs = score(found, truth)
    theirs = json.loads(run(hadalens, "evaluate", folder / "out" / "frame_emitters.csv", folder / "truth.csv",
                            "--json"))["files"][0]
    assert o.drift or abs(theirs["f1"] - ours["f1"]) < 1e-9 and abs(theirs["axial_rmse"] - ours["axial"]) < 1e-4
    rivals = best_maxima(volume, truth)
    off = (found[pairs[:, 0], :4] - truth[pairs[:, 1]]) / found[pairs[:, 0], 4:8]
    ours["of_sd"] = np.sqrt(np.median(off ** 2, 0) / 0.4549)  # the median of chi squared of one degree
    ours["volume_s"] = said["frames"][0]["seconds"]["total"]
    ours["all_s"] = said["seconds"]
    ours["whole"] = whole
    return ours, rivals


def film_of(rng, depths, count):
    """[frame][emitter]: x, y, z, light; NaN where it is out."""
    low, high = np.array([2.0, 2.0, 0.5]), np.array([o.window - 3.0, o.window - 3.0, depths - 1.5])
    at = rng.uniform(low, high, (count, 3))
    speed = rng.standard_normal((count, 3))
    speed *= rng.uniform(0.3, 1.5, (count, 1)) / np.linalg.norm(speed, axis=1, keepdims=True)  # pixels and depths a frame
    light, straight, to_and_fro = rng.uniform(0.5, 1.5, count), np.arange(count) % 3 == 0, np.arange(count) % 3 == 1
    film, out = [], np.zeros(count, int)
    for _ in range(o.frames):
        out = np.where(out > 0, out - 1, np.where(rng.uniform(size=count) < 0.03, rng.integers(1, 4, count), 0))
        film.append(np.column_stack([at, np.where(out > 0, np.nan, light * rng.uniform(0.8, 1.2, count))]))
        at = at + straight[:, None] * speed + to_and_fro[:, None] * 0.4 * rng.standard_normal((count, 3))
        turn = (at < low) | (at > high)
        at, speed = np.clip(at, low, high), np.where(turn, -speed, speed)
    return np.array(film)


def nearest_tracks(rows, pixels, depths, gap):
    """Tracks of a table of emitters: pairs of tracks and emitters by rising distance."""
    live, count, lines = [], 0, []
    for frame in range(o.frames):
        here = rows[rows[:, 0] == frame]
        live = [one for one in live if frame - one[1] <= gap + 1]
        pairs = sorted((np.hypot(*(row[1:3] - at[:2])), k, i) for k, (at, last, _) in enumerate(live)
                       for i, row in enumerate(here)
                       if np.hypot(*(row[1:3] - at[:2])) <= pixels * (frame - last)
                       and abs(row[3] - at[2]) <= depths * (frame - last))
        tracks, used = {}, set()
        for _, k, i in pairs:
            if k not in used and i not in tracks:
                used.add(k)
                tracks[i] = live[k][2]
                live[k] = (here[i, 1:4], frame, live[k][2])
        for i in range(len(here)):
            if i not in tracks:
                tracks[i] = count
                live.append((here[i, 1:4], frame, count))
                count += 1
            lines.append((tracks[i], *here[i, :4]))
    return lines


def film_trial(folder, kind, depths, count, seed):
    camera, psf_light = fit_camera(folder, kind, depths, seed)
    rng = np.random.default_rng(1000 * seed + count)
    film = film_of(rng, depths, count)
    margin = (o.size - o.window) // 2
    frames = np.zeros((o.frames, o.size, o.size))
    for frame, emitters in zip(frames, film):
        for x, y, z, light in emitters[~np.isnan(emitters[:, 3])]:
            _, scale, part = optics_at(z, depths)
            frame += light * camera.point(margin + y, margin + x, scale, part)
    unit = frames.max()
    frames = frames / unit + o.noise * rng.standard_normal(frames.shape)
    tifffile.imwrite(folder / "film.tif", frames.astype(np.float32), photometric="minisblack")
    with open(folder / "truth.csv", "w") as file:
        file.write("track,frame,x,y,z\n" + "".join(f"{k},{t},{x},{y},{z}\n" for t, rows in enumerate(film)
                                                   for k, (x, y, z, light) in enumerate(rows) if light == light))
    motion = ["--track-pixels", 2, "--track-depths", 2.5, "--track-gap", 3]
    started = time.perf_counter()
    run(hadalens, "reconstruct", folder / "film.tif", "-m", folder / "m.model", "-o", folder / "out", "--emitters",
        "--no-preview", *motion)
    seconds = (time.perf_counter() - started) / o.frames
    ours = json.loads(run(hadalens, "evaluate", folder / "out" / "film_tracks.csv", folder / "truth.csv",
                          "--json"))["files"][0]
    with open(folder / "out" / "film_tracks.csv", newline="") as file:
        rows = [[float(row[name]) for name in ("frame", "x", "y", "z", "amplitude", "track")]
                for row in csv.DictReader(file)]
    with open(folder / "nearest.csv", "w") as file:
        file.write("track,frame,x,y,z\n" + "".join(",".join(map(str, line)) + "\n"
                                                   for line in nearest_tracks(np.array(rows), 2, 2.5, 3)))
    theirs = json.loads(run(hadalens, "evaluate", folder / "nearest.csv", folder / "truth.csv", "--json"))["files"][0]
    errors, found = [], np.array(rows)
    for t, there in enumerate(film):
        here, there = found[found[:, 0] == t], there[~np.isnan(there[:, 3])]
        for i, k in match(here[:, 1:4], there[:, :3]):
            errors.append(here[i, 4] / (there[k, 3] * psf_light / unit) - 1)
    return {"f1": ours["f1"], "switches": ours["switches"], "tracks": ours["tracks"], "theirs": theirs["switches"],
            "their_tracks": theirs["tracks"], "light": 100 * np.sqrt(np.median(np.square(errors)) / 0.4549),
            "seconds": seconds}


def vessels(rng, depths, count):
    """Blurred random paths through the volume, [depth][row][col]."""
    size = np.array([depths, o.window, o.window])
    volume = np.zeros(size)
    for _ in range(count):
        one, at, way = np.zeros(size), rng.uniform(0, 1, 3) * size, rng.standard_normal(3)
        for _ in range(4 * o.window):
            way += 0.12 * rng.standard_normal(3)
            way /= np.linalg.norm(way)
            at += 0.5 * way * [depths / o.window, 1, 1]
            place = np.round(at).astype(int)
            if (place >= 0).all() and (place < size).all():
                one[tuple(place)] += 1
        volume += rng.uniform(0.5, 1.5) * gaussian_filter(one, [rng.uniform(0.5, 1.0), *[rng.uniform(1.0, 2.5)] * 2])
    return volume


def film_noise(frame, rng):
    """The frame, whose brightest value becomes 1, with haze and noise."""
    y, x = np.indices(frame.shape) / o.size - rng.uniform(0.3, 0.7, (2, 1, 1))
    frame = frame / frame.max() + o.haze * np.exp(-2 * (y * y + x * x))
    if o.photons:
        frame = rng.poisson(o.photons * np.maximum(frame, 0)) / o.photons
    return frame + o.noise * rng.standard_normal(frame.shape)


def psnr(volume, truth):
    scaled = volume * (volume * truth).sum() / max((volume * volume).sum(), 1e-300)
    return 10 * np.log10(truth.max() ** 2 / ((scaled - truth) ** 2).mean())


def tissue_trial(folder, kind, depths, count, seed):
    """PSNR and seconds: Richardson-Lucy's best and 100 iterations, then each way."""
    fit_camera(folder, kind, depths, seed)
    rng = np.random.default_rng(1000 * seed + count)
    psf, truth = tifffile.imread(folder / "psf.tif"), vessels(rng, depths, count)
    half = (o.size - o.window) // 2
    frame = np.zeros((o.size, o.size))
    for h, x in zip(psf, truth):
        frame += fftconvolve(np.pad(x, half), h)[o.size // 2:o.size // 2 + o.size, o.size // 2:o.size // 2 + o.size]
    tifffile.imwrite(folder / "frame.tif", film_noise(frame, rng).astype(np.float32))

    def way(words):
        said = json.loads(run(hadalens, "reconstruct", folder / "frame.tif", "-m", folder / "m.model", "-o", folder / "out",
                              "--no-preview", "--json", *words.split()))["files"][0]["frames"][0]
        volume = tifffile.imread(folder / "out" / "frame_stack.tif").reshape(truth.shape)
        return psnr(volume, truth), said["seconds"]["total"], said["residual"], said["scene"]

    lucy = [way(f"--method rl --iterations {n}") for n in (10, 20, 30, 45, 70, 100, 150, 220, 320)]
    return [max(lucy), lucy[5], *map(way, o.ways.split("/"))]


def trials(one):
    """The kind, depths and number of emitters of each row, and what a trial of each seed gives."""
    for kind in o.cameras.split(","):
        for depths in map(int, o.depths.split(",")):
            for count in map(int, o.counts.split(",")):
                rows = []
                for seed in map(int, o.seeds.split(",")):
                    with tempfile.TemporaryDirectory() as room:
                        folder = pathlib.Path(o.keep or room)
                        folder.mkdir(exist_ok=True)
                        rows.append(one(folder, kind, depths, count, seed))
                yield kind, depths, count, rows


if o.tissue:
    print("| camera | depths | vessels | Richardson-Lucy: best, 100 | " + " | ".join(f"`{w or 'default'}`" for w in o.ways.split("/")) + " |")
    print("|---" * (4 + o.ways.count("/") + 1) + "|")
    for kind, depths, count, rows in trials(tissue_trial):
        best, lucy, *ways = zip(*rows)
        mean = lambda way, k: np.mean([row[k] for row in way])  # noqa: E731
        cells = [f"{mean(way, 0):.2f} ({mean(way, 0) - mean(best, 0):+.2f}, least {min(w[0] - b[0] for w, b in zip(way, best)):+.2f}), "
                 f"{mean(way, 1) / mean(lucy, 1):.1f} times, left {mean(way, 2) / mean(lucy, 2):.2f}, "
                 f"{'/'.join(sorted({w[3] for w in way}))}" for way in ways]
        print(f"| {kind} | {depths} | {count} | {mean(best, 0):.2f}, {mean(lucy, 0):.2f} | " + " | ".join(cells) + " |", flush=True)
    raise SystemExit
if o.frames > 1:
    print("| camera | depths | emitters | frames | F1 | switches | tracks | nearest: switches | tracks | error of the "
          "light, % | seconds a frame |")
    print("|---" * 11 + "|")
    for kind, depths, count, rows in trials(film_trial):
        mean = {name: np.mean([row[name] for row in rows]) for name in rows[0]}
        print(f"| {kind} | {depths} | {count} | {o.frames} | {mean['f1']:.3f} | {mean['switches']:.1f} | "
              f"{mean['tracks']:.1f} | {mean['theirs']:.1f} | {mean['their_tracks']:.1f} | {mean['light']:.1f} | "
              f"{mean['seconds']:.1f} |", flush=True)
    raise SystemExit
print("| camera | depths | emitters | F1 | recall | precision | lateral | axial | errors in sd: x, y, z, light | "
      "seconds: volume, emitters | maxima at their best: F1 | lateral | axial |")
print("|---" * 13 + "|")
for kind, depths, count, rows in trials(trial):
    mean = lambda which, name: np.mean([row[which][name] for row in rows], 0)  # noqa: B023, E731
    of_sd = " ".join(f"{v:.2f}" for v in mean(0, "of_sd"))
    volume_s, all_s = mean(0, "volume_s"), mean(0, "all_s")
    print(f"| {kind} | {depths} | {count} | {mean(0, 'f1'):.3f} | {mean(0, 'recall'):.3f} | "
          f"{mean(0, 'precision'):.3f} | {mean(0, 'lateral'):.3f} | {mean(0, 'axial'):.3f} | {of_sd} | "
          f"{volume_s:.1f}, {all_s - volume_s:.1f} | {mean(1, 'f1'):.3f} | {mean(1, 'lateral'):.3f} | "
          f"{mean(1, 'axial'):.3f} |", flush=True)
