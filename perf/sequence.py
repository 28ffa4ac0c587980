#!/usr/bin/env python3
"""Sequences of ten frames through a camera that is known by its PSF alone: decibels and seconds a frame with a weight of
total variation that each frame finds, and with the one that is kept. Moving: a photograph that moves by 3 pixels a
frame; photographs: ten different ones, which should not keep it.
  perf/sequence.py HADALENS PHOTOGRAPHS [--seed 7] [--boundary padded|circular] [--scenes 0 1]
  perf/sequence.py HADALENS PHOTOGRAPHS --warm OTHERS [--depths 1|4] [--noise 0.01] [--films still cut] ...
--warm: refinement that goes on from the frame before (reconstruct --warm) beside refinement from nothing, with a camera
that is learned from pairs which show the OTHERS: still scenes, scenes that move, objects that move before a still
ground, a scene that becomes brighter, a cut; of four depths, the first and the third show half a scene each. Lost, most:
by a frame. Ghost: what is left of what was elsewhere in the frame before, from nothing and warm.
The camera, and noise, are those of psf_only.py. Needs NumPy, tifffile, Pillow."""
import argparse
import json
import pathlib
import shutil
import tempfile

import numpy as np
import tifffile
from PIL import Image

import frames
from psf_only import GRID, NOISE, WINDOW, fit, lenses, optics, save, see

FRAMES = 10


def photograph(path, size):
    return np.moveaxis(np.asarray(Image.fromarray(tifffile.imread(path)).resize((size, size), Image.LANCZOS)), -1, 0) / 255


def moving(photographs, number):
    image = photograph(photographs[3 * number % len(photographs)], WINDOW * 3 // 2)
    return [image[:, 10 + 3 * t // 2:10 + 3 * t // 2 + WINDOW, 8 + 3 * t:8 + 3 * t + WINDOW] for t in range(FRAMES)]


def different(photographs, number):
    return [photograph(photographs[(t + number) % len(photographs)], WINDOW) for t in range(FRAMES)]


def expose(scene, otf, grid, noise, seed):
    clean = see(np.moveaxis(scene, 0, -1), grid, otf)
    return (clean + noise * clean.max() * np.random.default_rng(seed).standard_normal(clean.shape)).astype(np.float32)


DISTANCES = (100, 140, 225, 600)
PAIRS = 12


def shifted(photographs, number, speed):
    image = photograph(photographs[3 * number % len(photographs)], WINDOW * 3 // 2)
    return [image[:, 10 + int(speed * t / 2):, 8 + int(speed * t):][:, :WINDOW, :WINDOW] for t in range(FRAMES)]


def gliding(photographs, number, down, across, fine=10):
    """By parts of a pixel: means over fine x fine pixels."""
    image = photograph(photographs[3 * number % len(photographs)], fine * WINDOW * 3 // 2)
    frames_ = []
    for t in range(FRAMES):
        row, col = fine * 8 + round(fine * down * t), fine * 8 + round(fine * across * t)
        part = image[:, row:row + fine * WINDOW, col:col + fine * WINDOW]
        frames_.append(part.reshape(3, WINDOW, fine, WINDOW, fine).mean((2, 4)))
    return frames_


def objects(photographs, number, size, step, shown):
    """shown(image, place): what stands there of an object on half of a photograph."""
    ground = photograph(photographs[3 * number % len(photographs)], WINDOW) / 2
    scenes = []
    for t in range(FRAMES):
        scene = ground.copy()
        part = scene[:, 40:40 + size, 16 + step * t:16 + step * t + size]
        part[:] = shown(part)
        scenes.append(scene)
    return scenes


def over(scene, t, other):
    scene = scene / 2
    scene[:, 40:64, 16 + 4 * t:40 + 4 * t] = other
    return scene


def flicker(number):
    return 0.9 + 0.05 * np.random.default_rng(number).uniform(-1, 1, FRAMES)


def films(photographs, number):
    """Name and scenes, (3, rows, cols)."""
    other = photograph(photographs[(3 * number + 1) % len(photographs)], 24) / 2 + 0.5
    still = shifted(photographs, number, 0)
    return {"still": still,
            **{f"{speed} pixels a frame": shifted(photographs, number, speed) for speed in (0.5, 1, 3)},
            "gliding by 0.3, 0.4 pixels": gliding(photographs, number, 0.3, 0.4),
            "gliding by 1.2, -0.7 pixels": gliding(photographs, number, 1.2, -0.7),
            "object of 24 pixels": objects(photographs, number, 24, 4, lambda ground: other),
            "object of 6 pixels": objects(photographs, number, 6, 2, lambda ground: ground + 0.3),
            "faint object": objects(photographs, number, 24, 4, lambda ground: ground + 0.05),
            "object before what moves": [over(scene, t, other) for t, scene in enumerate(shifted(photographs, number, 1))],
            "2 % brighter a frame": [scene * (0.8 + 0.02 * t) for t, scene in enumerate(still)],
            "0.5 % brighter a frame": [scene * (0.9 + 0.005 * t) for t, scene in enumerate(still)],
            "flicker of 5 %": [scene * light for scene, light in zip(still, flicker(number))],
            "1 pixel and 2 % brighter a frame": [scene * (0.8 + 0.02 * t)
                                                 for t, scene in enumerate(shifted(photographs, number, 1))],
            "object, flicker of 5 %": [scene * light for scene, light in zip(
                objects(photographs, number, 24, 4, lambda ground: other), flicker(number))],
            "cut": still[:FRAMES // 2] + different(photographs, 3 * number + 2)[:1] * (FRAMES - FRAMES // 2)}


def planes_of(scene, depths):
    """A scene at one depth, or its halves at the first and the third."""
    planes = np.zeros((depths, *scene.shape))
    planes[0] = scene
    if depths > 1:
        planes[2, :, :, WINDOW // 2:] = scene[:, :, WINDOW // 2:]
        planes[0, :, :, WINDOW // 2:] = 0
    return planes


def look(planes, otfs, grid, noise, seed):
    clean = sum(see(np.moveaxis(plane, 0, -1), grid, otf) for plane, otf in zip(planes, otfs))
    return (clean + noise * clean.max() * np.random.default_rng(seed).standard_normal(clean.shape)).astype(np.float32)


def learn(hadalens, folder, arguments, grid):
    """Transfer functions and a model from pairs; spots of farther depths are closer."""
    others = sorted(arguments.warm.glob("*.tif"))
    whole = lenses(arguments.seed, grid)
    otfs = []
    for depth in range(arguments.depths):
        image = whole if not depth else np.stack([scaled(channel, 1 - 0.05 * depth) for channel in whole])
        otfs.append(np.fft.rfft2(np.fft.ifftshift(image, axes=(1, 2))))
        for k in range(PAIRS):
            scene = photograph(others[(k * arguments.depths + depth + arguments.seed) % len(others)], WINDOW)
            pair = folder / "pairs" / f"z{DISTANCES[depth]}mm"
            save(pair / "raw" / f"p{k}.tif", look([scene], [otfs[-1]], grid, arguments.noise, 1000 * depth + k))
            save(pair / "scene" / f"p{k}.tif", scene.astype(np.float32))
    frames.run(hadalens, "fit", folder / "pairs", "--window", f"{WINDOW}x{WINDOW}", "--boundary", arguments.boundary,
               "-o", folder / "camera.model")
    return otfs, folder / "camera.model"


def scaled(image, times):
    """An image smaller by a factor, round its middle pixel, of the same sum."""
    rows, cols = image.shape
    small = Image.fromarray(image.astype(np.float32)).transform(
        image.shape[::-1], Image.AFFINE, (1 / times, 0, cols // 2 * (1 - 1 / times), 0, 1 / times, rows // 2 * (1 - 1 / times)),
        Image.BICUBIC)
    small = np.clip(np.asarray(small, float), 0, None)
    return small / small.sum()


def ghost(image, before, now):
    """What of the difference that left is still there."""
    left = before - now
    return ((image - now) * left).sum() / (left**2).sum()


def warm_starts(arguments, photographs):
    grid, depths = GRID[arguments.boundary], arguments.depths
    shown = [0, 2] if depths > 1 else [0]
    print("| scenes | from nothing | warm | lost, most | ghost |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        otfs, model = learn(arguments.hadalens, folder, arguments, grid)
        for kind in arguments.films or films(photographs, 0):
            found = {"cold": [], "warm": []}  # decibels, seconds, steps, ghost
            for number in arguments.scenes:
                scenes = [planes_of(scene, depths) for scene in films(photographs, number)[kind]]
                seen = [look(s, otfs, grid, arguments.noise, t + 100 * number) for t, s in enumerate(scenes)]
                tifffile.imwrite(folder / "f.tif", np.moveaxis(np.stack(seen), 1, -1), photometric="rgb")
                for way, rows in found.items():
                    shutil.rmtree(folder / "out", ignore_errors=True)
                    report = json.loads(frames.run(arguments.hadalens, "reconstruct", folder / "f.tif", "-m", model, "-o",
                                                   folder / "out", "--no-preview", "--json", "--scene", "planes",
                                                   *["--warm"] * (way == "warm")))["files"][0]["frames"]
                    stack = tifffile.imread(folder / "out" / ("f_stack.tif" if depths > 1 else "f_aif.tif"))
                    stack = stack.astype(float).reshape(FRAMES, depths, *stack.shape[-3:])
                    stack = np.moveaxis(stack, -1, 2) if stack.shape[-1] == 3 else stack
                    for t in range(2, FRAMES):
                        image, scene = np.clip(stack[t][shown], 0, 1), scenes[t][shown]
                        rows.append((-10 * np.log10(np.mean((image - scene) ** 2)), report[t]["seconds"]["total"],
                                     report[t]["refine_steps"],
                                     ghost(image, scenes[t - 1][shown], scene) if "object" in kind else np.nan))
            cold, warm = np.array(found["cold"]), np.array(found["warm"])
            cells = [f"{rows[:, 0].mean():.2f} dB, {1e3 * np.median(rows[:, 1]):.0f} ms, {rows[:, 2].mean():.1f} steps"
                     for rows in (cold, warm)]
            lost = cold[:, 0] - warm[:, 0]
            there = f"{cold[:, 3].mean():.1%}, {warm[:, 3].mean():.1%}" if "object" in kind else ""
            print(f"| {kind} | {cells[0]} | {cells[1]} | {lost.mean():.2f}, {lost.max():.2f} dB | {there} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hadalens")
    parser.add_argument("photographs", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--scenes", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--boundary", choices=GRID, default="padded")
    parser.add_argument("--warm", type=pathlib.Path, metavar="OTHERS")
    parser.add_argument("--depths", type=int, choices=(1, len(DISTANCES)), default=1)
    parser.add_argument("--films", nargs="+", help="those of the names in the table, as \"still\"; default: all")
    parser.add_argument("--noise", type=float, default=0.01)
    arguments = parser.parse_args()
    photographs = sorted(arguments.photographs.glob("*.tif"))
    photographs = photographs[arguments.seed % len(photographs):] + photographs[:arguments.seed % len(photographs)]
    if arguments.warm:
        warm_starts(arguments, photographs)
        return
    grid = GRID[arguments.boundary]
    print("| scenes | noise | each frame | kept | lost, most | kept by |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        out, file, otf = folder / "out", folder / "f.tif", optics(folder, arguments.seed, grid)
        model = fit(arguments.hadalens, folder, "--boundary", arguments.boundary)
        for kind in (moving, different):
            for noise in NOISE:
                found = {"frame": [], "auto": []}  # decibels, seconds, kept
                for number in arguments.scenes:
                    scenes = kind(photographs, number)
                    seen = [expose(s, otf, grid, noise, t + 100 * number) for t, s in enumerate(scenes)]
                    tifffile.imwrite(file, np.moveaxis(np.stack(seen), 1, -1), photometric="rgb")
                    for way, rows in found.items():
                        report = json.loads(frames.run(arguments.hadalens, "reconstruct", file, "-m", model, "-o", out,
                                                       "--no-preview", "--json", "--refine-tv", way))
                        images = np.moveaxis(tifffile.imread(out / "f_aif.tif").astype(float), -1, 1)
                        rows += [(-10 * np.log10(np.mean((np.clip(image, 0, 1) - scene) ** 2)), frame["seconds"]["total"],
                                  frame["refine_tv_kept"])
                                 for image, scene, frame in zip(images, scenes, report["files"][0]["frames"])]
                each, kept = np.array(found["frame"]), np.array(found["auto"])
                lost = each[:, 0] - kept[:, 0]
                print(f"| {kind.__name__} | {noise} | {each[:, 0].mean():.2f} dB, {each[:, 1].mean():.2f} s | "
                      f"{kept[:, 0].mean():.2f} dB, {kept[:, 1].mean():.2f} s | {lost.mean():.2f}, {lost.max():.2f} dB | "
                      f"{kept[:, 2].mean():.0%} |", flush=True)


if __name__ == "__main__":
    main()
