"""The authors' weights: files in Keras' layout with random weights, against what their program computes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

h5py = pytest.importorskip("h5py")
pytest.importorskip("safetensors")

from hadalens import keras  # noqa: E402

rng = np.random.default_rng(7)
Array = npt.NDArray[Any]
Weights = dict[str, Array]


def write_h5(path: Path, layers: dict[str, Weights], config: object = None) -> Path:
    """A file as Keras 2 writes it; layers in the order of their names, as it does not keep that of making them."""
    with h5py.File(path, "w") as file:
        if config is not None:
            file.attrs["model_config"] = json.dumps(config)
        group = file.create_group("model_weights") if config is not None else file
        group.attrs["layer_names"] = [name.encode() for name in layers]
        for layer, weights in layers.items():
            inner = group.create_group(layer)
            inner.attrs["weight_names"] = [f"{layer}/{name}:0".encode() for name in weights]
            for name, value in weights.items():
                inner.create_dataset(f"{layer}/{name}:0", data=value)
        if config is not None:
            file.create_group("optimizer_weights").create_dataset("hadamard/kernel:0", data=np.zeros(3))
    return path


def real_filter(rows: int, cols: int, turn: float) -> Array:
    """A filter all of whose images are real and positive, but for a phase: a smooth positive kernel's spectrum."""
    y, x = np.fft.fftfreq(rows) * rows, np.fft.fftfreq(cols) * cols
    kernel = np.exp(-((y[:, None] - 1) ** 2 + (x - 2) ** 2) / 3) + 0.01 * rng.random((rows, cols))
    full = np.conj(np.fft.fft2(kernel) * np.exp(1j * turn))
    return np.stack([full.real, full.imag]).astype(np.float32)[..., None]


def authors(raw: Array, kernel: Array, crop: list[list[int]]) -> Array:
    """What their Hadamard layer and crop give."""
    spectrum = np.fft.fft2(raw) * np.conj(kernel[0, ..., 0] + 1j * kernel[1, ..., 0].astype(np.float64))
    image = np.abs(np.fft.fftshift(np.fft.ifft2(spectrum)))
    (top, bottom), (left, right) = crop
    return image[top : image.shape[0] - bottom, left : image.shape[1] - right]


def ours(raw: Array, imported: keras.Imported, depth: int, channel: int) -> Array:
    """What a model of these filters gives (docs/reference/files.md)."""
    image = np.fft.irfft2(imported.filters[depth, channel] * np.fft.rfft2(raw), s=raw.shape)
    top, left = ((a - b) // 2 for a, b in zip(imported.raw, imported.window, strict=True))
    return image[top : top + imported.window[0], left : left + imported.window[1]]


def recon(path: Path, shape: tuple[int, int], crop: list[list[int]] | None, first: int = 0) -> list[Array]:
    """Write a file of filters; return them."""
    kernels = [real_filter(*shape, turn) for turn in (0.3, 2.0, -2.5)]
    names = ["hadamard" + (f"_{first + i}" if first + i else "") for i in range(3)]
    layers = [{"class_name": "Cropping2D", "config": {"cropping": crop}}] if crop else []
    # written in the order of the names, which is not that of making where there are ten
    write_h5(
        path, {n: {"kernel": k} for n, k in sorted(zip(names, kernels, strict=True))}, {"config": {"layers": layers}}
    )
    return kernels


@pytest.mark.parametrize(
    ("shape", "crop"),
    [((24, 32), [[6, 6], [10, 10]]), ((24, 31), [[8, 9], [11, 11]]), ((23, 32), [[9, 8], [13, 12]]), ((16, 16), None)],
)
def test_filters_give_the_authors_images(tmp_path: Path, shape: tuple[int, int], crop: list[list[int]] | None) -> None:
    """Filters give the authors images."""
    kernels = recon(tmp_path / "a.h5", shape, crop, first=9)
    imported = keras.import_filters([tmp_path / "a.h5"], [100])
    raw = rng.random(shape)
    assert imported.real_share == pytest.approx(np.ones((1, 3)), abs=1e-6)
    for channel, kernel in enumerate(kernels):
        want = authors(raw, kernel, crop or [[0, 0], [0, 0]])
        assert imported.window == want.shape
        np.testing.assert_allclose(ours(raw, imported, 0, channel), want, rtol=0, atol=2e-6 * want.max())


def test_what_has_no_symmetry_is_left_out(tmp_path: Path) -> None:
    """What has no symmetry is left out."""
    kernel = real_filter(16, 16, 0.0)
    noise = rng.normal(size=kernel.shape).astype(np.float32)
    write_h5(tmp_path / "a.h5", {"hadamard": {"kernel": kernel + noise}})
    share = keras.import_filters([tmp_path / "a.h5"], [1]).real_share[0, 0]
    energy, extra = np.sum(kernel**2.0), np.sum(noise**2.0)
    assert share == pytest.approx((energy + extra / 2) / (energy + extra), rel=0.05)


def test_distances_are_sorted_and_shifts_move(tmp_path: Path) -> None:
    """Distances are sorted and shifts move."""
    far, near = recon(tmp_path / "far.h5", (16, 16), None), recon(tmp_path / "near.h5", (16, 16), None)
    files, raw = [tmp_path / "far.h5", tmp_path / "near.h5"], rng.random((16, 16))
    imported = keras.import_filters(files, [600, 100], shifts=[(2, -3), (0, 0)])
    assert imported.distances_mm == (100.0, 600.0)
    np.testing.assert_allclose(ours(raw, imported, 0, 0), authors(raw, near[0], [[0, 0], [0, 0]]), atol=1e-4)
    moved = np.roll(authors(raw, far[0], [[0, 0], [0, 0]]), (2, -3), (0, 1))
    np.testing.assert_allclose(ours(raw, imported, 1, 0), moved, atol=1e-4)


def test_what_is_wrong_with_filters_is_said(tmp_path: Path) -> None:
    """What is wrong with filters is said."""
    recon(tmp_path / "a.h5", (16, 16), None)
    recon(tmp_path / "b.h5", (16, 18), None)
    recon(tmp_path / "c.h5", (16, 16), [[4, 4], [4, 4]])
    with pytest.raises(ValueError, match="one distance for each file"):
        keras.import_filters([tmp_path / "a.h5"] * 2, [5, 5])
    with pytest.raises(ValueError, match="another size"):
        keras.import_filters([tmp_path / "a.h5", tmp_path / "b.h5"], [1, 2])
    with pytest.raises(ValueError, match="cropped otherwise"):
        keras.import_filters([tmp_path / "a.h5", tmp_path / "c.h5"], [1, 2])
    with pytest.raises(ValueError, match="one shift"):
        keras.import_filters([tmp_path / "a.h5"], [1], shifts=[])
    write_h5(tmp_path / "none.h5", {"dense": {"kernel": np.zeros((2, 2)), "bias": np.zeros(2)}})
    with pytest.raises(ValueError, match="no Hadamard filters"):
        keras.import_filters([tmp_path / "none.h5"], [1])
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros(2)
    with pytest.raises(ValueError, match="Keras 2"):
        keras.import_filters([tmp_path / "other.h5"], [1])


# The authors' net, as their program makes it: x1 ... x14, from below before the skip.
WIDTHS = [(1, 32), (32, 32), (32, 64), (64, 64), (64, 128), (128, 256), (256, 512), (512, 256), (256, 128)]
WIDTHS += [(384, 128), (256, 64), (128, 32), (96, 32), (64, 1)]


def random_net(shared: bool) -> dict[str, Weights]:
    """Return the layers of a net with random weights."""
    layers: dict[str, Weights] = {}
    number = 98  # so that names sort otherwise than numbers
    for into, out in WIDTHS:
        for _ in range(1 if shared else 3):
            kernel = rng.normal(size=(3, 3, into, out)) * np.sqrt(2 / (9 * into))
            layers[f"conv2d_{number}"] = {"kernel": kernel, "bias": rng.normal(size=out) * 0.1}
            number += 1
    for i in range(3):
        layers["batch_normalization" + (f"_{i}" if i else "")] = {
            "gamma": rng.uniform(0.5, 1.5, 64),
            "beta": rng.normal(size=64) * 0.1,
            "moving_mean": rng.normal(size=64) * 0.1,
            "moving_variance": rng.uniform(0.5, 1.5, 64),
        }
    return dict(sorted(layers.items()))


def authors_net(layers: dict[str, Weights], image: Array, shared: bool) -> Array:
    """Their forward pass, each line as in their program, in PyTorch's double precision."""
    import torch
    import torch.nn.functional as F  # noqa: N812

    convs = [layers[f"conv2d_{n}"] for n in range(98, 98 + 14 * (1 if shared else 3))]
    out = []
    for c in range(3):

        def conv(x: torch.Tensor, number: int, colour: int = c) -> torch.Tensor:
            layer = convs[number - 1] if shared else convs[3 * (number - 1) + colour]
            weight = torch.from_numpy(layer["kernel"].transpose(3, 2, 0, 1).copy())
            return F.relu(F.conv2d(x, weight, torch.from_numpy(layer["bias"]), padding=1))

        def up(x: torch.Tensor) -> torch.Tensor:
            return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)

        c2 = conv(conv(torch.from_numpy(image[None, c : c + 1]).double(), 1), 2)
        c4 = conv(F.max_pool2d(c2, 2), 3)
        c6 = conv(F.max_pool2d(c4, 2), 4)
        c8 = conv(F.max_pool2d(c6, 2), 5)
        c10 = conv(F.max_pool2d(c8, 2), 6)
        c16 = conv(conv(conv(F.max_pool2d(c10, 2), 7), 8), 9)
        c19 = conv(torch.cat([up(c16), c10], 1), 10)
        c22 = conv(torch.cat([up(c19), c8], 1), 11)
        c25 = conv(torch.cat([up(c22), c6], 1), 12)
        c28 = conv(torch.cat([up(c25), c4], 1), 13)
        c30 = torch.cat([up(c28), c2], 1)
        norm = layers["batch_normalization" + (f"_{c}" if c else "")]
        mean, variance, gamma, beta = (
            torch.from_numpy(norm[key])[:, None, None] for key in ("moving_mean", "moving_variance", "gamma", "beta")
        )
        out.append(conv((c30 - mean) / torch.sqrt(variance + 1e-3) * gamma + beta, 14))
    return np.asarray(torch.cat(out, 1)[0])


@pytest.mark.parametrize("shared", [True, False])
def test_net_gives_the_authors_images(tmp_path: Path, shared: bool) -> None:
    """Net gives the authors images."""
    torch = pytest.importorskip("torch")
    from hadalens.torch import Net

    layers = random_net(shared)
    write_h5(tmp_path / "net.h5", layers, {"config": {"layers": []}})
    net = keras.import_net(tmp_path / "net.h5", size=(64, 32))
    assert sum(w.size for n, w in net.weights.items() if ".take." not in n) == (3_745_057 if shared else 3 * 3_744_545)
    net.save(tmp_path / "net.safetensors")
    image = rng.random((3, 64, 32)).astype(np.float32)
    with torch.no_grad():
        got = Net.load(tmp_path / "net.safetensors").eval()(torch.from_numpy(image[None])).numpy()[0]
    want = authors_net(layers, image, shared)
    assert np.linalg.norm(got - want) < 1e-5 * np.linalg.norm(want)


def test_a_model_of_filters_and_net(tmp_path: Path) -> None:
    """A model file of the authors' filters and net is reconstructed with, and gives their images."""
    torch = pytest.importorskip("torch")
    import hadalens
    from hadalens.torch import Net

    kernels = recon(tmp_path / "a.h5", (72, 80), [[4, 4], [24, 24]])
    write_h5(tmp_path / "net.h5", random_net(True), {"config": {"layers": []}})
    file = tmp_path / "a.model"
    keras.import_model(file, [tmp_path / "a.h5"], [150], net=tmp_path / "net.h5", net_size=(64, 32))
    model = hadalens.Model.load(file)
    assert model.info.distances_mm == (150.0,)
    assert (model.info.window_rows, model.info.window_cols, model.info.enhance) == (64, 32, True)
    raw = rng.random((3, 72, 80)).astype(np.float32)
    plain = hadalens.Plan(model, occupied="all", enhance=False).run(raw).stack[0]
    for channel, kernel in enumerate(kernels):
        want = authors(raw[channel], kernel, [[4, 4], [24, 24]])
        np.testing.assert_allclose(plain[channel], want, rtol=0, atol=1e-5 * want.max())
    got = hadalens.Plan(model, occupied="all").run(raw).stack[0]
    with torch.no_grad():
        want = Net.load(file).eval()(torch.from_numpy(plain[None])).numpy()[0]
    assert np.linalg.norm(got - want) < 1e-5 * np.linalg.norm(want)


def test_what_is_wrong_with_nets_is_said(tmp_path: Path) -> None:
    """What is wrong with nets is said."""
    layers = random_net(True)
    write_h5(tmp_path / "net.h5", layers)
    with pytest.raises(ValueError, match="multiples of 32"):
        keras.import_net(tmp_path / "net.h5", size=(100, 100))
    del layers["conv2d_105"]
    write_h5(tmp_path / "less.h5", layers)
    with pytest.raises(ValueError, match="13 convolutions"):
        keras.import_net(tmp_path / "less.h5")
    layers["conv2d_105"] = {"kernel": np.zeros((3, 3, 512, 128)), "bias": np.zeros(128)}
    write_h5(tmp_path / "other.h5", layers)
    with pytest.raises(ValueError, match=r"a convolution \(down\.5\.1\)"):
        keras.import_net(tmp_path / "other.h5")
