"""Reads what ptxas and nvdisasm say of kernels: resources, and figures of their machine code (SASS)."""
import re

ARITHMETIC = re.compile(r"FFMA|HMMA")
NARROW = {"8": 1, "16": 2, "32": 4, "64": 8, "128": 16}


def resources(text):
    """{kernel: {registers, stack, spills, local}} of the messages of ptxas -v."""
    found = {}
    for block in re.split(r"Compiling entry function ", text)[1:]:
        name = re.match(r"'(\w+)'", block).group(1)
        stack, stores, loads = (int(x) for x in re.search(
            r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", block).groups())
        shared = re.search(r"(\d+) bytes smem", block)
        found[name] = {"registers": int(re.search(r"Used (\d+) registers", block).group(1)), "stack": stack,
                       "spills": stores + loads, "local": int(shared.group(1)) if shared else 0}
    return found


def group_sizes(code):
    """{kernel: (x, y, z)} of the kernels whose LLVM code states the size of their groups."""
    nodes = dict(re.findall(r"^(!\d+) = !\{(i32 \d+, i32 \d+, i32 \d+)\}", code, re.M))
    return {name: tuple(int(x) for x in re.findall(r"i32 (\d+)", nodes[node])) for name, node in
            re.findall(r"^define .*?@(\w+)\(.*?!reqd_work_group_size (!\d+)", code, re.M)}


def with_group_sizes(ptx, sizes):
    """PTX that states them as well, from which ptxas knows how many registers there are; clang leaves them out."""
    for name, size in sizes.items():
        words = ", ".join(map(str, size))
        ptx = re.sub(rf"(\.entry {name}\([^)]*\)\s*)\{{", rf"\1.reqntid {words}\n{{", ptx)
    return ptx


def bodies(sass):
    """{kernel: [(label or None, operation, words)]}: instructions with the label before them."""
    found, lines, label = {}, None, None
    for line in sass.splitlines():
        line = line.strip()
        start = re.match(r"\.text\.(\w+):", line)
        if start:
            lines = found.setdefault(start.group(1), [])
            continue
        mark = re.match(r"(\.L_x_\d+):", line)
        if mark:
            label = mark.group(1)
            continue
        code = re.match(r"/\*[0-9a-f]+\*/\s+(?:@!?U?P\w+\s+)?([A-Z][\w.]*)(.*?);", line)
        if code and lines is not None:
            lines.append((label, code.group(1), code.group(2)))
            label = None
    return found


def width(operation):
    """Bits of a load or store."""
    match = re.search(r"\.(?:U|S)?(8|16|64|128)(?:\.|$)", operation)
    return match.group(1) if match else "32"


def innermost_loops(lines):
    """[(first, last)]: stretches between a label and a jump back to it that hold no other."""
    at, loops = {}, []
    for i, (label, operation, words) in enumerate(lines):
        if label:
            at[label] = i
        target = re.search(r"\.L_x_\d+", words)
        # a kernel ends with a jump to itself
        if operation == "BRA" and target and at.get(target.group(0), i) < i:
            loops.append((at[target.group(0)], i))
    return [a for a in loops if not any(b != a and a[0] <= b[0] and b[1] <= a[1] for b in loops)]


def length(lines):
    """Instructions before the padding at a kernel's end."""
    count = len(lines)
    while count and lines[count - 1][1] in ("NOP", "BRA"):
        count -= 1
    return count + 1


def hottest_loop(lines):
    """(instructions, share of multiply-adds in percent) of the innermost loop with the most multiply-adds."""
    best = (0, 0, 0)
    for first, last in innermost_loops(lines):
        part = lines[first:last + 1]
        adds = sum(1 for _, operation, _ in part if ARITHMETIC.match(operation))
        best = max(best, (adds, len(part), 100 * adds // len(part)))
    return best[1:]


def figures(lines):
    """What the machine code of a kernel says."""
    widths = {kind: dict.fromkeys(NARROW, 0) for kind in ("load", "store")}
    for _, operation, _ in lines:
        kind = {"LDG": "load", "STG": "store"}.get(operation.split(".")[0])
        if kind:
            widths[kind][width(operation)] += 1
    loop, share = hottest_loop(lines)
    return {"instructions": length(lines), "loop": loop, "fma": share,
            **{kind: widths[kind] for kind in widths}}
