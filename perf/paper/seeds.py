#!/usr/bin/env python3
"""Does enhancement help beyond its own spread? Nets from several seeds behind the same refined filters, on frames that no
training has seen: with a squared error alone, and with the adversarial stage after it.
   perf/paper/seeds.py [--seeds 5] [--steps 400] [--adversarial-steps 300]"""
from experiment import Experiment, spread, table

e = Experiment(__doc__, seeds=5, steps=400, adversarial_steps=300)
o = e.options
camera = e.camera()
exact, _ = e.fit(camera)
before = e.score(camera, exact)
MEASURES = ("psnr", "ssim", "sharpness", "lpips")
enhanced, sharp = [], []
for seed in range(1, o.seeds + 1):
    net, _, _ = e.train(camera, "-m", exact, "--stage", "enhance", "--steps", o.steps, "--seed", seed, "--quiet")
    enhanced.append(e.score(camera, net, name=f"enhanced-{seed}"))
    if o.adversarial_steps:
        net, _, _ = e.train(camera, "-m", net, "--stage", "adversarial", "--steps", o.adversarial_steps, "--seed", seed, "--quiet")
        sharp.append(e.score(camera, net, name=f"adversarial-{seed}"))
rows = []
for key in MEASURES:
    for name, scores in (("squared error alone", enhanced), ("adversarial", sharp)):
        if scores:
            mean, low, high, deviation = spread([s[key] for s in scores])
            rows.append([key, name, before[key], mean, low, high, deviation, mean - before[key]])
rows.append(["sharpness", "truth", before["sharpness_truth"], *[float("nan")] * 5])
table(["measure", "training", "refined, no net", "mean of seeds", "lowest", "highest", "standard deviation", "gain"], rows)
