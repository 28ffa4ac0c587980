#!/usr/bin/env python3
"""Holds the order of the house by what the object files need of each other, and draws it.

    rooms.py ROOT BUILD            check; says what is wrong, exit 1
    rooms.py ROOT BUILD --draw     writes docs/pictures/rooms.svg

A room is a folder of lib. It may see itself, the public headers, and the rooms that lib/layers.txt names on its line, all
of which stand above it. Both kinds of seeing count: quoted includes, and symbols, so a call through a public header is
seen as well. What is allowed and not used is reported too. Files of a room see each other one way: no circles.
"""
import pathlib
import re
import subprocess
import sys

SEES_INCLUDE = re.compile(r'^#include "([^"]+)"', re.M)


def objects(root, build):
    """{source: object} of what the library is made of."""
    base = build / "CMakeFiles" / "hadalens_objects.dir" / "lib"
    found = {}
    for source in sorted((root / "lib").rglob("*.c")):
        path = base / (str(source.relative_to(root / "lib")) + ".o")
        if path.exists():
            found[source.relative_to(root / "lib").as_posix()] = path
    return found


def file_arrows(found):
    """{(file, file): names}: what each file takes from another."""
    source_of = {str(path): source for source, path in found.items()}
    home, needs = {}, {source: set() for source in found}
    listing = subprocess.run(["nm", "-A", *source_of], capture_output=True, text=True, check=True).stdout
    for line in listing.splitlines():
        path, _, rest = line.partition(".o:")
        kind, name = rest.split()[-2:]
        source = source_of[path + ".o"]
        if kind == "U":
            needs[source].add(name)
        elif kind.isupper():
            home[name] = source
    arrows = {}
    for source, names in needs.items():
        for name in names:
            target = home.get(name, source)
            if target != source:
                arrows.setdefault((source, target), set()).add(name)
    return arrows


def room(source):
    return source.split("/")[0]


def circles(files, arrows):
    """Strongly connected parts of more than one file (Tarjan)."""
    after = {f: sorted(b for a, b in arrows if a == f and b in files) for f in files}
    index, low, stack, out = {}, {}, [], []

    def visit(f):
        index[f] = low[f] = len(index)
        stack.append(f)
        for g in after[f]:
            if g not in index:
                visit(g)
                low[f] = min(low[f], low[g])
            elif g in stack:
                low[f] = min(low[f], index[g])
        if low[f] == index[f]:
            part = []
            while not part or part[-1] != f:
                part.append(stack.pop())
            if len(part) > 1:
                out.append(sorted(part))

    for f in sorted(files):
        if f not in index:
            visit(f)
    return out


def layers(root):
    rows = {}
    for line in (root / "lib" / "layers.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            name, _, allowed = line.partition(":")
            rows[name] = allowed.split()
    return rows


def check(root, found, arrows):
    wrong = []
    rows = layers(root)
    above = []
    folders = sorted(p.name for p in (root / "lib").iterdir() if p.is_dir() and p.name != "include")
    for folder in folders:
        if folder not in rows:
            wrong.append(f"lib/{folder} is not in lib/layers.txt")
    for name, allowed in rows.items():
        if name not in folders:
            wrong.append(f"lib/layers.txt names {name}, which is no folder of lib")
        wrong += [f"lib/layers.txt: {name} names {a}, which does not stand above it" for a in allowed if a not in above]
        above.append(name)
    seen = {}
    for (a, b), names in arrows.items():
        if room(a) != room(b):
            seen.setdefault((room(a), room(b)), f"lib/{a} calls {min(names)} of lib/{b}")
    for path in sorted((root / "lib").rglob("*.[ch]")):
        name = path.relative_to(root / "lib").as_posix()
        for target in SEES_INCLUDE.findall(path.read_text()):
            if "/" not in target:
                wrong.append(f"lib/{name} includes \"{target}\": write the folder too")
            elif room(target) != room(name) and room(target) in rows and room(name) != "include":
                seen.setdefault((room(name), room(target)), f"lib/{name} includes {target}")
    for (a, b), example in sorted(seen.items()):
        if a in rows and b not in rows[a]:
            wrong.append(f"{a} may not see {b} (lib/layers.txt): {example}")
    for name, allowed in rows.items():
        wrong += [f"lib/layers.txt: {name} does not need {a}" for a in allowed if (name, a) not in seen]
    for part in circles(set(found), {k for k in arrows if room(k[0]) == room(k[1])}):
        wrong.append("a circle between files: " + ", ".join(f"lib/{f}" for f in part))
        for (a, b), names in sorted(arrows.items()):
            if a in part and b in part:
                wrong.append(f"    {a} -> {b}: {', '.join(sorted(names)[:4])}{', ...' if len(names) > 4 else ''}")
    wrong += other_rules(root)
    return wrong


def other_rules(root):
    """What includes alone tell."""
    wrong = []
    for folder in ("bindings", "examples"):
        for path in sorted((root / folder).rglob("*.[ch]")):
            if path.is_relative_to(root / "bindings/reader"):  # the other half of lib/io/isolate.c
                continue
            for target in SEES_INCLUDE.findall(path.read_text()):
                if "/" in target and (root / "lib" / target).exists():
                    wrong.append(f"{path.relative_to(root)} includes {target}: bindings and examples see public headers only")
    for path in sorted((root / "lib" / "include").rglob("*.h")):
        if path.name != "opencl.h" and re.search(r"include.*(CL/|clFFT|tiffio|jansson|cairo)", path.read_text()):
            wrong.append(f"{path.relative_to(root)}: public headers need no headers of OpenCL, TIFF, JSON or cairo")
    names = {}
    for path in sorted((root / "lib").rglob("*.[ch]")):
        if "include" not in path.parts:
            names.setdefault(path.name, []).append(path.relative_to(root).as_posix())
    wrong += [f"a file name used twice: {', '.join(paths)}" for paths in names.values() if len(paths) > 1]
    return wrong


def floors(rows):
    """How deep each room is: one below the deepest that it sees."""
    floor = {}
    for name, allowed in rows.items():
        floor[name] = 1 + max((floor[a] for a in allowed), default=-1)
    return floor


def draw(rows):
    """The rooms on their floors, an arrow to each room that is seen and not seen through another one."""
    floor = floors(rows)
    through = {n: set() for n in rows}
    for n in rows:
        for a in rows[n]:
            through[n] |= through[a] | set(rows[a])
    wide, tall, gap, rise = 104, 34, 26, 92
    lines = {f: [n for n in rows if floor[n] == f] for f in range(max(floor.values()) + 1)}
    # the order on a floor follows the mean place of the rooms seen
    place = {}
    for f, names in lines.items():
        names.sort(key=lambda n: (sum(place.get(a, 0.5) for a in rows[n]) / max(len(rows[n]), 1), n))
        place.update({n: (i + 0.5) / len(names) for i, n in enumerate(names)})
    width = max(len(v) for v in lines.values()) * (wide + gap) + gap
    height = len(lines) * rise + 10
    at = {n: (place[n] * width, 30 + floor[n] * rise) for n in rows}
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
           'font-family="sans-serif" font-size="14">', f'<rect width="{width}" height="{height}" fill="white"/>',
           '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
           '<path d="M0 0L8 4L0 8z" fill="#777777"/></marker>']
    for n in rows:
        for a in rows[n]:
            if a not in through[n]:
                (x, y), (u, v) = at[n], at[a]
                out.append(f'<line x1="{x:.0f}" y1="{y - tall / 2:.0f}" x2="{u:.0f}" y2="{v + tall / 2:.0f}" '
                           'stroke="#777777" marker-end="url(#tip)"/>')
    for n, (x, y) in at.items():
        out.append(f'<rect x="{x - wide / 2:.0f}" y="{y - tall / 2:.0f}" width="{wide}" height="{tall}" rx="5" '
                   'fill="#eef3f8" stroke="#335577"/>')
        out.append(f'<text x="{x:.0f}" y="{y + 5:.0f}" text-anchor="middle">{n}</text>')
    return "\n".join(out + ["</svg>", ""])


def main():
    root, build = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    found = objects(root, build)
    if not found:
        sys.exit(f"{build}: no object files of the library")
    picture = root / "docs" / "pictures" / "rooms.svg"
    if "--draw" in sys.argv:
        picture.write_text(draw(layers(root)))
        return
    wrong = check(root, found, file_arrows(found))
    if not picture.exists() or picture.read_text() != draw(layers(root)):
        wrong.append("docs/pictures/rooms.svg is not of these rooms: tests/house/rooms.py . BUILD --draw")
    print("\n".join(wrong) or f"{len(found)} files in {len(layers(root))} rooms, one way")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
