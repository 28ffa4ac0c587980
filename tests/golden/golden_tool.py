#!/usr/bin/env python3
"""What whole_way.sh needs beside the program, with Python's standard library alone.
  golden_tool.py hash FOLDER               hashes of all that is deterministic in the folder, sorted by name
  golden_tool.py pages IN.tif OUT.tif N    N pages, each IN's first, a little darker each time, the last two equal
  golden_tool.py offset IN.tif OUT.tif V   IN's first page plus V
  golden_tool.py turned IN_DEPTH OUT_DEPTH a depth's pairs with scenes mirrored, turned and enlarged twice
  golden_tool.py vgg OUT.safetensors       VGG-16 and the heads of LPIPS, weights from a hash
  golden_tool.py key HADALENS              what decides on bits here: OpenCL platform, driver, device, its units, C library
"""
import array
import hashlib
import json
import os
import platform
import re
import shutil
import struct
import subprocess
import sys

# Figures that are not results: times, versions, devices, what was cached, bytes held, where files went.
NOT_RESULTS = re.compile(r'^(version|seconds.*|.*_seconds|programs|device|devices|memory|outputs|log)$')
PROGRAM = re.compile(rb'hadalens \d+\.\d+\.\d+')
MADE_FROM = re.compile(rb'made_from=[0-9a-f-]+\n')  # since 0.2.0
VERSION = re.compile(rb'Hadalens=\d+\.\d+\.\d+')  # the stored hashes are of 0.1.0
SOFTWARE, DATE_TIME = 305, 306
STRIP_OFFSETS, STRIP_COUNTS, TILE_OFFSETS, TILE_COUNTS = 273, 279, 324, 325
TYPES = {1: 'B', 2: 's', 3: 'H', 4: 'I', 5: 'Q', 6: 'b', 7: 's', 8: 'h', 9: 'i', 10: 'q', 11: 'f', 12: 'd', 16: 'Q'}


def directories(data):
    """The tags of each page: {tag: values}, of a little-endian TIFF or BigTIFF file."""
    assert data[:2] == b'II', 'not a little-endian TIFF file'
    big = struct.unpack_from('<H', data, 2)[0] == 43
    count_at, count_size, entry, field = ('<Q', 8, 20, '<Q') if big else ('<H', 2, 12, '<I')
    size = struct.calcsize(field)
    at = struct.unpack_from(field, data, 8 if big else 4)[0]
    while at:
        tags = {}
        number = struct.unpack_from(count_at, data, at)[0]
        for i in range(number):
            base = at + count_size + i * entry
            tag, kind = struct.unpack_from('<HH', data, base)
            count = struct.unpack_from(field, data, base + 4)[0]
            code = TYPES[kind]
            length = count * struct.calcsize(code)
            place = base + 4 + size
            if length > size:
                place = struct.unpack_from(field, data, place)[0]
            raw = data[place:place + length]
            tags[tag] = raw if code == 's' else struct.unpack('<%d%s' % (count, code), raw)
        yield tags
        at = struct.unpack_from(field, data, at + count_size + number * entry)[0]


def pieces(data, tags):
    offsets = tags.get(STRIP_OFFSETS) or tags.get(TILE_OFFSETS)
    counts = tags.get(STRIP_COUNTS) or tags.get(TILE_COUNTS)
    return [data[o:o + c] for o, c in zip(offsets, counts)]


def hash_tiff(data, add):
    for tags in directories(data):
        for tag in sorted(tags):
            if tag not in (SOFTWARE, DATE_TIME, STRIP_OFFSETS, TILE_OFFSETS):
                add(b'%d' % tag)
                value = tags[tag]
                if isinstance(value, bytes):
                    add(VERSION.sub(b'Hadalens=0.1.0', PROGRAM.sub(b'', MADE_FROM.sub(b'', value))))
                else:
                    add(repr(value).encode())
        for piece in pieces(data, tags):
            add(piece)


def without(value):
    """A JSON document without what is no result."""
    if isinstance(value, dict):
        return {k: without(v) for k, v in value.items() if not NOT_RESULTS.match(k)}
    return [without(v) for v in value] if isinstance(value, list) else value


def canonical(value):
    return json.dumps(without(value), sort_keys=True).encode()


def hash_safetensors(data, add):
    length = struct.unpack_from('<Q', data)[0]
    header = json.loads(data[8:8 + length])
    words = header.pop('__metadata__', {})
    words.pop('library', None)
    add(canonical(words))
    for name in sorted(header):
        tensor = header[name]
        add(('%s %s %s' % (name, tensor['dtype'], tensor['shape'])).encode())
        begin, end = tensor['data_offsets']
        add(data[8 + length + begin:8 + length + end])


def hash_json(data, add):
    add(canonical(json.loads(data)))


def hash_csv(data, add):
    lines = [line.split(b',') for line in data.splitlines()]
    keep = [i for i, name in enumerate(lines[0]) if b'second' not in name]
    for line in lines:
        add(b','.join(line[i] for i in keep if i < len(line)))


def print_hashes(folder):
    ways = {'.tif': hash_tiff, '.model': hash_safetensors, '.safetensors': hash_safetensors, '.sums': hash_safetensors,
            '.net': hash_safetensors, '.json': hash_json, '.csv': hash_csv}
    found = []
    for root, _, files in os.walk(folder):
        for name in files:
            way = ways.get(os.path.splitext(name)[1])
            if way:
                path = os.path.join(root, name)
                digest = hashlib.sha256()

                def add(part):
                    digest.update(b'%d:' % len(part))
                    digest.update(part)
                with open(path, 'rb') as file:
                    way(file.read(), add)
                found.append((os.path.relpath(path, folder), digest.hexdigest()[:32]))
    for path, value in sorted(found):
        print(value, path)


def read_page(path):
    """rows, cols, channels, floats of the first page of a file as 'hadalens simulate' writes it."""
    with open(path, 'rb') as file:
        data = file.read()
    tags = next(directories(data))
    channels = tags.get(277, (1,))[0]
    assert tags.get(259, (1,))[0] == 1 and tags[258][0] == 32 and tags.get(284, (1,))[0] == 1, path
    values = array.array('f')
    values.frombytes(b''.join(pieces(data, tags)))
    return tags[257][0], tags[256][0], channels, values


def write_pages(path, rows, cols, channels, pages):
    """Float TIFF, channels interleaved, one strip a page."""
    out = bytearray(b'II*\0\0\0\0\0')
    link = 4
    for values in pages:
        data = array.array('f', values).tobytes()
        at = len(out)
        out += data
        bits = len(out)
        out += struct.pack('<%dH' % channels, *[32] * channels)
        formats = len(out)
        out += struct.pack('<%dH' % channels, *[3] * channels)
        out += bytes(-len(out) % 4)
        three = channels > 2
        entries = [(256, 4, 1, cols), (257, 4, 1, rows), (258, 3, channels, bits if channels > 1 else 32),
                   (259, 3, 1, 1), (262, 3, 1, 2 if three else 1), (273, 4, 1, at), (277, 3, 1, channels),
                   (278, 4, 1, rows), (279, 4, 1, len(data)), (284, 3, 1, 1), (339, 3, channels, formats if channels > 1 else 3)]
        assert channels != 2, 'pairs of 16-bit numbers stand in the entry itself'
        struct.pack_into('<I', out, link, len(out))
        out += struct.pack('<H', len(entries))
        for entry in entries:
            out += struct.pack('<HHII', *entry)
        link = len(out)
        out += b'\0\0\0\0'
    with open(path, 'wb') as file:
        file.write(out)


def save_pages(source, path, count):
    rows, cols, channels, values = read_page(source)
    darker = [array.array('f', (v * (1 - 0.125 * min(i, count - 2)) for v in values)) for i in range(count)]
    write_pages(path, rows, cols, channels, darker)


def save_offset(source, path, offset):
    rows, cols, channels, values = read_page(source)
    write_pages(path, rows, cols, channels, [array.array('f', (v + offset for v in values))])


def save_turned(source, folder):
    shutil.copytree(os.path.join(source, 'raw'), os.path.join(folder, 'raw'))
    os.makedirs(os.path.join(folder, 'scene'))
    for name in sorted(os.listdir(os.path.join(source, 'scene'))):
        rows, cols, channels, values = read_page(os.path.join(source, 'scene', name))
        turned = array.array('f')
        for i in range(2 * cols):  # a row of the new scene is a column of the old one: mirrored and turned
            for j in range(2 * rows):
                at = ((j // 2) * cols + i // 2) * channels
                turned.extend(values[at:at + channels])
        write_pages(os.path.join(folder, 'scene', name), 2 * cols, 2 * rows, channels, [turned])


def made_weights(name, count, exponent):
    """Floats of either sign with magnitudes from 2^exponent to 2^(exponent + 1), from a hash of their name."""
    bits = int.from_bytes(hashlib.shake_128(name.encode()).digest(4 * count), 'little')
    mask = int.from_bytes(struct.pack('<I', 0x807fffff) * count, 'little')
    power = int.from_bytes(struct.pack('<I', (127 + exponent) << 23) * count, 'little')
    return ((bits & mask) | power).to_bytes(4 * count, 'little')


def save_vgg(path):
    tensors = []
    inputs = 3
    for layer, channels in ((0, 64), (2, 64), (5, 128), (7, 128), (10, 256), (12, 256), (14, 256), (17, 512), (19, 512),
                            (21, 512), (24, 512), (26, 512), (28, 512)):
        exponent = -((9 * inputs).bit_length() + 1) // 2  # about 1 over the root of what is summed
        tensors.append(('features.%d.weight' % layer, (channels, inputs, 3, 3), exponent))
        tensors.append(('features.%d.bias' % layer, (channels,), -6))
        inputs = channels
    for i, channels in enumerate((64, 128, 256, 512, 512)):
        tensors.append(('lin%d.model.1.weight' % i, (1, channels, 1, 1), -4))
    header, at = {}, 0
    for name, shape, _ in tensors:
        size = 4
        for n in shape:
            size *= n
        header[name] = {'dtype': 'F32', 'shape': shape, 'data_offsets': [at, at + size]}
        at += size
    words = json.dumps(header).encode()
    words += b' ' * (-len(words) % 8)
    with open(path, 'wb') as file:
        file.write(struct.pack('<Q', len(words)) + words)
        for name, shape, exponent in tensors:
            begin, end = header[name]['data_offsets']
            data = made_weights(name, (end - begin) // 4, exponent)
            if name.startswith('lin'):  # the heads are nowhere negative
                data = b''.join(struct.pack('<f', abs(v)) for (v,) in struct.iter_unpack('<f', data))
            file.write(data)


def print_key(program):
    document = json.loads(subprocess.run([program, 'devices', '--json'], capture_output=True, check=True).stdout)
    chosen = next(d for d in document['devices'] if d['index'] == 0)
    # the device's instruction set stands in its version; weight gradients are summed in as many parts as it has units
    words = ' '.join([chosen['platform'], chosen['driver'], chosen['version'].split()[-1],
                      '%d units' % chosen['compute_units'], *platform.libc_ver()])
    print(re.sub(r'[^A-Za-z0-9.]+', '-', words).strip('-').lower())


def main(words):
    what, rest = words[0], words[1:]
    if what == 'hash':
        print_hashes(rest[0])
    elif what == 'pages':
        save_pages(rest[0], rest[1], int(rest[2]))
    elif what == 'offset':
        save_offset(rest[0], rest[1], float(rest[2]))
    elif what == 'turned':
        save_turned(*rest)
    elif what == 'vgg':
        save_vgg(rest[0])
    elif what == 'key':
        print_key(rest[0])
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main(sys.argv[1:] or [''])
