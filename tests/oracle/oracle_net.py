"""Nets against PyTorch: weights written here load there and the other way round; outputs, gradients of weights and
input, and running statistics agree. Argument: the program oracle_net."""
import os
import subprocess
import sys
import tempfile

try:
    import torch
    from safetensors import safe_open
    from safetensors.torch import load_file, save_file
except ImportError as missing:
    print("skipped:", missing)
    sys.exit(77)

import torch_nets

tool = sys.argv[1]
only = sys.argv[2:]
torch.set_num_threads(2)
failures = 0


def run(*arguments):
    subprocess.run([tool, *map(str, arguments)], check=True)


def compare(name, got, want, tolerance):
    global failures
    want = want.detach().double()
    error = float((got.double() - want).norm() / max(float(want.norm()), 1e-30))
    ok = got.shape == want.shape and error <= tolerance
    failures += not ok
    if not ok:
        print(f"  {name}: relative error {error:.2e} above {tolerance:.0e}")
    return error


def check(kind, channels, images, rows, cols, folder, again=False):
    net, data, out = (os.path.join(folder, f + ".safetensors") for f in ("net", "in", "out"))
    run("make", kind, channels, net)
    torch.manual_seed(len(kind) + rows)
    module = {"discriminator": lambda: torch_nets.Discriminator(channels), "patch": lambda: torch_nets.Patches(channels),
              "vgg16": torch_nets.VGG16}.get(kind, lambda: torch_nets.unet(kind, channels))()
    state = load_file(net)
    for name in state:  # biases and statistics that are not 0 and 1
        if state[name].dim() == 1 and not name.startswith("normalize"):
            state[name] = torch.rand_like(state[name]) * 0.5 + (0.5 if "running_var" in name or name == "last.bias" else -0.2)
    if kind == "vgg16":  # as torchvision's file: without the normalisation, with a classifier
        given = {key: value for key, value in state.items() if key.startswith("features")}
        given["classifier.0.weight"] = torch.zeros(4, 25088)
        save_file(given, data)
        run("vgg16", data, net)
        assert all(torch.equal(state[key], value) for key, value in load_file(net).items())
    missing = module.load_state_dict(state, strict=False)
    assert not missing.unexpected_keys and all("num_batches" in k for k in missing.missing_keys), missing
    with safe_open(net, "pt") as file:
        meta = file.metadata()
    save_file(module.state_dict(), net, metadata=meta)  # PyTorch's own file, with its counters, loads here
    module = module.double()
    x = torch.rand(images, channels, rows, cols)
    xd = x.double().requires_grad_(True)
    module.eval()
    with torch.no_grad():
        y = module(x.double())
    save_file({"x": x}, data)
    run("forward", net, data, out)
    # a discriminator's single value is a small difference of many
    tolerance = {"vgg16": 5e-6, "discriminator": 5e-5}.get(kind, 2e-6)
    worst = compare("output", load_file(out)["y"], y, tolerance)
    module.train()
    y = module(xd)
    dy = torch.randn(y.shape)
    y.backward(dy.double())
    save_file({"x": x, "dy": dy}, data)
    run("backward", net, data, out, *(["again"] if again else []))
    got = load_file(out)
    compare("output in training", got["y"], y, max(tolerance, 5e-6))
    worst_gradient = compare("gradient of the input", got["dx"], xd.grad, 1e-5)
    ours, theirs = [], []
    for name, parameter in module.named_parameters():
        # parts may be small differences of large numbers; the whole gradient is not
        compare("gradient of " + name, got["grad." + name], parameter.grad, 1e-4)
        ours.append(got["grad." + name].flatten())
        theirs.append(parameter.grad.flatten())
    worst_gradient = max(worst_gradient, compare("the whole gradient", torch.cat(ours), torch.cat(theirs), 1e-5))
    for name, buffer in module.named_buffers():
        if "running" in name:
            compare(name, got[name], buffer, 1e-5)
    print(f"{kind} {images}x{channels}x{rows}x{cols}{' again' if again else ''}: output {worst:.1e}, "
          f"gradients {worst_gradient:.1e}", flush=True)


cases = [
    ("8,8|16,16|24/16|8", 3, 2, 32, 40, False),
    ("8,8|16,16|24/16|8", 3, 2, 32, 40, True),
    ("5,7|9|11/6|/nearest", 2, 1, 21, 27, False),
    ("16|32|32/32|16/transposed", 3, 1, 24, 32, False),
    ("16|32|32/32|16/transposed", 3, 1, 27, 19, True),
    ("6|10|12/9|/linear/norm", 3, 2, 18, 22, False),
    ("6|10|12/9|/linear/norm", 1, 2, 17, 23, True),
    ("compact", 3, 1, 64, 80, False),
    ("paper", 3, 1, 64, 64, False),
    ("paper", 3, 1, 65, 71, True),
    ("discriminator", 3, 2, 40, 48, False),
    ("patch", 3, 2, 21, 34, False),
    ("vgg16", 3, 1, 64, 64, False),
]
with tempfile.TemporaryDirectory() as folder:
    paper = torch_nets.unet("paper", 3)
    count = sum(p.numel() for p in paper.parameters()) + sum(b.numel() for n, b in paper.named_buffers() if "run" in n)
    print("values of the paper's net:", count)
    failures += count != 3745057
    for case in cases:
        if not only or any(case[0].startswith(o) for o in only):
            check(*case[:5], folder, case[5])
sys.exit(failures != 0)
