"""Makes completion for bash and zsh from the manual pages, which the program writes from its option tables.

    completion.py MANUALS_FOLDER OUT_FOLDER

writes OUT/hadalens (bash) and OUT/_hadalens (zsh): hadalens.bash and hadalens.zsh of this folder with what the pages say
in place of @NAMES@. What a value may be is read from the word that stands for it: small words ("auto|none") are offered,
FILE and the like ask for files, FOLDER and DATASET for folders. An option may follow again where its first sentence says
"may be given more than once".
"""
import re
import sys
from pathlib import Path

FILES = {"FILE", "MODEL", "MODEL2"}
FOLDERS = {"FOLDER", "DATASET", "DATASET2"}
WORD = re.compile(r"[a-z0-9-]+")
FILE_NAME = re.compile(r"[^.]*\.[a-z].*")  # PSF.tif, but not NAME=N,...
OPTION = re.compile(r"(?:\\fB-(?P<letter>.)\\fR, )?\\fB--(?P<name>[a-z0-9-]+)\\fR(?: \\fI(?P<argument>.+)\\fR)?")


def lines_of(page):
    """The lines of a manual page, without troff's escapes of single characters."""
    return [re.sub(r"\\([-e&])", lambda match: {"-": "-", "e": "\\", "&": ""}[match[1]], line)
            for line in page.read_text(encoding="utf-8").splitlines()]


class Option:
    """A row of a table: its name, and what may follow it."""

    def __init__(self, match, sentence):
        self.letter, self.name, self.argument = match["letter"], match["name"], match["argument"]
        self.help = sentence.removesuffix(".")
        self.again = "may be given more than once" in sentence
        parts = (self.argument or "").split("|")
        self.words = [part for part in parts if WORD.fullmatch(part)]
        others = [part for part in parts if not WORD.fullmatch(part)]
        self.files = any(part in FILES or FILE_NAME.fullmatch(part) for part in others)
        self.folders = any(part in FOLDERS for part in others)

    def kind(self, files, folders, neither):
        return files if self.files else folders if self.folders else neither


def read(manuals):
    """[(command, summary, options)] in the order of the program's own page."""
    page, commands = lines_of(manuals / "hadalens.1"), []
    for line, summary in zip(page, page[1:]):
        if found := re.fullmatch(r"\.BR hadalens-(\w+) \(1\)", line):
            text = lines_of(manuals / f"hadalens-{found[1]}.1")
            options = [Option(match, after) for before, row, after in zip(text, text[1:], text[2:])
                       if before == ".TP" and (match := OPTION.fullmatch(row))]
            commands.append((found[1], summary.removesuffix("."), options))
    return commands


def bash_value(command, option):
    """A line of a `case` on COMMAND/OPTION: what stands for the value."""
    names = f"{command}/--{option.name}" + (f" | {command}/-{option.letter}" if option.letter else "")
    return f"    {names}) echo '{' '.join([option.kind('FILE', 'FOLDER', 'VALUE'), *option.words])}' ;;"


def bash(commands):
    return {
        "COMMANDS": " ".join(command for command, _, _ in commands),
        "OPTIONS": "\n".join(f"    {command}) echo '{''.join(f' --{option.name}' for option in options)} ' ;;"
                             for command, _, options in commands),
        "VALUES": "\n".join(bash_value(command, option) for command, _, options in commands for option in options
                            if option.argument),
    }


def zsh_text(text):
    """Text between quotes of zsh, where _arguments takes brackets and colons for its own."""
    return re.sub(r"[\[\]:\\]", r"\\\g<0>", text).replace("'", "'\\''")


def zsh_option(option):
    """What _arguments is told of an option."""
    long = f"--{option.name}" + ("=" if option.argument else "")
    many = "*" if option.again else ""
    if not option.letter:
        line = f"'{many}{long}["
    elif many:
        line = f"'*'{{-{option.letter},{long}}}'["
    else:
        line = f"'(-{option.letter} --{option.name})'{{-{option.letter},{long}}}'["
    line += zsh_text(option.help) + "]"
    if option.argument:
        # a blank before a function: it is called as it stands
        line += ":" + zsh_text(option.argument) + ": _hadalens_" + option.kind("files", "folders", "words")
        line += "".join(f" {word}" for word in option.words)
    return line + "'"


def zsh(commands):
    return {
        "COMMANDS": "\n".join(f"        '{command}:{zsh_text(summary)}'" for command, summary, _ in commands),
        "ARGUMENTS": "\n".join(f"    {command})\n        _arguments -S "
                               + "".join(f"\\\n        {zsh_option(option)} " for option in options)
                               + "\\\n        '*:file:_files' ;;" for command, _, options in commands),
    }


def main():
    manuals, out, here = Path(sys.argv[1]), Path(sys.argv[2]), Path(__file__).parent
    commands = read(manuals)
    out.mkdir(parents=True, exist_ok=True)
    for form, made, name in (("hadalens.bash", bash(commands), "hadalens"), ("hadalens.zsh", zsh(commands), "_hadalens")):
        text = re.sub(r"@([A-Z]+)@", lambda match: made[match[1]], (here / form).read_text(encoding="utf-8"))
        (out / name).write_text(text, encoding="utf-8")


main()
