#!/usr/bin/env python3
"""Shows a public header to Doxygen: plain comments become its own, with nothing in them that it would take for markup.

A comment behind code on its line belongs to what stands before it, one on a line of its own to what follows, the first
of the file to the file."""
import re
import sys

MARKUP = re.compile(r"[\\@<>#%&]")


def shown(match, text, first):
    begin = text.rfind("\n", 0, match.start()) + 1
    body = MARKUP.sub(lambda mark: "\\" + mark.group(), match.group(1))
    if first:
        return "/** \\file\n" + body + "*/"
    return ("/**<" if text[begin : match.start()].strip() else "/**") + body + "*/"


def main():
    text = open(sys.argv[1], encoding="utf-8").read()
    # the one of extern "C" and the guard's text stay as they are: they hold no comments
    out, at = [], 0
    for number, match in enumerate(re.finditer(r"/\*(.*?)\*/", text, re.S)):
        out += [text[at : match.start()], shown(match, text, number == 0)]
        at = match.end()
    sys.stdout.write("".join(out) + text[at:])


main()
