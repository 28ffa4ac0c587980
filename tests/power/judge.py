#!/usr/bin/env python3
"""judge.py LOG FOLDER: what a loss of power at any moment of a recorded run would have left in FOLDER.

The disk of the worst case: data is on it only when the file was synchronised after its last write, and a name (made,
renamed, linked) only when its folder was; what was not synchronised may be there or not, in any order. So it suffices
to look at every step: whatever takes a name that is not hidden must be on the disk as a whole before, and at the end
every such name must be."""
import os
import sys

HIDDEN = ".hadalens-"


def hidden(path):
    return any(HIDDEN in part for part in path.split("/"))


class Disk:
    def __init__(self, folder):
        self.folder = folder
        self.dirty = set()  # files with writes, and folders with names, that are not on the disk
        self.known = set()  # all that the run made
        self.wrong = []

    def ours(self, path):
        return path.startswith(self.folder + "/") or path == self.folder

    def name_changes(self, path):
        self.dirty.add(os.path.dirname(path))

    def below(self, path):
        return [p for p in self.dirty if p == path or p.startswith(path + "/")]

    def write(self, path, _):
        if path not in self.known:
            self.known.add(path)
            self.name_changes(path)
        self.dirty.add(path)

    def sync(self, path, _):
        self.dirty.discard(path)

    def mkdir(self, path, _):
        self.known.add(path)
        self.name_changes(path)

    def link(self, _, path):
        self.known.add(path)
        self.name_changes(path)

    def unlink(self, path, _):
        self.known.discard(path)
        self.dirty.discard(path)

    def rename(self, source, target):
        if not hidden(target):
            for path in self.below(source):
                self.wrong.append(f"{target} took its name while {path} was not on the disk")
        for group in (self.dirty, self.known):
            for path in [p for p in group if p == source or p.startswith(source + "/")]:
                group.discard(path)
                group.add(target + path[len(source):])
        self.known.add(target)
        self.name_changes(target)
        self.dirty.discard(target)

    def end(self):
        for path in sorted(self.dirty):
            if path in self.known or path == self.folder:
                if not hidden(path):
                    self.wrong.append(f"{path} was not on the disk when the program ended")


def main():
    disk = Disk(os.path.realpath(sys.argv[2]))
    steps = renames = 0
    with open(sys.argv[1], encoding="utf-8", errors="surrogateescape") as log:
        for line in log:
            what, path, other = line.rstrip("\n").split("\t")
            path, other = os.path.normpath(path), os.path.normpath(other) if other else ""
            if disk.ours(path) or disk.ours(other):
                getattr(disk, what)(path, other)
                steps += 1
                renames += what == "rename"
    disk.end()
    print(f"{steps} steps, {renames} names taken, {len(disk.wrong)} wrong")
    for wrong in disk.wrong[:10]:
        print("  " + wrong)
    sys.exit(1 if disk.wrong or not renames else 0)


main()
