"""Makes net_*.safetensors: small nets with what PyTorch computes for them, by hand when they are to be made again.
   python3 make_nets.py
Each file holds a net as the library saves it (weights by name, the list of layers in the metadata under "net") and, with
the prefix "golden.": x, dy, and the results y (evaluation), y_training, dx, one gradient per parameter (grad.<name>)
and the running statistics after the step. Computed in float64, stored in float32."""
import json
import os

import torch
import torch_nets
import torch.nn as nn
import torch.nn.functional as F
from safetensors.torch import save_file

folder = os.path.dirname(os.path.abspath(__file__))


def unet_list(channels, down, up, up_by, shared, norm, last_kernel, last_relu):
    """The list of layers of torch_nets.UNet."""
    layers = [{"layer": "input", "channels": 1 if shared else channels}]
    skips = []

    def add(layer):
        layers.append(layer)
        return len(layers) - 1

    def conv(name, out, at, **more):
        return add({"layer": "conv", "name": name, "from": at, "channels": out, **more})

    at = 0
    for level, widths in enumerate(down):
        if level:
            at = add({"layer": "pool", "from": at})
        for i, out in enumerate(widths):
            at = conv(f"down.{level}.{i}", out, at, activation="relu")
        skips.append(at)
    for level, widths in zip(range(len(down) - 2, -1, -1), up):
        if up_by == "transposed":
            at = conv(f"lift.{level}", down[level][-1], at, kernel=2, stride=2, pad=0, transposed=True)
        else:
            at = add({"layer": "resize", "resize": up_by, "from": at, "like": skips[level]})
        at = add({"layer": "concat", "from": [skips[level], at]})
        for i, out in enumerate(widths):
            at = conv(f"up.{level}.{i}", out, at, activation="relu")
    if norm:
        at = add({"layer": "norm", "name": "norm", "from": at})
    conv("last", 1 if shared else channels, at, kernel=last_kernel, pad=last_kernel // 2,
         activation="relu" if last_relu else "none")
    return {"format": "hadalens-net-1", "colours": channels if shared else 1, "layers": layers}


class Small(nn.Module):
    """What U-nets do not have: strides, mean pooling, cubic resizing, activations by themselves, linear layers."""

    def __init__(self):
        super().__init__()
        self.a = nn.Conv2d(2, 6, 3, stride=2, padding=1)
        self.b = nn.Conv2d(6, 10, 5, padding=2)
        self.n = nn.BatchNorm2d(16)
        self.f = nn.Linear(16 * 4 * 3, 5)
        self.g = nn.Linear(5, 2, bias=False)

    def forward(self, x):
        x = F.interpolate(x, size=(18, 14), mode="bicubic", align_corners=False)
        a = F.leaky_relu(self.a(x), 0.1)
        b = torch.sigmoid(self.b(a))
        x = F.relu(self.n(torch.cat([a, b], 1)))
        x = F.avg_pool2d(x, 2)
        return self.g(F.relu(self.f(torch.flatten(x, 1))))[:, :, None, None]


small_list = {"format": "hadalens-net-1", "layers": [
    {"layer": "input", "channels": 2},
    {"layer": "resize", "resize": "cubic", "rows": 18, "cols": 14},
    {"layer": "conv", "name": "a", "channels": 6, "stride": 2},
    {"layer": "activation", "activation": "leaky_relu", "slope": 0.1},
    {"layer": "conv", "name": "b", "channels": 10, "kernel": 5, "pad": 2, "activation": "sigmoid"},
    {"layer": "concat", "from": [3, 4]},
    {"layer": "norm", "name": "n"},
    {"layer": "activation", "activation": "relu"},
    {"layer": "pool", "pool": "mean"},
    {"layer": "linear", "name": "f", "in": 192, "channels": 5, "activation": "relu"},
    {"layer": "linear", "name": "g", "in": 5, "channels": 2, "bias": False}]}


def golden(name, module, description, shape):
    torch.manual_seed(3)
    for parameter in module.parameters():
        parameter.data = torch.randn_like(parameter) * (0.3 if parameter.dim() == 1 else
                                                        (2.0 / parameter[0].numel()) ** 0.5)
    for key, buffer in module.named_buffers():
        if "running" in key:
            buffer.copy_(torch.rand_like(buffer) + (0.5 if "var" in key else -0.5))
    tensors = {key: value.clone() for key, value in module.state_dict().items() if "num_batches" not in key}
    x = torch.rand(shape)
    module = module.double().eval()
    with torch.no_grad():
        tensors["golden.y"] = module(x.double())
    module.train()
    xd = x.double().requires_grad_(True)
    y = module(xd)
    dy = torch.randn(y.shape)
    y.backward(dy.double())
    tensors.update({"golden.x": x, "golden.dy": dy, "golden.y_training": y, "golden.dx": xd.grad})
    tensors.update({"golden.grad." + key: p.grad for key, p in module.named_parameters()})
    tensors.update({"golden." + key: b for key, b in module.named_buffers() if "running" in key})
    tensors = {key: value.detach().float().contiguous() for key, value in tensors.items()}
    save_file(tensors, os.path.join(folder, f"net_{name}.safetensors"), metadata={"net": json.dumps(description)})


def golden_unet(name, shape, channels, down, up, up_by="linear", shared=False, norm=False, last_kernel=1,
                last_relu=False):
    arguments = (channels, down, up, up_by, shared, norm, last_kernel, last_relu)
    golden(name, torch_nets.UNet(*arguments), unet_list(*arguments), shape)


golden_unet("shared", (2, 3, 10, 13), 3, [[4, 5], [6]], [[5]], shared=True, norm=True, last_kernel=3)
golden_unet("transposed", (1, 2, 13, 11), 2, [[16], [8], [8]], [[16], [8]], up_by="transposed")
golden("small", Small(), small_list, (3, 2, 11, 9))
