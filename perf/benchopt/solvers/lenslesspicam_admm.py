from benchopt import BaseSolver

import numpy as np
from lensless.recon.admm import ADMM

SPLITS = 1.0, 0.01, 0.001  # of hadalens' ADMM; the last two times the largest gain
TV = 1e-3


class Solver(BaseSolver):
    """ADMM of LenslessPiCam (package lensless): total variation, non-negative; it takes a sensor that crops for granted.
    'default': its own parameters, and a point spread function of norm 1, as its loader makes it; 'scaled': in proportion
    to gain and brightness, as hadalens has them."""

    name = 'lenslesspicam_admm'
    parameters = {'settings': ['default', 'scaled']}
    requirements = ['pip::lensless', 'pip::opencv-python-headless', 'pip::scikit-image']
    sampling_strategy = 'iteration'

    def set_objective(self, frames, psf, window, boundary, noise):
        self.window = window
        self.frames = [np.moveaxis(np.clip(frame, 0, None) / frame.max(), 0, -1)[np.newaxis] for frame in frames]
        image = np.moveaxis(psf, 0, -1)[np.newaxis]
        norm = np.linalg.norm(image) if self.settings == 'default' else 1.0
        self.psf = np.ascontiguousarray(image / norm, np.float32)

    def weights(self, frame):
        if self.settings == 'default':
            return {}
        otf = float(self.psf.sum((0, 1, 2)).max())
        light = float(np.sqrt(np.mean(np.square(frame))))
        return dict(zip(('mu1', 'mu2', 'mu3'), np.array(SPLITS) * (1, otf**2, otf**2)), tau=TV * otf * light)

    def run(self, n_iter):
        rows, cols = self.window
        self.images = []
        for frame in self.frames:
            method = ADMM(self.psf, **self.weights(frame))
            method.set_data(np.ascontiguousarray(frame, np.float32))
            image = np.asarray(method.apply(n_iter=n_iter, disp_iter=None, plot=False))[0] if n_iter else frame[0]
            top, left = (image.shape[0] - rows) // 2, (image.shape[1] - cols) // 2
            self.images.append(np.moveaxis(image[top:top + rows, left:left + cols], -1, 0))

    def get_result(self):
        return dict(images=np.ascontiguousarray(self.images, np.float32))
