#!/usr/bin/env python3
"""Weights of LPIPS from PyTorch's files to the safetensors file that `hadalens evaluate --lpips` takes.

    pip install torch safetensors
    python3 convert_lpips.py BACKBONE.pth HEADS.pth -o vgg.safetensors

BACKBONE.pth: torchvision's weights of VGG-16 or AlexNet, such as vgg16-397923af.pth or alexnet-owt-7be5be79.pth (in
~/.cache/torch/hub/checkpoints once torchvision has loaded them). HEADS.pth: those of the package `lpips`, such as
lpips/weights/v0.1/vgg.pth in its folder. One file that holds both, a saved state dict of lpips.LPIPS, will do as well.
"""

from __future__ import annotations

import argparse
import re
import sys

import torch
from safetensors.torch import save_file

HEAD = re.compile(r"lin[0-4]\.model\.1\.weight")
PACKAGE = re.compile(r"net\.slice\d+\.(\d+\.(weight|bias))")


def take(path: str, into: dict[str, torch.Tensor]) -> None:
    """Add the tensors of a file, by torchvision's names."""
    for name, value in torch.load(path, map_location="cpu", weights_only=True).items():
        inside = PACKAGE.fullmatch(name)
        if inside:
            name = "features." + inside[1]
        if name.startswith("features.") or HEAD.fullmatch(name):
            into[name] = value.detach().float().contiguous()


def main() -> None:
    """Convert what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE.pth")
    parser.add_argument("-o", "--output", required=True, metavar="FILE.safetensors")
    arguments = parser.parse_args()
    weights: dict[str, torch.Tensor] = {}
    for file in arguments.files:
        take(file, weights)
    heads = sum(name.startswith("lin") for name in weights)
    if heads != 5 or len(weights) not in (5 + 10, 5 + 26):
        sys.exit(
            f"{heads} heads and {len(weights) - heads} other tensors: give the backbone (features.*) and the heads "
            "(lin0 to lin4) of one net"
        )
    save_file(weights, arguments.output)
    print(f"{arguments.output}: {'AlexNet' if len(weights) == 15 else 'VGG-16'}, {heads} heads")


if __name__ == "__main__":
    main()
