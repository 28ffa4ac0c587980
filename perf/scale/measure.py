#!/usr/bin/env python3
"""What sharing a command over ranks costs on one machine: measure.py BUILD OUT.json [ROUNDS] [--wall].

Runs of one rank with little and with much work give the costs of an item and of all that comes once; runs of 1, 2 and 4
ranks are what model.py has to foretell. What is counted is the processor time of each rank outside of exchanges: on a
shared machine it says what the wall clock of a free one would. --wall, on a machine that does nothing else: the wall
clock, of ranks that take turns on a core their part of it. Rounds take turns, and of each rank the least counts, for what
else runs only adds; then that of the rank that has most.
"""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

BATCH, STEPS = 8, 8
PAIRS, FRAMES, REFINED = 24, 96, 8


def command(count, program, arguments, folder, whole=False):
    """Run on `count` ranks with a core each, or one with the whole device; return what each says of its costs."""
    costs = folder / "costs"
    for old in folder.glob("costs.*"):
        old.unlink()
    root = ["--allow-run-as-root"] if os.geteuid() == 0 else []
    # every rank has one core, also where they are more than cores
    cores = os.cpu_count() or 1
    parts = [f"0:{i + 1}/{cores}" for i in range(cores)] if cores > 1 else ["0"]
    environment = os.environ | {
        "HADALENS_MPI_COSTS": str(costs),
        "HADALENS_DEVICE": "0" if whole else ",".join(parts if count > 1 else parts[:1]),
        "OMPI_MCA_plm": "isolated",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
    }
    subprocess.run(
        ["mpirun", *root, "--oversubscribe", "-np", str(count), program, *arguments, "-q"],
        check=True, cwd=folder, env=environment, stdout=subprocess.DEVNULL,
    )
    return [json.loads(Path(f"{costs}.{rank}").read_text()) for rank in range(count)]


def seconds(ranks, wall):
    """Return the seconds of each rank outside of exchanges."""
    if wall:
        turns = max(1.0, len(ranks) / (os.cpu_count() or 1))
        return [(rank["seconds"] - rank["exchange_seconds"]) / turns for rank in ranks]
    return [rank["cpu_seconds"] - rank["exchange_cpu_seconds"] for rank in ranks]


def busiest(rounds):
    """Return the least of the rounds of the rank whose least is most."""
    return max(min(rank) for rank in zip(*rounds))


def frames(folder, count):
    """Return `count` frames: one under other names, for frames differ in what they cost, and ranks get others of them."""
    raw = folder / "camera/test/raw/test01.tif"
    out = folder / f"frames{count}"
    out.mkdir(exist_ok=True)
    for i in range(count):
        link = out / f"frame{i:05d}.tif"
        if not link.exists():
            os.link(raw, link)
    return [str(path.relative_to(folder)) for path in sorted(out.glob("*.tif"))]


def data(folder, pairs):
    """Return a data set of `pairs` pairs of each depth: those of the camera under other names."""
    out = folder / f"pairs{pairs}"
    for depth in sorted((folder / "camera").glob("z*mm")):
        names = sorted(path.name for path in (depth / "raw").glob("*.tif"))
        for kind in ("raw", "scene"):
            (out / depth.name / kind).mkdir(parents=True, exist_ok=True)
            for i in range(pairs):
                link = out / depth.name / kind / f"pair{i:05d}.tif"
                if not link.exists():
                    os.link(depth / kind / names[i % len(names)], link)
    return out.name


def main():
    """Measure."""
    words = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    words.add_argument("build", type=Path)
    words.add_argument("out", type=Path)
    words.add_argument("rounds", type=int, nargs="?", default=3)
    words.add_argument("--wall", action="store_true")
    given = words.parse_args()
    build, out = given.build.resolve(), given.out.resolve()
    alone, shared = build / "bindings/cli/hadalens", build / "bindings/mpi/hadalens-mpi"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([alone, "simulate", "--preset", "sim300", "--test", "2", "-q", "-o", "camera"], check=True, cwd=folder)
        subprocess.run([alone, "fit", "camera", "-q", "-o", "camera.model"], check=True, cwd=folder)
        sums = ["--no-leave-one-out", "--boundary", "circular", "--psf-sign", "free", "-o", "out.model"]
        training = ["train", "camera", "-m", "camera.model", "-o", "net.model", "--log", "net.log", "--restart",
                    "--validate-every", "0", "--show-every", "0", "--compose", "0", "--save-every", "1000"]
        # engine: arguments for some amount of work, the least and the most of it that one rank measures
        engines = {
            # each is computed, though it is equal to the one before
            "frames": (lambda n: ["reconstruct", *frames(folder, n), "-m", "camera.model", "-o", "out", "--refine", "0",
                                  "--no-preview", "--skip", "none"], FRAMES // 4, FRAMES),
            "refined": (lambda n: ["reconstruct", *frames(folder, n), "-m", "camera.model", "-o", "out", "--no-preview",
                                   "--skip", "none"], REFINED // 4, REFINED),
            "fit": (lambda n: ["fit", data(folder, n), *sums], PAIRS // 4, PAIRS),
            "train": (lambda n: [*training, "--batch", str(n), "--at-once", "1", "--steps", str(STEPS)], BATCH // 4, BATCH),
        }
        found = {engine: {} for engine in engines}
        for _ in range(given.rounds):
            for engine, (arguments, little, much) in engines.items():
                for label, count, amount in (("little", 1, little), ("whole", 1, much), ("1", 1, much), ("2", 2, much),
                                             ("4", 4, much)):
                    ranks = command(count, shared, arguments(amount), folder, label == "whole")
                    row = found[engine].setdefault(label, {"seconds": [], "bytes": 0, "amount": amount})
                    row["seconds"].append(seconds(ranks, given.wall))
                    row["bytes"] = max(rank["bytes"] for rank in ranks)
        files = {
            "frame_in": (folder / "camera/test/raw/test01.tif").stat().st_size,
            "frame_out": sum(path.stat().st_size for path in (folder / "out").glob("frame00000_*")),
            "pair_in": sum(next((folder / "camera").glob(f"z100mm/{kind}/*.tif")).stat().st_size for kind in ("raw", "scene")),
        }
        depths = len(list((folder / "camera").glob("z*mm")))
    report = {"files": files, "depths": depths, "steps": STEPS, "clock": "wall" if given.wall else "processor",
              "engines": {}}
    for engine, rows in found.items():
        report["engines"][engine] = {
            label: {"seconds": busiest(row["seconds"]), "rounds": row["seconds"],
                    "bytes": row["bytes"], "amount": row["amount"]}
            for label, row in rows.items()
        }
    out.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
