"""ADMM with total variation and FISTA as LenslessPiCam does them (E. Bezzam et al., JOSS 8(86), 2023), in PyTorch.

Where the package `lensless` is installed its own classes run; else, and for comparison with a leaner arrangement, the
same iterations written anew here: channels first, transforms of real images with the PSF's shift taken into its
transfer function. Arrays are (channels, rows, cols)."""
import numpy as np
import torch


def package(name):
    """The package's class for "admm" or "fista"; None where it is not installed."""
    try:
        from lensless.recon.admm import ADMM
        from lensless.recon.gd import FISTA
    except ImportError:
        return None
    return {"admm": ADMM, "fista": FISTA}[name]


class Package:
    def __init__(self, name, psf, frame, **settings):
        last = lambda image: torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, 0, -1))[None]).float()
        if name == "fista":  # from zero, with steps within the bound of convergence
            settings = {"lip_fact": 1.0, "initial_est": torch.zeros((1, 1) + frame.shape[1:] + frame.shape[:1])}
        self.fista = name == "fista"
        self.solver = package(name)(last(psf), norm="backward", **settings)
        self.solver.set_data(last(frame)[0])

    def run(self, iterations):
        if self.fista:  # the package iterates in place on what it starts from
            self.solver._initial_est = torch.zeros_like(self.solver._initial_est)
        done = self.solver.apply(n_iter=iterations, plot=False)
        if self.fista:  # apply() gives where the next step would start, which is past the result
            done = self.solver._xk[0]
        return np.moveaxis(done[0].numpy(), -1, 0)


class Lean:
    """Both methods on the grid that the package pads to."""

    def __init__(self, name, psf, frame, grid, mu1=1e-6, mu2=1e-5, mu3=4e-5, tau=1e-4):
        self.name, self.grid, self.mu, self.tau = name, grid, (mu1, mu2, mu3), tau
        rows, cols = psf.shape[1:]
        self.place = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid, (rows, cols)))
        padded = torch.zeros((psf.shape[0],) + tuple(grid))
        padded[:, :rows, :cols] = torch.from_numpy(psf).float()
        padded = torch.roll(padded, (-(rows // 2), -(cols // 2)), (1, 2))
        self.otf = torch.fft.rfft2(padded)
        self.frame = torch.from_numpy(frame).float()

    def forward(self, x):
        return torch.fft.irfft2(torch.fft.rfft2(x) * self.otf, s=self.grid)

    def adjoint(self, y):
        return torch.fft.irfft2(torch.fft.rfft2(y) * self.otf.conj(), s=self.grid)

    def crop(self, x):
        return x[(slice(None),) + self.place]

    def pad(self, x):
        out = torch.zeros((x.shape[0],) + tuple(self.grid))
        self.crop(out).copy_(x)
        return out

    def run(self, iterations):
        return (self.admm if self.name == "admm" else self.fista)(iterations).numpy()

    def fista(self, iterations):
        square = (self.otf.abs() ** 2).amax((1, 2), keepdim=True)
        x = v = torch.zeros_like(self.frame)
        t = 1.0
        for _ in range(iterations):
            rest = self.crop(self.forward(self.pad(v))) - self.frame
            z = (v - self.crop(self.adjoint(self.pad(rest))) / square).clamp_(min=0)
            t_next = (1 + (1 + 4 * t * t) ** 0.5) / 2
            v = z + (t - 1) / t_next * (z - x)
            x, t = z, t_next
        return x

    def admm(self, iterations):
        mu1, mu2, mu3 = self.mu
        shape = (self.frame.shape[0],) + tuple(self.grid)
        frequencies = torch.fft.fftfreq(self.grid[0]), torch.fft.rfftfreq(self.grid[1])
        ky, kx = (2 - 2 * torch.cos(2 * torch.pi * f) for f in frequencies)
        divisor = 1 / (mu1 * self.otf.abs() ** 2 + mu2 * (ky[:, None] + kx[None, :]) + mu3)
        inside = 1 / (self.pad(torch.ones_like(self.frame)) + mu1)
        data = self.pad(self.frame)
        x = torch.zeros(shape)
        y, xi, rho = torch.zeros(shape), torch.zeros(shape), torch.zeros(shape)
        slope = [torch.zeros(shape), torch.zeros(shape)]
        eta = [torch.zeros(shape), torch.zeros(shape)]
        for _ in range(iterations):
            u = [torch.nn.functional.softshrink(s + e / mu2, self.tau / mu2) for s, e in zip(slope, eta)]
            v = inside * (xi + mu1 * y + data)
            w = (rho / mu3 + x).clamp_(min=0)
            rest = mu3 * w - rho + self.adjoint(mu1 * v - xi)
            for k, dim in ((0, 1), (1, 2)):
                dual = mu2 * u[k] - eta[k]
                rest += torch.roll(dual, -1, dim) - dual
            x = torch.fft.irfft2(divisor * torch.fft.rfft2(rest), s=self.grid)
            y = self.forward(x)
            slope = [torch.roll(x, 1, dim) - x for dim in (1, 2)]
            xi += mu1 * (y - v)
            for k in (0, 1):
                eta[k] += mu2 * (slope[k] - u[k])
            rho += mu3 * (x - w)
        return self.crop(x).clamp(min=0)
