#!/usr/bin/env python3
"""Golden numbers for tests/unit/test_lpips.c, from PyTorch in double precision.

    pip install numpy torch
    python3 tests/golden/make_lpips_golden.py > tests/golden/lpips.txt
"""
import torch
from torch_lpips import NETS, distances, hashed, hashed_weights, spatial, whole

print(f"# PyTorch {torch.__version__}; made by tests/golden/make_lpips_golden.py")
print("# net channels rows cols lpips masked largest")
for net in NETS:
    weights = hashed_weights(net)
    for channels, rows, cols in {"vgg": [(3, 16, 16), (3, 33, 42), (1, 24, 19)],
                                 "alex": [(3, 31, 31), (3, 67, 50), (1, 64, 48)]}[net]:
        count = channels * rows * cols
        a = torch.from_numpy(hashed(201, count)).double() + 0.5
        b = 0.75 * a + 0.25 * (torch.from_numpy(hashed(202, count)).double() + 0.5)
        a, b = (x.reshape(1, channels, rows, cols) for x in (a, b))
        maps = distances(net, weights, a, b)
        pixels = spatial(maps, rows, cols)
        mask = (torch.arange(rows)[:, None] + 2 * torch.arange(cols)[None]) % 5 < 2
        print(net, channels, rows, cols, *(f"{v:.12g}" for v in
              (whole(maps), float(pixels[mask].mean()), float(pixels.max()))))
