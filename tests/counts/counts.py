#!/usr/bin/env python3
"""Calls of a further frame, from the counts of a run over one frame and of another over more; held against a table.

    counts.py ONE MORE FRAMES                   prints them; FRAMES: how many more the second run had
    counts.py ONE MORE FRAMES TABLE WHAT        holds them against the row of that name: exit code 1 where one is above
"""
import sys

FIGURES = ["launches", "fills and copies", "writes", "reads", "waits", "arguments", "KiB up", "KiB down"]


def load(path):
    rows = {}
    for line in open(path, encoding="utf-8"):
        kind, what, calls, amount = line.rstrip("\n").split("\t")
        rows[kind, what] = int(calls), float(amount)
    return rows


def further(one, more, frames):
    """Calls and amount of each kind, a frame."""
    none = 0, 0.0
    return {
        key: tuple((b - a) / frames for a, b in zip(one.get(key, none), more.get(key, none)))
        for key in sorted(set(one) | set(more))
    }


def figures(rows):
    def total(which, *kinds, what=None):
        return sum(value[which] for key, value in rows.items() if key[0] in kinds and what in (None, key[1]))

    return [
        total(0, "launch"),
        total(0, "fill", "copy"),
        total(0, "write"),
        total(0, "read"),
        total(0, "wait") + total(0, "read", "write", "map", what="blocking"),
        total(0, "argument"),
        total(1, "write") / 1024,
        total(1, "read") / 1024,
    ]


def limits(path, what):
    for line in open(path, encoding="utf-8"):
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if cells[0] == what:
            return [float(cell) for cell in cells[1 : len(FIGURES) + 1]]
    sys.exit(f"counts: {path} has no row '{what}'")


def main(arguments):
    if len(arguments) not in (3, 5):
        sys.exit(__doc__)
    rows = further(load(arguments[0]), load(arguments[1]), int(arguments[2]))
    found = figures(rows)
    for (kind, what), (calls, amount) in sorted(rows.items(), key=lambda item: -item[1][0]):
        if calls > 0:
            print(f"  {kind + ' ' + what:32s} {calls:9.1f}  {amount / calls:12.0f} each")
    most = limits(arguments[3], arguments[4]) if len(arguments) == 5 else found
    worse = False
    for name, value, limit in zip(FIGURES, found, most):
        above = value > limit
        worse |= above
        print(f"{name:18s} {value:10.1f}   at most {limit:10.1f}{'   ABOVE' if above else ''}")
    print("| " + " | ".join(f"{value:.0f}" for value in found) + " |")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
