"""The U-nets of the library in PyTorch, run on request: the other half of perf_unet.
Reads lines "NET MODE CHANNELS ROWS COLS" (compact|paper, forward|train) from standard input; for each, runs once in NCHW
and once in channels_last, and prints the milliseconds of both. Two threads (PEER_THREADS); PEER_DEVICE=cuda runs on a
GPU."""
import os
import sys
import time

import torch
import torch.nn.functional as F

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "tests", "golden"))
import torch_nets  # noqa: E402

torch.set_num_threads(int(os.environ.get("PEER_THREADS", "2")))
device = torch.device(os.environ.get("PEER_DEVICE", "cpu"))
made = {}


def finish():
    if device.type == "cuda":
        torch.cuda.synchronize()


def make(net, mode, shape):
    variants = []
    for layout in (torch.contiguous_format, torch.channels_last):
        torch.manual_seed(1)
        module = torch_nets.unet(net, shape[0]).to(device, memory_format=layout)
        x = torch.rand(1, *shape).to(device, memory_format=layout)
        if mode == "forward":
            module.eval()

            def run(module=module, x=x):
                with torch.no_grad():
                    module(x)
        else:
            target = torch.rand(1, *shape).to(device)
            optimizer = torch.optim.Adam(module.parameters(), lr=1e-4)

            def run(module=module, x=x, target=target, optimizer=optimizer):
                optimizer.zero_grad(set_to_none=True)
                F.mse_loss(module(x), target).backward()
                optimizer.step()
        run()
        run()
        variants.append(run)
    return variants


for line in sys.stdin:
    net, mode, *shape = line.split()
    key = (net, mode, tuple(int(v) for v in shape))
    if key not in made:
        made[key] = make(*key)
    times = []
    for run in made[key]:
        finish()
        start = time.perf_counter()
        run()
        finish()
        times.append(1e3 * (time.perf_counter() - start))
    print(*(f"{t:.4f}" for t in times), flush=True)
