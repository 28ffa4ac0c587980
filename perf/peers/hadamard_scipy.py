"""The Hadamard stage as the paper's authors compute it, in SciPy: for every depth and colour a full complex forward
transform, the complex product, a full complex inverse transform, modulus and shift, in complex64 on two threads.
Prints one JSON line: milliseconds a plane. Also with half spectra and one shared forward transform.
   python3 hadamard_scipy.py ROWS COLS DEPTHS [REPEATS]"""
import json
import sys
import time

import numpy as np
import scipy.fft as fft

rows, cols, depths = (int(v) for v in sys.argv[1:4])
repeats = int(sys.argv[4]) if len(sys.argv) > 4 else 1
rng = np.random.default_rng(1)
raw = rng.random((3, rows, cols), dtype=np.float32)
kernel = (rng.standard_normal((rows, cols)) + 1j * rng.standard_normal((rows, cols))).astype(np.complex64)
half = np.ascontiguousarray(kernel[:, : cols // 2 + 1])

full_times, half_times = [], []
for _ in range(repeats):
    for depth in range(depths):
        start = time.perf_counter()
        for channel in range(3):
            spectrum = fft.fft2(raw[channel].astype(np.complex64), workers=2)
            plane = np.abs(fft.ifftshift(fft.ifft2(spectrum * kernel, workers=2)))
        full_times.append((time.perf_counter() - start) / 3)
    start = time.perf_counter()
    spectra = fft.rfft2(raw, workers=2)
    for depth in range(depths):
        for channel in range(3):
            plane = fft.irfft2(spectra[channel] * half, s=(rows, cols), workers=2)
    half_times.append((time.perf_counter() - start) / (3 * depths))
assert plane.dtype == np.float32
print(json.dumps({"full_ms": 1e3 * float(np.median(full_times)), "half_ms": 1e3 * float(np.median(half_times)),
                  "planes": 3 * depths * repeats}))
