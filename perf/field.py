#!/usr/bin/env python3
"""The field's data: quality on held-out frames against the number of pairs, of the exact fit and of nets behind it.

    field.py simulated TRAIN TEST [--counts 4,16,64,256]   photographs (TIFF) of two folders, and a camera with mismatch
    field.py LAYOUT FOLDER [--counts 4,...] [--tests N]    LAYOUT: diffusercam, multiwienernet, rml, diffuser, flatcam,
                                                           huggingface, folders (FOLDER/raw and FOLDER/scene)
Splits are those of hadalens.datasets. With fewer than 20 pairs every pair is held out once, as many as --tests in a row, and the
counts are of the others. Other options: --steps of a net's training (0: no nets), --net compact|paper, --downsample N (frames, and
scenes where they are as large; mosaics need it), --mosaic PATTERN, --register (where scenes are what a display showed), --mismatch, of the simulated
camera: how much larger its pattern is at the corners of the field than on the axis (0.03), --lpips FILE (weights as for hadalens
evaluate), --seed.

Methods: `linear` (the fitted filters alone), `refined` (as a plan comes), `net` (train behind the refined planes, which may change
single planes: compose 0; an eighth of the pairs is held out to choose the best step).

Figures, each the mean over frames: images are encoded as the model found the scenes to be, cut off at 0 and 1, and compared on the
whole frame, or on the window where scenes are smaller. PSNR is 10 log10(1 / mean squared error) over pixels and channels, without
a factor, as Monakhova et al. (2019) compute it (they do not cut off). "by maximum": image and scene are divided by their largest
values first, as LenslessPiCam computes it. SSIM: Gaussian window of 11 pixels. LPIPS: version 0.1; Monakhova et al. take AlexNet,
LenslessPiCam takes VGG."""
import argparse
import pathlib
import tempfile
import time

import hadalens
import numpy as np
from hadalens import datasets

LAYOUTS = {
    'diffusercam': datasets.DiffuserCam,
    'multiwienernet': datasets.MultiWienerNet,
    'rml': lambda folder, split: datasets.ParallelLensless(folder, 'rml', split),
    'diffuser': lambda folder, split: datasets.ParallelLensless(folder, 'diffusercam', split),
    'flatcam': datasets.FlatCam,
    'huggingface': datasets.HuggingFace,
    'folders': lambda folder, split: datasets.Folders(f'{folder}/raw', f'{folder}/scene', split),
}
FEW = 20


class Simulated:
    """A colour camera whose pattern grows towards the corners of its field, which no single pattern explains."""

    def __init__(self, folder, count, seed, mismatch, regions=5):
        from PIL import Image
        from scipy.ndimage import affine_transform

        camera = hadalens.Camera('crop300')
        camera.resize((96, 128), (48, 48))
        camera.set_depths(100, 100, 1)
        self.size, self.window = (96, 128), (48, 48)
        psf = np.asarray(camera.psf_stack())[0, 0].astype(np.float64)
        centre, grid = np.array(psf.shape) // 2, tuple(2 * n for n in self.size)
        places = np.linspace(0, 1, regions)
        hats = [np.array([np.interp(np.arange(n) / (n - 1), places, row) for row in np.eye(regions)]) for n in self.window]
        self.parts = []
        for i in range(regions):
            for j in range(regions):
                off = np.hypot(2 * places[i] - 1, 2 * places[j] - 1) / np.sqrt(2)
                zoom = 1 / (1 + mismatch * off**2)
                pattern = affine_transform(psf, [zoom, zoom], centre - zoom * centre, order=3).clip(0)
                pattern = np.roll(np.pad(pattern / pattern.sum(), [(0, n) for n in self.size]), -centre, (0, 1))
                self.parts.append((hats[0][i][:, None] * hats[1][j][None], np.fft.rfft2(pattern)))
        self.grid = grid
        self.photographs = [Image.open(p).convert('RGB') for p in sorted(pathlib.Path(folder).glob('*.tif'))]
        self.count, self.seed = count, seed

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(self.count))]
        if index >= self.count:
            raise IndexError
        random = np.random.default_rng((self.seed, index))
        photograph = self.photographs[index % len(self.photographs)]
        side = int(random.uniform(0.4, 1) * min(photograph.size))
        left, top = (int(random.integers(n - side + 1)) for n in photograph.size)
        scene = np.asarray(photograph.crop((left, top, left + side, top + side)).resize(self.window[::-1])) / 255
        scene = np.moveaxis(scene[:, :: random.choice((-1, 1))], -1, 0)
        top, left = ((n - m) // 2 for n, m in zip(self.size, self.window))
        light = 0
        for weight, otf in self.parts:
            wide = np.zeros((3, *self.grid))
            wide[:, top:top + self.window[0], left:left + self.window[1]] = weight * scene
            light = light + otf * np.fft.rfft2(wide)
        frame = np.fft.irfft2(light, s=self.grid)[:, :self.size[0], :self.size[1]]
        frame += 0.01 * frame.max() * random.standard_normal(frame.shape)
        return datasets.Pair(frame.astype(np.float32), np.ascontiguousarray(scene, np.float32))


def judge(images, truths, response, lpips):
    """Two PSNR, SSIM and LPIPS."""
    rows = []
    for image, truth in zip(images, truths):
        shown = hadalens.response.convert(np.ascontiguousarray(image.clip(0, 1)), hadalens.response.LINEAR, response).clip(0, 1)
        if shown.shape != truth.shape:
            top, left = ((a - b) // 2 for a, b in zip(truth.shape[1:], shown.shape[1:]))
            truth = truth[:, top:top + shown.shape[1], left:left + shown.shape[2]]
        truth = np.ascontiguousarray(truth)
        by_maximum = hadalens.metrics.psnr(shown / max(shown.max(), 1e-9), truth / truth.max())
        rows.append([hadalens.metrics.psnr(shown, truth), by_maximum, hadalens.metrics.ssim(shown, truth),
                     lpips(shown, truth) if lpips else np.nan])
    return np.array(rows)


def ready(pairs, mosaic, options):
    """Pairs of the size that is asked for."""
    made = []
    for raw, scene in pairs:
        if options.downsample > 1:
            same = raw.shape[1:] == scene.shape[1:]
            raw = hadalens.downsample(raw, options.downsample, mosaic=mosaic)
            scene = hadalens.downsample(scene, options.downsample) if same else scene
        made.append((raw, scene))
    return made


def learn(pairs, tests, options, lpips):
    """{method: figures of each frame}, and seconds of learning."""
    began = time.process_time()
    if options.register:
        found = hadalens.register([raw for raw, _ in pairs[:8]], [scene for _, scene in pairs[:8]])
        pairs, tests = ([(raw, found.apply(scene)) for raw, scene in some] for some in (pairs, tests))
    model = hadalens.fit({100.0: pairs})
    seconds = {'linear': time.process_time() - began}
    seconds['refined'] = seconds['linear']
    found, models = {}, {'linear': (model, {'refine': 0}), 'refined': (model, {})}
    with tempfile.TemporaryDirectory() as room:
        if options.steps and len(pairs) >= 4:
            began = time.process_time()
            file = hadalens.train({100.0: pairs}, f'{room}/net.model', model=model, net=options.net, steps=options.steps, compose=0.0,
                                  seed=options.seed, validate_every=max(options.steps // 10, 1), log=f'{room}/log')
            seconds['net'] = seconds['linear'] + time.process_time() - began
            models['net'] = (hadalens.Model.load(file), {})
        for method, (one, words) in models.items():
            plan = hadalens.Plan(one, **words)
            images = [plan.run(raw).all_in_focus.copy() for raw, _ in tests]
            found[method] = judge(images, [scene for _, scene in tests], one.info.scene_response, lpips)
    return found, seconds


def show(count, results, tests):
    """A row for each method."""
    for method in results[0][0]:
        figures = np.concatenate([found[method] for found, _ in results])
        psnr, other, ssim, lpips = figures.mean(0)
        cost = np.mean([seconds[method] for _, seconds in results])
        shown = '%.3f' % lpips if np.isfinite(lpips) else ''
        print('| %d | %s | %.2f | %.2f | %.3f | %s | %.1f | %d |' % (count, method, psnr, other, ssim, shown, cost, len(figures)),
              flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('layout', choices=['simulated', *LAYOUTS])
    parser.add_argument('folders', nargs='+')
    parser.add_argument('--counts', default='4,16,64,256')
    parser.add_argument('--tests', type=int, default=24)
    parser.add_argument('--steps', type=int, default=600)
    parser.add_argument('--net', default='compact')
    parser.add_argument('--downsample', type=int, default=1)
    parser.add_argument('--mosaic', help='of frames of one channel, for the layout folders')
    parser.add_argument('--register', action='store_true')
    parser.add_argument('--mismatch', type=float, default=0.03)
    parser.add_argument('--lpips')
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    counts = [int(n) for n in options.counts.split(',')]
    lpips = hadalens.metrics.Lpips(options.lpips) if options.lpips else None
    if options.layout == 'simulated':
        train = Simulated(options.folders[0], max(counts), options.seed, options.mismatch)
        test = Simulated(options.folders[1], options.tests, options.seed + 1000, options.mismatch)
    else:
        train, test = (LAYOUTS[options.layout](options.folders[0], split) for split in ('train', 'test'))
    mosaic = options.mosaic or getattr(train, 'mosaic', 'none')
    print('| pairs | method | PSNR (dB) | by maximum (dB) | SSIM | LPIPS | learning, s | frames |\n' + '|---' * 8 + '|')
    if options.layout != 'simulated' and len(train) + len(test) < FEW:
        every = ready([*train, *test], mosaic, options)
        for count in [n for n in counts if n <= len(every) - 1]:
            held = min(options.tests, len(every) - count)
            folds = [every[i:i + held] for i in range(0, len(every), held)]
            results = []
            for i, fold in enumerate(folds):
                others = every[i * held + len(fold):] + every[:i * held]
                results.append(learn(others[:count], fold, options, lpips))
            show(count, results, every)
        return
    test = ready(test[:options.tests], mosaic, options)
    for count in counts:
        show(count, [learn(ready(train[:count], mosaic, options), test, options, lpips)], test)


if __name__ == '__main__':
    main()
