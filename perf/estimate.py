#!/usr/bin/env python3
"""The time that a frame should take on a device that is not at hand, from what it asks of one (docs/reference/measures.md).

    estimate.py BENCH.json [--device h100] [--launch US] [--wait US] [--link GB/S] [--copy GB/S] [--flops TFLOP/S]

BENCH.json: of `hadalens bench`. For a GPU let the bench run in a GPU's shape, whose launches and waits are others than
a CPU's: tests/devices/pretend.c makes a CPU call itself one. Bytes and operations are the least that the work needs, so
the estimate is a floor for kernels and an estimate for calls.
"""
import argparse
import json

# Measured on an H200 (results/gpu.md). The others: data sheets (SXM5 and PCIe 5.0 x16; PCIe 4.0), and what launches and
# waits were thought to take with NVIDIA's driver.
DEVICES = {
    "h200": {"launch": 4.8, "wait": 5.7, "link": 17.0, "copy": 3900.0, "flops": 57.4},
    "h100": {"launch": 2.5, "wait": 15.0, "link": 50.0, "copy": 3350.0, "flops": 67.0},
    "a100": {"launch": 2.5, "wait": 15.0, "link": 25.0, "copy": 1555.0, "flops": 19.5},
}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench")
    parser.add_argument("--device", choices=sorted(DEVICES), default="h100")
    for name in next(iter(DEVICES.values())):
        parser.add_argument(f"--{name}", type=float)
    given = vars(parser.parse_args())
    cost = {name: given[name] if given[name] is not None else value for name, value in DEVICES[given["device"]].items()}
    return given["bench"], given["device"], cost


def main():
    path, device, cost = arguments()
    with open(path, encoding="utf-8") as file:
        rows = json.load(file)["rows"]
    print(f"{device}: {cost}")
    for workload, mode in sorted({(r["workload"], r["name"].split(",")[0]) for r in rows if r["group"] == "calls"}):
        of = lambda group: [
            r for r in rows if r["group"] == group and r["workload"] == workload and r["name"].startswith(mode + ",")
        ]
        calls = {r["name"].split(", ", 1)[1]: r["median"] for r in of("calls")}
        transfers = {"write", "read", "fill", "copy", "map", "unmap"}
        kernels = [r for r in of("kernel") if r["name"].rsplit(", ", 1)[1] not in transfers]
        parts = {
            "launches": calls["launches"] * cost["launch"] * 1e-3,
            "waits": calls["waits"] * cost["wait"] * 1e-3,
            "transfers": (calls["to the device"] + calls["to the host"]) * 1024 / cost["link"] * 1e-6,
            "kernels": sum(
                max((r["bytes"] or 0) / cost["copy"] * 1e-6, (r["flops"] or 0) / cost["flops"] * 1e-9) for r in kernels
            ),
        }
        text = ", ".join(f"{name} {value:.3f}" for name, value in parts.items())
        print(f"{workload}, {mode}: {sum(parts.values()):.2f} ms ({text})")


if __name__ == "__main__":
    main()
