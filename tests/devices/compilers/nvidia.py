"""NVIDIA's own compiler of OpenCL C, as its driver has it, without a GPU and without the driver.

    nvidia.py FOLDER ARCHITECTURE [OPTION ...] <SOURCE

FOLDER holds libnvidia-nvvm.so.4 (OpenCL C to PTX) and libnvidia-ptxjitcompiler.so.1 (PTX to instructions, whose interface
is that of CUDA's nvPTXCompiler.h). A process of its own: what crashes ends one program alone. Prints JSON: what the two
compilers said.
"""
import ctypes
import json
import re
import sys
from pathlib import Path


def ptx_of(folder, source, options):
    """(PTX or None, messages). The function is the one that the driver's clBuildProgram calls."""
    library = ctypes.CDLL(str(folder / "libnvidia-nvvm.so.4"))
    sources, sizes = (ctypes.c_char_p * 1)(source), (ctypes.c_size_t * 1)(len(source))
    log, ptx = ctypes.c_char_p(), ctypes.c_char_p()
    code = library.NvCliCompileProgram(sources, 1, sizes, " ".join(options).encode(), ctypes.byref(log), ctypes.byref(ptx))
    return None if code else ptx.value, (log.value or b"").decode(errors="replace")


def assemble(folder, ptx, architecture):
    """(whether it went well, messages), resources among them."""
    library = ctypes.CDLL(str(folder / "libnvidia-ptxjitcompiler.so.1"))
    compiler = ctypes.c_void_p()
    if library.nvPTXCompilerCreate(ctypes.byref(compiler), ctypes.c_size_t(len(ptx)), ptx):
        return False, "nvPTXCompilerCreate failed"
    options = (ctypes.c_char_p * 2)(b"-v", f"--gpu-name={architecture}".encode())
    code = library.nvPTXCompilerCompile(compiler, len(options), options)
    said = ""
    for kind in ("Error", "Info"):
        size = ctypes.c_size_t()
        getattr(library, f"nvPTXCompilerGet{kind}LogSize")(compiler, ctypes.byref(size))
        text = ctypes.create_string_buffer(size.value + 1)
        getattr(library, f"nvPTXCompilerGet{kind}Log")(compiler, text)
        said += text.value.decode(errors="replace")
    library.nvPTXCompilerDestroy(ctypes.byref(compiler))
    return code == 0, said


def misaligned(ptx):
    """Kernels that read or write local memory by more bytes than any of their arrays is aligned to. The hardware ends
    the context there; a compiler for CPUs, which lays arrays out by more, does not show it."""
    found = []
    for name, parameters, body in re.findall(r"\.entry (\w+)\((.*?)\n\)(.*?)(?=\.entry |\Z)", ptx.decode(), re.S):
        aligned = [int(n) for n in re.findall(r"\.shared \.align (\d+)", body + parameters)]
        widths = [int(n or 1) * int(bits) // 8 for n, bits in re.findall(r"(?:ld|st)\.shared(?:\.v(\d))?\.[fubs](\d+)", body)]
        if max(widths, default=0) > max(aligned, default=0):
            found.append(f"{name}: local memory is used by {max(widths)} bytes and aligned to {max(aligned, default=0)}")
    return found


def main():
    folder, architecture, options = Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
    # what the driver adds by itself: the language, the device, addresses of 64 bits
    options += ["-cl-nv-cstd=CL1.2", f"-cl-nv-arch {architecture}", "-nv-m64"]
    ptx, messages = ptx_of(folder, sys.stdin.buffer.read(), options)
    well, resources = assemble(folder, ptx, architecture) if ptx else (False, "")
    json.dump({"well": well, "messages": "\n".join([messages, *(misaligned(ptx) if ptx else ())]), "resources": resources},
              sys.stdout)


if __name__ == "__main__":
    main()
