#!/usr/bin/env python3
"""Convolutions and their gradients by PyTorch in double precision, for test_net_conv.c.

    pip install torch safetensors
    python3 tests/golden/make_conv.py        # writes conv.safetensors beside it

A case holds x, w, b, y (without activation), dy, dx, dw, db, and how: stride, padding of rows and columns, transposed,
output padding. Inputs are exact in float32.
"""
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file

torch.manual_seed(2022)
OUT = {}


def single(*shape):
    return torch.randn(*shape, dtype=torch.float32).double()


def case(name, images, channels, out, rows, cols, kernel, stride=1, pad=(0, 0), transposed=0, output_pad=0):
    x = single(images, channels, rows, cols).requires_grad_()
    w = single(*((channels, out) if transposed else (out, channels)), *kernel).requires_grad_()
    b = single(out).requires_grad_()
    if transposed:
        y = F.conv_transpose2d(x, w, b, stride, pad, output_pad)
    else:
        y = F.conv2d(x, w, b, stride, pad)
    dy = single(*y.shape)
    y.backward(dy)
    how = torch.tensor([stride, *pad, transposed, output_pad], dtype=torch.float64)
    for part, value in dict(x=x, w=w, b=b, y=y, dy=dy, dx=x.grad, dw=w.grad, db=b.grad, how=how).items():
        OUT[f"{name}.{part}"] = value.detach().clone().contiguous()


case("same", 2, 2, 3, 5, 7, (3, 3), pad=(1, 1))
case("strided", 1, 3, 2, 8, 9, (3, 3), stride=2, pad=(1, 1))
case("one", 2, 4, 3, 4, 5, (1, 1))
case("large", 1, 2, 2, 7, 6, (5, 5), pad=(2, 2))
case("flat", 1, 2, 3, 6, 8, (1, 3), pad=(0, 1))
case("doubling", 1, 3, 2, 4, 5, (2, 2), stride=2, transposed=1)
case("growing", 2, 2, 3, 4, 3, (3, 3), stride=2, pad=(1, 1), transposed=1, output_pad=1)
case("channels", 1, 16, 16, 12, 12, (3, 3), pad=(1, 1))
save_file(OUT, Path(__file__).with_name("conv.safetensors"))
