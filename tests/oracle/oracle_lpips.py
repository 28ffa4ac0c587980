#!/usr/bin/env python3
"""LPIPS of `hadalens evaluate --lpips` against PyTorch (torch_lpips.py) and, where it is installed, the authors' package
`lpips` with its own heads, both with the same backbone. Usage: oracle_lpips.py HADALENS"""
import json
import os
import subprocess
import sys
import tempfile
import warnings

try:
    import numpy as np
    import tifffile
    import torch
    from safetensors.torch import save_file
except ImportError as missing:
    print("skipped:", missing)
    sys.exit(77)

import torch_lpips

try:
    warnings.simplefilter("ignore")
    import lpips
except ImportError:
    lpips = None

torch.manual_seed(7)
failures = 0


def compare(what, got, want):
    global failures
    error = abs(got - want) / want
    failures += not error < 5e-6
    print(f"{what}: {got:.9g}, relative error {error:.1e}")


def evaluate(folder, *options):
    run = subprocess.run([sys.argv[1], "evaluate", f"{folder}/b.tif", f"{folder}/a.tif", "--json", "--lpips", *options],
                         capture_output=True, text=True)
    if run.returncode:
        sys.exit(run.stderr)
    return json.loads(run.stdout)["files"][0]["lpips"]


def write_pair(folder, rows, cols):
    a = torch.nn.functional.interpolate(torch.rand(1, 3, 12, 14), size=(rows, cols), mode="bicubic").clamp(0, 1)
    b = (a + 0.1 * torch.randn_like(a)).clamp(0, 1)
    for name, image in ("a", a), ("b", b):
        tifffile.imwrite(f"{folder}/{name}.tif", image[0].permute(1, 2, 0).numpy(), photometric="rgb")
    return a.double(), b.double()


def by_package(net, weights, folder):
    """The package's own heads behind our backbone, and the file that the script for users makes of both."""
    module = lpips.LPIPS(net=net, pnet_rand=True, verbose=False)
    state = module.state_dict()
    for name in state:
        if name.startswith("net."):
            state[name] = weights["features." + name.split(".", 2)[2]]
    module.load_state_dict(state)
    torch.save({**weights, "classifier.0.bias": torch.zeros(2)}, f"{folder}/backbone.pth")  # as torchvision's
    heads = os.path.join(os.path.dirname(lpips.__file__), "weights", "v0.1", f"{net}.pth")
    script = os.path.join(os.path.dirname(__file__), "..", "..", "examples", "convert_lpips.py")
    subprocess.run([sys.executable, script, f"{folder}/backbone.pth", heads, "-o", f"{folder}/package.safetensors"],
                   check=True)
    return module.double()


with tempfile.TemporaryDirectory() as folder:
    for net, rows, cols in ("alex", 96, 120), ("vgg", 80, 99):
        weights = torch_lpips.hashed_weights(net)
        save_file(weights, f"{folder}/both.safetensors")
        a, b = write_pair(folder, rows, cols)
        with torch.no_grad():
            compare(f"{net} against PyTorch", evaluate(folder, f"{folder}/both.safetensors"),
                    torch_lpips.whole(torch_lpips.distances(net, weights, a, b)))
            mask = np.zeros((rows, cols), np.uint8)
            mask[10:50, 20:33] = 1
            tifffile.imwrite(f"{folder}/mask.tif", mask)
            pixels = torch_lpips.spatial(torch_lpips.distances(net, weights, a, b), rows, cols)
            compare(f"{net} with a mask",
                    evaluate(folder, f"{folder}/both.safetensors", "--mask", f"{folder}/mask.tif"),
                    float(pixels[torch.from_numpy(mask) > 0].mean()))
            if lpips:
                module = by_package(net, weights, folder)
                compare(f"{net} against the package", evaluate(folder, f"{folder}/package.safetensors"),
                        float(module(a, b, normalize=True)))
print("the package lpips is", "installed" if lpips else "not installed: compared with PyTorch alone")
sys.exit(failures != 0)
