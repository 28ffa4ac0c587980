from benchopt import BaseDataset

import pathlib
import tempfile

import hadalens
import numpy as np


class Dataset(BaseDataset):
    """Frames of a camera by design, made by hadalens: one depth, three colours, white noise.

    camera: a preset; the sensor of crop300 crops. scenes: a folder of TIFF pictures; '' draws coloured shapes.
    """

    name = 'simulated'
    parameters = {'camera': ['crop300'], 'size': [(150, 200)], 'window': [(60, 60)], 'noise': [0.01], 'frames': [4],
                  'scenes': ['']}
    test_parameters = {'size': [(48, 64)], 'window': [(24, 24)], 'frames': [1]}
    requirements = ['pip::numpy', 'pip::hadalens']

    def get_data(self):
        camera = hadalens.Camera(self.camera)
        camera.resize(self.size, self.window)
        camera.set_depths(100, 100, 1)
        with tempfile.TemporaryDirectory() as room:
            folder = pathlib.Path(room) / 'camera'
            hadalens.simulate(camera, folder, pairs=1, tests=self.frames, test_depths=1, noise=self.noise,
                              test_scenes=self.scenes or None)
            names = sorted((folder / 'test/raw').iterdir())
            frames = np.stack([hadalens.read_tiff(path, 0) for path in names])
            truths = np.stack([hadalens.read_tiff(folder / 'test/truth' / f'{p.stem}_stack.tif', 0) for p in names])
        psf = np.repeat(np.asarray(camera.psf_stack())[0], 3, 0)
        noise = self.noise * float(frames.max((1, 2, 3)).mean())
        return dict(frames=frames, psf=psf, window=tuple(self.window), boundary=camera.boundary, noise=noise, truths=truths)
