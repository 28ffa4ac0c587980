#!/usr/bin/env python3
"""Counts what shows whether the house is in order: how many, how long, how many of what should not be.

    count.py ROOT [BUILD]      a table; with a build also its tests, library and circles
    count.py --hold ROOT       fails where a number is above its limit, and says which

Run it on two versions to compare them.
"""
import pathlib
import re
import subprocess
import sys

# What has a limit: the limit that --hold enforces today, and the aim where it has not been reached.
LIMITS = {
    'lines of the library': (84_340, 56_000),  # light and transfer functions of pairs found together, a coarse grid for wide point spread functions, saturated values of pairs and of frames, faults of frames that come together (exposures, light, encoding, colours), colours and light of mosaics, the split of sensors that crop, light of each frame's own, frames encoded for displays, colours that a sensor mixes, stray light and bad pixels of single frames, bad pixels and light of the room, found in pairs and kept by models, responses confirmed with the crop in the model, noise of PSFs that is cut off at black, point spread functions that are not quite right, notes on captures of PSFs and on encoded frames, a dark level from the pairs, brightness that changes in sequences, steps that keep up with a camera, tissue recognised before a surface is tried, optics that settle slowly or spread wide, PSFs that vary over the field, scenes that move as a whole, of several depths too, emitters and their tracks, tissue and haze, the learned regulariser, frames as they come, readers without rights
    'lines of the kernels': (13_260, 12_000),  # errors less their mean, components of PSFs, the learned regulariser, scenes that move as a whole
    'lines of the command line': (8_560, 8_000),  # a colour matrix, films in bench, steps that keep up, PSFs that vary over the field, scenes cut off at white, tables of emitters and tracks, frames as they come
    'lines of tests (without corpora, frozen headers)': (63_130, 50_000),  # a coarse grid for wide point spread functions, saturated values of pairs, faults of frames that come together, colours and light of mosaics, light of each frame's own, encoded frames from files and pipes, colours that a sensor mixes, stray light and bad pixels of single frames, poor frames, PSFs whose noise is cut off, emitters that are dropped and found, weights that are found by predictions, files without a header under fuzzing, brightness that changes, steps that keep up, PSFs that vary over the field, readers without rights, sequences of several depths, emitters, tracks, tissue, weights of learned cameras, the learned regulariser; PyTorch's refinement, deepinv, the field's data
    'public functions': (241, 240),  # steps that keep up with a camera
    'words of the documentation (docs)': (45_100, 45_000),
    'files of SMALL lines or fewer, library and bindings': (80, 80),
    'files of more than 900 lines that give no reason': (0, 0),
}
SMALL = 60  # lines of a file that is likely to be a part of another
MANY = 10  # parameters that nobody can keep apart by position
SUBJECT = 72  # characters of a commit's first line
# private words where the field has one: docs/reference/conventions.md
PRIVATE = (r'\bTURN\b', r'\bSHADOW\b', r'\bSEEN\b', r'\bMADE\b', r'\bENGINE_FALL\b', r'\bbe_positive\b', r'\bmeet_frame\b',
           r'\bstumble\b', r'\bhada_\w*_look\b', r'(?<!")critic')  # in quotes: the old spelling, which is understood
KERNEL = re.compile(r'__kernel\b[^;{}]*?\bvoid\s+(\w+)\s*\(([^{}]*?)\)\s*\{', re.S)
STRUCT = re.compile(r'struct (\w+)\s*\{(.*?)^\}', re.S | re.M)
COMMENT = re.compile(r'/\*.*?\*/|//[^\n]*', re.S)


def texts(root, folders, *endings):
    """{path: text} of the sources in some folders."""
    found = {}
    for folder in folders:
        for path in sorted((root / folder).rglob('*')):
            if path.suffix in endings and path.is_file():
                found[path.relative_to(root).as_posix()] = path.read_text(encoding='utf-8', errors='replace')
    return found


def lines(files):
    return sum(text.count('\n') for text in files.values())


def matches(files, pattern):
    return sum(len(re.findall(pattern, text)) for text in files.values())


def parameters(kernels):
    """{kernel: number of its parameters}."""
    counts = {}
    for text in kernels.values():
        for name, inside in KERNEL.findall(COMMENT.sub('', text)):
            inside = re.sub(r'^\s*#.*$', '', inside, flags=re.M)
            counts[name] = inside.count(',') + 1
    return counts


def widest_struct(files):
    """fields, name and path of the struct with most fields in an internal header."""
    widest = (0, '', '')
    for path, text in files.items():
        if path.endswith('.h') and '/include/' not in path:
            for name, body in STRUCT.findall(COMMENT.sub('', text)):
                fields = sum(1 + line.count(',') for line in re.sub(r'\([^()]*\)', '', body).split(';') if line.strip())
                widest = max(widest, (fields, name, path))
    return widest


def run(*words):
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False).stdout


def count_sources(root, row):
    lib, cli = texts(root, ['lib'], '.c', '.h'), texts(root, ['bindings'], '.c', '.h')
    kernels = texts(root, ['kernels'], '.cl', '.h')
    kernels.pop('kernels/shared_ridge_weights.h', None)  # numbers
    host = {**lib, **cli}
    small = sum(text.count('\n') <= SMALL for path, text in host.items())
    bare = {path: COMMENT.sub('', text) for path, text in host.items()}
    tests = {path: text for path, text in texts(root, ['tests'], '.c', '.h', '.py', '.sh').items()
             if not re.match(r'tests/(abi/frozen|fuzz/corpus)', path)}
    docs = texts(root, ['docs'], '.md', '.rst')
    long = {path for path, text in {**host, **kernels, **tests}.items()
            if text.count('\n') > 900 and 'One file:' not in text[:1500]}
    row('files of the library and its bindings', len(host))
    limited = {
        'lines of the library': lines(lib),
        'lines of the kernels': lines(kernels),
        'lines of the command line': lines({path: text for path, text in cli.items() if '/cli/' in path}),
        'lines of tests (without corpora, frozen headers)': lines(tests),
        'public functions': matches(texts(root, ['lib/include'], '.h'), r'(?m)^HADA_API\b'),
        'words of the documentation (docs)': sum(len(text.split()) for text in docs.values()),
        'files of SMALL lines or fewer, library and bindings': small,
        'files of more than 900 lines that give no reason': len(long),
    }
    for what, number in limited.items():
        limit, aim = LIMITS[what]
        row(what + (f'; aim {aim:,}' if number > aim else ''), number, limit)
    widest = widest_struct(lib)
    row(f'fields of the widest internal struct ({widest[1]})', widest[0])
    row('  files that include its header', matches(host, '#include "' + re.escape(widest[2].removeprefix('lib/')) + '"'))
    row('positional kernel arguments (HADA_ARG)', matches(host, r'\bHADA_ARG\w*\('), 0)
    row('launches by name', matches(host, r'\bhada_launch_\w+\('))
    counts = parameters(kernels)
    row('kernels', len(counts))
    wide = sorted(name for name, n in counts.items() if n >= MANY)
    row(f'kernels of {MANY} parameters or more: ' + ' '.join(wide), len(wide), 0)
    row('parameters of the longest', max(counts.values()))
    row('macros of kernels spelt in host code (-D)', matches(bare, r'"[^"\n]*-D[A-Z]'), 0)
    row('if (!status) in the library', matches(lib, r'if \(!status\)'), 0)
    row('HADA_TRY in the library', matches(lib, r'\bHADA_TRY\('))
    row('private words', sum(matches({**host, **kernels}, word) for word in PRIVATE), 0)
    row('"freed with free()" in public headers', matches(texts(root, ['lib/include'], '.h'), r'freed with free\(\)'), 0)
    drawn = {path: text for path, text in host.items() if re.search(r'font|canvas|svg|plot|preview|draw|picture', path)}
    row('lines that draw previews and plots', lines(drawn))
    pages = texts(root, ['docs'], '.md')
    row('pages of the docs', len(pages), 25)
    for path, text in texts(root, ['examples'], '.c').items():
        row(f'lines of {path}', text.count('\n'), 80 if 'learn' in path else None)
    subjects = run('git', '-C', root, 'log', '-n', '50', '--format=%s').splitlines()
    row(f'of the last {len(subjects)} commits, subjects above {SUBJECT} characters',
        sum(len(subject) > SUBJECT for subject in subjects))


def count_build(root, build, row):
    library = (build / 'libhadalens.so').resolve()
    if library.exists():
        row('bytes of the library (text and data)', sum(map(int, run('size', library).splitlines()[1].split()[:2])))
        row('exported functions', len(run('nm', '-D', '--defined-only', library).splitlines()))
    rooms = root / 'tests/house/rooms.py'
    if rooms.exists():
        found = run(sys.executable, rooms, root, build).splitlines()
        row('circles between files and rooms, and other findings', len([line for line in found if 'one way' not in line]))
    tests = re.findall(r'Test +#\d+: (\S+)', run('ctest', '--test-dir', build, '-N'))
    row('tests', len(tests))
    row('  of operations of the check tool', sum(test.startswith('check_') for test in tests))
    # what the last run of each took, as ctest keeps it
    costs = {}
    data = build / 'Testing/Temporary/CTestCostData.txt'
    if data.exists():
        for line in data.read_text().splitlines():
            if line == '---':
                break
            name, _, seconds = line.split()
            costs[name] = float(seconds)
    for tier in ('quick', 'full', 'long', 'oracle', 'stress'):
        names = re.findall(r'Test +#\d+: (\S+)', run('ctest', '--test-dir', build, '-N', '-FS', '.', '-L', f'^{tier}$'))
        if names:
            row(f'  {tier}: tests', len(names))
            row(f'  {tier}: seconds, one after the other, mean of runs', round(sum(costs.get(name, 0) for name in names)))
    if costs:
        slowest = max((name for name in costs if name in tests), key=costs.get, default=None)
        row(f'  longest: {slowest}, seconds', round(costs.get(slowest, 0)))


def main(words):
    hold = words[:1] == ['--hold']
    words = words[hold:]
    if len(words) not in ((1,) if hold else (1, 2)):
        sys.exit(__doc__)
    above = []

    def row(what, number, most=None):
        if most is not None and number > most:
            above.append(f'{what}: {number:,}, at most {most:,}')
        if not hold:
            print(f'{number:>9,}  {what}')
    root = pathlib.Path(words[0])
    count_sources(root, row)
    if len(words) == 2:
        count_build(root, pathlib.Path(words[1]), row)
    if hold and above:
        sys.exit('\n'.join(above))


if __name__ == '__main__':
    main(sys.argv[1:])
