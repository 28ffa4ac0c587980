"""coverage.py ROOT OBJECTS ROOM...: which share of the lines and branches of each room of lib was reached, from gcov's
data beneath OBJECTS. Prints a line a room, with --missed those of the source whose branches were not all taken. Fails
where a room that has an aim, or all of them together, is below it.

A HADA_TRY() around hada_fail() has a branch that nothing takes, for a failure never succeeds: it counts as one.
"""
import json
import subprocess
import sys
from pathlib import Path

# In percent of branches: rooms that read bytes of others, and all rooms together.
AIMS = {"io": 90, "model": 90, "dataset": 90}
AIM_OF_ALL = 80


def certain_failures(source):
    """The lines of a file on which a HADA_TRY() around hada_fail() begins."""
    found = set()
    lines = source.read_text().splitlines() + [""]
    for number, line in enumerate(lines[:-1], 1):
        inner = line.partition("HADA_TRY(")[2] or lines[number]
        if "HADA_TRY(" in line and inner.strip().startswith("hada_fail("):
            found.add(number)
    return found


def measure(objects, room, root):
    """For each file of a room, by line: how often it was reached, and each of its branches, in every object."""
    files = {}
    for data in sorted((objects / room).glob("*.gcda")):
        command = ["gcov", "--json-format", "--stdout", "-b", data]
        told = subprocess.run(command, capture_output=True, check=True, text=True).stdout
        for file in (file for text in told.splitlines() for file in json.loads(text)["files"]):
            name = file["file"][file["file"].find(f"lib/{room}/") :]
            if not name.startswith(f"lib/{room}/") or not (root / name).is_file():
                continue
            lines = files.setdefault(name, {})
            for line in file["lines"]:
                counts = [branch["count"] for branch in line["branches"]]
                lines.setdefault(line["line_number"], []).append((line["count"], counts))
    return files


def share(part, whole):
    return 100 * part / whole if whole else 100


def tell(room, files, root, missed):
    lines = hit = branches = taken = 0
    for name, by_line in sorted(files.items()):
        certain = certain_failures(root / name)
        source = (root / name).read_text().splitlines()
        for number, parts in sorted(by_line.items()):
            lines += 1
            hit += any(count for count, _ in parts)
            here = [count for _, counts in parts for count in counts]
            if number in certain and any(here):
                here = [count for count in here if count]
            branches += len(here)
            taken += sum(count > 0 for count in here)
            if missed and not all(here):
                left = f"{sum(not count for count in here)} of {len(here)}"
                print(f"{name}:{number}: {left}: {source[number - 1].strip()}")
    return hit, lines, taken, branches, show(f"lib/{room}", hit, lines, taken, branches, AIMS.get(room, 0))


def show(what, hit, lines, taken, branches, aim):
    below = f", below {aim} %" if share(taken, branches) < aim else ""
    reached = f"lines {share(hit, lines):5.1f} % of {lines:5d}"
    print(f"{what:<14} {reached}, branches {share(taken, branches):5.1f} % of {branches:5d}{below}")
    return bool(below)


def main():
    words = [word for word in sys.argv[1:] if word != "--missed"]
    root, objects = Path(words[0]).resolve(), Path(words[1]).resolve()
    results = [tell(room, measure(objects, room, root), root, "--missed" in sys.argv) for room in words[2:]]
    sums = [sum(column) for column in zip(*results)]
    return show("all of these", *sums[:4], AIM_OF_ALL) or sums[4] > 0


sys.exit(main())
