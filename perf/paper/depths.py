#!/usr/bin/env python3
"""How well are depths told apart? Scenes at one depth, refocused by the linear filters at all of them: how much each
refocused plane looks like the scene (correlation), by its distance from the depth in focus in steps, and how often
pursuit names the depth.
   perf/paper/depths.py [--depths 14]"""
from experiment import Experiment, table

import numpy as np
import tifffile

e = Experiment(__doc__, depths=14, frames=28)
camera = e.camera()
model, _ = e.fit(camera)
frames = sorted((camera / "test" / "raw").glob("*.tif"))
report = e.json("reconstruct", *frames, "-m", model, "-o", e.folder / "linear", "--refine", 0, "--occupied", "all", "--no-preview")
found = e.json("reconstruct", *frames, "-m", model, "-o", e.folder / "auto", "--no-preview")
right, alike = 0, {}
for k, frame in enumerate(frames):
    truth = tifffile.imread(camera / "test" / "truth" / f"{frame.stem}_stack.tif").astype(float)
    planes = tifffile.imread(e.folder / "linear" / f"{frame.stem}_stack.tif").astype(float)
    place = int(np.argmax([np.sum(p**2) for p in truth]))
    for z, plane in enumerate(planes):
        alike.setdefault(abs(z - place), []).append(np.corrcoef(plane.ravel(), truth[place].ravel())[0, 1])
    occupied = found["files"][k]["frames"][0]["occupied_mm"]
    distances = tifffile.imread(camera / "test" / "truth" / f"{frame.stem}_depth.tif")
    right += len(occupied) == 1 and abs(occupied[0] - np.nanmedian(distances)) < 0.01 * occupied[0]
table(["depth steps away", "correlation of that plane with the scene", "lowest", "highest"],
      [[step, *map(float, (np.mean(values), min(values), max(values)))] for step, values in sorted(alike.items())])
print(f"\nPursuit named exactly the one occupied depth in {right} of {len(frames)} frames.")
