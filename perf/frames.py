"""What the scripts that compare results share: running the program, reading images, sheets of pictures. Needs NumPy and
tifffile."""
import json
import pathlib
import shutil
import struct
import subprocess
import zlib

import numpy as np
import tifffile


def run(hadalens, *words):
    done = subprocess.run([str(hadalens), *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"hadalens {' '.join(map(str, words))}\n{done.stderr}")
    return done.stdout


def reconstruct(hadalens, files, model, out, options):
    """Median seconds of a frame, without the first where there are more: it pays for the start."""
    shutil.rmtree(out, ignore_errors=True)
    report = json.loads(run(hadalens, "reconstruct", *files, "-m", model, "-o", out, "--no-preview", "--json", *options))
    seconds = sorted(f["frames"][0]["seconds"]["total"] for f in report["files"][1:] or report["files"])
    return seconds[len(seconds) // 2]


def picture(path):
    """A TIFF image as rows x cols x 3 of floats."""
    image = np.asarray(tifffile.imread(path), float)
    image = image[None] if image.ndim == 2 else image
    image = image if image.shape[-1] in (1, 3) else np.moveaxis(image, 0, -1)
    return np.repeat(image, 3, -1) if image.shape[-1] == 1 else image


def coloured(distances_mm, near_mm, far_mm):
    """A distance map, linear in 1/z: warm is near, cold is far, grey is not known."""
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (1 / near_mm - 1 / distances_mm) / (1 / near_mm - 1 / far_mm)
    unknown = ~np.isfinite(t)
    t = np.clip(np.where(unknown, 0, t), 0, 1)
    stops = np.array([[0.94, 0.98, 0.13], [0.97, 0.58, 0.25], [0.80, 0.28, 0.47], [0.49, 0.01, 0.66], [0.05, 0.03, 0.53]])
    at = t * (len(stops) - 1)
    low = np.minimum(at.astype(int), len(stops) - 2)
    part = (at - low)[..., None]
    image = stops[low] * (1 - part) + stops[low + 1] * part
    image[unknown] = 0.5
    return image


def png(path, image, gamma=2.2):
    """8-bit RGB, rows x cols x 3, values 0 to 1, of light (gamma 1: shown as they are)."""
    pixels = (255 * np.clip(image, 0, 1) ** (1 / gamma) + 0.5).astype(np.uint8)
    raw = b"".join(b"\0" + row.tobytes() for row in pixels)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
    pathlib.Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw, 9)) +
                                   chunk(b"IEND", b""))


def sheet(path, panels, side, per_row, gamma=2.2):
    """Panels side by side, in rows, each brought to side x side pixels."""
    def scaled(image):
        rows = np.arange(side) * image.shape[0] // side
        cols = np.arange(side) * image.shape[1] // side
        return image[rows][:, cols]
    panels = [scaled(p) for p in panels]
    panels += [np.ones_like(panels[0])] * (-len(panels) % per_row)
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    png(path, np.concatenate([np.concatenate(panels[k:k + per_row], 1) for k in range(0, len(panels), per_row)], 0), gamma)
