"""Scenes made to be hard for depth pursuit, as a simulated camera with the circular boundary would see them: dots, stripes
and patches at few depths, neighbours, faint and coloured parts, noise; and slanted planes that fill all depths. Used by
pursuit.py. Needs NumPy and tifffile."""
import json

import numpy as np
import tifffile


class Stage:
    """A camera, and the scenes that are put before it."""

    def __init__(self, folder, seed):
        self.random = np.random.default_rng(seed)
        design = json.load(open(folder / "camera.json"))
        self.side, self.channels = (design["window_rows"], design["window_cols"]), design["channels"]
        psf = tifffile.imread(folder / "psf.tif").astype(float)
        self.depths, self.grid = len(psf), psf.shape[1:3]
        self.otf = np.fft.rfft2(np.fft.ifftshift(psf.reshape(self.depths, *self.grid), axes=(1, 2)))
        self.pictures = [tifffile.imread(f) for f in sorted(folder.glob("z*/scene/*.tif"))]
        self.row, self.col = np.mgrid[: self.side[0], : self.side[1]]

    def expose(self, scene, noise):
        """The frame of {depth: picture}."""
        first = [(n - s) // 2 for n, s in zip(self.grid, self.side)]
        frame = np.zeros((*self.grid, self.channels))
        for depth, picture in scene.items():
            for c in range(self.channels):
                image = np.zeros(self.grid)
                image[first[0] : first[0] + self.side[0], first[1] : first[1] + self.side[1]] = picture[..., c]
                frame[..., c] += np.fft.irfft2(np.fft.rfft2(image) * self.otf[depth], s=self.grid)
        return (frame + noise * frame.max() * self.random.standard_normal(frame.shape)).astype(np.float32)

    def some(self, count, neighbours=False):
        if neighbours:
            first = self.random.integers(self.depths - count + 1)
            return list(range(first, first + count))
        return sorted(int(z) for z in self.random.choice(self.depths, count, replace=False))

    def picture(self):
        return self.pictures[self.random.integers(len(self.pictures))].reshape(*self.side, self.channels)

    def dots(self, count, radius):
        picture = np.zeros((*self.side, self.channels))
        for _ in range(count):
            y, x = self.random.uniform(4, self.side[0] - 4), self.random.uniform(4, self.side[1] - 4)
            spot = np.exp(-((self.row - y) ** 2 + (self.col - x) ** 2) / (2 * radius**2))
            picture += spot[..., None] * self.random.uniform(0.3, 1, self.channels)
        return picture

    def patch(self):
        y, x = (self.random.integers(s // 6, s - s // 6) for s in self.side)
        inside = (self.row - y) ** 2 + (self.col - x) ** 2 < self.random.integers(6, 20) ** 2
        return inside[..., None] * self.picture()

    def stripes(self):
        along = self.row if self.random.random() < 0.5 else self.col
        return (along // self.random.integers(3, 12) % 2)[..., None] * self.random.uniform(0.4, 1, self.channels)

    def side_by_side(self, depths, pictures):
        """Every depth has a strip of the window, in a random direction."""
        angle = self.random.uniform(0, np.pi)
        way = np.cos(angle) * self.col + np.sin(angle) * self.row
        strip = np.searchsorted(np.quantile(way, np.linspace(0, 1, len(depths) + 1))[1:-1], way)
        return {z: p * (strip == k)[..., None] for k, (z, p) in enumerate(zip(depths, pictures))}


def strips(depths, picture, neighbours=False, contrast=None):
    def make(s):
        scene = s.side_by_side(s.some(depths, neighbours), [picture(s) for _ in range(depths)])
        for part, factor in zip(s.random.permutation(list(scene)), contrast or ()):
            scene[int(part)] = scene[int(part)] * factor
        return scene

    return make


def laid_over(depths, picture):
    return lambda s: {z: picture(s) for z in s.some(depths)}


def one_colour_each(s):
    return {z: s.picture() * (np.arange(s.channels) == k % s.channels) for k, z in enumerate(s.some(3))}


def slanted(s):
    return s.side_by_side(range(s.depths), [s.picture()] * s.depths)


KINDS = {  # what is seen, noise as a part of the frame's maximum
    "dots at 2 depths": (laid_over(2, lambda s: s.dots(12, 1.5)), 0.01),
    "dots at 3": (laid_over(3, lambda s: s.dots(8, 1.5)), 0.01),
    "fine dots at 3": (laid_over(3, lambda s: s.dots(5, 0.7)), 0.01),
    "dots at 3, noise 4 %": (laid_over(3, lambda s: s.dots(8, 1.5)), 0.04),
    "patches at 3": (laid_over(3, Stage.patch), 0.01),
    "pictures over each other at 3": (laid_over(3, Stage.picture), 0.01),
    "one colour each at 3": (one_colour_each, 0.01),
    "strips at 3 neighbours": (strips(3, Stage.picture, neighbours=True), 0.01),
    "strips of 100, 15 and 5 % at 3": (strips(3, Stage.picture, contrast=(1, 0.15, 0.05)), 0.01),
    "strips at 3, noise 10 %": (strips(3, Stage.picture), 0.1),
    "stripes at 2": (strips(2, Stage.stripes), 0.01),
    "stripes at 3": (strips(3, Stage.stripes), 0.01),
    "stripes at 3, noise 4 %": (strips(3, Stage.stripes), 0.04),
    "slanted over 5": (lambda s: s.side_by_side(s.some(5, True), [s.picture()] * 5), 0.01),
    "slanted over all": (slanted, 0.01),
    "dots at all": (lambda s: {z: s.dots(4, 1.5) for z in range(s.depths)}, 0.01),
}


def write(name, count, camera, folder):
    """Writes frames of a kind; returns their paths and the sets of depths that are in them."""
    stage = Stage(camera, sorted(KINDS).index(name))
    make, noise = KINDS[name]
    folder.mkdir()
    files, wanted = [], []
    for k in range(count):
        scene = make(stage)
        files.append(folder / f"frame{k:02d}.tif")
        wanted.append(tuple(sorted(scene)))
        tifffile.imwrite(files[-1], stage.expose(scene, noise))
    return files, wanted
