#!/usr/bin/env python3
"""Is a net enough? A conventional net from the raw frame to the image (Appendix C), against the same net behind filters
that were fitted exactly: parameters, training time, quality on pairs that neither the fit nor the nets have seen. The
camera has one depth, since such a net gives one image.
   perf/paper/conventional.py [--steps 600]"""
from experiment import Experiment, table

e = Experiment(__doc__, depths=1, pairs=48, frames=1, steps=600)
o = e.options
camera = e.camera()
_, _, behind = e.train(camera, "--stage", "enhance", "--steps", o.steps, "--quiet")
_, _, alone = e.train(camera, "--stage", "conventional", "--steps", o.steps, "--quiet")
filters = 2 * 3 * int(o.size.split("x")[0]) * (int(o.size.split("x")[1]) // 2 + 1)


def row(name, values, seconds, score):
    return [name, values, seconds, score["psnr"], score["ssim"], score["mae"], score["sharpness"]]


def best(said):
    return max(said["validation"], key=lambda v: v["psnr"])


table(["way", "parameters", "training, s", "PSNR, dB", "SSIM", "MAE", "sharpness"], [
    row("exact fit, what it chose of refinement", filters, float("nan"), best(behind)["before"]),
    row("the same, enhanced", filters + behind["net_values"], behind["seconds"], best(behind)),
    row("a net alone, from the raw frame", alone["net_values"], alone["seconds"], best(alone))])
print(f"\n{behind['pairs']} pairs to learn from, {behind['held_out']} held out; {o.steps} steps each.")
