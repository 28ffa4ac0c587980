#!/usr/bin/env python3
"""The figures of `hadalens evaluate --json` against formulas in NumPy and SciPy and, where it is installed, against
scikit-image. Usage: oracle_metrics.py HADALENS"""
import json
import subprocess
import sys
import tempfile
from pathlib import Path

try:
    import numpy as np
    import tifffile
    from scipy.ndimage import gaussian_filter
except ImportError as missing:
    print("skipped:", missing)
    sys.exit(77)

try:
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity
except ImportError:
    structural_similarity = None

failures = checks = 0


def expect(what, got, want, tolerance):
    global failures, checks
    checks += 1
    if not abs(got - want) <= tolerance:
        failures += 1
        print(f"{what}: {got} instead of {want}")


def evaluate(result, truth, *options):
    run = subprocess.run([sys.argv[1], "evaluate", result, truth, "--json", *options], capture_output=True, text=True)
    if run.returncode:
        sys.exit(run.stderr)
    return json.loads(run.stdout)["files"][0]


def ssim_map(a, b, span):
    """Wang et al. 2004, of every window inside the image, all channels."""
    def mean(x):
        return gaussian_filter(x, (1.5, 1.5, 0), truncate=3.5)[5:-5, 5:-5]
    c1, c2 = (0.01 * span) ** 2, (0.03 * span) ** 2
    ma, mb = mean(a), mean(b)
    va, vb, vab = mean(a * a) - ma**2, mean(b * b) - mb**2, mean(a * b) - ma * mb
    return (2 * ma * mb + c1) * (2 * vab + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))


def image_case(folder, seed, rows, cols, channels, peak, window, masked):
    draw = np.random.default_rng(seed)
    scale = peak / 2
    truth = gaussian_filter(draw.random((rows, cols, channels)), (2, 2, 0)) * 2 * scale
    result = 0.9 * truth + gaussian_filter(draw.normal(size=truth.shape), (1, 1, 0)) * 0.1 * scale
    truth, result = truth.astype(np.float32), result.astype(np.float32)
    mask = gaussian_filter(draw.normal(size=(rows, cols)), 4) > 0
    for name, image in ("truth", truth), ("result", result), ("mask", mask.astype(np.uint8) * 255):
        tifffile.imwrite(f"{folder}/{name}.tif", image.squeeze(), photometric="rgb" if image.shape[2:] == (3,) else
                         "minisblack")
    options = ["--peak", str(peak)]
    if window:
        height, width, row, col = window
        options += ["--window", f"{height}x{width}" + ("" if row is None else f"+{row}+{col}")]
        row, col = ((rows - height) // 2, (cols - width) // 2) if row is None else (row, col)
        truth, result, mask = (x[row:row + height, col:col + width] for x in (truth, result, mask))
    if masked:
        options += ["--mask", f"{folder}/mask.tif"]
    else:
        mask = np.ones_like(mask)
    got = evaluate(f"{folder}/result.tif", f"{folder}/truth.tif", *options)
    truth, result = truth.astype(np.float64), result.astype(np.float64)
    case = f"{rows}x{cols}x{channels} window {window} mask {masked}"
    for name, span in ("ssim", peak), ("authors_ssim", 2 * peak):
        expect(f"{case}: {name}", got[name], ssim_map(truth, result, span)[mask[5:-5, 5:-5]].mean(), 1e-6)
        if structural_similarity and not masked:
            expect(f"{case}: {name} of scikit-image", got[name],
                   structural_similarity(truth, result, data_range=span, gaussian_weights=True, sigma=1.5,
                                         use_sample_covariance=False, channel_axis=2), 1e-6)
    a, b = truth[mask], result[mask]
    mse = ((a - b) ** 2).mean()
    expect(f"{case}: psnr", got["psnr"], 10 * np.log10(peak**2 / mse), 1e-5)
    if structural_similarity:
        expect(f"{case}: psnr of scikit-image", got["psnr_all_pages"], peak_signal_noise_ratio(a, b, data_range=peak),
               1e-5)
    expect(f"{case}: mae", got["mae"], np.abs(a - b).mean(), 1e-7 * peak)
    each = 10 * np.log(peak**2 / ((a - b) ** 2).mean(axis=1)) / 2.303
    expect(f"{case}: authors_psnr", got["authors_psnr"], each.mean(), 1e-4)
    for name, image in ("sharpness", result), ("sharpness_truth", truth):
        want = np.hypot(*np.gradient(image, axis=(0, 1)))[mask].mean()
        expect(f"{case}: {name}", got[name], want, 1e-7 * peak)


def map_case(folder, seed, window, masked):
    draw = np.random.default_rng(seed)
    list_mm = np.array([100.0, 150.0, 220.0, 400.0])
    truth = list_mm[draw.integers(0, 4, (31, 45))]
    truth[draw.random(truth.shape) < 0.2] = np.nan
    result = truth * draw.uniform(0.7, 1.4, truth.shape)
    result[draw.random(truth.shape) < 0.3] = np.nan
    mask = draw.random(truth.shape) < 0.5
    truth, result = truth.astype(np.float32), result.astype(np.float32)
    for name, image in ("truth_depth", truth), ("result_depth", result), ("mask", mask.astype(np.uint8)):
        tifffile.imwrite(f"{folder}/{name}.tif", image)
    options = ["--distances", ",".join(map(str, list_mm)), "--tolerance", "0.4"]
    if window:
        options += ["--window", "20x30+3+7"]
        truth, result, mask = (x[3:23, 7:37] for x in (truth, result, mask))
    if masked:
        options += ["--mask", f"{folder}/mask.tif"]
        truth = np.where(mask, truth, np.nan)
    got = evaluate(f"{folder}/result_depth.tif", f"{folder}/truth_depth.tif", *options)

    def index(z):  # linear in 1/z, beyond the ends with the slope of the last step
        i = np.clip(np.searchsorted(list_mm, z) - 1, 0, 2)
        a, b = 1 / list_mm[i], 1 / list_mm[i + 1]
        return i + (a - 1 / z) / (a - b)

    there = ~np.isnan(truth)
    covered = there & ~np.isnan(result)
    t, r = truth[covered].astype(float), result[covered].astype(float)
    steps = np.abs(index(r) - index(t))
    case = f"map window {window} mask {masked}"
    expect(f"{case}: coverage", got["coverage"], covered.sum() / there.sum(), 1e-9)
    expect(f"{case}: within", got["within"], (steps <= 0.4).mean(), 1e-9)
    expect(f"{case}: mean_error_mm", got["mean_error_mm"], np.abs(r - t).mean(), 1e-6)
    expect(f"{case}: mean_error_steps", got["mean_error_steps"], steps.mean(), 1e-6)


with tempfile.TemporaryDirectory() as folder:
    Path(folder).mkdir(exist_ok=True)
    image_case(folder, 1, 40, 57, 3, 1.0, None, False)
    image_case(folder, 2, 40, 57, 1, 1.0, None, True)
    image_case(folder, 3, 61, 48, 3, 1.0, (33, 29, None, None), False)
    image_case(folder, 4, 61, 48, 3, 2.5, (33, 29, 4, 19), True)
    for i, (window, masked) in enumerate(((False, False), (False, True), (True, False), (True, True))):
        map_case(folder, 10 + i, window, masked)
print(f"{checks - failures} of {checks} figures agree;", "with" if structural_similarity else "without", "scikit-image")
sys.exit(failures != 0)
