"""The references of wave optics against NumPy and SciPy, by formulas of their own. Usage: oracle_optics.py ORACLE_OPTICS"""
import sys

try:
    import numpy as np
    import scipy.fft as fft
    import scipy.special as special
    from oracle_tool import call
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

RANDOM = np.random.default_rng(1)


def run(words, *arrays, shape):
    return call(words, *arrays).reshape(shape)


def check(name, got, expected, tolerance=1e-12):
    error = np.linalg.norm(got - expected) / np.linalg.norm(expected)
    assert error <= tolerance, (name, error)
    print(f"{name}: {error:.1e}")


def single(values):
    if np.iscomplexobj(values):
        return values.astype(np.complex64).astype(np.complex128)
    return values.astype(np.float32).astype(np.float64)


def noise(*shape):
    return single(RANDOM.standard_normal(shape))


def complex_noise(*shape):
    return single(noise(*shape) + 1j * noise(*shape))


def fresnel():
    """Separable phases as matrices, instead of a sum over the points."""
    n, step, x, y, lam, z, d = 24, 0.02, 0.3, -0.2, 6e-4, 150.0, 18.0
    field = complex_noise(n, n)
    at = np.stack([0.4 + 0.1 * RANDOM.standard_normal(9), -0.3 + 0.1 * RANDOM.standard_normal(9)], 1)
    q = (np.arange(n) - (n - 1) / 2) * step
    wave = lambda s, q: np.exp(2j * np.pi / lam * (q ** 2 / (2 * z) + (s - q) ** 2 / (2 * d)))
    expected = [wave(sy, y + q) @ field @ wave(sx, x + q) * step ** 2 / (lam * d) for sx, sy in at]
    words = ["fresnel", n, step, x, y, lam, z, d, len(at)]
    got = run(words, field, at, shape=(9, 2))
    check("fresnel", got[:, 0] + 1j * got[:, 1], np.array(expected), 1e-11)
    # over a pixel: Gauss-Legendre instead of equal steps
    width, nodes = 0.004, np.polynomial.legendre.leggauss(6)
    expected = []
    for sx, sy in at:
        light = 0
        for u, a in zip(*nodes):
            for v, b in zip(*nodes):
                light += a * b / 4 * abs(wave(sy + width * v / 2, y + q) @ field @ wave(sx + width * u / 2, x + q)) ** 2
        expected.append(light * width ** 2 * (step ** 2 / (lam * d)) ** 2)
    got = run(["pixel", n, step, x, y, lam, z, d, width, 24, len(at)], field, at, shape=9)
    check("pixel", got, np.array(expected), 1e-4)


def airy():
    """A round lens in focus: (2 J1(v) / v)^2, whose zeros are those of J1."""
    n, diameter, lam, d = 300, 1.0, 5e-4, 20.0
    step = 1.02 * diameter / n
    q = (np.arange(n) - (n - 1) / 2) * step
    u, v = np.meshgrid(q, q)
    # area of the circle in each sample, by 8 x 8 points
    fine = (np.arange(8 * n) - (8 * n - 1) / 2) * step / 8
    inside = (np.hypot(*np.meshgrid(fine, fine)) < diameter / 2).reshape(n, 8, n, 8).mean((1, 3))
    field = inside * np.exp(-1j * np.pi * (u ** 2 + v ** 2) / (lam * d))
    zeros = special.jn_zeros(1, 3)
    assert abs(zeros[0] / np.pi - 1.21967) < 1e-5
    args = np.concatenate([np.linspace(0.2, 15, 40), zeros])
    r = args * lam * d / (np.pi * diameter)
    at = np.stack([r * np.cos(args), r * np.sin(args)], 1)
    got = run(["fresnel", n, step, 0, 0, lam, 1e30, d, len(at)], field, at, shape=(len(at), 2))
    light = (got ** 2).sum(1)
    peak = (np.pi / 4 * diameter ** 2 / (lam * d)) ** 2
    check("airy", light, peak * (2 * special.j1(args) / args) ** 2, 1e-3)
    assert light[-3:].max() < 1e-5 * peak, light[-3:] / peak


def pupil():
    x, y, n, pitch, step, radius, aperture = 0.5, -0.25, 21, 24, 0.125, 1.125, 1.5
    across, down = complex_noise(pitch), complex_noise(pitch)
    planes = np.array([[0.6, 0.8, 0.7, 0], [-1, 0, 0.9, 0]], np.float32).astype(float)
    q = (np.arange(n) - (n - 1) / 2) * step
    u, v = np.meshgrid(q, q)
    edges = [radius - np.hypot(u, v), aperture - np.hypot(x + u, y + v)] + [c - a * u - b * v for a, b, c, _ in planes]
    share = np.clip(0.5 + np.min(edges, axis=0) / step, 0, 1)
    expected = np.zeros((n, pitch), complex)
    expected[:, :n] = share * across[:n] * down[:n, None]
    got = run(["pupil", x, y, 2, n, pitch, step, radius, aperture], np.concatenate([across, down]), planes, shape=(2, n, pitch))
    check("pupil", got[0] + 1j * got[1], expected)


def blocked(half):
    """Columns in blocks of 8, block after block."""
    rows, cols = half.shape
    wide = np.zeros((rows, (cols + 7) // 8 * 8), complex)
    wide[:, :cols] = half
    return wide.reshape(rows, -1, 8).transpose(1, 0, 2)


def spot():
    for pixels, samples in ((6, 4), (10, 3)):
        n = pixels * samples
        field = complex_noise(n, n)
        a, b = single(fft.rfft2(field.real)), single(fft.rfft2(field.imag))
        light = np.abs(fft.fftshift(fft.fft2(field))) ** 2
        expected = light.reshape(pixels, samples, pixels, samples).sum((1, 3))
        got = run(["spot", pixels, samples], blocked(a), blocked(b), shape=(pixels, pixels))
        check("spot", got, expected, 1e-6)


def mask():
    path, share = noise(50), noise(50)
    got = run(["mask", 50, 7.25], path, share, shape=(2, 50))
    check("mask", got[0] + 1j * got[1], share * np.exp(2j * np.pi * 7.25 * path))


def travel():
    """Free space, as a product of whole complex transforms."""
    n, step, lam, d = 20, 0.01, 5e-4, 12.0
    field = complex_noise(n, n)
    f = fft.fftfreq(n, step)
    free = single(np.exp(-1j * np.pi * lam * d * f ** 2))
    expected = fft.ifft2(fft.fft2(field) * free * free[:, None])
    across = np.zeros(16, complex)
    across[:n // 2 + 1] = free[:n // 2 + 1]
    real, imaginary = single(fft.rfft2(field.real)), single(fft.rfft2(field.imag))
    got = run(["travel", n, 2], blocked(real), blocked(imaginary), across, free, shape=(2, 2, n, 8, 2))
    half = (got[..., 0] + 1j * got[..., 1]).transpose(0, 2, 1, 3).reshape(2, n, 16)[:, :, :n // 2 + 1]
    parts = fft.irfft2(half, s=(n, n))
    check("travel", parts[0] + 1j * parts[1], expected, 1e-6)


def sensor():
    """By integrals from the corner, between whose values lines run."""
    rows, cols, row, col, width, shape = 17, 23, -2.5, 1.75, 3.25, (7, 6)
    field = complex_noise(rows, cols)
    total = np.zeros((rows + 1, cols + 1))
    total[1:, 1:] = (np.abs(field) ** 2).cumsum(0).cumsum(1)
    down = np.clip(row + width * np.arange(shape[0] + 1), 0, rows)
    across = np.clip(col + width * np.arange(shape[1] + 1), 0, cols)
    lines = np.stack([np.interp(across, np.arange(cols + 1), line) for line in total])
    corner = np.stack([np.interp(down, np.arange(rows + 1), line) for line in lines.T], 1)
    expected = np.diff(np.diff(corner, axis=0), axis=1)
    got = run(["sensor", rows, cols, row, col, width, *shape], field.real.copy(), field.imag.copy(), shape=shape)
    check("sensor", got, expected, 1e-11)


fresnel()
airy()
pupil()
spot()
mask()
travel()
sensor()
print("the references of wave optics agree")
