from benchopt import BaseSolver

import deepinv
import hadalens
import numpy as np
import torch
from hadalens.deepinv import Lensless, TotalVariation


class Solver(BaseSolver):
    """Plug-and-play of deepinv with hadalens.deepinv.Lensless: half quadratic splitting with DPIR's schedule over so many
    steps. The denoiser 'drunet' downloads its weights; 'tv' needs none. noise: told, over the true one."""

    name = 'deepinv_pnp'
    parameters = {'denoiser': ['tv'], 'noise': [1.0, 4.0]}
    requirements = ['pip::deepinv', 'pip::hadalens']
    sampling_strategy = 'iteration'

    def set_objective(self, frames, psf, window, boundary, noise):
        self.frames, self.sigma = torch.from_numpy(frames), self.noise * noise
        model = hadalens.Model.from_psf(psf, 100.0, boundary=boundary, window=window, psf_dark=0.0)
        self.physics = Lensless(model)
        self.net = TotalVariation() if self.denoiser == 'tv' else deepinv.models.DRUNet()

    def run(self, n_iter):
        levels = np.geomspace(49 / 255, self.sigma, max(n_iter, 1))
        x = self.physics.A_adjoint(self.frames)
        with torch.no_grad():
            for level in levels[:n_iter]:
                x = self.physics.prox_l2(x, self.frames, (level / max(0.01, self.sigma)) ** 2 / 0.23)
                x = torch.cat([self.net(image[None], float(level)) for image in x])
        self.images = x.numpy()

    def get_result(self):
        return dict(images=self.images)
