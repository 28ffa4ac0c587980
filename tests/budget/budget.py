"""Kernels of the groups shape as a GPU's compiler would make them, held against a committed table.

    budget.py [options] [KERNEL ...]       compares (all kernels, or those whose file or kernel is named)
    budget.py [options] --renew [KERNEL ...]  writes what is measured to the table
    budget.py [options] --show [KERNEL ...]   prints what is measured, and compares nothing

Every row of kernels/manifest.txt that a GPU builds goes through clang (NVPTX), libclc, ptxas and nvdisasm for sm_90: a
stand-in for a driver's compiler, near enough to see what it will have to do. README.md says what the columns are.
"""
import argparse
import concurrent.futures
import hashlib
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import sass

HERE = Path(__file__).resolve().parent
KERNELS = HERE.parent.parent / "kernels"
sys.path.insert(0, str(HERE.parent.parent / "cmake"))
from kernels import flatten  # noqa: E402
TABLE = HERE / "budget.txt"
ARCHITECTURE = "sm_90"
# the first with tensor cores for TF32: programs that use them have to be good for it too
FIRST_ARCHITECTURE = "sm_80"
# clang 15 knows no later architecture; ptxas assembles its text for ARCHITECTURE
CLANG_ARCHITECTURE, CLANG_PTX = "sm_86", "+ptx75"
# Registers are given out in eights, and another order of the same sums moves a few instructions.
REGISTER_STEP, INSTRUCTION_SLACK = 8, 0.05
COLUMNS_OF_BLOCK = 8  # of half spectra: HADA_FFT_BLOCK
COLUMNS = ("registers", "stack", "spills", "local", "instructions", "narrow_loads", "narrow_stores", "wide", "loop", "fma",
           "a_point")
HEADER = """\
# What kernels take on a GPU: made by tests/budget/run.sh --renew, explained in README.md.
"""


def rows_of_gpu():
    """[(file, program, macros, architecture)] of the manifest that a GPU builds. It prefers vectors of one value, so that
    tensors have blocks of eight channels (lib/net): rows for blocks of sixteen are for CPUs."""
    rows = []
    for line in (KERNELS / "manifest.txt").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("#")[0].split("|")]
        if len(cells) == 4 and cells[1] in ("groups", "tensor_cores", "all") and "NET_BLOCK=16" not in cells[3]:
            rows.append((cells[0], cells[2], cells[3], ARCHITECTURE))
            if cells[1] == "tensor_cores":
                rows.append((cells[0], f"{cells[2]}_{FIRST_ARCHITECTURE}", cells[3], FIRST_ARCHITECTURE))
    return rows


def run(command):
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stderr[:2000]}")
    return done


def compile_row(options, row, folder):
    """What the tools say of a program: ({kernel: its fixed group size}, messages of ptxas, SASS)."""
    file, program, macros, architecture = row
    code, ptx, cubin = (folder / f"{file}.{program}.{end}" for end in ("ll", "ptx", "cubin"))
    target = ["-target", "nvptx64--nvidiacl", "-O3", "-w", "-S"]
    for word in ("-target-cpu", min(CLANG_ARCHITECTURE, architecture), "-target-feature", CLANG_PTX):
        target += ["-Xclang", word]
    run([options.clang, "-x", "cl", "-cl-std=CL1.2", *target, "-Xclang", "-finclude-default-header", "-Xclang",
         "-mlink-builtin-bitcode", "-Xclang", options.libclc, f"-I{KERNELS}", *macros.split(), "-emit-llvm",
         KERNELS / f"{file}.cl", "-o", code])
    run([options.clang, "-x", "ir", *target, "-Xclang", "-disable-llvm-passes", code, "-o", ptx])
    sizes = sass.group_sizes(code.read_text())
    ptx.write_text(sass.with_group_sizes(ptx.read_text(), sizes))
    messages = run([options.tools / "ptxas", "-v", f"-arch={architecture}", ptx, "-o", cubin]).stderr
    return sizes, messages, run([options.tools / "nvdisasm", "-c", cubin]).stdout


def points_of_item(file, macros, group):
    """Complex points that a work-item transforms, where the program is for one length (kernels/shared_fft_sizes.h)."""
    length = re.search(r"-DFFT_POINTS=(\d+)", macros)
    if not length or file not in ("fft_sized_cols", "fft_sized_rows"):
        return 0
    sizes = (KERNELS / "shared_fft_sizes.h").read_text()
    part = sizes[sizes.index("#define FFT_COLUMN_SIZES" if file == "fft_sized_cols" else "#define FFT_ROW_SIZES"):]
    row = re.search(rf"M\({length.group(1)}, \d+, \d+, \d+, \d+, (\d+), \d+\)", part)
    points, last = int(length.group(1)), int(row.group(1))
    return points * COLUMNS_OF_BLOCK / last / group if file == "fft_sized_cols" else points / last


def measure(options, row, folder):
    """{kernel: figures} of a program."""
    sizes, messages, text = compile_row(options, row, folder)
    code = sass.bodies(text)
    found = {}
    for kernel, figures in sass.resources(messages).items():
        figures.update(sass.figures(code[kernel]))
        points = points_of_item(row[0], row[2], math.prod(sizes.get(kernel, (1,))))
        figures["a_point"] = round(figures["instructions"] / points) if points else 0
        for kind in ("load", "store"):
            widths = figures.pop(kind)
            figures[f"narrow_{kind}s"] = sum(count for bits, count in widths.items() if bits != "128")
            figures["wide"] = figures.get("wide", 0) + widths["128"]
        found[kernel] = figures
    return found


def text_of(file):
    """The text of a file with its includes in their places, each once, as the library has it."""
    pieces = flatten(file, (KERNELS / f"{file}.cl").read_text(), KERNELS, [])
    return "".join(text for _, text in pieces)


def measured(options, row):
    """As measure(), kept in the cache under everything that it depends on."""
    words = [text_of(row[0]), *row[2:], options.clang, str(options.libclc), (HERE / "sass.py").read_text(),
             Path(__file__).read_text(), str((options.tools / "ptxas").resolve())]
    key = hashlib.sha256("\0".join(words).encode()).hexdigest()[:32]
    kept = options.cache / f"{row[0]}.{row[1]}.{key}.json"
    if kept.exists():
        return json.loads(kept.read_text())
    with tempfile.TemporaryDirectory() as folder:
        found = measure(options, row, Path(folder))
    options.cache.mkdir(parents=True, exist_ok=True)
    part = kept.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps(found))
    part.replace(kept)
    return found


def measure_all(options, rows):
    """{(file, program, kernel): figures}."""
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        all_figures = list(pool.map(lambda row: measured(options, row), rows))
    return {(row[0], row[1], kernel): figures for row, one in zip(rows, all_figures) for kernel, figures in one.items()}


def read_table():
    table = {}
    if TABLE.exists():
        for line in TABLE.read_text().splitlines():
            cells = line.split("#")[0].split()
            if cells and cells[0] != "file":
                table[tuple(cells[:3])] = dict(zip(COLUMNS, map(int, cells[3:])))
    return table


def aligned(rows, names):
    """Lines of rows of cells, the first so many cells being names and the others numbers."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) if i < names else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths))).rstrip()
            for row in rows]


def lines_of(table):
    rows = [[*key, *(str(figures[column]) for column in COLUMNS)] for key, figures in table.items()]
    return aligned([["file", "program", "kernel", *COLUMNS], *rows], 3)


def above(budget, figures):
    """The columns in which a kernel takes more than its budget."""
    most = {column: budget[column] for column in ("stack", "spills", "local", "narrow_loads", "narrow_stores")}
    most["registers"] = -(-budget["registers"] // REGISTER_STEP) * REGISTER_STEP
    for column in ("instructions", "a_point"):
        most[column] = int(budget[column] * (1 + INSTRUCTION_SLACK)) + 1
    failed = [f"{column} {figures[column]}, budget {most[column]}" for column in most if figures[column] > most[column]]
    if figures["fma"] < budget["fma"] - 100 * INSTRUCTION_SLACK:
        failed.append(f"multiply-adds' share of the inner loop {figures['fma']} %, budget {budget['fma']} %")
    return failed


def compare(table, found, whole):
    failed = 0
    for key, figures in found.items():
        complaints = above(table[key], figures) if key in table else ["no budget yet"]
        for complaint in complaints:
            print(f"{' '.join(key)}: {complaint}")
        failed += bool(complaints)
    gone = [key for key in table if key not in found] if whole else []
    for key in gone:
        print(f"{' '.join(key)}: there is a budget, but no such kernel")
    print(f"{len(found)} kernels, {failed + len(gone)} not within their budgets")
    if failed or gone:
        print("Where that is meant: tests/budget/run.sh --renew [FILE or KERNEL ...], and say why in the commit.")
    return 1 if failed or gone else 0


def renew(table, found, names):
    """The table with what is found; sorted as the manifest and the files have it."""
    files = list(dict.fromkeys(file for file, *_ in rows_of_gpu()))
    built = {row[:2] for row in rows_of_gpu()}
    kept = {key: figures for key, figures in table.items()
            if names and key[:2] in built and not {key[0], key[2]} & set(names)}
    kept.update(found)
    rows = {key: kept[key] for key in sorted(kept, key=lambda key: (files.index(key[0]) if key[0] in files else -1))}
    TABLE.write_text(HEADER + "\n".join(lines_of(rows)) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("--clang", "--libclc"):
        parser.add_argument(name, required=True)
    parser.add_argument("--tools", type=Path, required=True, help="folder of ptxas and nvdisasm")
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--jobs", type=int, default=max(1, (os.cpu_count() or 1)))
    parser.add_argument("--renew", action="store_true")
    parser.add_argument("--show", action="store_true")
    parser.add_argument("names", nargs="*")
    options = parser.parse_args()
    rows = [row for row in rows_of_gpu()
            if not options.names or any(name == row[0] or re.search(rf"\b{name}\b", text_of(row[0])) for name in options.names)]
    found = measure_all(options, rows)
    if options.names:
        found = {key: figures for key, figures in found.items() if key[0] in options.names or key[2] in options.names}
    if not found:
        sys.exit("no such kernel is built for GPUs: " + " ".join(options.names))
    if options.show:
        print("\n".join(lines_of(found)))
        return 0
    if options.renew:
        renew(read_table(), found, options.names)
        return 0
    return compare(read_table(), found, not options.names)


if __name__ == "__main__":
    sys.exit(main())
