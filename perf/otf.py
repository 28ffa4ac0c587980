#!/usr/bin/env python3
"""Transfer functions that a fit gives from the pairs alone (--psf-sign free) and from pairs and the sign of light
(nonnegative), against those of the camera's true PSF; and what refined reconstructions gain. Prints a Markdown table.
   perf/otf.py [--build build/release] [--scenes FOLDER --test-scenes FOLDER] [--frames 6]
Errors are relative: weighted by the mean power of scenes, and over all frequencies alike, mean over depths and channels,
after the best common scale. PSNR of the occupied planes; which depths are occupied is not told. Needs NumPy."""
import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy as np

here = pathlib.Path(__file__).resolve().parent
arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
arguments.add_argument("--build", default=str(here.parent / "build" / "release"))
arguments.add_argument("--scenes", default="procedural", help="photographs for the rows that say so")
arguments.add_argument("--test-scenes", default="", help="photographs for their test frames")
arguments.add_argument("--frames", type=int, default=6)
arguments = arguments.parse_args()
hadalens = f"{arguments.build}/bindings/cli/hadalens"
small = "sim512 --size 256x256 --window 96x96 --depths 6"
CASES = [("sim300", "circular", noise, pairs, "photographs") for noise, pairs in
         ((0.001, 8), (0.01, 2), (0.01, 4), (0.01, 8), (0.01, 16), (0.03, 8))]
CASES += [("sim300", "circular", 0.01, 8, "procedural"), ("sim300", "padded", 0.01, 8, "photographs"),
          (small, "circular", 0.01, 8, "procedural"), (small, "padded", 0.03, 4, "procedural")]


def run(*words):
    return subprocess.run([hadalens, *map(str, words)], check=True, capture_output=True, text=True).stdout


def tensors(path):
    """The arrays of a safetensors file."""
    data = pathlib.Path(path).read_bytes()
    size = int.from_bytes(data[:8], "little")
    head = json.loads(data[8:8 + size])
    head.pop("__metadata__", None)
    types = {"F32": np.float32, "F64": np.float64}
    return {name: np.frombuffer(data[8 + size + at["data_offsets"][0]:8 + size + at["data_offsets"][1]],
                                types[at["dtype"]]).reshape(at["shape"])
            for name, at in head.items() if at["dtype"] in types}


def error(model, true):
    got, wanted = (a["otf"][..., 0] + 1j * a["otf"][..., 1] for a in (model, true))
    power = model["scene_power"].astype(float)
    inner = np.ones_like(power)
    inner[:, 1:-1] = 2  # how often a frequency stands in the whole spectrum; the sizes here are even
    table = []
    for z in range(got.shape[0]):
        for c in range(got.shape[1]):
            h, t = got[z, c], wanted[z, min(c, wanted.shape[1] - 1)]
            scale = np.sum(inner * power * (np.conj(t) * h).real) / np.sum(inner * power * abs(t) ** 2)
            table.append([np.sqrt(np.sum(w * abs(h - scale * t) ** 2) / np.sum(w * abs(scale * t) ** 2))
                          for w in (inner * power, inner)])
    return np.mean(table, axis=0)


def psnr(model, folder, out):
    run("reconstruct", *sorted((folder / "test" / "raw").glob("*.tif")), "-m", model, "-o", out, "--no-preview", "--quiet")
    rows = json.loads(run("evaluate", out, folder / "test" / "truth", "--json"))["files"]
    return np.mean([row["psnr"] for row in rows if row["kind"] == "stack"])


print("| camera | boundary | noise | pairs | scenes | error weighted: free | non-negative | error: free | non-negative |"
      " one depth, dB: free | non-negative | two depths, dB: free | non-negative |")
print("|---" * 13 + "|")
for preset, boundary, noise, pairs, scenes in CASES:
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        design = ["--preset", *preset.split(), "--noise", noise, "--boundary", boundary, "--seed", 1]
        if scenes == "photographs":
            design += ["--scenes", arguments.scenes]
            design += ["--test-scenes", arguments.test_scenes] if arguments.test_scenes else []
        for occupied in (1, 2):
            run("simulate", *design, "-o", folder / f"c{occupied}", "--pairs", pairs if occupied == 1 else 1,
                "--test", arguments.frames, "--test-depths", occupied, "--quiet")
        camera = json.load(open(folder / "c1" / "camera.json"))
        window = f"{camera['window_rows']}x{camera['window_cols']}"
        run("fit", "--psf", folder / "c1" / "psf.tif", "--boundary", boundary, "--window", window, "-o", folder / "true",
            "--quiet")
        errors, gains = [], []
        for sign in ("free", "nonnegative"):
            run("fit", folder / "c1", "-o", folder / sign, "--psf-sign", sign, "--quiet")
            errors.append(error(tensors(folder / sign), tensors(folder / "true")))
            gains.append([psnr(folder / sign, folder / f"c{occupied}", folder / f"out{occupied}{sign}")
                          for occupied in (1, 2)])
        name = preset.split()[0] + (" reduced" if " " in preset else "")
        print(f"| {name} | {boundary} | {100 * noise:g} % | {pairs} | {scenes} | " +
              " | ".join(f"{errors[s][k]:.4f}" if k == 0 else f"{errors[s][k]:.3f}" for k in (0, 1) for s in (0, 1)) +
              " | " + " | ".join(f"{gains[s][k]:.2f}" for k in (0, 1) for s in (0, 1)) + " |", flush=True)
