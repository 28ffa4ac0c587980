#!/usr/bin/env python3
"""Cameras learned from pairs whose raw frames are poor in one way, and frames that are so too: PSNR of the all-in-focus image of
four frames of other photographs, in dB, with a common gain taken off.
   perf/poor_frames.py HADALENS PHOTOGRAPHS OTHER_PHOTOGRAPHS [--kinds none,hot,room] [--first 900] [--frames] [--mosaic]
none: as simulated. hot: one pixel of a thousand at white. room: light of a room, 5 % of full scale and a slope of 12 % more.
rooms: another one in each frame. srgb: 8 bits, encoded for displays. eight: 8 bits. level: a dark level of 6 %, 16 bits. black: cut
off at black. exposures: each frame's own, 0.7 to 1.4. balance: the same of red and blue beside green, some 14 %. rows: an offset
of each row, 1 % of full scale. gains: of each pixel, 2 %. white: the brightest 5 % cut off. corners: 60 % of the light is lost there. colours, few_colours: each channel of the sensor sees
some of the others, up to a third or a twentieth. stray: 3 % of white everywhere. dim: 0.7 times as bright. ten: 10 bits in a file
of 16. Kinds joined by + come one after the other: exposures+dim+srgb. --frames: the pairs are as simulated. --mosaic: all cameras
are in colour, behind a colour filter mosaic. Needs NumPy and tifffile."""
import argparse
import json
import pathlib
import shutil
import tempfile

import numpy as np
import tifffile
from frames import run

# preset, mask, noise, scenes, pairs, occupied depths, depths, channels
CAMERAS = [
    ("crop300", "diffuser", 0.01, "srgb", 6, 1, 1, 3),
    ("sim300", "mla", 0.01, "srgb", 6, 1, 2, 3),
    ("crop300", "contour", 0.005, "srgb", 6, 1, 1, 1),
    ("crop300", "mla", 0.01, "linear", 8, 2, 3, 3),
    ("crop300", "diffuser", 0.005, "srgb", 4, 1, 1, 1),
]
MANY = np.array([[0.77, 0.19, 0.04], [0.13, 0.67, 0.2], [0.04, 0.25, 0.71]])
FEW = np.array([[0.95, 0.05, 0], [0.05, 0.9, 0.05], [0, 0.05, 0.95]])
COLOURS = {"colours": MANY, "few_colours": FEW}
WHITE = 0.8  # the brightest pixel of a camera's frames
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("hadalens", type=pathlib.Path)
parser.add_argument("photographs", type=pathlib.Path)
parser.add_argument("others", type=pathlib.Path)
parser.add_argument("--kinds", default="none,hot,room,rooms,srgb,eight,level,black,exposures,rows,gains,white,corners")
parser.add_argument("--first", type=int, default=900, help="seed of the first camera")
parser.add_argument("--frames", action="store_true")
parser.add_argument("--mosaic", action="store_true")
o = parser.parse_args()


def encoded(light):
    return np.where(light > 0.0031308, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055, 12.92 * light)


def spoil_once(kind, frame, chance):
    sensor = np.random.default_rng(5)
    rows, cols = frame.shape[:2]
    shape = (rows, cols) + (1,) * (frame.ndim - 2)
    y, x = (np.mgrid[:rows, :cols] / np.array([rows, cols])[:, None, None]).reshape(2, *shape)
    if kind in COLOURS:
        return frame @ COLOURS[kind].T if frame.ndim == 3 else frame
    if kind == "hot":
        return np.where(sensor.random(shape) < 0.001, 1.0, frame)
    if kind == "room":
        return frame + 0.05 + 0.08 * x + 0.04 * y
    if kind == "rooms":
        return frame + chance.uniform(0.01, 0.15) * (0.5 + chance.uniform(0, 1) * x + 0.4 * y)
    if kind == "exposures":
        return frame * chance.uniform(0.7, 1.4)
    if kind == "balance":
        gains = np.exp(chance.normal(0, 0.1, 3))
        return frame * gains / gains[1] if frame.ndim == 3 else frame
    if kind == "rows":
        return frame + chance.normal(0, 0.01, (rows, *(1,) * (frame.ndim - 1)))
    if kind == "gains":
        return frame * (1 + sensor.normal(0, 0.02, shape))
    if kind == "white":
        return np.minimum(frame, np.quantile(frame, 0.95))
    if kind == "corners":
        return frame * (1 - 1.2 * ((x - 0.5) ** 2 + (y - 0.5) ** 2))
    if kind == "level":
        return 0.9 * frame + 0.06
    if kind in ("stray", "dim"):
        return frame + 0.03 if kind == "stray" else 0.7 * frame
    return frame


def spoil(kinds, frame, chance):
    """The frame, at most WHITE, as a poor sensor gives it."""
    for kind in kinds.split("+"):
        frame = spoil_once(kind, frame, chance)
    if kind in ("srgb", "eight"):
        return (np.clip(encoded(np.clip(frame, 0, 1)) if kind == "srgb" else frame, 0, 1) * 255 + 0.5).astype(np.uint8)
    if kind in ("level", "black", "ten"):
        return (np.clip(frame, 0, 1) * (1023 if kind == "ten" else 65535) + 0.5).astype(np.uint16)
    return frame.astype(np.float32)


def mosaic(frame):
    """What the pixels of a mosaic RGGB hold of a frame in colour."""
    rows, cols = np.mgrid[: frame.shape[0], : frame.shape[1]] % 2
    return np.take_along_axis(frame, (rows + cols)[..., None], 2)[..., 0]


def measure(camera, kind, folder):
    poor = folder / kind
    shutil.copytree(camera, poor)
    raws = sorted(poor.glob("z*mm/raw/*.tif")) + sorted((poor / "test/raw").iterdir())
    brightest = max(tifffile.imread(raw).max() for raw in raws)
    chance = np.random.default_rng(77)
    for raw in raws:
        sound = o.frames and raw.parent.parent.name != "test"
        frame = spoil("none" if sound else kind, tifffile.imread(raw) / brightest * WHITE, chance)
        frame = mosaic(frame) if o.mosaic else frame
        tifffile.imwrite(raw, frame, photometric="rgb" if frame.ndim == 3 else "minisblack")
    model, out = folder / f"{kind}.model", folder / f"{kind}.out"
    run(o.hadalens, "fit", poor, "-o", model, "-q", *(["--bayer", "rggb"] if o.mosaic else []))
    try:
        run(o.hadalens, "reconstruct", *sorted((poor / "test/raw").iterdir()), "-m", model, "-o", out, "--no-preview", "-q")
    except SystemExit:  # a frame whose planes came out black
        return np.nan
    table = json.loads(run(o.hadalens, "evaluate", out, camera / "test/truth", "--match-gain", "--json"))
    return np.mean([row["psnr"] for row in table["files"] if row["kind"] == "images"])


kinds = o.kinds.split(",")
print("| camera | " + " | ".join(kinds) + " |\n|" + "---|" * (len(kinds) + 1))
for number, (preset, mask, noise, scenes, pairs, occupied, depths, channels) in enumerate(CAMERAS):
    channels = 3 if o.mosaic else channels
    with tempfile.TemporaryDirectory() as name:
        camera = pathlib.Path(name) / "camera"
        run(o.hadalens, "simulate", "-o", camera, "--preset", preset, "--mask", mask, "--size", "200x260", "--noise", noise,
            "--scene-response", scenes, "--pairs", pairs, "--depths", depths, "--channels", channels, "--scenes", o.photographs,
            "--test-scenes", o.others, "--test", 4, "--test-depths", occupied, "--seed", o.first + number, "-q")
        values = [measure(camera, kind, pathlib.Path(name)) for kind in kinds]
        print(f"| {preset}, {mask}, {depths} depths, {channels} channels | " + " | ".join(f"{v:.2f}" for v in values) + " |",
              flush=True)
