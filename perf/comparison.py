#!/usr/bin/env python3
"""Every method on the same scenes: quality and time, in one table, with pictures. Simulated cameras (learned from pairs; the
classic methods get the designer's own PSFs, the best case for them, and the learned ones), and real captures where
folders are given. Weights of total variation are chosen for the best PSNR on a frame that is not scored.
   perf/comparison.py [--build build/release] [--scenes FOLDER --test-scenes FOLDER] [--pairs FOLDER] [--hand FOLDER]
                      [--out perf/results/comparison.md] [--pictures docs/pictures] [--preset sim300] [--frames 6]
                      [--only flat,two-depths,crop-flat,crop-two-depths,encoded-flat,surfaces,pairs,hand]
--pairs: a data set of real pairs, each left out in turn. --hand: psf_sample.tif and rawdata_hand_sample.tif.
--only: some of the sections. Needs NumPy and tifffile."""
import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import numpy as np
import tifffile

here = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(here))
import frames  # noqa: E402
from frames import picture  # noqa: E402
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", default=str(here.parent / "build" / "release"))
parser.add_argument("--scenes", default="procedural")
parser.add_argument("--test-scenes", default="")
parser.add_argument("--pairs", default="")
parser.add_argument("--hand", default="")
parser.add_argument("--preset", default="sim300")
parser.add_argument("--frames", type=int, default=6)
parser.add_argument("--iterations", type=int, default=100)
parser.add_argument("--train-steps", type=int, default=400, help="of the net of the enhanced row; 0: no such row")
parser.add_argument("--seed", default="1")
parser.add_argument("--only", default="flat,two-depths,crop-flat,crop-two-depths,encoded-flat,surfaces,pairs,hand")
parser.add_argument("--out", default="")
parser.add_argument("--pictures", default="")
o = parser.parse_args()
hadalens = f"{o.build}/bindings/cli/hadalens"
MARK = "<!-- below this line: perf/comparison.py -->"
# where the pictures are, seen from the page
shown_at = os.path.relpath(o.pictures or ".", pathlib.Path(o.out or "x").parent)
WEIGHTS = ["0.0001", "0.0003", "0.001", "0.003", "0.01"]
lines = []


def say(line=""):
    lines.append(line)
    print(line, flush=True)


def run(*words):
    return frames.run(hadalens, *words)


# A way: its name, whether it takes the designer's PSFs, and its options; TV is replaced by the weight that serves best.
ITERATIONS = ["--iterations", o.iterations]
FEW = "ADMM, TV, 16 iterations"  # so that time against quality is fair; not in the pictures
CLASSIC = [
    ("Wiener", ["--method", "wiener"]),
    ("Richardson-Lucy, TV", ["--method", "rl", *ITERATIONS, "--tv", "TV"]),
    ("FISTA, non-negative", ["--method", "fista", *ITERATIONS]),
    ("FISTA, TV", ["--method", "fista", *ITERATIONS, "--tv", "TV"]),
    (FEW, ["--method", "admm", "--iterations", 16, "--tv", "TV"]),
    ("ADMM, TV", ["--method", "admm", *ITERATIONS, "--tv", "TV"]),
]


def sheet(name, panels, side, per_row=4):
    """Panels side by side, in rows, each scaled to its own brightness where it has no truth (gain given)."""
    if o.pictures:
        frames.sheet(pathlib.Path(o.pictures) / name, panels, side, per_row)


def reconstruct(files, model, out, options):
    return frames.reconstruct(hadalens, files, model, out, options)


def evaluate(out, truth, *options):
    rows = json.loads(run("evaluate", out, truth, "--json", *options))["files"]

    def mean(kind, key):
        values = [r[key] for r in rows if r["kind"] == kind and r.get(key) is not None]
        return sum(values) / len(values) if values else float("nan")
    kind = "stack" if any(r["kind"] == "stack" for r in rows) else "images"
    return mean(kind, "psnr"), mean(kind, "ssim"), mean("distance_map", "within")


def best_weight(options, tune):
    """The options with the weight that serves best; `tune` scores them."""
    if "TV" not in options:
        return options
    tried = [[w if x == "TV" else x for x in options] for w in WEIGHTS]
    return max(tried, key=tune)


def simulated(title, camera, models, name, short=False):
    """`short`: the best of the classic methods alone."""
    files = sorted((camera / "test" / "raw").glob("*.tif"))
    tune_file, files = files[0], files[1:]
    truth = camera / "test" / "truth"
    say(f"\n## {title}\n")
    say("| method | OTF | depths | PSNR, dB | SSIM | map right | ms a frame |")
    say("|---|---|---|---|---|---|---|")
    shown, out = [picture(files[0])], folder / "out"
    learned, designed, enhanced = models
    ways = [("learned filters", learned, "learned", "all", ["--refine", 0, "--occupied", "all"]),
            ("**learned, refined**", learned, "learned", "found", [])]
    if enhanced:
        ways.append(("**learned, refined, enhanced**", enhanced, "learned", "found", []))
    for method, options in CLASSIC[-1:] if short else CLASSIC:
        ways.append((method, designed, "designed", "all", options))
        ways.append((method, learned, "learned", "all", options))
        if method.startswith("ADMM"):
            ways.append((method, designed, "designed", "known", options))
            ways.append((method, learned, "learned", "known", options))
    ways.append(("learned, refined", learned, "learned", "known", []))
    for method, model, otf, depths, options in ways:
        def known(file):
            values = tifffile.imread(truth / f"{file.stem}_depth.tif")
            return ",".join(f"{v:g}mm" for v in np.unique(values[np.isfinite(values)]))

        def do(some, chosen):
            """The occupied depths of a frame."""
            times = []
            for k, file in enumerate(some):
                more = ["--occupied", known(file)] if depths == "known" else []
                times.append(reconstruct([file] if depths == "known" else some, model, out / str(k), [*chosen, *more]))
                if depths != "known":
                    break
            scores = [evaluate(p, truth) for p in sorted(out.iterdir())]
            shutil.move(out / "0", folder / "first") if not (folder / "first").exists() else None
            shutil.rmtree(out)
            return np.mean(np.array(scores), 0), float(np.median(times))
        shutil.rmtree(folder / "first", ignore_errors=True)
        chosen = best_weight(options, lambda trial: do([tune_file], trial)[0][0])
        shutil.rmtree(folder / "first", ignore_errors=True)
        (psnr, ssim, right), seconds = do(files, chosen)
        weight = f", {chosen[chosen.index('--tv') + 1]}" if "--tv" in chosen else ""
        say(f"| {method}{weight} | {otf} | {depths} | {psnr:.2f} | {ssim:.3f} | {100 * right:.1f} % | {1e3 * seconds:.0f} |")
        if otf == "designed" and depths == "all" and method != FEW or "learned" in method and depths != "known":
            shown.append(picture(folder / "first" / f"{files[0].stem}_aif.tif"))
    shown.append(picture(truth / f"{files[0].stem}_aif.tif"))
    sheet(f"comparison-{name}.png", shown, 192)
    say(f"\n![{title}]({shown_at}/comparison-{name}.png)\n")
    classic = "" if short else "Wiener, Richardson-Lucy, FISTA non-negative, FISTA with TV, "
    say("In rows: the raw frame, learned filters, learned and refined, " + ("the same enhanced, " if enhanced else "") + classic +
        "ADMM with TV (designed OTF, all depths), the truth. All-in-focus images of the first frame.")


# A title, the depths that a scene occupies, the name of its picture, the camera, and options of its simulation.
SIMULATED = [
    (f"Flat scenes, {o.preset}", 1, "flat", o.preset, []),
    (f"Scenes at two depths, {o.preset}", 2, "two-depths", o.preset, []),
    ("Flat scenes, a sensor that crops (crop300)", 1, "crop-flat", "crop300", []),
    ("Scenes at two depths, a sensor that crops (crop300)", 2, "crop-two-depths", "crop300", []),
    (f"Flat scenes, display-encoded, {o.preset}", 1, "encoded-flat", o.preset, ["--scene-response", "srgb"]),
]


def surfaces():
    """What perf/surface.py says of two cameras."""
    words = [sys.executable, here / "surface.py", "--build", o.build, "--scenes", o.scenes, "--seeds", "11,12", "--out",
             folder / "surface.md", *(["--test-scenes", o.test_scenes] if o.test_scenes else []),
             *(["--pictures", o.pictures] if o.pictures else [])]
    subprocess.run([str(w) for w in words], check=True, stdout=subprocess.DEVNULL)
    say("\n## Scenes on surfaces, a sensor that crops (crop300)")
    for line in (folder / "surface.md").read_text().split("-->")[1].splitlines()[2:]:
        say(re.sub(r"\]\(.*/surface-", f"]({shown_at}/surface-", line.replace("## ", "### ")))


def real_pairs(source):
    """Each pair left out in turn; gains matched, since a capture's scale is arbitrary for methods that are given a PSF."""
    depth = next(pathlib.Path(source).glob("z*mm"))
    names = sorted(p.name for p in (depth / "raw").glob("*.tif"))
    say("\n## Real pairs (DiffuserCam), each left out in turn\n")
    say("| method | OTF | PSNR, dB | ms a frame |")
    say("|---|---|---|---|")
    scores, shown = {}, None
    for left in names:
        camera = folder / "left"
        shutil.rmtree(camera, ignore_errors=True)
        for kind in ("raw", "scene"):
            (camera / depth.name / kind).mkdir(parents=True)
            for name in names:
                if name != left:
                    (camera / depth.name / kind / name).symlink_to((depth / kind / name).resolve())
        run("fit", camera, "-o", folder / "left.model", "--boundary", "padded", "--dark", "auto", "--quiet")
        truth = folder / "truth"
        shutil.rmtree(truth, ignore_errors=True)
        truth.mkdir()
        (truth / left).symlink_to((depth / "scene" / left).resolve())
        panels = [picture(depth / "raw" / left)]
        for method, options in [("learned filters", ["--refine", 0]), ("learned, what the fit chose", []), *CLASSIC]:
            def do(chosen):
                seconds = reconstruct([depth / "raw" / left], folder / "left.model", folder / "out", ["--occupied", "all", *chosen])
                return evaluate(folder / "out", truth, "--match-gain")[0], seconds
            options = best_weight(options, lambda trial: do(trial)[0]) if left == names[0] else \
                [scores[method][1] if x == "TV" else x for x in options]
            psnr, seconds = do(options)
            weight = options[options.index("--tv") + 1] if "--tv" in options else ""
            scores.setdefault(method, ([], weight, []))[0].append(psnr)
            scores[method][2].append(seconds)
            if method != FEW:
                panels.append(picture(next((folder / "out").glob("*_aif.tif"))))
        shown = shown or [*panels, picture(depth / "scene" / left)]
    for method, (values, weight, seconds) in scores.items():
        say(f"| {method}{', ' + weight if weight else ''} | learned | {np.mean(values):.2f} | {1e3 * np.median(seconds):.0f} |")
    sheet("comparison-pairs.png", [shown[0], *shown[1:]], 192)
    say(f"\n![Real pairs]({shown_at}/comparison-pairs.png)\n")
    say("In rows: the raw frame, learned filters, what the fit chose, Wiener, Richardson-Lucy, FISTA non-negative, FISTA with "
        "TV, ADMM with TV, the truth, of the first pair. The weight of TV is the best for that pair.")


def real_hand(source):
    source = pathlib.Path(source)
    model, raw = folder / "hand.model", source / "rawdata_hand_sample.tif"
    run("fit", "--psf", source / "psf_sample.tif", "--distances", 300, "-o", model, "--quiet")
    say("\n## A real capture with a measured PSF (DiffuserCam, a hand; 1200 x 1600)\n")
    say("| method | ms a frame |")
    say("|---|---|")
    panels = [picture(raw)]
    panels[0] = panels[0] / panels[0].max()
    for method, options in [("refinement", []), *[(m, [("0.001" if x == "TV" else x) for x in w]) for m, w in CLASSIC]]:
        seconds = reconstruct([raw], model, folder / "out", ["--dark", "auto", "--occupied", "all", *options])
        say(f"| {method} | {1e3 * seconds:.0f} |")
        image = picture(next((folder / "out").glob("*_aif.tif")))
        if method != FEW:
            panels.append(image / np.percentile(image, 99.9))
    sheet("comparison-hand.png", panels, 256)
    say(f"\n![The hand]({shown_at}/comparison-hand.png)\n")
    say("In rows: the raw frame, refinement, Wiener, Richardson-Lucy, FISTA non-negative, FISTA with TV, ADMM with TV "
        "(weight 0.001). There is no truth to score against; each is shown at its own scale.")


with tempfile.TemporaryDirectory() as scratch:
    folder = pathlib.Path(scratch)
    say(f"\nMade by `perf/comparison.py`: {o.iterations} iterations, weights of total variation chosen on a frame that is not "
        "scored. `designed`: the OTFs that the simulation used, which nobody has for a real camera; `learned`: estimated from "
        "8 pairs a depth. The net of the enhanced row learned from the same pairs. Depths: `all` of the camera, `known` (the occupied ones), or `found` by pursuit. PSNR "
        "and SSIM of the occupied planes, peak 1.")
    for title, depths, name, preset, options in SIMULATED:
        if name not in o.only.split(","):
            continue
        short = name not in ("flat", "two-depths")
        camera = folder / name
        words = ["simulate", "--preset", preset, "--pairs", 8, "--test", o.frames + 1, "--test-depths", depths, "--seed", o.seed,
                 "--scenes", o.scenes, "-o", camera, "--quiet", *options]
        run(*words, *(["--test-scenes", o.test_scenes] if o.test_scenes else []))
        learned, designed = folder / f"{name}.model", folder / f"{name}-designed.model"
        run("fit", camera, "-o", learned, "--quiet")
        facts = json.load(open(camera / "camera.json"))
        run("fit", "--psf", camera / "psf.tif", "--distances", ",".join(f"{d:g}" for d in facts["distances_mm"]), "--boundary",
            facts["boundary"], "--window", f"{facts['window_rows']}x{facts['window_cols']}", "--psf-dark", "0", "--colour", "-o", designed, "--quiet")
        enhanced = folder / f"{name}-enhanced.model" if o.train_steps and not short else None
        if enhanced:
            run("train", camera, "-m", learned, "-o", enhanced, "--steps", o.train_steps, "--quiet")
        simulated(title, camera, (learned, designed, enhanced), name, short)
    if "surfaces" in o.only.split(","):
        surfaces()
    if o.pairs and "pairs" in o.only.split(","):
        real_pairs(o.pairs)
    if o.hand and "hand" in o.only.split(","):
        real_hand(o.hand)
if o.out:
    out = pathlib.Path(o.out)  # what a person wrote above the mark stays
    above = out.read_text().split(MARK)[0] if out.exists() and MARK in out.read_text() else "# Comparison\n\n"
    out.write_text(above + MARK + "\n" + "\n".join(lines) + "\n")
