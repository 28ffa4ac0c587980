#!/usr/bin/env python3
"""Does enhancement help beyond its own spread? Nets from several seeds behind the same refined filters, on frames that no
training has seen: with a squared error alone, and with the adversarial stage after it. Sharpness is the mean length of
the gradient, which noise raises; "apart" is how far it is from the truth's, |log(sharpness / truth's)|, frame by frame.
   perf/paper/seeds.py [--seeds 5] [--noise 0.03] [--steps 500] [--adversarial-steps 300] [--critic patch]
                       [--adversarial-words "--adversarial 2e-3 --rate 2e-4"]: more options of that stage"""
from experiment import Experiment, spread, table

e = Experiment(__doc__, seeds=5, steps=500, adversarial_steps=300, critic="patch", pairs=40, adversarial_words="")
o = e.options
camera = e.camera()
exact, _ = e.fit(camera)
before = e.score(camera, exact, name="refined")
MEASURES = {"psnr": "PSNR, dB", "ssim": "SSIM", "sharpness": "sharpness", "apart": "apart from the truth's", "lpips": "LPIPS"}
enhanced, sharp = [], []
for seed in range(1, o.seeds + 1):
    net, _, _ = e.train(camera, "-m", exact, "--stage", "enhance", "--steps", o.steps, "--seed", seed, "--quiet")
    enhanced.append(e.score(camera, net, name=f"enhanced-{seed}"))
    if o.adversarial_steps:
        net, _, _ = e.train(camera, "-m", net, "--stage", "adversarial", "--critic", o.critic, "--steps",
                            o.adversarial_steps, "--seed", seed, "--quiet", *o.adversarial_words.split())
        sharp.append(e.score(camera, net, name=f"adversarial-{seed}"))
rows = []
for key, what in MEASURES.items():
    for name, scores in (("squared error alone", enhanced), ("adversarial", sharp)):
        if scores:
            mean, low, high, _ = spread([s[key] for s in scores])
            rows.append([what, name, before[key], mean, low, high, high - low, mean - before[key]])
rows.append(["sharpness", "truth", before["sharpness_truth"], *[float("nan")] * 5])
table(["measure", "training", "refined, no net", "mean of seeds", "lowest", "highest", "spread", "difference"], rows)
