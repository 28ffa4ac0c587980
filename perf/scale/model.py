#!/usr/bin/env python3
"""A model of scale: what measured costs say of 1 to 10,000 devices. model.py COSTS.json [--check] [OPTIONS].

Shares are those of the library (docs/how-to/use-several-machines.md): files and depths are dealt out, pairs and samples stand in a row and are
cut. A rank's time is what comes once, its share, and the exchanges; files come through one file system for all. --check:
what the model says of 1, 2 and 4 ranks on the measured machine against what was measured there, within 15 %.
"""

import argparse
import json
import math
import sys

DEVICES = [1, 2, 4, 8, 14, 16, 32, 64, 100, 128, 256, 512, 1000, 2000, 5000, 10000]
WITHIN = 0.15


def costs(engine):
    """Return what comes once, and what each item takes, in processor seconds."""
    little, much = engine["little"], engine["1"]
    each = (much["seconds"] - little["seconds"]) / (much["amount"] - little["amount"])
    return max(much["seconds"] - each * much["amount"], 0.0), each


def dealt(count, ranks):
    """Return the largest number of items that a rank gets where they are dealt out."""
    return -(-count // ranks)


def cut(count, ranks):
    """Return the largest share where they stand in a row."""
    return max(count * (rank + 1) // ranks - count * rank // ranks for rank in range(min(ranks, 2 * count)))


def pairs_of_one(depths, pairs, ranks):
    """Return the pairs of the busiest rank, and whether depths are whole (lib/fit/fitter.c)."""
    whole = dealt(depths, ranks) * pairs
    if whole * ranks <= 1.1 * depths * pairs:
        return whole, True
    return depths * cut(pairs, ranks), False


def exchange(count, size, network):
    """Return the seconds of a sum in rank order over `count` ranks: slices to all, slices from all."""
    if count == 1:
        return 0.0
    return 2 * (count - 1) / count * size / network.bandwidth + 2 * (count - 1) * network.latency


def handed_on(count, size, network):
    """Return the seconds of giving an array to all, down a tree."""
    return 0.0 if count == 1 else math.ceil(math.log2(count)) * network.latency + size / network.bandwidth


class Network:
    """What stands between devices."""

    def __init__(self, options):
        """Take the options over."""
        self.bandwidth, self.latency, self.files = options.bandwidth * 1e9, options.latency * 1e-6, options.files * 1e9


def frames(of, count, options, network):
    """Return seconds for a night of frames."""
    once, each = of
    compute = (once + dealt(options.frames, count) * each) / options.speed
    read = options.frames * (options.costs["files"]["frame_in"] + options.costs["files"]["frame_out"]) / network.files
    return max(compute, read)


def fit(of, count, options, network):
    """Return seconds for the sums of a fit: pairs, then the sums of all to all."""
    once, each = of
    most, whole = pairs_of_one(options.depths, options.pairs, count)
    compute = (once + most * each) / options.speed
    read = options.depths * options.pairs * options.costs["files"]["pair_in"] / network.files
    size = options.depths * options.costs["sums_bytes"]
    shared = handed_on(count, size, network) if whole else exchange(count, size, network)
    return max(compute, read) + shared


def train(of, count, options, network):
    """Return seconds for the steps of a training; ranks beyond the batch have no sample."""
    once, each, update = of
    ranks = min(count, options.batch)
    step = (update + cut(options.batch, ranks) * each) / options.speed
    return once / options.speed + options.steps * (step + exchange(ranks, options.costs["gradient_bytes"], network))


def table(name, unit, seconds, work):
    """Print a table, and where doubling the devices stops to pay."""
    print(f"\n{name}\n\n| devices | {unit} | efficiency |\n|---|---|---|")
    alone, stop = seconds(1), None
    for count in DEVICES:
        now = seconds(count)
        print(f"| {count} | {work(now)} | {alone / now / count:.2f} |")
    count = 1
    while count < DEVICES[-1] and stop is None:
        if seconds(count) / seconds(2 * count) < 1.25:
            stop = count
        count *= 2
    print(f"\nTwice the devices give less than 1.25 times the work from {stop} on." if stop else "\nIt does not stop there.")


def check(report):
    """Hold what the model says of 1, 2 and 4 ranks against what was measured; return whether all is within the limit."""
    good = True
    print("| engine | ranks | measured, s | model, s | ratio |\n|---|---|---|---|---|")
    for name, engine in report["engines"].items():
        once, each = costs(engine)
        amount = engine["1"]["amount"]
        for count in (1, 2, 4):
            if name == "fit":
                # items are pairs of every depth
                share = pairs_of_one(report["depths"], amount, count)[0] / report["depths"]
            else:
                share = dealt(amount, count) if name in ("frames", "refined") else cut(amount, count)
            said, was = once + share * each, engine[str(count)]["seconds"]
            good = good and abs(said / was - 1) <= WITHIN
            print(f"| {name} | {count} | {was:.3f} | {said:.3f} | {said / was:.2f} |")
    return good


def against_one(report):
    """Print what two ranks with a core each reach of one process on both cores."""
    # processor time of one that was busy on both from beginning to end, which none is
    cores = 1 if report["clock"] == "wall" else 2
    print("\n| engine | one process, both cores, s | busiest of two ranks, s | ratio |\n|---|---|---|---|")
    for name, engine in report["engines"].items():
        whole, two = engine["whole"]["seconds"] / cores, engine["2"]["seconds"]
        print(f"| {name} | {whole:.3f} | {two:.3f} | {whole / two:.2f} |")


def main():
    """Print tables, or check."""
    words = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    words.add_argument("costs")
    words.add_argument("--check", action="store_true")
    words.add_argument("--speed", type=float, default=20.0, help="of a device, in measured cores (20)")
    words.add_argument("--bandwidth", type=float, default=12.5, help="of the network at a rank, GB/s (12.5)")
    words.add_argument("--latency", type=float, default=2.0, help="of a message, microseconds (2)")
    words.add_argument("--files", type=float, default=100.0, help="of the shared file system, GB/s (100)")
    words.add_argument("--frames", type=int, default=1000000)
    words.add_argument("--pairs", type=int, default=25000, help="of each depth")
    words.add_argument("--depths", type=int, default=14)
    words.add_argument("--batch", type=int, default=64)
    words.add_argument("--steps", type=int, default=100000)
    options = words.parse_args()
    with open(options.costs) as file:
        report = options.costs = json.load(file)
    if options.check:
        good = check(report)
        against_one(report)
        sys.exit(0 if good else 1)
    network = Network(options)
    engines = report["engines"]
    once, each = costs(engines["fit"])
    per_pair = (once, each / report["depths"])
    start, sample = costs(engines["train"])
    training = (0.0, sample / report["steps"], start / report["steps"])
    # a gradient is exchanged once a step: bytes of two ranks, of which each sends its half twice
    report["gradient_bytes"] = engines["train"]["2"]["bytes"] / report["steps"]
    report["sums_bytes"] = engines["fit"]["2"]["bytes"] / report["depths"] * 2
    for engine, name in (("frames", "Frames, linear filters"), ("refined", "Frames, refined")):
        table(name, "frames a second", lambda n, engine=engine: frames(costs(engines[engine]), n, options, network),
              lambda s: f"{options.frames / s:,.0f}")
    table(f"Sums of a fit, {options.depths} depths of {options.pairs:,} pairs", "seconds",
          lambda n: fit(per_pair, n, options, network), lambda s: f"{s:,.1f}")
    table(f"Training, {options.steps:,} steps of {options.batch}", "hours",
          lambda n: train(training, n, options, network), lambda s: f"{s / 3600:,.2f}")


if __name__ == "__main__":
    main()
