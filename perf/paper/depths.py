#!/usr/bin/env python3
"""How well are depths told apart? One plane is shown at each depth in turn; the share of light that linear planes of the
other depths hold, by steps of distance, and how often the found depth is right, linear and with pursuit.
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
right, share = 0, {}
for k, frame in enumerate(frames):
    truth = tifffile.imread(camera / "test" / "truth" / f"{frame.stem}_stack.tif").astype(float)
    planes = tifffile.imread(e.folder / "linear" / f"{frame.stem}_stack.tif").astype(float)
    place = int(np.argmax([np.sum(p**2) for p in truth]))
    energy = np.array([np.sum(p**2) for p in planes])
    for z, value in enumerate(energy / energy[place]):
        share.setdefault(abs(z - place), []).append(value)
    occupied = found["files"][k]["frames"][0]["occupied_mm"]
    distances = tifffile.imread(camera / "test" / "truth" / f"{frame.stem}_depth.tif")
    right += len(occupied) == 1 and abs(occupied[0] - np.nanmedian(distances)) < 0.01 * occupied[0]
table(["depth steps away", "energy of that linear plane, relative to the plane in focus"],
      [[step, float(np.mean(values))] for step, values in sorted(share.items())])
print(f"\nPursuit named exactly the one occupied depth in {right} of {len(frames)} frames.")
