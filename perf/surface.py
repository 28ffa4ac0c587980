#!/usr/bin/env python3
"""Scenes on surfaces, as a user meets them: cameras whose sensor crops, learned from 8 pairs a depth, frames of six kinds of
surfaces (photographs that were not learned from; nothing is told), and what others would do. One table of means over the
kinds, one of the kinds, and sheets of pictures.
  perf/surface.py --scenes FOLDER --test-scenes FOLDER [--seeds 11,12] [--preset crop300] [--noise 0.01] [--response linear]
                  [--kinds slant,half,hill,ball,steps,bars] [--more overlap,outside] [--occlude] [--rivals 1]
                  [--simulate "OPTIONS"] [--also "NAME: OPTIONS of simulate"]... [--fit "OPTIONS"]
                  [--way "NAME: OPTIONS of reconstruct"]...
                  [--camera FOLDER] [--out FILE.md] [--pictures FOLDER] [--build build/release] [--keep FOLDER]
--also: a further camera, with another mask for instance. --more: kinds with rows of their own, which the means leave out. --camera: a data set that is there already, with test/raw
and test/truth. --rivals 0: without ADMM with total variation over all depths (60 iterations, its weight chosen on a frame
that is not scored). Needs NumPy and tifffile."""
import argparse
import json
import os
import pathlib
import re
import shlex
import sys
import tempfile
import time

import numpy as np
import tifffile

here = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(here))
import frames  # noqa: E402

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=str(here.parent / "build" / "release"))
parser.add_argument("--scenes", default="procedural")
parser.add_argument("--test-scenes", default="")
parser.add_argument("--preset", default="crop300")
parser.add_argument("--seeds", default="11,12")
parser.add_argument("--noise", default="0.01")
parser.add_argument("--response", default="linear")
parser.add_argument("--kinds", default="slant,half,hill,ball,steps,bars")
parser.add_argument("--more", default="overlap,outside")
parser.add_argument("--occlude", action="store_true")
parser.add_argument("--rivals", type=int, default=1)
parser.add_argument("--simulate", default="")
parser.add_argument("--also", action="append", default=[])
parser.add_argument("--fit", default="")
parser.add_argument("--way", action="append", default=[])
parser.add_argument("--camera", default="")
parser.add_argument("--out", default="")
parser.add_argument("--pictures", default="")
parser.add_argument("--keep", default="", help="where cameras, models and results stay")
o = parser.parse_args()
hadalens = f"{o.build}/bindings/cli/hadalens"
ITERATIONS = 60
WEIGHTS = ["0.001", "0.003", "0.01"]  # of the rival's total variation
MARK = "<!-- below this line: perf/surface.py -->"
USUAL = "0.003"                       # where there is no frame to choose by: the best on most
lines = []


def say(line=""):
    lines.append(line)
    print(line, flush=True)


def rival(weight):
    return ["--method", "admm", "--iterations", str(ITERATIONS), "--tv", weight, "--occupied", "all"]


def scores(out, truth):
    """Figures of each frame, by its name."""
    table = {}
    for row in json.loads(frames.run(hadalens, "evaluate", out, truth, "--json"))["files"]:
        name = pathlib.Path(row["truth"]).stem
        if row["kind"] == "distance_map":
            table.setdefault(name.removesuffix("_depth"), {}).update(
                error=row["mean_error_steps"], mm=row["mean_error_mm"], right=row["within"], cover=row["coverage"],
                error_jumps=row["jumps"]["mean_error_steps"], error_away=row["away"]["mean_error_steps"],
                unknown=row["outside_unknown"], sure=row["confident_half_error"])
        elif name.endswith("_aif"):
            table.setdefault(name.removesuffix("_aif"), {}).update(
                psnr=row["psnr"], ssim=row["ssim"], psnr_jumps=row["psnr_jumps"], psnr_away=row["psnr_away"])
    return table


def mean(rows, key):
    values = [r[key] for r in rows if r.get(key) is not None]
    return sum(values) / len(values) if values else float("nan")


COLUMNS = [("all-in-focus, dB", "psnr", "{:.2f}"), ("at jumps", "psnr_jumps", "{:.2f}"), ("SSIM", "ssim", "{:.3f}"),
           ("depth error, steps", "error", "{:.3f}"), ("at jumps", "error_jumps", "{:.2f}"), ("mm", "mm", "{:.1f}"),
           ("within half a step", "right", "{:.3f}"), ("cover", "cover", "{:.3f}"), ("error, surer half", "sure", "{:.3f}"),
           ("outside said unknown", "unknown", "{:.2f}")]


def cells(rows):
    return " | ".join("-" if np.isnan(mean(rows, key)) else form.format(mean(rows, key)) for _, key, form in COLUMNS)


def head(first):
    say("| " + " | ".join([*first, *(title for title, _, _ in COLUMNS)]) + " |")
    say("|" + "---|" * (len(first) + len(COLUMNS)))


def make(folder, design, kinds):
    """A camera, its frames, and the one to choose the rival's weight by."""
    words = ["simulate", "--noise", o.noise, "--pairs", 8, "--scenes", o.scenes, "--surface", ",".join(kinds), "--test",
             len(kinds) + 1, "-o", folder, "--quiet", *design]
    words += ["--test-scenes", o.test_scenes] if o.test_scenes else []
    words += ["--scene-response", o.response] if o.response != "linear" else []
    frames.run(hadalens, *words, *(["--occlude"] if o.occlude else []))
    files = sorted((folder / "test" / "raw").glob("*.tif"))
    return files[:-1], files[-1]


def panels(name, out, truth, distances):
    near, far = distances[0], distances[-1]
    return [frames.picture(truth / f"{name}_aif.tif"), *(frames.picture(p / f"{name}_aif.tif") for p in out),
            frames.coloured(tifffile.imread(truth / f"{name}_depth.tif"), near, far),
            *(frames.coloured(tifffile.imread(p / f"{name}_depth.tif"), near, far) for p in out)]


def picture_of(title):
    return "surface-" + re.sub("[^a-z0-9]+", "-", title.lower()) + ".png"


def kind_of(name):
    return name.split("_")[-1]


def one_camera(title, camera, files, tune, folder):
    """Fits, reconstructs by every way, scores; returns what the tables need."""
    model, truth = folder / "camera.model", camera / "test" / "truth"
    start = time.monotonic()
    frames.run(hadalens, "fit", camera, "-o", model, "--quiet", *shlex.split(o.fit))
    fitted = time.monotonic() - start
    ways = [("**reconstruct**", [])]
    ways += [(w.split(":", 1)[0], shlex.split(w.split(":", 1)[1])) for w in o.way]
    if o.rivals:
        weight = USUAL
        if tune:
            def quality(w):
                frames.reconstruct(hadalens, [tune], model, folder / "tune", rival(w))
                return mean(scores(folder / "tune", truth).values(), "psnr")
            weight = max(WEIGHTS, key=quality)
        ways.append(("ADMM, TV, all depths", rival(weight)))
        print(f"{title}: weight of the rival's total variation {weight}", file=sys.stderr)
    table, out = [], []
    for k, (way, options) in enumerate(ways):
        out.append(folder / f"way{k}")
        seconds = frames.reconstruct(hadalens, files, model, out[-1], options)
        table.append((way, scores(out[-1], truth), seconds))
    if o.pictures:
        facts = json.loads((camera / "camera.json").read_text()) if (camera / "camera.json").exists() else None
        distances = facts["distances_mm"] if facts else [100.0, 600.0]
        shown = [p for f in files for p in panels(f.stem, out, truth, distances)]
        frames.sheet(pathlib.Path(o.pictures) / picture_of(title), shown, 96, 2 * (1 + len(ways)), gamma=1)
    return title, fitted, table


def report(cameras, kinds):
    say("\n## Means over the kinds\n")
    head(["camera", "method", "s a frame", "fit, s"])
    for title, fitted, table in cameras:
        for way, rows, seconds in table:
            of = [r for n, r in rows.items() if not kinds or kind_of(n) in kinds]
            say(f"| {title} | {way} | {seconds:.2f} | {fitted:.1f} | {cells(of)} |")
    if len(cameras) > 1:
        for k, (way, _, _) in enumerate(cameras[0][2]):
            of = [r for _, _, table in cameras for n, r in table[k][1].items() if not kinds or kind_of(n) in kinds]
            seconds = float(np.median([table[k][2] for _, _, table in cameras]))
            say(f"| all | {way} | {seconds:.2f} | | {cells(of)} |")
    say("\n## The kinds\n")
    head(["kind", "method"])
    names = {kind_of(n): 1 for _, _, table in cameras for n in table[0][1]}
    for kind in names:
        for k, (way, _, _) in enumerate(cameras[0][2]):
            of = [r for _, _, table in cameras for n, r in table[k][1].items() if kind_of(n) == kind]
            say(f"| {kind} | {way} | {cells(of)} |")
    if o.pictures:
        relative = pathlib.Path(os.path.relpath(o.pictures, pathlib.Path(o.out or "x").parent))
        for title, _, table in cameras:
            say(f"\n![{title}]({relative / picture_of(title)})")
        say("\nA row a kind. All-in-focus: the truth, then " + ", ".join(w for w, _, _ in cameras[0][2]) +
            "; distance maps in the same order (warm is near, cold is far, grey is not known).")


with tempfile.TemporaryDirectory() as scratch:
    base = pathlib.Path(o.keep or scratch)
    kinds = o.kinds.split(",")
    done = []
    if o.camera:
        camera = pathlib.Path(o.camera)
        files = sorted((camera / "test" / "raw").glob("*.tif"))
        base.mkdir(parents=True, exist_ok=True)
        done.append(one_camera(camera.name, camera, files, None, base))
        kinds = [k for k in kinds if any(kind_of(f.stem) == k for f in files)]
    designs = {f"{o.preset} {s}": ["--preset", o.preset, "--seed", s, *shlex.split(o.simulate)] for s in o.seeds.split(",") if s}
    designs.update((a.split(":", 1)[0], shlex.split(a.split(":", 1)[1])) for a in o.also)
    for title, design in designs.items() if not o.camera else []:
        folder = base / title.replace(" ", "-")
        folder.mkdir(parents=True, exist_ok=True)
        files, tune = make(folder / "camera", design, kinds + [k for k in o.more.split(",") if k])
        done.append(one_camera(title, folder / "camera", files, tune, folder))
    report(done, kinds)
if o.out:
    out = pathlib.Path(o.out)  # what a person wrote above the mark stays
    above = out.read_text().split(MARK)[0] if out.exists() and MARK in out.read_text() else "# Scenes on surfaces\n\n"
    out.write_text(above + MARK + "\n\n" + "\n".join(lines) + "\n")
