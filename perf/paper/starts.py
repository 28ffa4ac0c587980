#!/usr/bin/env python3
"""Do random starts matter? Filters trained by gradients from many seeds, both forms, against the exact fit and the fit
that judges the window: quality on frames that no training has seen, and time (the paper's claim that no initialisation
is needed).
   perf/paper/starts.py [--seeds 20] [--filter-steps 600]"""
from experiment import Experiment, spread, table

e = Experiment(__doc__, seeds=20, filter_steps=600)
o = e.options
camera = e.camera()
rows = []
for form in ("complex", "split"):
    exact, exact_seconds = e.fit(camera, "--form", form, "--outside", 1)
    exact_score = e.score(camera, exact, "--refine", 0)["psnr"]
    judged, judged_seconds = e.fit(camera, "--form", form, "--refine", 0)
    scores, seconds = [], []
    for seed in range(1, o.seeds + 1):
        model, took, _ = e.train(camera, "-m", exact, "--form", form, "--stage", "filters", "--random", "--steps",
                                 o.filter_steps, "--seed", seed, "--quiet")
        scores.append(e.score(camera, model, "--refine", 0)["psnr"])
        seconds.append(took)
    mean, low, high, _ = spread(scores)
    rows.append([form, o.seeds, mean, low, high, high - low, sum(seconds) / len(seconds), exact_score, exact_seconds,
                 e.score(camera, judged)["psnr"], judged_seconds])
table(["form", "seeds", "mean PSNR, dB", "worst", "best", "best - worst", "training, s", "exact fit, dB", "s",
       "judged in the window, dB", "s"], rows)
