"""The same PSFs by wave optics, lens by lens, with NumPy and SciPy's transforms on two threads. Reads camera.json,
lenses.csv and psf.tif of a folder that 'hadalens optics --optics wave' made; prints the seconds, and how far the stacks
are from each other (relative L2). Usage: optics_scipy.py FOLDER [ROUNDS]"""
import json
import sys
import time

import numpy as np
import scipy.fft as fft

STRAY, OVERSAMPLING, MOST, GOOD, LEAST = 0.002, 1.5, 4.0, 8, 3


def smooth(least, step):
    n = int(np.ceil(least / step)) * step
    while True:
        m = n
        for p in (2, 3, 5, 7):
            while m % p == 0:
                m //= p
        if m == 1:
            return n
        n += step


def edges(camera, lenses, reach, l, u, v):
    """Distance to the nearest edge of the ground of lens l at u, v from its centre."""
    x, y = lenses[l]
    edge = np.minimum(camera["lens_diameter_mm"] / 2 - np.hypot(u, v), camera["aperture_mm"] / 2 - np.hypot(x + u, y + v))
    for other in np.delete(lenses, l, 0) - lenses[l]:
        apart = np.hypot(*other)
        if apart <= 2 * reach:
            edge = np.minimum(edge, apart / 2 - (other[0] * u + other[1] * v) / apart)
    return edge


def index(camera, nm):
    d, f, c = 587.5618, 486.1327, 656.2725
    n, v = camera["refractive_index"], camera["abbe_number"]
    return n + ((n - 1) / v / (f ** -2 - c ** -2) * (nm ** -2 - d ** -2) if v else 0)


def channel(camera, lenses, reach, area, z, nm):
    d, w = camera["distance_mm"], camera["pixel_pitch_mm"]
    lam, rows, cols = nm * 1e-6, camera["rows"], camera["cols"]
    power = (index(camera, nm) - 1) / (camera["refractive_index"] - 1) / camera["focal_length_mm"]
    chirp, m = 1 / z + 1 / d - power, 1 + d / z
    pixels = smooth((2 * reach * abs(chirp) * d + 4 * lam * d / (np.pi ** 2 * 2 * reach * STRAY)) / w + 1, 2)
    spots = w * 2 * reach / (lam * d)
    samples = smooth(max(LEAST, OVERSAMPLING * spots, min(MOST * spots, GOOD)), 1)
    n = pixels * samples
    step = lam * d / (pixels * w)
    points = min(int(np.ceil(2 * reach / step)) + 1, n)
    i = np.arange(points) - (points - 1) / 2
    u, v = np.meshgrid((i * step).astype(np.float32), (i * step).astype(np.float32))
    psf = np.zeros((rows + 2 * pixels, cols + 2 * pixels), np.float64)
    for l, (x, y) in enumerate(lenses):
        phases, corner = [], []
        for at, middle in ((y * m / w, rows // 2), (x * m / w, cols // 2)):
            pixel = round(middle + at)
            shift = (pixel - middle - at) * samples + 0.5 - 0.5 * samples
            phases.append(np.exp(1j * (np.pi * chirp * (i * step) ** 2 / lam - 2 * np.pi * i * shift / n)).astype(np.complex64))
            corner.append(pixel + pixels // 2)
        share = np.clip(0.5 + edges(camera, lenses, reach, l, u, v) / np.float32(step), 0, 1)
        field = np.zeros((n, n), np.complex64)
        field[:points, :points] = share * phases[0][:, None] * phases[1]
        field = fft.fft2(field, workers=2, overwrite_x=True)
        light = (field.real ** 2 + field.imag ** 2).reshape(pixels, samples, pixels, samples).sum((1, 3), dtype=np.float32)
        psf[corner[0]:corner[0] + pixels, corner[1]:corner[1] + pixels] += fft.fftshift(light)
    return psf[pixels:-pixels, pixels:-pixels] / (n * n * area / step ** 2)


def stack(camera, lenses):
    grid = (np.arange(512) + 0.5) / 512 * camera["aperture_mm"] - camera["aperture_mm"] / 2
    u, v = np.meshgrid(grid, grid)
    away = np.min([np.hypot(u - x, v - y) for x, y in lenses], 0)
    away = away[(np.hypot(u, v) < camera["aperture_mm"] / 2) & (away < camera["lens_diameter_mm"] / 2)]
    reach = min(camera["lens_diameter_mm"] / 2, away.max() + camera["aperture_mm"] / 512)
    grid = (np.arange(256) + 0.5) / 128 * reach - reach
    u, v = np.meshgrid(grid, grid)
    area = sum(np.clip(0.5 + edges(camera, lenses, reach, l, u, v) / (reach / 128), 0, 1).sum() for l in range(len(lenses)))
    area *= (reach / 128) ** 2
    for z in camera["distances_mm"]:
        yield np.stack([channel(camera, lenses, reach, area, z, nm) for nm in camera["wavelengths_nm"]])


folder = sys.argv[1]
with open(f"{folder}/camera.json") as file:
    camera = json.load(file)
lenses = np.loadtxt(f"{folder}/lenses.csv", delimiter=",", skiprows=1)
for round_number in range(int(sys.argv[2]) if len(sys.argv) > 2 else 1):
    begin = time.perf_counter()
    psfs = list(stack(camera, lenses)) if round_number == 0 else [None for _ in stack(camera, lenses)]
    print(f"SciPy, two threads, round {round_number + 1}: {time.perf_counter() - begin:.2f} s", flush=True)
    if round_number == 0:
        try:
            import tifffile
            ours = tifffile.imread(f"{folder}/psf.tif")
            far = [np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(ours, psfs)]
            print(f"relative difference: {min(far):.1e} to {max(far):.1e}")
        except ImportError:
            print("no tifffile: stacks are not compared")
