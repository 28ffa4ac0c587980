"""Convolutions against PyTorch (on CPUs oneDNN), taking turns with `perf_conv --serve`: both layouts of PyTorch, the
better one counts. Forward with bias and ReLU here, with bias there; without autograd. Prints median (fastest)
milliseconds and the ratios of the fastest times and of the median processor times.
   python3 perf/peers/conv_torch.py build/perf/perf_conv [--rounds N] [--methods auto,direct] [--threads N]
                                    [--what forward,data] [--layers 0,1] [--device cuda]
On a machine that others use too, --threads 1 and the processors' time are what can be compared."""
import argparse
import os
import statistics
import subprocess
import time

import torch

LAYERS = [  # in, out, size, kernel, stride, pad, transposed
    (16, 16, 512, 3, 1, 1, 0), (32, 32, 256, 3, 1, 1, 0), (64, 64, 128, 3, 1, 1, 0), (128, 128, 64, 3, 1, 1, 0),
    (256, 256, 32, 3, 1, 1, 0), (3, 16, 512, 3, 1, 1, 0), (1, 32, 256, 3, 1, 1, 0), (32, 64, 128, 3, 1, 1, 0),
    (64, 64, 64, 3, 1, 1, 0), (64, 128, 32, 3, 1, 1, 0), (128, 256, 16, 3, 1, 1, 0), (256, 512, 8, 3, 1, 1, 0),
    (512, 256, 8, 3, 1, 1, 0), (16, 3, 512, 1, 1, 0, 0), (32, 16, 256, 2, 2, 0, 1), (256, 128, 32, 2, 2, 0, 1),
    (32, 64, 128, 3, 2, 1, 0)]


def peers(layer, device):
    """What PyTorch runs: {what: [one function for each layout]}."""
    i, o, size, kernel, stride, pad, transposed = layer
    made = {"forward": [], "data": [], "weights": []}
    for layout in (torch.contiguous_format, torch.channels_last):
        x = torch.randn(1, i, size, size).to(device, memory_format=layout)
        w = torch.randn(*((i, o) if transposed else (o, i)), kernel, kernel).to(device, memory_format=layout)
        b = torch.randn(o, device=device)
        call = torch.nn.functional.conv_transpose2d if transposed else torch.nn.functional.conv2d
        y = call(x, w, b, stride, pad)
        dy = torch.randn_like(y).to(memory_format=layout)

        def back(mask, x=x, w=w, dy=dy):
            return torch.ops.aten.convolution_backward(dy, x, w, [o], [stride] * 2, [pad] * 2, [1, 1], bool(transposed),
                                                       [0, 0], 1, mask)
        made["forward"].append(lambda x=x, w=w, b=b: call(x, w, b, stride, pad))
        made["data"].append(lambda back=back: back([True, False, False]))
        made["weights"].append(lambda back=back: back([False, True, True]))
    return made


def timed(run):
    start, used = time.perf_counter(), time.process_time()
    run()
    if torch.cuda.is_initialized():
        torch.cuda.synchronize()
    return 1e3 * (time.perf_counter() - start), 1e3 * (time.process_time() - used)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--methods", default="auto,direct")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--layers", default="")
    parser.add_argument("--what", default="forward,data,weights")
    parser.add_argument("--device", default="cpu")
    chosen = parser.parse_args()
    torch.set_num_threads(chosen.threads)
    torch.set_grad_enabled(False)
    server = subprocess.Popen([chosen.program, "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                              env=dict(os.environ, POCL_MAX_PTHREAD_COUNT=str(chosen.threads)))

    def own(line):
        server.stdin.write(line + "\n")
        server.stdin.flush()
        return tuple(float(v) for v in server.stdout.readline().split())

    print(f"PyTorch {torch.__version__}, {chosen.threads} threads; {chosen.rounds} rounds; median (fastest) ms; "
          "ratios own/PyTorch of the fastest, and of the processors' median time")
    for layer in [LAYERS[int(n)] for n in chosen.layers.split(",")] if chosen.layers else LAYERS:
        made = peers(layer, chosen.device)
        for what in chosen.what.split(","):
            text = f"{what:8s} {layer[0]:3d} -> {layer[1]:3d} at {layer[2]:3d}, {layer[3]}x{layer[3]}"
            text += (f" stride {layer[4]}" if layer[4] > 1 else "") + (" transposed" if layer[6] else "")
            print(f"{text:48s}", end="", flush=True)
            for method in chosen.methods.split(","):
                line = f"{what} {method} " + " ".join(str(v) for v in layer)
                runs = made[what] + [lambda: None]
                for run in runs:
                    run()
                own(line)
                times = [[], [], []]
                for _ in range(chosen.rounds):
                    for side in range(2):
                        times[side].append(timed(made[what][side]))
                    times[2].append(own(line))
                fastest = [min(t[0] for t in side) for side in times]
                middle = [statistics.median(t[0] for t in side) for side in times]
                worked = [statistics.median(t[1] for t in side) for side in times]
                best = 0 if fastest[0] < fastest[1] else 1
                print(f"  PyTorch {middle[best]:7.3f} ({fastest[best]:7.3f}) {method} {middle[2]:7.3f} "
                      f"({fastest[2]:7.3f}) {fastest[2] / fastest[best]:.2f} {worked[2] / worked[best]:.2f}", end="",
                      flush=True)
            print(flush=True)
    server.stdin.close()
    server.wait()


if __name__ == "__main__":
    main()
