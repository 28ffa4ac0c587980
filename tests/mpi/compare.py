#!/usr/bin/env python3
"""Hold the tensors of two safetensors files against each other.

compare.py ONE OTHER LIMIT: the relative L2 difference of each tensor is at most LIMIT; "same": the bits. Sums of a fit,
whose values are stored as value and rest (docs/reference/files.md), are compared as their sum.
"""

import array
import json
import math
import struct
import sys

CODES = {"F32": "f", "F64": "d", "F16": "H", "U8": "B", "I64": "q", "U64": "Q"}


def load(path):
    """Return the tensors of a file: name to (shape, values)."""
    with open(path, "rb") as file:
        data = file.read()
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    header.pop("__metadata__", None)
    tensors = {}
    for name, entry in header.items():
        begin, end = (8 + length + at for at in entry["data_offsets"])
        tensors[name] = (entry["shape"], array.array(CODES[entry["dtype"]], data[begin:end]))
    return tensors


def whole(name, shape, values):
    """Return values in double precision, with value and rest added."""
    if name != "sums":
        return list(values)
    plane = shape[4] * shape[5]
    return [
        values[at + i] + values[at + plane + i]
        for at in range(0, len(values), 2 * plane)
        for i in range(plane)
    ]


def difference(one, other):
    """Return the relative L2 difference."""
    norm = math.sqrt(sum(x * x for x in one))
    apart = math.sqrt(sum((x - y) ** 2 for x, y in zip(one, other)))
    return apart / norm if norm else apart


def main():
    """Compare, and say what is too far apart."""
    one, other, limit = load(sys.argv[1]), load(sys.argv[2]), sys.argv[3]
    bad = sorted(one) != sorted(other)
    for name in one:
        if limit == "same":
            wrong = one[name][0] != other[name][0] or one[name][1].tobytes() != other[name][1].tobytes()
            apart = float(wrong)
        else:
            apart = difference(whole(name, *one[name]), whole(name, *other[name]))
            wrong = one[name][0] != other[name][0] or not apart <= float(limit)
        print(f"{name}: {apart:.3g}{' TOO FAR APART' if wrong else ''}")
        bad = bad or wrong
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
