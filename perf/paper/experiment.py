"""What the experiments share: the program, a small camera, scenes, scores, tables."""
import argparse
import json
import math
import pathlib
import shutil
import subprocess
import tempfile
import time

here = pathlib.Path(__file__).resolve().parent


class Experiment:
    """Options that all experiments have, a scratch folder, and the program's commands."""

    def __init__(self, description, **defaults):
        parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--build", default=str(here.parents[1] / "build" / "release"))
        parser.add_argument("--scenes", default="procedural", help="folder of pictures for the pairs")
        parser.add_argument("--test-scenes", default="", help="folder of pictures for the frames to judge by")
        parser.add_argument("--preset", default="sim512")
        parser.add_argument("--size", default="256x256")
        parser.add_argument("--window", default="96x96")
        parser.add_argument("--depths", type=int, default=defaults.pop("depths", 4))
        parser.add_argument("--pairs", type=int, default=defaults.pop("pairs", 16), help="a depth")
        parser.add_argument("--frames", type=int, default=defaults.pop("frames", 12), help="to judge by")
        parser.add_argument("--noise", type=float, default=0.01, help="of a frame's maximum")
        parser.add_argument("--seed", type=int, default=1)
        parser.add_argument("--lpips", default="", help="weights for LPIPS (safetensors)")
        parser.add_argument("--pictures", default="", help="folder that takes pictures")
        for name, value in defaults.items():
            parser.add_argument("--" + name.replace("_", "-"), type=type(value), default=value)
        self.options = parser.parse_args()
        self.hadalens = f"{self.options.build}/bindings/cli/hadalens"
        self._scratch = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self._scratch.name)

    def run(self, *words):
        """Standard output of a command; a failure shows what it said."""
        done = subprocess.run([self.hadalens, *map(str, words)], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"hadalens {' '.join(map(str, words))}\n{done.stderr}")
        return done.stdout

    def json(self, *words):
        return json.loads(self.run(*words, "--json"))

    def camera(self, name="camera", pairs=None, test_depths=1, *more):
        """A data set with frames to judge by, of scenes that the pairs do not show."""
        o = self.options
        words = ["simulate", "--preset", o.preset, "--size", o.size, "--window", o.window, "--depths", o.depths,
                 "--pairs", pairs or o.pairs, "--test", o.frames, "--test-depths", test_depths, "--seed", o.seed,
                 "--noise", o.noise, "--scenes", o.scenes]
        if o.test_scenes:
            words += ["--test-scenes", o.test_scenes]
        self.run(*words, *more, "-o", self.folder / name, "--quiet")
        return self.folder / name

    def fit(self, camera, *more):
        """The exact fit: model and seconds. Refinement stays linear, without total variation."""
        model = self.folder / f"fit{time.monotonic_ns()}.model"
        start = time.monotonic()
        self.run("fit", camera, "-o", model, "--refine-tv", 0, "--quiet", *more)
        return model, time.monotonic() - start

    def train(self, camera, *more):
        """Training: model, seconds, and what the program says of it."""
        model = self.folder / f"train{time.monotonic_ns()}.model"
        start = time.monotonic()
        said = self.json("train", camera, "-o", model, *more)
        return model, time.monotonic() - start, said

    def score(self, camera, model, *more, name=None):
        """Means over the frames to judge by: of the occupied planes, and milliseconds of a frame."""
        out = self.folder / f"out{time.monotonic_ns()}"
        frames = sorted((camera / "test" / "raw").glob("*.tif"))
        preview = [] if name and self.options.pictures else ["--no-preview"]
        report = self.json("reconstruct", *frames, "-m", model, "-o", out, *preview, *more)
        seconds = sorted(f["frames"][0]["seconds"]["total"] for f in report["files"][1:] or report["files"])
        words = ["evaluate", out, camera / "test" / "truth"]
        if self.options.lpips:
            words += ["--lpips", self.options.lpips]
        rows = self.json(*words)["files"]

        def mean(kind, key):
            values = [r[key] for r in rows if r["kind"] == kind and r.get(key) is not None]
            return sum(values) / len(values) if values else float("nan")

        score = {key: mean("stack", key) for key in ("psnr", "ssim", "mae", "sharpness", "sharpness_truth", "lpips")}
        apart = [abs(math.log(r["sharpness"] / r["sharpness_truth"])) for r in rows
                 if r["kind"] == "stack" and r.get("sharpness") and r.get("sharpness_truth")]
        score["apart"] = sum(apart) / len(apart) if apart else float("nan")
        score["map"] = mean("distance_map", "within")
        score["ms"] = 1e3 * seconds[len(seconds) // 2]
        if name and self.options.pictures:
            self.keep(out, name)
        return score

    def keep(self, out, name):
        """The first frame's preview."""
        folder = pathlib.Path(self.options.pictures)
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy(sorted(out.glob("*_preview.png"))[0], folder / f"{name}.png")


def table(columns, rows):
    """A Markdown table; numbers as they are worth reading."""
    def text(value):
        if isinstance(value, float):
            return "" if value != value else f"{value:.4f}" if abs(value) < 1 else f"{value:.2f}"
        return str(value)
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(map(text, row)) + " |" for row in rows]
    print("\n".join(lines), flush=True)


def spread(values):
    """Mean, smallest, largest, standard deviation."""
    mean = sum(values) / len(values)
    deviation = (sum((v - mean) ** 2 for v in values) / max(1, len(values) - 1)) ** 0.5
    return mean, min(values), max(values), deviation
