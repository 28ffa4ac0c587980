from benchopt import BaseObjective

import numpy as np
import hadalens


class Objective(BaseObjective):
    """A picture of what a mask-based lensless camera saw; the true point spread function is known.

    Each image is judged after the one factor that is best for it, for the scale of some methods is arbitrary, with values
    cut off at 0 and 1.
    """

    name = 'Lensless reconstruction'
    requirements = ['pip::numpy', 'pip::hadalens']
    min_benchopt_version = '1.6'

    def set_data(self, frames, psf, window, boundary, noise, truths):
        self.frames, self.psf, self.window, self.boundary, self.noise = frames, psf, window, boundary, noise
        self.truths = truths

    def get_objective(self):
        """frames: (N, C, Y, X); psf: (C, Y, X); window: rows and columns of the scene, in the middle of the frame."""
        return dict(frames=self.frames, psf=self.psf, window=self.window, boundary=self.boundary, noise=self.noise)

    def evaluate_result(self, images):
        """images: (N, C, Y, X) of the window."""
        errors, likeness = [], []
        for image, truth in zip(images, self.truths):
            factor = float(np.vdot(image, truth) / max(np.vdot(image, image), 1e-20))
            image = np.clip(np.float32(factor) * image, 0, 1)
            errors.append(float(np.mean((image - truth) ** 2)))
            likeness.append(hadalens.metrics.ssim(np.ascontiguousarray(image, np.float32), truth))
        return dict(value=float(np.mean(errors)), psnr=float(np.mean(-10 * np.log10(errors))), ssim=float(np.mean(likeness)))

    def get_one_result(self):
        return dict(images=np.zeros_like(self.truths))
