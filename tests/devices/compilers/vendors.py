"""The compilers of GPUs' vendors: each takes a program's source and macros for one device, and says what it made of it.

A vendor is a function (folder, device, source, macros) -> (complaints, {kernel: figures}). Complaints: errors, and warnings
that mean something. Figures: registers of a work-item (0: not said); spilled, as the compiler counts it; private, bytes of
a work-item's arrays that are in memory.
"""
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
LANGUAGE = "-cl-std=CL1.2"  # as lib/runtime/program.c asks for it


def nvidia(folder, device, source, macros):
    done = subprocess.run([sys.executable, HERE / "nvidia.py", folder, device, LANGUAGE, *macros], input=source.encode(),
                          capture_output=True, check=False)
    if done.returncode:
        return [f"the compiler ended with {done.returncode}: {done.stderr.decode(errors='replace')[-300:]}"], {}
    said = json.loads(done.stdout)
    # every kernel is an entry, which nothing calls
    complaints = [line for line in said["messages"].splitlines() if line.strip() and "overriding noinline" not in line]
    if not said["well"]:
        complaints.append("does not compile: " + said["resources"][-300:])
    found = {}
    for kernel, figures in re.findall(r"Compiling entry function '(\w+)'(.*?)(?=Compiling entry|\Z)", said["resources"], re.S):
        stack, stores, loads = map(int, re.search(
            r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", figures).groups())
        found[kernel] = {"registers": int(re.search(r"Used (\d+) registers", figures).group(1)),
                         "spilled": stores + loads, "private": stack}
    return complaints, found


def amd(folder, device, source, macros):
    """ROCm's way: clang, and ROCm's library of OpenCL C's functions."""
    command = ["clang-15", "-x", "cl", LANGUAGE, "-target", "amdgcn-amd-amdhsa", f"-mcpu={device}",
               f"--rocm-device-lib-path={folder}", "-O3", "-S", *macros, "-", "-o", "-"]
    done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    complaints = [line for line in done.stderr.splitlines() if re.search(r"(error|warning):", line)]
    if done.returncode:
        return complaints or ["does not compile: " + done.stderr[-300:]], {}
    found = {}
    kernels = re.search(r"^amdhsa\.kernels:(.*?)^amdhsa\.", done.stdout, re.M | re.S).group(1)
    for kernel in re.split(r"\n  - ", kernels)[1:]:
        # a kernel's own entries are indented by four; those of its arguments deeper
        said = dict(re.findall(r"^    \.(\w+): +(\S+)", "    " + kernel, re.M))
        found[said["name"]] = {"registers": int(said["vgpr_count"]), "spilled": int(said["vgpr_spill_count"]),
                               "private": int(said["private_segment_fixed_size"])}
    return complaints, found


def intel(folder, device, source, macros):
    """The compiler says how much is spilled, in a warning, and nothing of registers: every work-item has all of them."""
    libraries = folder / "usr/lib/x86_64-linux-gnu"
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "program.cl").write_text(source)
        done = subprocess.run([folder / "usr/bin/ocloc", "compile", "-file", "program.cl", "-device", device, "-options",
                               " ".join([LANGUAGE, *macros])], cwd=place, capture_output=True, text=True, check=False,
                              env=os.environ | {"LD_LIBRARY_PATH": str(libraries)})
    said = done.stdout + done.stderr
    found = {kernel: {"registers": 0, "spilled": int(count), "private": 0}
             for kernel, count in re.findall(r"kernel (\w+) +compiled SIMD\d+ allocated \d+ regs and spilled around (\d+)", said)}
    complaints = [line for line in said.splitlines() if re.search(r"error|warning|Error", line) and "spilled around" not in line]
    if done.returncode and not complaints:
        complaints = ["does not compile: " + said[-300:]]
    return complaints, found
