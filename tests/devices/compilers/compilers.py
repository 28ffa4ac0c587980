"""Every program of the groups shape, as the compilers of GPUs' vendors take it, without a GPU.

    compilers.py [--form full|brief] [--renew] --versions VERSIONS VENDOR FOLDER [FILE ...]

VENDOR: nvidia, amd or intel; FOLDER: where tests/devices/environment.sh has put its compiler. A program must compile
without an error or a warning, and no kernel may keep more in memory, instead of in registers, than memory.txt says for it,
where that was made by the same compiler: VERSIONS lists the packages that it came in.
brief: of AMD's and Intel's, one program of each kernel file. README.md tells more.
"""
import argparse
import concurrent.futures
import os
import re
import sys
from pathlib import Path

import vendors

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent.parent / "budget"))
import budget  # noqa: E402  (which programs a GPU builds)

TABLE = HERE / "memory.txt"
HEADER = """\
# Kernels that keep something of a work-item in memory where a vendor's compiler makes them, made by compilers.py --renew.
# spilled: NVIDIA: bytes stored and loaded; AMD: vector registers; Intel: registers. private: bytes of arrays.
"""
# devices of each vendor: what a laboratory has. Programs with tensor cores are NVIDIA's, and say their architecture.
DEVICES = {"nvidia": ("sm_90",), "amd": ("gfx90a", "gfx1030"), "intel": ("dg2",)}
KEPT = ("spilled", "private")


def expanded(name, seen):
    """A kernel file with what it includes, each once, as the library hands it to the driver."""
    if name in seen:
        return ""
    seen.add(name)
    return re.sub(r'^#include "(\w+\.h)".*$', lambda found: expanded(found.group(1), seen),
                  (budget.KERNELS / name).read_text(), flags=re.M)


def jobs_of(vendor, form, files):
    """[(device, file, program, macros)]"""
    jobs, seen = [], set()
    for file, program, macros, architecture in budget.rows_of_gpu():
        tensor_cores = "CONV_MMA" in macros
        if files and file not in files or tensor_cores and vendor != "nvidia":
            continue
        if form == "brief" and vendor != "nvidia" and file in seen:
            continue
        seen.add(file)
        devices = (architecture,) if tensor_cores else DEVICES[vendor]
        jobs += [(device, file, program, macros) for device in devices[:1 if form == "brief" else None]]
    return jobs


def read_table():
    table = {}
    for line in TABLE.read_text().splitlines() if TABLE.exists() else []:
        cells = line.split("#")[0].split()
        if cells and cells[0] != "vendor":
            table[tuple(cells[:5])] = dict(zip(KEPT, map(int, cells[5:])))
    return table


def recorded(vendor, versions):
    """The line of the table that says what made its figures."""
    return f"# {vendor}: {' '.join(versions.read_text().split())}"


def write_table(table, made_by):
    kept = [line for line in TABLE.read_text().splitlines() if re.match(r"# \w+: \S+\.deb", line)]
    kept = sorted([line for line in kept if line.split()[1] != made_by.split()[1]] + [made_by])
    rows = [["vendor", "device", "file", "program", "kernel", *KEPT]]
    rows += [[*key, *(str(table[key][column]) for column in KEPT)] for key in sorted(table)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    TABLE.write_text(HEADER + "".join(line + "\n" for line in kept) + "".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths)).rstrip() + "\n" for row in rows))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vendor", choices=DEVICES)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--form", choices=("full", "brief"), default="full")
    parser.add_argument("--renew", action="store_true")
    parser.add_argument("--versions", type=Path, required=True)
    parser.add_argument("files", nargs="*")
    options = parser.parse_intermixed_args()
    jobs = jobs_of(options.vendor, options.form, options.files)
    if not jobs:
        sys.exit("no such kernel is built for GPUs: " + " ".join(options.files))
    take = getattr(vendors, options.vendor)

    def compiled(job):
        device, file, _, macros = job
        return take(options.folder, device, expanded(f"{file}.cl", set()), macros.split())

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(compiled, jobs))
    table, failed, kernels, most = read_table(), 0, 0, 0
    made_by = recorded(options.vendor, options.versions)
    held = options.renew or made_by in TABLE.read_text().splitlines()
    if not held:
        print("another version of the compiler than that of memory.txt: what is kept in memory is not compared")
    for (device, file, program, _), (complaints, found) in zip(jobs, results):
        prefix = (options.vendor, device, file, program)
        for complaint in complaints:
            print(f"{' '.join(prefix)}: {complaint}")
            failed += 1
        if options.renew:
            table = {key: kept for key, kept in table.items() if key[:4] != prefix}
        for kernel, figures in found.items():
            kernels += 1
            most = max(most, figures["registers"])
            key = (*prefix, kernel)
            if options.renew:
                table |= {key: figures} if any(figures[column] for column in KEPT) else {}
                continue
            for column in KEPT:
                limit = table.get(key, {}).get(column, 0)
                if held and figures[column] > limit:
                    print(f"{' '.join(key)}: {column} {figures[column]}, {limit} at most")
                    failed += 1
    if options.renew:
        write_table(table, made_by)
    print(f"{len(jobs)} programs" + (f", {kernels} kernels, {most} registers at most" if most else "") + f"; {failed} complaints")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
