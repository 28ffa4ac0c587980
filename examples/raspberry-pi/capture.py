#!/usr/bin/env python3
"""Show pictures on a display and capture each with the camera of a Raspberry Pi: pairs to learn a camera from.

    capture.py PICTURE... -o camera/z300mm

For each picture it writes raw/NAME.dng, what the sensor recorded, and scene/NAME, the picture. The display stands at
the distance that the folder's name says. Pairs that are there already are passed over, so it can be stopped and started
again. Exposure and gain are measured on the first picture and kept for all of them.

Needs Python 3.9, feh (apt install feh) and rpicam-still, or other programs that --show and --camera name.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

SHOW = "feh --fullscreen --auto-zoom --hide-pointer --image-bg black"
CAMERA = "rpicam-still --nopreview --awbgains 1,1 --denoise off"


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="+", type=Path, help="what to show: photographs with many edges and textures")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="folder of the distance, such as camera/z300mm"
    )
    parser.add_argument("--shutter", type=int, help="exposure in microseconds (default: measured on the first picture)")
    parser.add_argument("--gain", type=float, default=1.0, help="of the sensor (default: 1, the least noise)")
    parser.add_argument("--settle", type=float, default=1.0, help="seconds until a picture stands still (default: 1)")
    parser.add_argument("--show", default=SHOW, help=f"program that shows a file until it is ended (default: {SHOW})")
    parser.add_argument("--camera", default=CAMERA, help=f"program that captures (default: {CAMERA})")
    return parser.parse_args()


@contextlib.contextmanager
def shown(command: str, picture: Path, settle: float) -> Iterator[None]:
    """Show a picture on the display as long as the block lasts."""
    words = [*shlex.split(command), str(picture)]
    program = subprocess.Popen(words)
    try:
        time.sleep(settle)
        if program.poll() is not None:
            raise SystemExit(f"{words[0]} ended by itself; is there a display? (over ssh: export DISPLAY=:0)")
        yield
    finally:
        program.terminate()
        program.wait()


def measure(camera: str, gain: float) -> int:
    """Return the exposure in microseconds that the camera chooses for what it sees."""
    with tempfile.TemporaryDirectory() as folder:
        facts = Path(folder) / "facts.json"
        command = [
            *shlex.split(camera),
            "--gain",
            str(gain),
            "--metadata",
            str(facts),
            "--output",
            f"{folder}/seen.jpg",
        ]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        return int(json.loads(facts.read_text())["ExposureTime"])


def capture(camera: str, shutter: int, gain: float, to: Path) -> None:
    """Write the sensor's values; the file appears whole or not at all."""
    with tempfile.TemporaryDirectory(dir=to.parent, prefix=".") as folder:
        taken = Path(folder) / "frame.dng"
        command = [*shlex.split(camera), "--immediate", "--raw", "--shutter", str(shutter), "--gain", str(gain)]
        subprocess.run([*command, "--output", str(taken.with_suffix(".jpg"))], check=True, stderr=subprocess.DEVNULL)
        taken.rename(to)


def main() -> None:
    """Capture what is not there yet."""
    options = arguments()
    names = [picture.stem for picture in options.pictures]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise SystemExit(f"two pictures have the name {min(twice)}; rename one")
    missing = [str(picture) for picture in options.pictures if not picture.is_file()]
    if missing:
        raise SystemExit(f"{missing[0]}: there is no such picture")
    raw, scene = options.output / "raw", options.output / "scene"
    raw.mkdir(parents=True, exist_ok=True)
    scene.mkdir(exist_ok=True)
    kept = options.output / "exposure.json"
    if kept.exists():  # pairs of one distance have one exposure
        options.shutter, options.gain = json.loads(kept.read_text())
    for number, picture in enumerate(options.pictures, 1):
        frame = raw / f"{picture.stem}.dng"
        if frame.exists():
            continue
        with shown(options.show, picture, options.settle):
            if options.shutter is None:
                options.shutter = measure(options.camera, options.gain)
            kept.write_text(json.dumps([options.shutter, options.gain]))
            capture(options.camera, options.shutter, options.gain, frame)
        shutil.copyfile(picture, scene / picture.name)
        print(f"{number} of {len(options.pictures)}: {frame}, {options.shutter} microseconds")


if __name__ == "__main__":
    try:
        main()
    except (OSError, subprocess.CalledProcessError, KeyError, ValueError) as reason:
        sys.exit(f"capture.py: {reason}")
