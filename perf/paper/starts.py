#!/usr/bin/env python3
"""Do random starts matter? Filters trained by gradients from many seeds, both forms, against the exact fit: quality on
frames that no training has seen, and time (the paper's claim that no initialisation is needed).
   perf/paper/starts.py [--seeds 20] [--filter-steps 600]"""
from experiment import Experiment, spread, table

e = Experiment(__doc__, seeds=20, filter_steps=600)
o = e.options
camera = e.camera()
rows = []
for form in ("complex", "split"):
    exact, exact_seconds = e.fit(camera, "--form", form)
    exact_score = e.score(camera, exact, "--refine", 0)["psnr"]
    scores, seconds = [], []
    for seed in range(1, o.seeds + 1):
        model, took, _ = e.train(camera, "-m", exact, "--form", form, "--stage", "filters", "--random", "--steps",
                                 o.filter_steps, "--seed", seed, "--quiet")
        scores.append(e.score(camera, model, "--refine", 0)["psnr"])
        seconds.append(took)
    mean, low, high, _ = spread(scores)
    rows.append([form, o.seeds, mean, low, high, high - low, exact_score, sum(seconds) / len(seconds), exact_seconds,
                 sum(seconds) / len(seconds) / exact_seconds])
table(["form", "seeds", "mean PSNR, dB", "worst", "best", "best - worst", "exact fit, dB", "training, s", "exact fit, s",
       "times as long"], rows)
