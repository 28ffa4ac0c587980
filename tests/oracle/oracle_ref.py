"""The references of tests/ref against NumPy and SciPy, by formulas of their own. Usage: oracle_ref.py ORACLE_REF"""
import sys

try:
    import numpy as np
    import scipy.ndimage as ndimage
    import scipy.signal as signal
    import scipy.stats as stats
    from oracle_tool import call
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

RANDOM = np.random.default_rng(1)


def run(words, *arrays, outputs):
    """Runs the tool; `outputs` are the shapes of its results."""
    values = call(words, *arrays)
    results, at = [], 0
    for shape in outputs:
        count = int(np.prod(shape))
        results.append(values[at:at + count].reshape(shape))
        at += count
    assert at == values.size, (words, at, values.size)
    return results if len(results) > 1 else results[0]


def as_complex(values):
    return values[..., 0] + 1j * values[..., 1]


def normal(*shape):
    return RANDOM.standard_normal(shape)


def single(values):
    """As the tool reads it: rounded to float."""
    return values.astype(np.float32).astype(np.float64)


def spectrum(*shape):
    return normal(*shape) + 1j * normal(*shape)


def single_spectrum(*shape):
    return single(normal(*shape)) + 1j * single(normal(*shape))


def check(name, got, expected, tolerance=1e-12):
    scale = np.linalg.norm(expected)
    assert scale > 0, (name, "nothing to compare")
    error = np.linalg.norm(got - expected) / scale
    assert error <= tolerance, (name, error)


def transforms():
    for rows, cols in [(1, 1), (1, 7), (6, 1), (8, 8), (9, 10), (12, 13), (35, 22), (64, 127)]:
        half = cols // 2 + 1
        image = normal(rows, cols)
        got = as_complex(run(["forward", rows, cols], image, outputs=[(rows, half, 2)]))
        check(("forward", rows, cols), got, np.fft.rfft2(image))
        # any half spectrum: what a real image cannot have is ignored, also by taking the real part of a full inverse
        given = spectrum(rows, half)
        whole = np.zeros((rows, cols), complex)
        whole[:, :half] = given
        mirrored = np.conj(np.roll(given[::-1], 1, axis=0))
        for kx in range(half):
            own = kx == 0 or 2 * kx == cols
            whole[:, kx] = (given[:, kx] + mirrored[:, kx]) / 2 if own else given[:, kx]
            if not own:
                whole[:, cols - kx] = mirrored[:, kx]
        got = run(["inverse", rows, cols], given, outputs=[(rows, cols)])
        check(("inverse", rows, cols), got, np.fft.ifft2(whole).real)


def convolutions():
    for rows, cols, psf_rows, psf_cols in [(6, 8, 6, 8), (7, 5, 7, 5), (9, 12, 4, 5), (8, 8, 13, 11)]:
        scene, psf = single(normal(rows, cols)), single(normal(psf_rows, psf_cols))
        # the axis of the PSF is its pixel (rows / 2, cols / 2)
        full = signal.convolve2d(scene, psf, mode="full")
        top, left = psf_rows // 2, psf_cols // 2
        got = run(["convolve_crop", rows, cols, psf_rows, psf_cols], scene, psf, outputs=[(rows, cols)])
        check(("cropped", rows, cols), got, full[top:top + rows, left:left + cols])
        if (psf_rows, psf_cols) == (rows, cols):
            circular = np.fft.irfft2(np.fft.rfft2(scene) * np.fft.rfft2(np.roll(psf, (-top, -left), (0, 1))), s=(rows, cols))
            got = run(["convolve", rows, cols], scene, psf, outputs=[(rows, cols)])
            check(("circular", rows, cols), got, circular)


def hadamard():
    for split in (0, 1):
        for rows, cols, raw, window in [(16, 20, (2, 3, 11, 13), (5, 6, 7, 4)), (15, 17, (0, 0, 15, 17), (1, 2, 3, 5))]:
            frame = single(normal(*raw[2:]))
            # filters of real images, and so also for the split form: even real parts, odd imaginary ones
            w = np.fft.rfft2(single(normal(rows, cols)))
            w = single(w.real) + 1j * single(w.imag)
            if split:
                w = w.real + 1j * np.abs(w.imag)
                w[:, 0] = w[:, 0].real + 1j * (w[:, 0].imag + np.roll(w[::-1, 0], 1).imag) / 2
                if cols % 2 == 0:
                    w[:, -1] = w[:, -1].real + 1j * (w[:, -1].imag + np.roll(w[::-1, -1], 1).imag) / 2
                w = single(w.real) + 1j * single(w.imag)
            whole = np.zeros((rows, cols))
            whole[raw[0]:raw[0] + raw[2], raw[1]:raw[1] + raw[3]] = frame
            b = np.fft.rfft2(whole)
            product = b.real * w.real + 1j * b.imag * w.imag if split else b * w
            image = np.fft.irfft2(product, s=(rows, cols))
            expected = image[window[0]:window[0] + window[2], window[1]:window[1] + window[3]]
            got = run(["hadamard", split, rows, cols, *raw, *window], frame, w, outputs=[window[2:]])
            check(("hadamard", split, rows), got, expected)


def ridge(x, b, other, alpha, lam):
    """The best real factor w for x = w b at each frequency, by least squares with rows for the regularisation."""
    out = np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        left = np.concatenate([b[:, i], [np.sqrt(alpha * other[i])], [np.sqrt(lam)]])
        right = np.concatenate([x[:, i], [0.0], [0.0]])
        out[i] = np.linalg.lstsq(left[:, None], right, rcond=None)[0][0]
    return out


def fit_filter(x, b, other, other_real, alpha, lam, split):
    if split:
        return ridge(x.real, b.real, other_real, alpha, lam / 2) + \
            1j * ridge(x.imag, b.imag, other - other_real, alpha, lam / 2)
    out = np.zeros(x.shape[1], complex)
    for i in range(x.shape[1]):
        left = np.concatenate([b[:, i], [np.sqrt(alpha * other[i])], [np.sqrt(lam)]])
        right = np.concatenate([x[:, i], [0.0], [0.0]])
        out[i] = np.linalg.lstsq(left[:, None], right, rcond=None)[0][0]
    return out


def sums_of(x, b):
    cross = (x * b.conj()).sum(0)
    return np.stack([cross.real, cross.imag, (abs(b) ** 2).sum(0), (abs(x) ** 2).sum(0), (x.real * b.real).sum(0), (b.real ** 2).sum(0)])


def fits():
    count, pairs, alpha, lam, least = 37, 5, 0.3, 0.7, 8.0
    x, b = spectrum(pairs, count), spectrum(pairs, count)
    other_real, weights = normal(count) ** 2, RANDOM.integers(0, 3, count)
    other = other_real + normal(count) ** 2
    for split in (0, 1):
        pair_data = [a for i in range(pairs) for a in (x[i], b[i])]
        sums, w, h, unexplained = run(["fit", count, pairs, split, alpha, lam, least], *pair_data, other, other_real, weights,
                                      outputs=[(6, count), (count, 2), (count, 2), (1,)])
        check(("sums", split), sums, sums_of(x, b))
        check(("filter", split), as_complex(w), fit_filter(x, b, other, other_real, alpha, lam, split), 1e-10)
        power = np.maximum((abs(x) ** 2).sum(0), least)
        h_expected = (b * x.conj()).sum(0) / power
        check(("transfer", split), as_complex(h), h_expected)
        # |b - h x|^2 summed over the pairs, where the floor does not act
        plain = (abs(x) ** 2).sum(0) >= least
        rest = np.where(plain, (abs(b - h_expected * x) ** 2).sum(0), (abs(b) ** 2).sum(0) - abs((b * x.conj()).sum(0)) ** 2 / power)
        assert 0 < plain.sum() < count
        check(("unexplained", split), unexplained, np.array([(weights * rest).sum()]), 1e-11)


def leave_one_out():
    rows, cols, window, pairs, alpha, lam = 10, 12, (3, 2, 5, 6), 4, 0.2, 0.5
    half = cols // 2 + 1
    x, b = np.fft.rfft2(normal(pairs, rows, cols)), np.fft.rfft2(normal(pairs, rows, cols))
    flat = lambda a: a.reshape(*a.shape[:-2], -1)
    other_real, seen_real = normal(2, rows * half) ** 2
    other, seen = other_real + normal(rows * half) ** 2, seen_real + normal(rows * half) ** 2
    weights = RANDOM.integers(0, 3, rows * half)
    for split in (0, 1):
        w = fit_filter(flat(x[1:]), flat(b[1:]), other, other_real, alpha, lam, split)
        product = flat(b[0]).real * w.real + 1j * flat(b[0]).imag * w.imag if split else flat(b[0]) * w
        error = (flat(x[0]) - product).reshape(rows, half)
        # the part of it that a real image has
        whole = np.fft.irfft2(error, s=(rows, cols))
        inside = whole[window[0]:window[0] + window[2], window[1]:window[1] + window[3]]
        seen_by = w.real ** 2 * seen_real + w.imag ** 2 * (seen - seen_real) if split else abs(w) ** 2 * seen
        sums = sums_of(flat(x), flat(b))
        grid = [rows, cols, 0, 0, rows, cols, *window]
        own, leak = run(["score", split, alpha, lam, *grid], x[0], b[0], sums, other, other_real, seen, seen_real, weights, outputs=[(1,), (1,)])
        if not split:  # the split product of a symmetric spectrum is symmetric too, but for the sign of the filter
            check(("own", split), own, np.array([(inside ** 2).sum()]), 1e-9)
        check(("leak", split), leak, np.array([(weights * seen_by).sum()]), 1e-9)


def refine(padded):
    """The same splitting, with stacked linear systems solved by numpy.linalg at every frequency."""
    rows, cols, depths, steps, rho, over, mu = 14, 15, 3, 6, 0.05, 1.6, 0.7
    half = cols // 2 + 1
    window, frame = (3, 4, 7, 6), (2, 1, 10, 12)
    h = np.fft.rfft2(normal(depths, rows, cols) / rows)
    prior = normal(rows, half) ** 2 * 0.1
    inside = np.zeros((rows, cols), bool)
    inside[window[0]:window[0] + window[2], window[1]:window[1] + window[3]] = True
    known = np.zeros((rows, cols), bool)
    known[frame[0]:frame[0] + frame[2], frame[1]:frame[1] + frame[3]] = True
    if not padded:
        known[:] = True
    image = normal(rows, cols) * known
    u, d = np.zeros((2, depths, rows, cols))
    v, e = image.copy(), np.zeros((rows, cols))
    back = lambda f: np.fft.irfft2(f, s=(rows, cols))
    residual = [(image[known] ** 2).sum()]
    split = [(image[known] ** 2).sum()]
    for step in range(steps):
        y = np.fft.rfft2(v - e if padded else image)
        t = np.fft.rfft2(u - d)
        normal_matrix = np.einsum("zij,wij->ijzw", h.conj(), h) + (rho + prior)[..., None, None] * np.eye(depths)
        right = np.moveaxis(h.conj() * y + rho * t, 0, -1)
        x_hat = np.moveaxis(np.linalg.solve(normal_matrix, right[..., None])[..., 0], -1, 0)
        relax = over if step else 1.0
        w = relax * back(x_hat) + (1 - relax) * u + d
        u = np.maximum(w, 0) * inside
        d = w - u
        if padded:
            a = relax * back((h * x_hat).sum(0)) + (1 - relax) * v + e
            v = np.where(known, (image + mu * a) / (1 + mu), a)
            e = a - v
        residual.append(((image - back((h * np.fft.rfft2(u)).sum(0)))[known] ** 2).sum())
        split.append(((image - v)[known] ** 2).sum())
    planes, got_residual, got_split = run(["refine", rows, cols, *window, int(padded), *frame, depths, steps, rho, over, mu], h, prior, image,
                                          outputs=[(depths, window[2], window[3]), (steps + 1,), (steps + 1,)])
    check(("planes", padded), planes, u[:, window[0]:window[0] + window[2], window[1]:window[1] + window[3]], 1e-9)
    check(("residual", padded), got_residual, np.array(residual), 1e-9)
    if padded:
        check("split", got_split[1:], np.array(split[1:]), 1e-9)


def variation():
    """The proximal step of total variation. Its end is proved by the duality gap: half the square of the distance to the
    true minimum is no more. Where scikit-image has the same step (grey, nothing negative) it gives the same image."""
    for channels, rows, cols, theta, colour in [(1, 9, 12, 0.3, 1), (3, 8, 11, 0.6, 1), (2, 1, 6, 0.2, 1.5), (4, 7, 1, 0.5, 1),
                                                (3, 8, 11, 0.3, 1.5), (3, 7, 5, 0.2, 4)]:
        w = normal(channels, rows, cols)
        u, p = run(["variation", channels, rows, cols, theta, colour, 0.2, 40000], w,
                   outputs=[(channels, rows, cols), (channels, 2, rows, cols)])
        slopes = np.zeros_like(p)
        slopes[:, 0, :-1] = np.diff(u, axis=1)
        slopes[:, 1, :, :-1] = np.diff(u, axis=2)
        parts = lambda v: ((v.mean(0) ** 2).sum(0) * channels, ((v - v.mean(0)) ** 2).sum((0, 1)))
        common, rest = parts(p)
        assert np.all(common + rest / colour ** 2 <= 1 + 1e-12) and np.all(u >= 0)
        back = np.zeros_like(w)  # the transposed differences of p
        back[:, 1:] += p[:, 0, :-1]
        back[:, :-1] -= p[:, 0, :-1]
        back[:, :, 1:] += p[:, 1, :, :-1]
        back[:, :, :-1] -= p[:, 1, :, :-1]
        best = np.maximum(w - theta * back, 0)
        common, rest = parts(slopes)
        primal = ((u - w) ** 2).sum() / 2 + theta * np.sqrt(common + colour ** 2 * rest).sum()
        dual = ((best - w) ** 2).sum() / 2 + theta * (best * back).sum()
        assert -1e-9 < (primal - dual) / primal < 1e-8, ("duality gap", channels, primal, dual)
        assert (slopes != 0).any() and ((u - np.maximum(w, 0)) ** 2).sum() > 1e-2 * (w ** 2).sum()
    try:
        from skimage import restoration
    except ImportError:
        return
    w = 5 + normal(1, 14, 17)
    u = run(["variation", 1, 14, 17, 0.7, 1, 0.2, 40000], w, outputs=[(1, 14, 17), (2, 14, 17)])[0]
    check("variation, scikit-image", u[0] - 5,
          restoration.denoise_tv_chambolle(w[0], weight=0.7, eps=1e-14, max_num_iter=40000) - 5, 1e-4)


def crosstalk():
    depths, channels, rows, cols, share = 3, 2, 13, 17, 0.12
    x = np.abs(normal(depths, channels, rows, cols)) * np.array([1, 0.3, 0.05])[:, None, None, None]
    x[:, :, :6, 4:] = x[::-1, :, :6, 4:]
    m = ndimage.uniform_filter(x.sum(1), size=(1, 5, 5), mode="constant")
    r = (m / m.max(0)) ** 4
    kept = x * ((1 + share ** 4) * r / (r + share ** 4))[:, None]
    best = (np.arange(depths)[:, None, None] == m.argmax(0))[:, None]
    check("crosstalk", run(["crosstalk", depths, channels, rows, cols, share], x, outputs=[x.shape]),
          kept + best * (x - kept).sum(0), 1e-12)


def edge_filter(light):
    across = ndimage.sobel(light, axis=-1, mode="nearest") / 8
    along = ndimage.sobel(light, axis=-2, mode="nearest") / 8
    return across ** 2 + along ** 2


def windowed(light, kind, sigma):
    """Local means; the image goes on beyond its edges with its edge pixels."""
    radius = int(np.ceil(3 * sigma))
    wide = np.pad(light, radius + 1, mode="edge")
    response = edge_filter(wide) if kind == 1 else np.maximum(wide, 0)
    mean = ndimage.gaussian_filter(response, sigma, radius=radius, mode="nearest")
    return mean[radius + 1:-radius - 1, radius + 1:-radius - 1]


def lower_median(values):
    return np.sort(values)[(values.size - 1) // 2]


def focus():
    rows, cols, depths = 21, 26, 5
    distances = 100.0 + 10 * np.arange(depths)
    for measure, summed, sigma, channels in [(1, 0, 2.5, 3), (2, 1, 1.2, 1), (3, 0, 2.0, 3), (1, 1, 0.5, 1)]:
        sharp = normal(depths, channels, rows, cols) * 0.1 + 0.5
        for z in range(depths):  # each depth is sharp in a stripe
            sharp[z, :, :, cols * z // depths:cols * (z + 1) // depths] += normal(channels, rows, cols * (z + 1) // depths - cols * z // depths)
        planes = single(sharp)
        light = np.tensordot([0.2126, 0.7152, 0.0722], planes, (0, 1)) if channels == 3 else planes[:, 0]
        if measure == 3:
            values = np.stack([windowed(p, 2, sigma) * np.sqrt(windowed(p, 1, sigma)) for p in light])
        else:
            values = np.stack([windowed(p, measure, sigma) for p in light])
        weights = np.ones_like(values) if summed else values + 1e-30
        expected = (planes * weights[:, None]).sum(0)
        if not summed:
            expected /= weights.sum(0)
        fused, distance, report = run(["focus", measure, summed, sigma, channels, rows, cols, depths], planes,
                                      outputs=[(channels, rows, cols), (rows, cols), (4,)])
        check(("fused", measure), fused, expected, 1e-10)
        # noise: Immerkaer's operator, the median of its absolute response
        response = np.abs(np.stack([signal.convolve2d(p, [[1, -2, 1], [-2, 4, -2], [1, -2, 1]], "valid") for p in light]))
        noise = lower_median(response[response > 1e-12]) / (6 * stats.norm.ppf(0.75))
        check(("noise", measure), report[:1], np.array([noise]), 1e-6)
        check(("distances", measure), *distance_map(values, distances, report, distance))


def distance_map(values, distances, report, distance):
    """Where a depth stands out: a parabola through the measures (numpy.polyfit) over the index, that is, over 1/z."""
    depths, rows, cols = values.shape
    best = values.argmax(0)
    losers = np.sort(values.reshape(depths, -1), axis=0)[:-1].ravel()
    base = lower_median(losers)
    spread = 1.4826 * lower_median(np.abs(losers - base))
    z = stats.norm.isf(0.01 / depths)
    assert np.isclose(report[2], z * spread, rtol=1e-6), (report, z * spread)
    assert report[1] >= (base + z * spread) * (1 - 1e-6)
    got, expected = [], []
    for r in range(rows):
        for c in range(cols):
            k, m = best[r, c], values[:, r, c]
            far = [m[i] for i in range(depths) if abs(i - k) > 1]
            found = m[k] > report[1] and m[k] - max(far, default=0) > report[2]
            assert found == np.isfinite(distance[r, c]), (r, c)
            if not found:
                continue
            step = 0.0
            if 0 < k < depths - 1:
                y = [max(m[k - 1] - base, 0), m[k] - base, max(m[k + 1] - base, 0)]
                a, b, _ = np.polyfit([-1, 0, 1], y, 2)
                step = float(np.clip(-b / (2 * a), -0.5, 0.5)) if a < 0 else 0.0
            expected.append(1 / np.interp(k + step, np.arange(depths), 1 / distances))
            got.append(distance[r, c])
    assert len(got) > 5, len(got)
    return np.array(got), np.array(expected), 1e-9


def spectra():
    # crop: an image of few frequencies looks the same on a coarse grid
    rows, cols, small_rows, small_cols = 24, 20, 12, 10
    base = np.zeros((small_rows, small_cols // 2 + 1), complex)
    base[[0, 1, 2, -1, -3], 1:4] = spectrum(5, 3)
    base[0, 0] = 3.0
    coarse = np.fft.irfft2(base, s=(small_rows, small_cols))
    fine = signal.resample(signal.resample(coarse, rows, axis=0), cols, axis=1)
    given = np.fft.rfft2(fine)
    got = as_complex(run(["crop", rows, cols, 1, small_rows, small_cols, 2, 0.25, 0, 0], given, outputs=[(small_rows, small_cols // 2 + 1, 2)]))
    check("crop", got, np.fft.rfft2(coarse), 1e-6)
    # tapers, channels, real values and their inverses at the frequencies that fftfreq names
    values = single(np.abs(normal(3, rows, cols // 2 + 1)) + 1)
    for tapers, invert in ((1, 0), (-2, 1)):
        got = run(["crop", rows, cols, 3, small_rows, small_cols, 1, 2.0, tapers, invert], values, outputs=[(small_rows, small_cols // 2 + 1)])
        ky = np.rint(np.fft.fftfreq(small_rows) * small_rows).astype(int)
        kx = np.arange(small_cols // 2 + 1)
        expected = 2 * values.mean(0)[np.ix_(ky, kx)]
        expected *= np.exp2(-tapers * ((ky / (small_rows / 2)) ** 2)[:, None]) * np.exp2(-tapers * (kx / (small_cols / 2)) ** 2)
        if invert:
            expected = 1 / expected
        expected[small_rows // 2] = 0
        expected[:, -1] = 0
        check(("taper", tapers), got, expected)
    # the product gives the spectrum of the real part of its image
    for kind in (0, 1, 2):
        for rows, cols in ((8, 10), (7, 9)):
            half = cols // 2 + 1
            a, w = single_spectrum(rows, half), single_spectrum(rows, half)
            product = a if kind == 0 else a * w if kind == 1 else a.real * w.real + 1j * a.imag * w.imag
            image = run(["inverse", rows, cols], product, outputs=[(rows, cols)])
            got = as_complex(run(["product", kind, rows, cols, rows, cols], a, w, outputs=[(rows, half, 2)]))
            check(("product", kind), got, np.fft.rfft2(image))
            band = as_complex(run(["product", kind, rows, cols, 2, 3], a, w, outputs=[(rows, half, 2)]))
            far = np.abs(np.rint(np.fft.fftfreq(rows) * rows)) > 2
            got[far] = 0
            got[:, 4:] = 0
            check(("band", kind), band, got)


def training():
    """Gradients of filters against PyTorch's autograd."""
    try:
        import torch
    except ImportError as missing:
        print(f"gradients of filters skipped: {missing}")
        return
    # frames on the grid, windows on it: even and odd sizes, a window as large as the grid, a padded frame
    grids = [((8, 10), (0, 0, 8, 10), (2, 3, 4, 4)), ((9, 11), (0, 0, 9, 11), (0, 0, 9, 11)),
             ((12, 15), (2, 3, 7, 9), (3, 4, 5, 6)), ((15, 12), (4, 1, 8, 10), (5, 3, 6, 5))]
    for (rows, cols), raw, window in grids:
        for split in (0, 1):
            half = cols // 2 + 1
            frame, w, fall = single(normal(raw[2], raw[3])), spectrum(rows, half), normal(window[2], window[3])
            words = ["train", split, rows, cols, *raw[:2], *raw[2:], *window[:2], *window[2:]]
            plane, gradient = run(words, frame, w, fall, outputs=[(window[2], window[3]), (rows, half, 2)])
            grid = torch.zeros(rows, cols, dtype=torch.float64)
            grid[raw[0]:raw[0] + raw[2], raw[1]:raw[1] + raw[3]] = torch.from_numpy(frame)
            b = torch.fft.rfft2(grid)
            filters = torch.from_numpy(w).requires_grad_(True)
            x = torch.complex(b.real * filters.real, b.imag * filters.imag) if split else b * filters
            image = torch.fft.irfft2(x, s=(rows, cols))
            image = image[window[0]:window[0] + window[2], window[1]:window[1] + window[3]]
            (image * torch.from_numpy(fall)).sum().backward()
            check(("plane", split), plane, image.detach().numpy())
            check(("gradient of a filter", split), as_complex(gradient), filters.grad.numpy())


transforms()
convolutions()
hadamard()
fits()
leave_one_out()
refine(False)
refine(True)
variation()
crosstalk()
focus()
spectra()
training()
print("all references agree")
