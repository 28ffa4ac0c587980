#!/usr/bin/env python3
"""Weights for LPIPS without a download: AlexNet with seeded random weights (He's), all features counting alike. Distances by
random features rank sharp and blurred images as the published ones do (Zhang et al., CVPR 2018, Fig. 4: "Random"), but
their values compare with nothing else: the experiments call them "LPIPS, random features".
   perf/paper/random_features.py FILE.safetensors"""
import json
import struct
import sys

import numpy as np

LAYERS = [(0, 64, 3, 11), (3, 192, 64, 5), (6, 384, 192, 3), (8, 256, 384, 3), (10, 256, 256, 3)]
random = np.random.default_rng(1)
tensors = {}
for head, (place, out, channels, kernel) in enumerate(LAYERS):
    fan = channels * kernel * kernel
    tensors[f"features.{place}.weight"] = random.normal(0, (2 / fan) ** 0.5, (out, channels, kernel, kernel))
    tensors[f"features.{place}.bias"] = np.zeros(out)
    tensors[f"lin{head}.model.1.weight"] = np.ones((1, out, 1, 1))
head, data = {}, b""
for name, values in tensors.items():
    part = values.astype("<f4").tobytes()
    head[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [len(data), len(data) + len(part)]}
    data += part
text = json.dumps(head).encode()
text += b" " * (-len(text) % 8)
with open(sys.argv[1], "wb") as file:
    file.write(struct.pack("<Q", len(text)) + text + data)
