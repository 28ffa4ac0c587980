#!/usr/bin/env python3
"""A library of empty functions with the declarations of the public headers: what abidw describes.

    stub.py INCLUDE > stub.c

So the description holds the exported functions and public types, whatever the library is built from, in a second."""
import pathlib
import re
import sys


def main():
    folder = pathlib.Path(sys.argv[1])
    headers = sorted((folder / "hadalens").glob("*.h"))
    print('#define CL_TARGET_OPENCL_VERSION 120')
    for header in headers:
        print(f"#include <hadalens/{header.name}>")
    for header in headers:
        text = re.sub(r"/\*.*?\*/", "", header.read_text(encoding="utf-8"), flags=re.S)
        text = re.sub(r"^#.*$", "", text, flags=re.M)
        for declaration in re.findall(r"^HADA_API ([^;{]*);", text, re.M):
            print(" ".join(declaration.split()), "{ __builtin_trap(); }")


main()
