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


def made_by(vendor, versions):
    """The line of the table that says what made a vendor's figures."""
    return f"# {vendor}: {' '.join(versions.read_text().split())}"


def renew(found, prefixes, maker):
    """Writes the table with what was found for the programs of these prefixes."""
    table = {key: kept for key, kept in read_table().items() if key[:4] not in prefixes}
    table |= {key: figures for key, figures in found.items() if any(figures[column] for column in KEPT)}
    vendor = maker.split()[1]
    makers = [line for line in TABLE.read_text().splitlines() if re.match(r"# \w+: \S+\.deb", line)]
    makers = sorted([line for line in makers if line.split()[1] != vendor] + [maker])
    rows = [[*key, *(str(table[key][column]) for column in KEPT)] for key in sorted(table)]
    lines = budget.aligned([["vendor", "device", "file", "program", "kernel", *KEPT], *rows], 5)
    TABLE.write_text(HEADER + "\n".join([*makers, *lines]) + "\n")


def compare(found):
    """How often a kernel keeps more in memory than the table says; prints where."""
    table, failed = read_table(), 0
    for key, figures in found.items():
        for column in KEPT:
            limit = table.get(key, {}).get(column, 0)
            if figures[column] > limit:
                print(f"{' '.join(key)}: {column} {figures[column]}, {limit} at most")
                failed += 1
    return failed


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
        return take(options.folder, device, budget.text_of(file), macros.split())

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(compiled, jobs))
    prefixes = [(options.vendor, *job[:3]) for job in jobs]
    complaints = [f"{' '.join(prefix)}: {one}" for prefix, (said, _) in zip(prefixes, results) for one in said]
    for complaint in complaints:
        print(complaint)
    found = {(*prefix, kernel): figures for prefix, (_, kernels) in zip(prefixes, results)
             for kernel, figures in kernels.items()}
    failed, maker = len(complaints), made_by(options.vendor, options.versions)
    if options.renew:
        renew(found, set(prefixes), maker)
    elif maker in TABLE.read_text().splitlines():
        failed += compare(found)
    else:
        print("another version of the compiler than that of memory.txt: what is kept in memory is not compared")
    most = max((figures["registers"] for figures in found.values()), default=0)
    print(f"{len(jobs)} programs" + (f", {len(found)} kernels, {most} registers at most" if most else "") + f"; {failed} complaints")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
