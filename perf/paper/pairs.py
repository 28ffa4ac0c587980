#!/usr/bin/env python3
"""How many pairs does a camera need? Quality on unseen frames against the number of pairs a depth, for filters trained
by gradients, the exact fit, and refinement.
   perf/paper/pairs.py [--counts 1,2,4,8,16,32]"""
from experiment import Experiment, table

e = Experiment(__doc__, counts="1,2,4,8,16,32", filter_steps=600)
o = e.options
rows = []
for count in map(int, o.counts.split(",")):
    camera = e.camera(f"camera{count}", count)
    exact, seconds = e.fit(camera, "--outside", 1)
    trained, trained_seconds, _ = e.train(camera, "-m", exact, "--stage", "filters", "--random", "--steps", o.filter_steps, "--quiet")
    rows.append([count, e.score(camera, trained, "--refine", 0)["psnr"], trained_seconds,
                 e.score(camera, exact, "--refine", 0)["psnr"], seconds, e.score(camera, exact)["psnr"]])
table(["pairs a depth", "by gradients, dB", "s", "exact fit, dB", "s", "refined, dB"], rows)
