"""Files by the Python package safetensors read here, and the other way round. Usage: oracle_safetensors.py ORACLE_IO"""
import subprocess
import sys
import tempfile
from pathlib import Path

try:
    import numpy as np
    from safetensors import safe_open
    from safetensors.numpy import load_file, save_file
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

TOOL = sys.argv[1]
TEMPORARY = tempfile.TemporaryDirectory(prefix="hadalens-safetensors-")
FOLDER = Path(TEMPORARY.name)


def foreign():
    random = np.random.default_rng(2)
    tensors = {"a": random.standard_normal((3, 5)).astype(np.float32), "b.c": random.standard_normal((4,)).astype(np.float64),
               "half": random.standard_normal((2, 2, 2)).astype(np.float16), "tiny": np.float16([6e-8, 1e-5, -0.0, np.inf]),
               "bytes": np.arange(5, dtype=np.uint8), "whole": np.arange(-3, 4, dtype=np.int64), "scalar": np.float32(7),
               "none": np.zeros((0, 3), np.float32)}
    tensors = {name: np.asarray(value) for name, value in tensors.items()}
    path = FOLDER / "foreign.safetensors"
    save_file(tensors, path, metadata={"note": "äöü ✓"})
    out = subprocess.run([TOOL, "read-tensors", path], check=True, capture_output=True, encoding="utf-8").stdout.splitlines()
    assert out[-1] == "note=äöü ✓", out[-1]
    seen = {}
    for line in out[:-1]:
        head, _, numbers = line.partition(" :")
        name, _, *shape = head.split()
        assert tuple(map(int, shape)) == tensors[name].shape, line
        seen[name] = np.array([float.fromhex(v) for v in numbers.split()], np.float32)
    assert set(seen) == set(tensors)
    for name, value in tensors.items():
        if value.dtype.kind == "f":
            assert np.array_equal(seen[name], value.astype(np.float32).ravel()), name


def ours():
    path = FOLDER / "ours.safetensors"
    subprocess.run([TOOL, "write-tensors", path], check=True)
    tensors = load_file(path)
    assert np.array_equal(tensors["doubles"], [[1, -2.5, 1e300], [0, 3, 7]])
    assert np.array_equal(tensors["floats"], np.float32([[0.5, -1e-30, 3e38], [4, 5, 6]]))
    assert tensors["scalar"].shape == () and tensors["scalar"] == 42 and tensors["empty"].shape == (0, 4)
    assert np.array_equal(tensors["halves"], np.float16([[0.1, -2, 65504], [6e-8, np.inf, 0]]))
    with safe_open(path, framework="numpy") as file:
        assert file.metadata() == {"note": 'für "Python"\n'}
    assert int.from_bytes(path.read_bytes()[:8], "little") % 8 == 0


foreign()
ours()
print("ok")
