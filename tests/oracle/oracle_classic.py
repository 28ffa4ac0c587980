"""The references of the classic methods against other software: scikit-image (Richardson-Lucy, Wiener), SciPy's solvers
and dense matrices, and the iterations of LenslessPiCam in NumPy. Usage: oracle_classic.py ORACLE_CLASSIC"""
import sys

try:
    import numpy as np
    import scipy.optimize as optimize
    from oracle_tool import call
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

RANDOM = np.random.default_rng(3)
METHODS = {"wiener": 0, "rl": 1, "fista": 2, "admm": 3}
PRIORS = {"none": 0, "tv": 1, "wavelet": 2, "haar": 3}


def run(method, psfs, image, frame=None, support=None, iterations=10, prior="none", weight=0.0, step=1.0, inner=5,
        levels=3, accelerate=0, flat=1.0, floor=1e-12, seen=1e-3, mu=(1, 1, 1), lam=0.1):
    """psfs: (depths, rows, cols), their origin at pixel 0, 0."""
    depths, rows, cols = psfs.shape
    whole = (0, 0, rows, cols)
    words = ["run", METHODS[method], rows, cols, depths, int(frame is not None), *(frame or whole), *(support or whole),
             iterations, PRIORS[prior], weight, step, inner, levels, accelerate, flat, floor, seen, *mu, lam]
    return call(words, np.fft.rfft2(psfs), image).reshape(psfs.shape)


def compare(name, got, expected, tolerance):
    error = np.linalg.norm(got - expected) / np.linalg.norm(expected)
    print(f"{name}: {error:.1e}")
    assert error <= tolerance, (name, error)


def make_psfs(depths, rows, cols, reach):
    """Sparse, of brightness 1, within `reach` pixels of the origin."""
    psfs = np.zeros((depths, rows, cols))
    for psf in psfs:
        for _ in range(6):
            psf[RANDOM.integers(-reach, reach + 1) % rows, RANDOM.integers(-reach, reach + 1) % cols] += RANDOM.random()
        psf /= psf.sum()
    return psfs


def matrix(psfs):
    """The circular convolutions as one dense matrix, by rolling: (pixels, depths x pixels)."""
    depths, rows, cols = psfs.shape
    columns = [np.roll(psf, (r, c), (0, 1)).ravel() for psf in psfs for r in range(rows) for c in range(cols)]
    return np.array(columns).T


def inside(rect, rows, cols):
    mask = np.zeros((rows, cols), bool)
    mask[rect[0]:rect[0] + rect[2], rect[1]:rect[1] + rect[3]] = True
    return mask


def scikit_image():
    try:
        from skimage import restoration
    except ImportError as missing:
        print(f"without scikit-image: {missing}")
        return
    rows, cols, reach = 40, 44, 5
    psfs = make_psfs(1, rows, cols, reach)
    small = np.roll(psfs[0], (reach, reach), (0, 1))[:2 * reach + 1, :2 * reach + 1]
    scene = np.zeros((rows, cols))
    scene[14:25, 15:28] = RANDOM.random((11, 13))  # nothing reaches the edges
    image = np.fft.irfft2(np.fft.rfft2(scene) * np.fft.rfft2(psfs[0]), s=scene.shape).clip(0)
    theirs = restoration.richardson_lucy(image, small, num_iter=15, clip=False)
    compare("Richardson-Lucy, scikit-image", run("rl", psfs, image, iterations=15, flat=0.5)[0], theirs, 1e-9)
    delta = np.array([[0.0, 0, 0], [0, 1, 0], [0, 0, 0]])
    theirs = restoration.wiener(image, small, 0.05, reg=delta, clip=False)
    compare("Wiener, scikit-image", run("wiener", psfs, image, lam=0.05)[0], theirs, 1e-12)


def dense_solutions():
    rows, cols = 9, 8
    frame, support = (1, 1, 7, 6), (2, 2, 5, 4)
    psfs = make_psfs(2, rows, cols, 2)
    image = np.where(inside(frame, rows, cols), RANDOM.random((rows, cols)), 0)
    all_of = matrix(psfs)
    # joint Wiener: the regularised normal equations, then the support
    a = all_of
    x = np.linalg.solve(a.T @ a + 0.07 * np.eye(a.shape[1]), a.T @ image.ravel()).reshape(psfs.shape)
    compare("Wiener over depths, normal equations", run("wiener", psfs, image, lam=0.07), x, 1e-11)
    # non-negative least squares, cropped by the frame, with planes within the support
    seen = inside(frame, rows, cols).ravel()
    bright = np.tile(inside(support, rows, cols).ravel(), 2)
    a = all_of[seen][:, bright]
    best = optimize.nnls(a, image.ravel()[seen])
    step = 1 / np.max(np.sum(np.abs(np.fft.fft2(psfs)) ** 2, 0))
    for name, mu, count in (("fista", (1, 0, 1), 20000), ("admm", (1, 0, 0.05), 20000)):
        got = run(name, psfs, image, frame, support, iterations=count, step=step, mu=mu).reshape(-1)
        if name == "admm":
            got = np.where(bright, got.clip(0), 0)
        rest = np.linalg.norm(all_of[seen] @ got - image.ravel()[seen])
        print(f"{name}, non-negative least squares: residual {rest:.9f}, SciPy {best[1]:.9f}")
        assert rest <= best[1] * (1 + 1e-5)
    # without the frame and the support FISTA's and ADMM's TV problems have the same solution but for the edges;
    # with a weight of zero both are least squares
    weight = 0.02
    def cost(got):
        sloped = sum(np.abs(np.diff(p, axis=k)).sum() for p in got for k in (0, 1))
        return 0.5 * np.sum((all_of @ got.ravel() - image.ravel()) ** 2) + weight * sloped
    got = run("fista", psfs, image, iterations=4000, step=step, prior="tv", weight=weight, inner=100).clip(0)
    start = cost(got)
    for _ in range(300):  # no small step is better
        other = (got + 1e-3 * RANDOM.standard_normal(got.shape)).clip(0)
        assert cost(other) >= start * (1 - 1e-9), "FISTA with TV is no minimum"
    print("fista with TV: a minimum")


def proximal_steps():
    rows, cols, weight = 11, 9, 0.15
    image = RANDOM.standard_normal((rows, cols)) + 0.5
    got = call(["tv", rows, cols, weight, 5000, 0], image).reshape(rows, cols)
    # optimality of min 1/2 |x - z|^2 + w |D x|_1, x >= 0: by the same problem as a bounded quadratic one in its dual
    pixels = np.eye(rows * cols).reshape(-1, rows, cols)
    d = np.array([np.concatenate([np.diff(e, axis=k).ravel() for k in (0, 1)]) for e in pixels]).T
    def dual(p):
        x = (image.ravel() - d.T @ p).clip(0)
        return 0.5 * x @ x, -d @ x
    solved = optimize.minimize(dual, np.zeros(len(d)), jac=True, method="L-BFGS-B", bounds=[(-weight, weight)] * len(d),
                               options={"maxiter": 20000, "maxfun": 40000, "ftol": 1e-16, "gtol": 1e-11})
    compare("TV step, L-BFGS-B on the dual", got, (image.ravel() - d.T @ solved.x).clip(0).reshape(rows, cols), 1e-5)
    # plain Haar, three levels, by an orthonormal matrix; translation-invariant: the mean over its shifts, in the middle
    size = 32
    image = RANDOM.standard_normal((size, size))
    def haar(n, levels):
        w = np.eye(n)
        for level in range(levels):
            m, step = n >> level, np.eye(n)
            step[:m, :m] = 0
            for k in range(m // 2):
                step[k, 2 * k], step[k, 2 * k + 1] = 0.5 ** 0.5, 0.5 ** 0.5
                step[m // 2 + k, 2 * k], step[m // 2 + k, 2 * k + 1] = 0.5 ** 0.5, -(0.5 ** 0.5)
            w = step @ w
        return w
    def plain(z, levels):
        out = z.copy()
        # the square transform: both axes level by level
        w = [haar(size >> k, 1) for k in range(levels)]
        for k, one in enumerate(w):
            m = size >> k
            out[:m, :m] = one @ out[:m, :m] @ one.T
        small = size >> levels
        kept = out[:small, :small].copy()
        out = np.sign(out) * np.maximum(np.abs(out) - weight, 0)
        out[:small, :small] = kept
        for k in reversed(range(levels)):
            m = size >> k
            out[:m, :m] = w[k].T @ out[:m, :m] @ w[k]
        return out
    got = call(["haar", size, size, weight, 3, 1], image).reshape(size, size)
    compare("Haar step, orthonormal matrices", got, plain(image, 3), 1e-12)
    shifts = [np.roll(plain(np.roll(image, (-r, -c), (0, 1)), 3), (r, c), (0, 1)) for r in range(8) for c in range(8)]
    got = call(["haar", size, size, weight, 3, 0], image).reshape(size, size)
    middle = slice(8, size - 8)
    compare("Haar step, mean over all shifts", got[middle, middle], np.mean(shifts, 0)[middle, middle], 1e-12)


def lensless_picam():
    """One depth, planes on the grid: the iteration of its class ADMM, with unscaled duals, in its order."""
    rows, cols, frame = 24, 20, (6, 5, 12, 10)
    psfs = make_psfs(1, rows, cols, 4)
    mask = inside(frame, rows, cols)
    data = np.where(mask, RANDOM.random((rows, cols)), 0)
    mu1, mu2, mu3, tau = 0.7, 0.05, 0.02, 0.004
    h = np.fft.fft2(psfs[0])
    forward = lambda x: np.fft.ifft2(h * np.fft.fft2(x)).real
    adjoint = lambda y: np.fft.ifft2(h.conj() * np.fft.fft2(y)).real
    psi = lambda x: np.stack([np.roll(x, 1, 0) - x, np.roll(x, 1, 1) - x])
    psi_adjoint = lambda u: np.roll(u[0], -1, 0) - u[0] + np.roll(u[1], -1, 1) - u[1]
    gram = np.zeros((rows, cols))
    gram[0, 0], gram[1, 0], gram[-1, 0], gram[0, 1], gram[0, -1] = 4, -1, -1, -1, -1
    divisor = mu1 * np.abs(h) ** 2 + mu2 * np.abs(np.fft.fft2(gram)) + mu3
    x, y, xi, rho = (np.zeros((rows, cols)) for _ in range(4))
    slopes, eta = np.zeros((2, rows, cols)), np.zeros((2, rows, cols))
    for _ in range(25):
        s = slopes + eta / mu2
        u = np.sign(s) * np.maximum(np.abs(s) - tau / mu2, 0)
        v = (xi + mu1 * y + data) / (mask + mu1)
        w = np.maximum(rho / mu3 + x, 0)
        rest = mu3 * w - rho + psi_adjoint(mu2 * u - eta) + adjoint(mu1 * v - xi)
        x = np.fft.ifft2(np.fft.fft2(rest) / divisor).real
        y, slopes = forward(x), psi(x)
        xi += mu1 * (y - v)
        eta += mu2 * (slopes - u)
        rho += mu3 * (x - w)
    got = run("admm", psfs, data, frame, iterations=25, prior="tv", weight=tau, mu=(mu1, mu2, mu3))
    compare("ADMM, the iteration of LenslessPiCam", got[0], x, 1e-11)
    alpha, x, v, t = 1 / np.max(np.abs(h) ** 2), np.zeros((rows, cols)), np.zeros((rows, cols)), 1.0
    for _ in range(25):
        z = np.where(mask, v - alpha * adjoint(np.where(mask, forward(v) - data, 0)), 0).clip(0)
        t_next = (1 + np.sqrt(1 + 4 * t ** 2)) / 2
        v, x, t = z + (t - 1) / t_next * (z - x), z, t_next
    got = run("fista", psfs, data, frame, frame, iterations=25, step=alpha)
    compare("FISTA, the iteration of LenslessPiCam", got[0], x, 1e-11)


def lucy():
    """Joint Richardson-Lucy by matrices: unknown boundaries, total variation, acceleration."""
    rows, cols, frame, support = 9, 10, (1, 1, 7, 7), (2, 2, 5, 6)
    psfs = make_psfs(2, rows, cols, 3)
    seen, bright = inside(frame, rows, cols).ravel(), np.tile(inside(support, rows, cols).ravel(), 2)
    a = matrix(psfs)[seen][:, bright]
    b = a @ (0.5 + RANDOM.random(a.shape[1])) + 0.02 * RANDOM.random(len(a))  # nothing becomes flat, where TV jumps
    image = np.zeros(rows * cols)
    image[seen] = b
    weight, norm = 0.01, a.sum(0)
    def curved(y):
        out = []
        for p in y.reshape(2, *support[2:]):
            down, right = np.diff(p, axis=0, append=p[-1:]), np.diff(p, axis=1, append=p[:, -1:])
            size = np.sqrt(down ** 2 + right ** 2 + 1e-30)
            out.append(np.diff(down / size, axis=0, prepend=0) + np.diff(right / size, axis=1, prepend=0))
        return np.ravel(out)
    x = y = np.ones(bright.sum())
    g = np.zeros_like(x)
    for _ in range(12):
        ratio = b / np.maximum(a @ y, 1e-12)
        new = y / np.maximum(norm, 1e-3) * (a.T @ ratio) / np.maximum(1 - weight * curved(y), 0.1)
        g_new = new - y
        factor = np.clip(g_new @ g / (g @ g), 0, 0.999) if g @ g > 0 else 0
        y, x, g = (new + factor * (new - x)).clip(0), new, g_new
    got = run("rl", psfs, image.reshape(rows, cols), frame, support, iterations=12, prior="tv", weight=weight,
              accelerate=1)
    compare("Richardson-Lucy with TV and acceleration, matrices", got.ravel()[bright], x, 1e-9)


lucy()
scikit_image()
dense_solutions()
proximal_steps()
lensless_picam()
