"""Makes the C source of the extension module from the public headers: cdef.py HEADERS OUTPUT.c.

What cffi needs to know of the C interface is read from the headers themselves, so that each declaration stands once:
comments and the preprocessor go, constants become declarations whose values the compiler finds, inline functions lose
their bodies, and every type of callback gets one function that C can call and Python defines.
"""

import re
import sys
from pathlib import Path

from cffi import FFI

MODULE = "hadalens._binding"
PYTHON = 0x030B0000  # 3.11: the oldest Python whose stable ABI is used

# what the headers take from others
PRELUDE = """
typedef ... *cl_context;
typedef ... *cl_device_id;
typedef ... *cl_command_queue;
typedef ... *cl_mem;
"""


def headers(folder: Path) -> list[str]:
    """Names of the headers in the order in which they may stand behind each other."""
    seen: list[str] = []

    def visit(name: str) -> None:
        if name in seen:
            return
        for other in re.findall(r"#include <(hadalens/\w+\.h)>", (folder / name).read_text()):
            visit(other)
        if name not in seen:
            seen.append(name)

    visit("hadalens/hadalens.h")
    visit("hadalens/opencl.h")
    return seen


def constants(text: str) -> str:
    """Declarations of the macros that are numbers or texts; the others have no place in Python."""
    lines = []
    for name, value in re.findall(r"^#define +(HADA\w+) +(\S.*?) *$", text, re.M):
        value = value.strip("()")
        if re.fullmatch(r"-?\d+", value):
            lines.append(f"#define {name} {value}")  # in full: arrays have such lengths
        elif re.fullmatch(r"0x[0-9a-f]+u", value):
            lines.append(f"#define {name} ...")
        elif re.fullmatch(r"-?\d+\.\d+", value):
            lines.append(f"static const double {name};")
        elif value.startswith('"'):
            lines.append(f"static char *const {name};")
    return "\n".join(lines) + "\n"


def declarations(text: str) -> str:
    """The declarations of a header, as cffi reads them."""
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.S)
    text = re.sub(r"\\\n", " ", text)
    found = constants(text)
    text = re.sub(r"^#.*$", "", text, flags=re.M)
    text = re.sub(r'extern "C" \{', "", text)
    text = re.sub(r"^HADA_INIT\((\w+), \w+\)", r"void \1_init(\1 *options);", text, flags=re.M)
    text = re.sub(r"static inline (.*?\))\s*\{.*?\n\}", r"\1;", text, flags=re.S)
    text = re.sub(r"\n\}\s*$", "", text)  # of extern "C"
    return found + text.replace("HADA_API ", "")


def callbacks(text: str) -> str:
    """For each type of function that C calls, a function named py_..., to be defined in Python (ffi.def_extern)."""
    made = []
    for result, name, arguments in re.findall(r"typedef ([\w ]+?) ?\(\*(\w+)\)\((.*?)\);", text, re.S):
        made.append(f"{result} py_{name.removeprefix('hada_')}({arguments});")
    for body, struct in re.findall(r"typedef struct \w+ \{(.*?)\} (\w+);", text, re.S) + [
        (body, struct) for struct, body in re.findall(r"^struct (\w+) \{(.*?)\};", text, re.S | re.M)
    ]:
        for result, name, arguments in re.findall(r"([\w ]+?) ?\(\*(\w+)\)\((.*?)\);", body, re.S):
            made.append(f"{result.strip()} py_{struct.removeprefix('hada_')}_{name}({arguments});")
    return 'extern "Python" {\n' + "\n".join(made) + "\n}\n"


def main(folder: str, output: str) -> None:
    """Read the headers of a folder and write the source."""
    names = headers(Path(folder))
    text = "".join(declarations((Path(folder) / name).read_text()) for name in names)
    ffi = FFI()
    ffi.cdef(PRELUDE + text + callbacks(text))
    ffi.set_source(
        MODULE,
        f"#define Py_LIMITED_API {PYTHON:#x}\n" + "".join(f"#include <{name}>\n" for name in names),
        py_limited_api=True,
    )
    ffi.emit_c_code(output)


if __name__ == "__main__":
    main(*sys.argv[1:])
