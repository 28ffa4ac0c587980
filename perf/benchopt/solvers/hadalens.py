from benchopt import BaseSolver

import numpy as np
import hadalens


class Solver(BaseSolver):
    """The C library, from the point spread function. 'default': as it comes, which finds its weight of total variation from
    the frame, and when to stop; 'refine': so many steps with the weight `tv`; 'admm': so many iterations of LenslessPiCam's
    method, with the same weight."""

    name = 'hadalens'
    parameters = {'method, tv': [('default', None), ('refine', 1e-3), ('admm', 1e-3)]}
    requirements = ['pip::hadalens']
    sampling_strategy = 'iteration'

    def set_objective(self, frames, psf, window, boundary, noise):
        self.frames = frames
        self.model = hadalens.Model.from_psf(psf, 100.0, boundary=boundary, window=window, psf_dark=0.0)

    def pre_run_hook(self, stop_val):
        options = {'default': {}, 'refine': dict(refine=stop_val, refine_tv=self.tv, refine_ridge=1.0),
                   'admm': dict(classic=hadalens.Classic('admm', iterations=max(stop_val, 1), weight=self.tv))}[self.method]
        self.plan = hadalens.Plan(self.model, dark=0.0, **(options if stop_val else {'refine': 0}))
        self.plan.run(np.ascontiguousarray(0.9 * self.frames[0]))  # another frame, for kernels

    def run(self, n_iter):
        self.images = np.stack([self.plan.run(frame).stack[0] for frame in self.frames])

    def get_result(self):
        return dict(images=self.images)
