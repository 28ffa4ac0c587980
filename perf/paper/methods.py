#!/usr/bin/env python3
"""Every way from a frame to an image, on frames that no training has seen: the transposed convolution (Eq. 2), a Wiener
filter, filters trained by gradients from a random start (split, Eq. 3 to the letter, and complex), the exact fit of
both, filters judged in the window, refinement, enhancement with a squared error and with the adversarial stage. Scenes at one depth, as on a display,
and at two. Quality beside training time.
   perf/paper/methods.py [--scenes FOLDER --test-scenes FOLDER] [--lpips FILE] [--pictures FOLDER]"""
from experiment import Experiment, table

e = Experiment(__doc__, filter_steps=600, steps=500, adversarial_steps=300, critic="patch", pairs=40)
o = e.options
one = e.camera("one")
two = e.camera("two", 1, 2)

split, split_seconds = e.fit(one, "--form", "split", "--outside", 1)
exact, exact_seconds = e.fit(one, "--outside", 1)
judged_split, judged_split_seconds = e.fit(one, "--form", "split", "--refine", 0)
judged, judged_seconds = e.fit(one, "--refine", 0)
filters = ["--stage", "filters", "--random", "--steps", o.filter_steps, "--quiet"]
trained_split, trained_split_seconds, _ = e.train(one, "-m", split, "--form", "split", *filters)
trained, trained_seconds, _ = e.train(one, "-m", exact, *filters)
enhanced, enhanced_seconds, _ = e.train(one, "-m", exact, "--stage", "enhance", "--steps", o.steps, "--quiet")
sharp, sharp_seconds, _ = e.train(one, "-m", enhanced, "--stage", "adversarial", "--critic", o.critic, "--steps",
                                   o.adversarial_steps, "--quiet")

ways = [
    ("transposed convolution (Eq. 2)", exact, exact_seconds, ["--method", "matched"]),
    ("Wiener, OTF from the fit", exact, exact_seconds, ["--method", "wiener"]),
    ("filters by gradients, split (Eq. 3)", trained_split, trained_split_seconds, ["--refine", 0]),
    ("filters by gradients, complex", trained, trained_seconds, ["--refine", 0]),
    ("exact fit, split", split, split_seconds, ["--refine", 0]),
    ("exact fit, complex", exact, exact_seconds, ["--refine", 0]),
    ("judged in the window, split", judged_split, judged_split_seconds, []),
    ("judged in the window, complex", judged, judged_seconds, []),
    ("exact fit, refined", exact, exact_seconds, []),
    ("refined and enhanced", enhanced, exact_seconds + enhanced_seconds, []),
    ("the same, adversarial", sharp, exact_seconds + enhanced_seconds + sharp_seconds, []),
]
for title, camera in (("One depth", one), ("Two depths", two)):
    print(f"\n**{title}**\n")
    rows = []
    for name, model, seconds, more in ways:
        s = e.score(camera, model, *more, name=f"{camera.name}-{len(rows) + 1}")
        rows.append([name, s["psnr"], s["ssim"], s["mae"], s["sharpness"], s["apart"], s["lpips"], s["ms"], seconds])
    rows.append(["truth", float("nan"), float("nan"), float("nan"), s["sharpness_truth"], *[float("nan")] * 4])
    table(["way", "PSNR, dB", "SSIM", "MAE", "sharpness", "apart", "LPIPS", "ms a frame", "training, s"], rows)
