"""Makes C from kernels/: the text of every kernel file, the programs of manifest.txt, and typed launches.

    kernels.py KERNELS_FOLDER OUT_FOLDER

writes OUT/kernels.c (text with includes flattened and without comments, programs, what each kernel takes); for each
kernels/FILE.cl OUT/launch/FILE.h: a struct of named arguments for each kernel, read from its own declaration, and a
macro that launches it and compiles with exactly these arguments; and copies of kernels/shared_*.h, the only headers of
kernels/ that the host sees, to OUT/kernels. CONTRIBUTING.md shows how they are used.
"""
import re
import sys
from pathlib import Path

VALUES = {f"{base}{width}": f"cl_{base}{width}" for base in ("int", "uint", "long", "ulong", "float")
          for width in ("", "2", "4", "8", "16")}
# What a buffer's elements are, and the type of the launch's argument (lib/runtime/buffer.h).
BUFFERS = {"float": "cl_mem", "void": "cl_mem", "int": "hada_ints", "uchar": "hada_bytes", "half": "hada_halves"}
SHAPES = ("lanes", "groups", "tensor_cores", "all")


def fail(where, message):
    sys.exit(f"{where}: {message}")


def flatten(name, text, folder, seen):
    """[(key, text)]: the pieces of a file with includes in place of their lines, each header once; a header's pieces have
    the same keys wherever it is included. Also collects the headers."""
    pieces, before, at = [], "", 0
    for number, match in enumerate(re.finditer(r'(?:^|(?<=\n))#include "([A-Za-z0-9_]+\.h)"[^\n]*\n', text)):
        header = match.group(1)
        # the line before an include keeps its end of line
        pieces.append((f"{name}_{number}", (before + text[at:match.start()])[:-1] + "\n"))
        if header not in seen:
            seen.append(header)
            pieces += flatten(header, (folder / header).read_text(), folder, seen)
        before, at = "\n", match.end()
    return pieces + [(f"{name}_end", before + text[at:])]


def without_comments(text):
    """A text on the same lines, with a space for each comment."""
    def ends_of_lines(comment):
        return " " + re.sub(r"[^\\\n]|\\(?!\n)", "", comment.group())

    return re.sub(r"//[^\n]*", "", re.sub(r"/\*.*?\*/", ends_of_lines, text, flags=re.S))


def compact(text):
    """What a compiler reads of a text: without comments, indentation, aligned ends of lines and empty lines, so that a
    comment can change without a program being built again."""
    lines = (re.sub(r"[ \t]*\\$", r" \\", line.strip()) for line in without_comments(text).split("\n"))
    return "".join(line + "\n" for line in lines if line)


class Parameter:
    def __init__(self, text, where):
        words = re.findall(r"\w+|\*", text)
        self.name = words[-1]
        rest = [word for word in words[:-1] if word not in ("const", "restrict", "volatile")]
        if "*" in rest:
            space = rest[0]
            if space in ("__global", "__constant"):
                self.kind, self.type = "BUFFER", self.buffer_type(rest[1], f"{where}: {text.strip()}")
            elif space == "__local":
                self.kind, self.type = "LOCAL", "hada_local"
                self.stated = "STATED_SIZE" in rest
            elif space.isupper():  # an address space by macro
                self.kind, self.type = "EITHER", "hada_either"
            else:
                fail(where, f"the parameter '{text.strip()}' is a pointer without an address space")
        elif len(rest) == 1:
            self.kind, self.type = "VALUE", VALUES.get(rest[0], rest[0])
            if self.type == rest[0] and not self.type.startswith("hada_"):
                fail(where, f"the parameter '{text.strip()}' is neither a number nor a shared struct (hada_...)")
        else:
            fail(where, f"cannot read the parameter '{text.strip()}'")


    @staticmethod
    def buffer_type(element, where):
        if element.startswith("hada_"):
            return f"{element}_array"
        scalar = re.sub(r"\d+$", "", element)
        return BUFFERS.get(scalar) or fail(where, f"a buffer of {element} has no type for launches (BUFFERS)")


class Kernel:
    def __init__(self, name, parameters, where):
        self.name = name
        self.parameters = [Parameter(p, f"{where}: {name}") for p in parameters.split(",") if p.strip() != "void"]


class Program:
    def __init__(self, name, shapes, macros, where):
        self.name, self.shapes, self.macros = name, shapes, macros
        self.values = {}
        for macro in macros.split():
            match = re.fullmatch(r"-D(\w+)=(\d+)", macro)
            if not match:
                fail(where, f"the macro {macro} does not read -DNAME=NUMBER")
            self.values[match.group(1)] = int(match.group(2))


class File:
    def __init__(self, path):
        self.name, self.where = path.stem, f"kernels/{path.name}"
        headers = []
        self.pieces = flatten(path.stem, path.read_text(), path.parent, headers)
        self.shared = [header for header in headers if header.startswith("shared_")]
        plain = without_comments("".join(text for _, text in self.pieces))
        self.defaults = {name: int(value) for name, value in
                         re.findall(r"#ifndef (\w+)\s*\n\s*#define \1 +(\d+)\s*\n", plain)}
        declarations = re.findall(r"__kernel\s+(?:__attribute__\s*\(\(.*?\)\)\)\s*)?void\s+(\w+)\s*\(([^()]*)\)", plain)
        self.kernels = [Kernel(name, parameters, self.where) for name, parameters in declarations]
        if len(self.kernels) != len(re.findall(r"\b__kernel\b", plain)) or not self.kernels:
            fail(self.where, "a kernel's declaration cannot be read; a plain list of parameters is wanted")
        self.programs = []

    def finish(self):
        """Once its programs are known: what their macros choose."""
        if not self.programs:
            fail("kernels/manifest.txt", f"there is no row of {self.name}")
        if any(program.shapes != "groups" for program in self.programs):
            for parameter in (p for kernel in self.kernels for p in kernel.parameters):
                if parameter.kind == "LOCAL" and not parameter.stated:
                    fail(self.where, f"'{parameter.name}' lies in local memory: FPGAs need its STATED_SIZE (shared_local.h)")
        self.macros = sorted({macro for program in self.programs for macro in program.values})
        for macro in self.macros:
            if macro not in self.defaults:
                fail(self.where, f"the macro {macro} of the manifest has no '#ifndef {macro}' with a number")
        names, choices = set(), set()
        for program in self.programs:
            program.choice = tuple(program.values.get(macro, self.defaults[macro]) for macro in self.macros)
            if program.name in names or program.choice in choices:
                fail("kernels/manifest.txt", f"two rows of {self.name} have the name {program.name} or its macros")
            names.add(program.name)
            choices.add(program.choice)


def read_manifest(path, files):
    known = {file.name: file for file in files}
    for number, line in enumerate(path.read_text().splitlines(), 1):
        where = f"kernels/manifest.txt, line {number}"
        line = line.split("#")[0].strip()
        if not line:
            continue
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) != 4 or cells[1] not in SHAPES or not re.fullmatch(r"[a-z0-9_]+", cells[2]):
            fail(where, f"not a row of file | {', '.join(SHAPES)} | name | macros: {line}")
        if cells[0] not in known:
            fail(where, f"there is no kernels/{cells[0]}.cl")
        known[cells[0]].programs.append(Program(cells[2], cells[1], cells[3], where))
    for file in files:
        file.finish()


def constant(file, program):
    return f"HADA_PROGRAM_{file.name}_{program.name}".upper()


def program_of_shape(file):
    """A device's program, where its shape alone decides."""
    names = {}
    for shape in ("lanes", "groups"):
        rows = [program for program in file.programs if program.shapes in (shape, "all")]
        if len(rows) != 1:
            return ""
        names[shape] = constant(file, rows[0])
    return f"""
static inline hada_program_{file.name} hada_program_{file.name}_of(const hada_slot *slot)
{{
    return slot->context->shape == HADA_SHAPE_GROUPS ? {names['groups']} : {names['lanes']};
}}
"""


def program_by_macros(file):
    if not file.macros:
        return ""
    members = "".join(f"    int {macro.lower()};\n" for macro in file.macros)
    return f"""
typedef struct HADA_BY_NAME hada_macros_{file.name} {{
{members}}} hada_macros_{file.name};

static inline int hada_find_by_macros_{file.name}(hada_macros_{file.name} macros)
{{
    return hada_program_find(&hada_file_{file.name}, (const int *)(const void *)&macros);
}}

static inline const hada_macros_{file.name} *hada_macros_of_{file.name}(hada_program_{file.name} program)
{{
    return (const hada_macros_{file.name} *)(const void *)(hada_file_{file.name}.macro_values +
                                                           (int)program * hada_file_{file.name}.macro_count);
}}

/* The program with these macros, each named; negative where the manifest has none, and then no launch succeeds. */
#define hada_find_{file.name}(...) \\
    (HADA_ALL_NAMED({len(file.macros)}, __VA_ARGS__), \\
     hada_find_by_macros_{file.name}((hada_macros_{file.name}){{__VA_ARGS__}}))
"""


def launch_header(file):
    guard = f"HADA_LAUNCH_{file.name.upper()}_H"
    out = f"/* Made from {file.where} and kernels/manifest.txt by cmake/kernels.py. */\n#ifndef {guard}\n#define {guard}\n\n"
    out += '#include "runtime/launch.h"\n' + "".join(f'#include "kernels/{header}"\n' for header in file.shared)
    arrays = sorted({p.type for kernel in file.kernels for p in kernel.parameters if p.type.endswith("_array")})
    out += "".join(f"\ntypedef struct {array.replace('_array', '_memory')} *{array};\n" for array in arrays)
    programs = ",\n".join(f"    {constant(file, program)} = {i}" for i, program in enumerate(file.programs))
    out += f"""
extern const hada_kernel_file hada_file_{file.name};

typedef enum hada_program_{file.name} {{
{programs}
}} hada_program_{file.name};

static inline hada_status hada_prepare_{file.name}(hada_slot *slot, hada_program_{file.name} program, hada_error *err)
{{
    return hada_program_prepare(slot, &hada_file_{file.name}, (int)program, err);
}}
"""
    out += program_of_shape(file) + program_by_macros(file)
    for kernel in file.kernels:
        name = kernel.name
        members = "".join(f"    {p.type} {p.name};\n" for p in kernel.parameters)
        out += f"""
typedef struct HADA_BY_NAME hada_args_{name} {{
{members}}} hada_args_{name};

extern const hada_kernel hada_kernel_{name};

static inline hada_status hada_launch_with_{name}(hada_slot *slot, hada_program_{file.name} program,
                                                  const hada_range *range, hada_error *err,
                                                  const hada_args_{name} *args)
{{
    return hada_launch(slot, &hada_kernel_{name}, (int)program, range, args, err);
}}

#define hada_launch_{name}(slot, program, range, err, ...) \\
    (HADA_ALL_NAMED({len(kernel.parameters)}, __VA_ARGS__), \\
     hada_launch_with_{name}(slot, program, range, err, &(const hada_args_{name}){{__VA_ARGS__}}))
"""
    return out + "\n#endif\n"


LONGEST_LITERAL = 4000  # characters; C11 promises 4095


def literals(text):
    """String literals of whole lines."""
    chunks = [""]
    for line in text.splitlines(keepends=True):
        if len(chunks[-1]) + len(line) > LONGEST_LITERAL:
            chunks.append("")
        chunks[-1] += line
    escaped = [chunk.replace("\\", "\\\\").replace('"', '\\"') for chunk in chunks]
    return ['"' + chunk.replace("\n", '\\n"\n    "') + '"' for chunk in escaped]


def texts(files):
    """Every piece of text once: {key: names of its constants}, and their declarations."""
    names, out = {}, ""
    for key, text in (piece for file in files for piece in file.pieces):
        if key in names:
            continue
        names[key] = []
        for number, literal in enumerate(literals(compact(text))):
            names[key].append(re.sub(r"\W", "_", f"text_{key}_{number}"))
            out += f"static const char {names[key][-1]}[] =\n    {literal};\n"
    return names, out


def tables(files):
    out = "/* Made from kernels/ by cmake/kernels.py. */\n#include <stddef.h>\n\n"
    out += "".join(f'#include "launch/{file.name}.h"\n' for file in files) + "\n"
    objects = 0
    names, declarations = texts(files)
    out += declarations
    for file in files:
        name = file.name
        parts = [part for key, _ in file.pieces for part in names[key]]
        out += f"static const char *const pieces_{name}[] = {{{', '.join(parts)}}};\n"
        rows = "".join(f'    {{"{p.name}", "{p.macros}", "{p.shapes}"}},\n' for p in file.programs)
        out += f"static const hada_program_row programs_{name}[] = {{\n{rows}}};\n"
        if file.macros:
            choices = "".join("    " + "".join(f"{value}, " for value in p.choice) + "\n" for p in file.programs)
            out += f"static const int macros_{name}[] = {{\n{choices}}};\n"
        for index, kernel in enumerate(file.kernels):
            args = f"hada_args_{kernel.name}"
            rows = "".join(f"    {{offsetof({args}, {p.name}), sizeof({p.type}), HADA_KERNEL_PARAMETER_{p.kind}}},\n"
                           for p in kernel.parameters)
            out += (f"static const hada_kernel_parameter parameters_{kernel.name}[] = {{\n{rows}}};\n"
                    f'const hada_kernel hada_kernel_{kernel.name} = {{"{kernel.name}", &hada_file_{name}, '
                    f"parameters_{kernel.name}, {len(kernel.parameters)}, {index}}};\n")
        kernels = "".join(f"    &hada_kernel_{kernel.name},\n" for kernel in file.kernels)
        out += (f"static const hada_kernel *const kernels_{name}[] = {{\n{kernels}}};\n"
                f'const hada_kernel_file hada_file_{name} = {{"{name}", pieces_{name}, {len(parts)}, '
                f"kernels_{name}, {len(file.kernels)}, programs_{name}, "
                f"{len(file.programs)}, {f'macros_{name}' if file.macros else 'NULL'}, {len(file.macros)}, {objects}}};\n\n")
        objects += len(file.kernels) * len(file.programs)
    listed = "".join(f"    &hada_file_{file.name},\n" for file in files)
    return out + (f"const hada_kernel_file *const hada_kernel_files[] = {{\n{listed}}};\n"
                  f"const int hada_kernel_file_count = {len(files)};\n"
                  f"const int hada_kernel_object_count = {objects};\n")


def main(folder, out):
    files = [File(path) for path in sorted(folder.glob("*.cl"))]
    read_manifest(folder / "manifest.txt", files)
    written = {out / "kernels.c": tables(files)}
    for file in files:
        written[out / "launch" / f"{file.name}.h"] = launch_header(file)
    for path in sorted(folder.glob("shared_*.h")):
        written[out / "kernels" / path.name] = path.read_text()
    for path, text in written.items():
        # what has not changed is left alone, so that nothing that includes it is built again
        if not path.exists() or path.read_text() != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
