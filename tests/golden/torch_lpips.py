"""LPIPS (Zhang et al., CVPR 2018) in PyTorch, written from the paper, with weights that need no download: those of
`hashed()`, which tests/unit/test_lpips.c makes as well."""
import numpy as np
import torch
import torch.nn.functional as F

# (place in torchvision's Sequential, channels, kernel, stride, padding), or (kernel, stride) of a maximum pooling, or
# None where the features are compared
VGG = [(0, 64, 3, 1, 1), (2, 64, 3, 1, 1), None, (2, 2), (5, 128, 3, 1, 1), (7, 128, 3, 1, 1), None, (2, 2),
       (10, 256, 3, 1, 1), (12, 256, 3, 1, 1), (14, 256, 3, 1, 1), None, (2, 2), (17, 512, 3, 1, 1),
       (19, 512, 3, 1, 1), (21, 512, 3, 1, 1), None, (2, 2), (24, 512, 3, 1, 1), (26, 512, 3, 1, 1),
       (28, 512, 3, 1, 1), None]
ALEX = [(0, 64, 11, 4, 2), None, (3, 2), (3, 192, 5, 1, 2), None, (3, 2), (6, 384, 3, 1, 1), None,
        (8, 256, 3, 1, 1), None, (10, 256, 3, 1, 1), None]
NETS = {"vgg": VGG, "alex": ALEX}


def hashed(seed, count):
    """`count` float32 in -0.5 ... 0.5."""
    h = np.arange(count, dtype=np.uint32) * np.uint32(0x9E3779B1) + np.uint32(seed * 0x85EBCA77 & 0xFFFFFFFF)
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39), (15, 1)):
        h = (h ^ (h >> np.uint32(shift))) * np.uint32(factor)
    return ((h >> np.uint32(8)).astype(np.float64) / 2**24 - 0.5).astype(np.float32)


def hashed_weights(net):
    weights, width, seed, head = {}, 3, 0, 0
    for part in NETS[net]:
        if part is None:
            weights[f"lin{head}.model.1.weight"] = (hashed(101 + head, width) + np.float32(0.5)).reshape(1, width, 1, 1)
            head += 1
        elif len(part) == 5:
            number, out, kernel = part[:3]
            fan = width * kernel * kernel
            weights[f"features.{number}.weight"] = \
                (hashed(seed + 1, out * fan) * np.float32((24 / fan) ** 0.5)).reshape(out, width, kernel, kernel)
            weights[f"features.{number}.bias"] = hashed(seed + 2, out) * np.float32(0.25)
            seed, width = seed + 2, out
    return {name: torch.from_numpy(value.copy()) for name, value in weights.items()}


def distances(net, weights, a, b):
    """The maps of the five stages; a and b in 0 ... 1, [1][1 or 3][rows][cols], of any float type."""
    kind = a.dtype
    shift, scale = (torch.tensor(v, dtype=kind).view(1, 3, 1, 1) for v in
                    ((-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)))
    x = torch.cat([a, b]).expand(-1, 3, -1, -1)
    x = ((2 * x - 1) - shift) / scale
    maps = []
    for part in NETS[net]:
        if part is None:
            unit = x / (x.pow(2).sum(1, keepdim=True).sqrt() + 1e-10)
            maps.append(F.conv2d((unit[:1] - unit[1:]) ** 2, weights[f"lin{len(maps)}.model.1.weight"].to(kind)))
        elif len(part) == 5:
            number, _, _, stride, padding = part
            x = F.relu(F.conv2d(x, weights[f"features.{number}.weight"].to(kind),
                                weights[f"features.{number}.bias"].to(kind), stride, padding))
        else:
            x = F.max_pool2d(x, *part)
    return maps


def whole(maps):
    return float(sum(m.mean() for m in maps))


def spatial(maps, rows, cols):
    return sum(F.interpolate(m, size=(rows, cols), mode="bilinear", align_corners=False) for m in maps)[0, 0]
