#!/usr/bin/env python3
"""Learns the ridge regulariser (lib/refine/proximal.h) from photographs, and writes kernels/shared_ridge_weights.h.

    photographs.sh FOLDER; train.py FOLDER [--iterations N] [--seed S] [--out FILE]
Photographs are seen at several sizes, encoded or as light, with noise of 0.2 to 15 %. Each step has filters of its own; the
loss is the mean logarithm of the mean square error, so that each level of noise counts alike. Needs PyTorch, NumPy, Pillow.
Three thousand iterations take ten minutes on one core; the same seed, machine and version give the same weights.
"""
import argparse
import math
import pathlib

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image

STEPS, FILTERS, SIZE, SOME = 4, 24, 5, 4
STEEPEST = 7.9  # m: below 8 each step's objective is convex, for psi'' is at least -1/8
PATCH, BATCH, RATE = 48, 12, 8e-3
SIDES = 130, 200, 300, 450, 700
OUT = pathlib.Path(__file__).resolve().parents[2] / 'kernels' / 'shared_ridge_weights.h'


class Ridge(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.filters = torch.nn.Parameter(0.1 * torch.randn(STEPS, FILTERS, 3, SIZE, SIZE))
        self.steep = torch.nn.Parameter(torch.zeros(STEPS, FILTERS))
        self.share = torch.nn.Parameter(torch.zeros(STEPS, FILTERS))
        self.momentum = torch.nn.Parameter(torch.full((STEPS,), 0.2))
        self.length = torch.nn.Parameter(torch.full((STEPS,), -1.5))
        self.largest = [torch.randn(1, 3, 32, 32) for _ in range(STEPS)]  # the singular vectors, nearly

    def scaled(self, step):
        """The filters without their mean, together of norm 1."""
        filters = self.filters[step] - self.filters[step].mean((2, 3), keepdim=True)
        vector = self.largest[step]
        with torch.no_grad():
            for _ in range(2 if self.training else 100):
                vector = F.conv_transpose2d(F.conv2d(vector, filters), filters)
                vector = vector / vector.norm()
            self.largest[step] = vector
        return filters / F.conv2d(vector, filters).norm()

    def tables(self):
        return 2 * self.steep.exp(), STEEPEST * torch.sigmoid(self.share)

    def forward(self, given, noise):
        steep, share = (table[:, None, :, None, None] for table in self.tables())
        now = before = given
        for step in range(STEPS):
            filters = self.scaled(step)
            each = steep[step] / noise[:, None, None, None]
            t = each * F.conv2d(now, filters)
            shaped = share[step] / each * t / (1 + t * t)
            gradient = now - given + F.conv_transpose2d(shaped, filters)
            length = torch.sigmoid(self.length[step])
            now, before = now - length * gradient + (self.momentum[step] * (now - before) if step else 0), now
        return now


def load(folder, sides):
    """Every photograph at each size that it has, bytes of [rows, columns, channels]."""
    images = []
    for path in sorted(pathlib.Path(folder).iterdir()):
        if path.suffix.lower() not in ('.jpg', '.png', '.tif'):
            continue
        photograph = Image.open(path).convert('RGB')
        for side in sides:
            factor = side / min(photograph.size)
            if factor <= 1:
                size = tuple(round(factor * n) for n in photograph.size)
                images.append(np.asarray(photograph.resize(size, Image.Resampling.LANCZOS)))
    if not images:
        raise SystemExit(f'{folder}: no photographs (.jpg, .png, .tif)')
    return images


def patches(images, random):
    batch = []
    for _ in range(BATCH):
        image = images[random.integers(len(images))]
        i, j = (random.integers(n - PATCH) for n in image.shape[:2])
        patch = image[i:i + PATCH, j:j + PATCH].astype(np.float32) / 255
        patch = patch[:: random.choice((-1, 1)), :: random.choice((-1, 1))]
        if random.random() < 0.5:
            patch = patch.transpose(1, 0, 2)
        if random.random() < 0.4:
            patch = patch**2.2
        batch.append((patch * random.uniform(0.4, 1.2)).transpose(2, 0, 1).copy())
    return torch.from_numpy(np.stack(batch))


def score(model, images):
    """PSNR before and after, by noise in 1/255."""
    model.eval()
    lines = []
    for level in (1, 2.55, 5, 15, 38):
        random = np.random.default_rng(1)
        values = []
        for image in images:
            x = torch.from_numpy(image.astype(np.float32).transpose(2, 0, 1).copy())[None] / 255
            y = x + level / 255 * torch.from_numpy(random.standard_normal(x.shape, dtype=np.float32))
            with torch.no_grad():
                z = model(y, torch.tensor([level / 255]))
            values.append([-10 * math.log10(float(((q - x) ** 2).mean())) for q in (y, z)])
        lines.append('%g: %.2f to %.2f' % (level, *np.mean(values, 0)))
    model.train()
    return ', '.join(lines)


def array(name, values, count):
    numbers = ['%.5gf' % v if 'e' in '%.5g' % v or '.' in '%.5g' % v else '%.5g.0f' % v for v in np.ravel(values)]
    lines, line = [], '   '
    for number in numbers:
        if len(line) + len(number) + 2 > 118:
            lines.append(line)
            line = '   '
        line += f' {number},'
    return '\n'.join([f'HADA_SHARED_TABLE float {name}[{count}] = {{', *lines, line, '};\n'])


def header(model):
    model.eval()
    with torch.no_grad():
        filters = torch.stack([model.scaled(step) for step in range(STEPS)]).numpy()
        steep, share = (table.numpy() for table in model.tables())
    grey = filters.sum(2, keepdims=True) / math.sqrt(3)

    def blocks(values):  # four filters side by side
        return values.reshape(STEPS * FILTERS // SOME, SOME, -1).transpose(0, 2, 1)

    momentum = model.momentum.detach().numpy().copy()
    momentum[0] = 0
    shapes = 'HADA_RIDGE_STEPS * HADA_RIDGE_FILTERS'
    return '\n'.join([
        '/* Weights of the learned ridge regulariser. Made by perf/prior/train.py. One file: they are numbers. */',
        '#ifndef SHARED_RIDGE_WEIGHTS_H', '#define SHARED_RIDGE_WEIGHTS_H', '', '#include "shared_ridge.h"', '',
        '/* clang-format off */', '',
        '/* Filters: [step][four of them][channel][row][column][one of the four], of three channels and of one. */',
        array('hada_ridge_colour', blocks(filters), f'{shapes} * 75'),
        array('hada_ridge_grey', blocks(grey), f'{shapes} * 25'),
        '/* Of each filter: a_k times the noise, and m_k (kernels/refine_ridge.cl). */',
        array('hada_ridge_in', steep, shapes),
        array('hada_ridge_share', share, shapes),
        '/* Of each step. */',
        array('hada_ridge_length', torch.sigmoid(model.length).detach().numpy(), 'HADA_RIDGE_STEPS'),
        array('hada_ridge_momentum', momentum, 'HADA_RIDGE_STEPS'), '#endif', ''])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('photographs', type=pathlib.Path)
    parser.add_argument('--iterations', type=int, default=3000)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--score', type=pathlib.Path, help='other photographs, shown every 1000 iterations')
    parser.add_argument('--out', type=pathlib.Path, default=OUT)
    arguments = parser.parse_args()
    torch.manual_seed(arguments.seed)
    random = np.random.default_rng(arguments.seed)
    images, others = load(arguments.photographs, SIDES), arguments.score and load(arguments.score, (200,))
    model = Ridge()
    optimizer = torch.optim.Adam(model.parameters(), lr=RATE, betas=(0.9, 0.99))
    for k in range(arguments.iterations):
        optimizer.param_groups[0]['lr'] = RATE * (0.5 + 0.5 * math.cos(math.pi * k / arguments.iterations)) + 1e-5
        x = patches(images, random)
        level = torch.from_numpy(np.exp(random.uniform(math.log(0.002), math.log(0.15), BATCH)).astype(np.float32))
        white = torch.from_numpy(random.standard_normal(x.shape, dtype=np.float32))
        y = x + level[:, None, None, None] * white
        error = ((model(y, level) - x)[:, :, SIZE - 1:1 - SIZE, SIZE - 1:1 - SIZE] ** 2).mean((1, 2, 3))
        loss = (error + 1e-7).log().mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        if others and (k + 1) % 1000 == 0:
            print(k + 1, score(model, others), flush=True)
    arguments.out.write_text(header(model), encoding='ascii')


if __name__ == '__main__':
    main()
