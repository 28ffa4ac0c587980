#!/usr/bin/env python3
"""The time that the convolutions of a net should take on a GPU that is not at hand, by each way of multiplying.

    estimate_net.py [--net paper|compact] [--size HxW] [--images N] [--device h100|a100] [--cache GB/S] [--layers]

Images are those of a batch: planes, times colours for `paper`, which takes one channel at a time. Ways:

    direct    conv_group.cl: instructions of its inner loop, as tests/budget/budget.txt has them, at one a clock and quarter
              of a unit
    tf32      conv_tf32.cl: the same, or the tensor cores' products, whichever takes longer
    three     Winograd's F(4x4,3x3) for 3 x 3 kernels in three launches, whose transformed tiles go through memory, at the
              direct way's instructions a product
    one       the same in one launch, whose sums stay in registers, so that a group has few tiles and reads each transformed
              weight from the second-level cache for these alone

All of them read and write the tensors once, and pay for launches. What a last wave of groups leaves idle is not counted, so
the figures are floors.
"""
import argparse
from pathlib import Path

# Units, clock in GHz, memory and second-level cache in GB/s, products of TF32 a clock and unit (data sheets; the cache:
# Chips and Cheese, 2023), the share of these that mma.sync reaches (Luo et al., "Benchmarking and Dissecting the Nvidia
# Hopper GPU Architecture", 2024), microseconds a launch (estimate.py).
DEVICES = {
    "h100": {"units": 132, "clock": 1.83, "memory": 3350, "cache": 5500, "tf32": 1024, "reached": 0.63, "launch": 2.5},
    "a100": {"units": 108, "clock": 1.41, "memory": 1555, "cache": 4000, "tf32": 512, "reached": 1.0, "launch": 2.5},
}
# As lib/netlist/unet.c has them.
NETS = {
    "compact": {"in": 3, "down": "16,16|32,32|64,64|128,128|256,256", "up": "128,128|64,64|32,32|16,16", "last": (1, 3)},
    "paper": {"in": 1, "down": "32,32|64|64|128|256|512,256,128", "up": "128|64|32|32|", "last": (3, 1)},
}
BUDGET = Path(__file__).resolve().parent.parent / "tests" / "budget" / "budget.txt"
GROUP_ITEMS, STEP_CHANNELS, QUARTERS = 128, 8, 4
TILES = {64: 128, 32: 256, 16: 256, 4: 384}  # output channels of a tile, its pixels (lib/net/conv_table.c)
READS, FEW = 4, 4                    # GROUP_READS and FEW there
PLACES, COVERED = 36, 16             # of a tile of F(4x4,3x3), and the pixels it gives
# One-dimensional transforms of a tile times instructions of each (kernels/inc_conv_winograd.h); reading and writing it.
IN_TRANSFORM, OUT_TRANSFORM = 12 * 12 + 2 * PLACES, 10 * 10 + PLACES + COVERED
SUMS = 64                            # of an item, in registers


def loops():
    """{(kernel, output channels of a tile): instructions of the loop over steps}."""
    found = {}
    for line in BUDGET.read_text().splitlines():
        cells = line.split()
        for high in TILES:
            if cells[:1] == ["conv_group"] and cells[2] == "conv_group" and f"_high{high}_" in cells[1]:
                found["direct", high] = int(cells[11])
            if cells[:2] == ["conv_tf32", f"high{high}_mma"]:
                found["tf32", high] = int(cells[11])
    return found


def layers_of(net, rows, cols):
    """[(name, kernel, in, out, rows, cols)] of a U-net."""
    read = lambda text: [[int(width) for width in level.split(",") if width] for level in text.split("|")]
    down, up, found, at, skips = read(net["down"]), read(net["up"]), [], net["in"], []

    def add(name, widths, level):
        nonlocal at
        for i, width in enumerate(widths):
            found.append((f"{name}.{level}.{i}", 3, at, width, rows >> level, cols >> level))
            at = width

    for level, widths in enumerate(down):
        add("down", widths, level)
        skips.append(at)
    for step, level in enumerate(range(len(down) - 2, -1, -1)):
        at += skips[level]
        add("up", up[step], level)
    kernel, out = net["last"]
    found.append(("last", kernel, at, out, rows, cols))
    return found


def up_to(value, step):
    return -(-value // step) * step


def ways(layer, images, device, loop):
    """{way: seconds}, of a layer."""
    _, kernel, inputs, outputs, rows, cols = layer
    high = min((h for h in TILES if h > FEW or outputs <= FEW), key=lambda h: up_to(outputs, h) // h * (h + READS))
    tensors = 4 * images * rows * cols * (inputs + outputs)
    clock, memory, launch = device["clock"] * 1e9, device["memory"] * 1e9, device["launch"] * 1e-6
    issue = 1 / (clock * device["units"] * QUARTERS)  # seconds an instruction of a warp takes, of all quarters together
    padded = up_to(outputs, high) * up_to(inputs, STEP_CHANNELS)
    share = TILES[high] * high * STEP_CHANNELS // (GROUP_ITEMS // 32)  # multiply-adds of a warp's step
    products = images * up_to(rows * cols, TILES[high]) * kernel * kernel * padded
    found = {"direct": max(products / share * loop["direct", high] * issue, tensors / memory) + launch}
    if ("tf32", high) in loop and inputs >= STEP_CHANNELS:
        cores = 3 * products / (device["tf32"] * device["reached"] * device["units"] * clock)
        found["tf32"] = max(products / share * loop["tf32", high] * issue, cores, tensors / memory) + launch
    if kernel != 3 or min(inputs, outputs) < 16:
        return found
    tiles = images * -(-rows // 4) * -(-cols // 4)
    multiply = PLACES * tiles * padded / share * loop["direct", high] * issue
    transforms = tiles * (inputs * IN_TRANSFORM + outputs * OUT_TRANSFORM) / 32 * issue
    stored = 2 * 4 * PLACES * tiles * (inputs + outputs)
    three = max(multiply + transforms, (tensors + stored) / memory) + 3 * launch
    channels = min(16, outputs)
    each = GROUP_ITEMS * SUMS // (PLACES * channels)  # tiles of a group
    repeated = tiles * (inputs * IN_TRANSFORM * (outputs / channels) + outputs * OUT_TRANSFORM) / 32 * issue
    weights = 4 * PLACES * inputs * outputs * tiles / each
    one = max(multiply + repeated, weights / (device["cache"] * 1e9), tensors / memory) + launch
    found["three"], found["one"] = three, one
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--net", choices=sorted(NETS), default="paper")
    parser.add_argument("--size", default="512x512")
    parser.add_argument("--images", type=int, default=6)
    parser.add_argument("--device", choices=sorted(DEVICES), default="h100")
    parser.add_argument("--cache", type=float, help="of the second-level cache, in GB/s, instead of the device's")
    parser.add_argument("--layers", action="store_true")
    options = parser.parse_args()
    device = dict(DEVICES[options.device])
    device["cache"] = options.cache or device["cache"]
    rows, cols = (int(side) for side in options.size.split("x"))
    loop, sums = loops(), {"direct": 0.0, "direct or tf32": 0.0, "direct or three": 0.0, "direct or one": 0.0,
                          "the best of all": 0.0}
    for layer in layers_of(NETS[options.net], rows, cols):
        found = ways(layer, options.images, device, loop)
        if options.layers:
            text = ", ".join(f"{way} {1e3 * seconds:.3f}" for way, seconds in found.items())
            print(f"{layer[0]:10s} {layer[2]:3d} > {layer[3]:3d}, {layer[4]} x {layer[5]}: {text} ms")
        sums["direct"] += found["direct"]
        for way in ("tf32", "three", "one"):
            sums[f"direct or {way}"] += min(found["direct"], found.get(way, found["direct"]))
        sums["the best of all"] += min(found.values())
    print(f"{options.net}, {options.images} images of {options.size}, {options.device}:",
          ", ".join(f"{way} {1e3 * seconds:.2f} ms" for way, seconds in sums.items()))


if __name__ == "__main__":
    main()
