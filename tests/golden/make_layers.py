#!/usr/bin/env python3
"""Layers, losses, optimisers and learning rates by PyTorch in double precision, for test_net_layers_golden.c.

    pip install torch safetensors
    python3 tests/golden/make_layers.py        # writes layers.safetensors beside it

A case NAME holds NAME.x (the input), NAME.y (what comes out), NAME.dy (a gradient of y) and NAME.dx (that of x), and what
else its kind needs.
"""
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file

torch.set_default_dtype(torch.float64)
torch.manual_seed(2022)
OUT = {}


def keep(case, **tensors):
    for name, tensor in tensors.items():
        OUT[f"{case}.{name}"] = torch.as_tensor(tensor).detach().clone().contiguous()


def layer(case, function, x, **inputs):
    """x through the function, and back; inputs: further tensors with gradients."""
    x = x.clone().requires_grad_()
    inputs = {name: value.clone().requires_grad_() for name, value in inputs.items()}
    y = function(x, **inputs)
    dy = torch.randn_like(y)
    y.backward(dy)
    keep(case, x=x, y=y, dy=dy, dx=x.grad, **inputs, **{"d" + name: value.grad for name, value in inputs.items()})


def image(*shape):
    return torch.randn(*shape)


# activations
layer("relu", torch.relu, image(2, 2, 3, 4))
layer("leaky", lambda x: F.leaky_relu(x, 0.2), image(2, 2, 3, 4))
layer("sigmoid", torch.sigmoid, 3 * image(2, 2, 3, 4))

# pooling; few different values, so that windows hold equal ones
for size, stride in ((2, 2), (3, 2), (3, 1), (2, 3)):
    few = torch.randint(-2, 3, (1, 2, 8, 9)).double()
    layer(f"max_pool_{size}_{stride}", lambda x: F.max_pool2d(x, size, stride), few)
    layer(f"mean_pool_{size}_{stride}", lambda x: F.avg_pool2d(x, size, stride), image(1, 2, 8, 9))

# resizing
for name, mode in (("nearest", "nearest"), ("linear", "bilinear"), ("cubic", "bicubic")):
    for aligned in (False, True):
        if aligned and mode == "nearest":
            continue
        for rows, cols, to_rows, to_cols in ((5, 7, 13, 16), (9, 8, 4, 5), (4, 5, 8, 10), (1, 3, 2, 1)):
            options = {} if mode == "nearest" else {"align_corners": aligned}
            layer(f"{name}_{int(aligned)}_{rows}_{cols}_{to_rows}_{to_cols}",
                  lambda x: F.interpolate(x, size=(to_rows, to_cols), mode=mode, **options), image(1, 2, rows, cols))

# placing in channels 2 ... 4 of 6, padded at the top left, cropped at the bottom right: rows 1, columns -2 of 4 x 5
def place(x):
    whole = F.pad(x, (-2, 5 - (x.shape[3] - 2), 1, 4 - x.shape[2] - 1))
    zeros = torch.zeros(x.shape[0], 6, 4, 5)
    return torch.cat((zeros[:, :2], whole, zeros[:, 5:]), 1)


layer("place", place, image(2, 3, 5, 6))

# batch normalisation
norm = torch.nn.BatchNorm2d(3, eps=1e-3, momentum=0.25)
with torch.no_grad():
    norm.weight.copy_(torch.randn(3)), norm.bias.copy_(torch.randn(3))
    norm.running_mean.copy_(torch.randn(3)), norm.running_var.copy_(torch.rand(3) + 0.5)
keep("norm", mean=norm.running_mean, variance=norm.running_var)
x = image(2, 3, 4, 5)
keep("norm", infer=norm.eval()(x))
norm.train()
layer("norm", lambda x, weight, bias: F.batch_norm(x, norm.running_mean, norm.running_var, weight, bias, True,
                                                    norm.momentum, norm.eps), x, weight=norm.weight.data,
      bias=norm.bias.data)
keep("norm", mean_after=norm.running_mean, variance_after=norm.running_var)

layer("linear", lambda x, weight, bias: F.linear(x, weight, bias), image(3, 7), weight=image(4, 7), bias=image(4))


# losses
def variation(x, squared):
    down, right = x[:, :, 1:] - x[:, :, :-1], x[:, :, :, 1:] - x[:, :, :, :-1]
    measure = torch.square if squared else torch.abs
    return (measure(down).sum() + measure(right).sum()) / x.shape[0]


def ssim(x, t, peak=1.0):
    line = torch.exp(-0.5 * (torch.arange(11) - 5.0) ** 2 / 1.5**2)
    window = torch.outer(line, line) / line.sum() ** 2

    def mean(v):
        return F.conv2d(v.flatten(0, 1).unsqueeze(1), window[None, None])

    mx, my = mean(x), mean(t)
    vx, vy, vxy = mean(x * x) - mx * mx, mean(t * t) - my * my, mean(x * t) - mx * my
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    return 1 - ((2 * mx * my + c1) * (2 * vxy + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2))).mean()


def loss(case, function, x, t, weight=1.5):
    x = x.clone().requires_grad_()
    value = weight * function(x, t)
    value.backward()
    keep(case, x=x, t=t, value=value.reshape(1), dx=x.grad)


loss("mse", F.mse_loss, image(2, 2, 3, 4), image(2, 2, 3, 4))
few = torch.randint(-1, 2, (2, 2, 3, 4)).double()
loss("l1", F.l1_loss, few, torch.randint(-1, 2, (2, 2, 3, 4)).double())
loss("logits", F.binary_cross_entropy_with_logits, 5 * image(2, 2, 3, 4), torch.rand(2, 2, 3, 4))
loss("tv", lambda x, t: variation(x, False), few, few)
loss("tv_squared", lambda x, t: variation(x, True), image(2, 2, 3, 4), few)
base = torch.rand(1, 2, 12, 13)
loss("ssim", ssim, base, (base + 0.3 * torch.rand(1, 2, 12, 13)).clamp(0, 1))


# optimisers: four steps, a rate and a gradient each
def optimizer(case, make):
    p = torch.nn.Parameter(torch.randn(6))
    keep(case, p=p)
    steps = make([p])
    gradients, after = [], []
    for step in range(4):
        steps.param_groups[0]["lr"] = 0.01 / (step + 1)
        p.grad = torch.randn(6)
        gradients.append(p.grad.clone())
        steps.step()
        after.append(p.detach().clone())
    keep(case, g=torch.stack(gradients), after=torch.stack(after))


optimizer("rmsprop", lambda p: torch.optim.RMSprop(p))
optimizer("rmsprop_all", lambda p: torch.optim.RMSprop(p, alpha=0.8, eps=1e-3, momentum=0.5, centered=True,
                                                       weight_decay=0.125))
optimizer("adam", lambda p: torch.optim.Adam(p))
optimizer("adam_decay", lambda p: torch.optim.Adam(p, betas=(0.5, 0.9), eps=1e-3, weight_decay=0.125))
optimizer("adamw", lambda p: torch.optim.AdamW(p, eps=1e-3, weight_decay=0.125))

parts = [torch.nn.Parameter(torch.zeros(n)) for n in (5, 9)]
for part in parts:
    part.grad = torch.randn_like(part)
keep("clip", first=parts[0].grad, second=parts[1].grad)
total = torch.nn.utils.clip_grad_norm_(parts, 1.5)
keep("clip", norm=total.reshape(1), first_after=parts[0].grad, second_after=parts[1].grad)


# learning rates, 12 steps
def rates(case, make, warmup):
    steps = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=0.1)
    plan = make(steps)
    if warmup:
        first = torch.optim.lr_scheduler.LinearLR(steps, start_factor=0.25, total_iters=warmup)
        plan = torch.optim.lr_scheduler.SequentialLR(steps, [first, plan], milestones=[warmup])
    values = []
    for _ in range(12):
        values.append(steps.param_groups[0]["lr"])
        steps.step()
        plan.step()
    keep(case, rates=torch.tensor(values))


rates("step", lambda s: torch.optim.lr_scheduler.StepLR(s, 3, 0.5), 0)
rates("step_warm", lambda s: torch.optim.lr_scheduler.StepLR(s, 3, 0.5), 4)
rates("cosine", lambda s: torch.optim.lr_scheduler.CosineAnnealingLR(s, 12, 0.01), 0)
rates("cosine_warm", lambda s: torch.optim.lr_scheduler.CosineAnnealingLR(s, 9, 0.01), 3)

save_file(OUT, Path(__file__).parent / "layers.safetensors", metadata={"made by": f"PyTorch {torch.__version__}"})
