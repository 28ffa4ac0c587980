#!/usr/bin/env python3
"""Which depths are found on random scenes of a simulated camera that was learned from 8 pairs a depth, and what the
looking costs, against refining every depth (--occupied all), in turns. Prints a Markdown table, and every frame whose
set of depths was not found.
   perf/pursuit.py [--build build/release] [--preset sim512] [--seed 1] [--frames 30] [--depths 1,2,3,14] [--rounds 2]
                   [--noise 0.01] [--full 0] [--made 0]
With --made N, also N scenes of each kind of pursuit_scenes.py, made to be hard; --depths "" leaves the others out. Needs
NumPy and tifffile. Times are medians (and 90th percentiles of the looking) of the rounds over a row's frames, without the
first frame of a run."""
import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy as np
import tifffile

import pursuit_scenes

here = pathlib.Path(__file__).resolve().parent
arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
arguments.add_argument("--build", default=str(here.parent / "build" / "release"))
arguments.add_argument("--preset", default="sim512")
arguments.add_argument("--design", default="", help="further options of simulate, such as '--depths 14'")
arguments.add_argument("--seed", default="1")
arguments.add_argument("--frames", type=int, default=30)
arguments.add_argument("--depths", default="1,2,3,14", help="occupied depths of the rows")
arguments.add_argument("--rounds", type=int, default=2)
arguments.add_argument("--noise", default="0.01")
arguments.add_argument("--full", type=int, default=0, help="frames of each row that the reference search decides as well")
arguments.add_argument("--made", type=int, default=0, help="scenes of each hard kind (circular boundary)")
arguments = arguments.parse_args()
hadalens = f"{arguments.build}/bindings/cli/hadalens"
NOT_DEPTHS = "prune,frequencies,half,channels,frames,tiles"


def run(*words):
    return subprocess.run([hadalens, *map(str, words)], check=True, capture_output=True, text=True).stdout


def reconstruct(files, model, out, *options):
    """Per frame: the set of indices of the occupied depths, and seconds by stage."""
    report = json.loads(run("reconstruct", *files, "-m", model, "-o", out, "--no-preview", "--json", *options))
    frames = [f["frames"][0] for f in report["files"]]
    return [(tuple(frame["occupied_mm"]), frame["seconds"]) for frame in frames]


def near(mm, distances):
    return tuple(sorted(int(np.argmin(abs(distances - d))) for d in mm))


def truth(path, distances):
    values = tifffile.imread(path)
    return near(np.unique(values[np.isfinite(values)]), distances)


def kind(found, wanted, depths):
    if found == wanted:
        return "exact"
    if len(found) == depths:
        return "all"
    if len(found) == len(wanted) and all(abs(a - b) <= 1 for a, b in zip(found, wanted)):
        return "one step off"
    return "one too many" if set(wanted) < set(found) and len(found) == len(wanted) + 1 else "other"


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    design = ["--preset", arguments.preset, "--seed", arguments.seed, "--noise", arguments.noise, *arguments.design.split()]
    run("simulate", *design, "-o", folder / "camera", "--pairs", 8, "--quiet")
    run("fit", folder / "camera", "-o", folder / "model", "--quiet")
    distances = np.array(json.load(open(folder / "camera" / "camera.json"))["distances_mm"])
    misses, equal, compared = [], 0, 0
    print("| occupied depths | frames | exact | one step off | one too many | all | other |"
          " pursuit, ms | slowest tenth, ms | total, ms |"
          " all depths: refinement, ms | total, ms | ratio of totals | pursuit / refinement of all |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for count in map(int, filter(None, arguments.depths.split(","))):
        scenes = folder / f"scenes{count}"
        run("simulate", *design, "-o", scenes, "--pairs", 1, "--test", arguments.frames, "--test-depths", count, "--quiet")
        files = sorted((scenes / "test" / "raw").glob("*.tif"))
        wanted = [truth(scenes / "test" / "truth" / f"{f.stem}_depth.tif", distances) for f in files]
        auto, dense = [], []
        for _ in range(arguments.rounds):
            auto += reconstruct(files, folder / "model", folder / "out")[1:]
            dense += reconstruct(files[:8], folder / "model", folder / "out", "--occupied", "all")[1:]
        first = reconstruct(files, folder / "model", folder / "out")
        found = [near(mm, distances) for mm, _ in first]
        kinds = [kind(f, w, len(distances)) for f, w in zip(found, wanted)]
        misses += [(count, f.name, w, g, k) for f, w, g, k in zip(files, wanted, found, kinds) if k != "exact"]
        if arguments.full:
            full = reconstruct(files[:arguments.full], folder / "model", folder / "out", "--skip", NOT_DEPTHS)
            same = [near(mm, distances) == f for (mm, _), f in zip(full, found)]
            equal, compared = equal + sum(same), compared + len(same)
            misses += [(count, f.name, "reference search", near(mm, distances), "differs")
                       for f, (mm, _), s in zip(files, full, same) if not s]
        ms = {(who, stage): 1e3 * float(np.median([seconds[stage] for _, seconds in table]))
              for who, table in (("auto", auto), ("all", dense)) for stage in ("pursuit", "refine", "total")}
        slow = 1e3 * float(np.quantile([seconds["pursuit"] for _, seconds in auto], 0.9))
        print(f"| {count} | {len(files)} | " + " | ".join(str(kinds.count(k)) for k in
              ("exact", "one step off", "one too many", "all", "other")) +
              f" | {ms['auto', 'pursuit']:.1f} | {slow:.1f} | {ms['auto', 'total']:.0f} | {ms['all', 'refine']:.0f} |"
              f" {ms['all', 'total']:.0f} | {ms['all', 'total'] / ms['auto', 'total']:.1f} |"
              f" {100 * ms['auto', 'pursuit'] / ms['all', 'refine']:.1f} % |", flush=True)
    if arguments.made:
        print("\n| made-up scenes | frames | exact | all | other |\n|---|---|---|---|---|")
    for name in pursuit_scenes.KINDS if arguments.made else ():
        files, wanted = pursuit_scenes.write(name, arguments.made, folder / "camera", folder / name)
        found = [near(mm, distances) for mm, _ in reconstruct(files, folder / "model", folder / "out")]
        kinds = [kind(f, w, len(distances)) for f, w in zip(found, wanted)]
        exact, every = kinds.count("exact"), kinds.count("all")
        print(f"| {name} | {len(files)} | {exact} | {every} | {len(files) - exact - every} |", flush=True)
        misses += [(name, f.name, w, g, k) for f, w, g, k in zip(files, wanted, found, kinds) if k != "exact"]
    if arguments.full:
        print(f"\nThe reference search decided the same on {equal} of {compared} frames.")
    print()
    for miss in misses:
        print("-", *miss)
