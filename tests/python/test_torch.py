"""Nets as PyTorch modules: what the library makes of the same image, for every kind of layer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import hadalens
import numpy as np
import numpy.typing as npt
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")

from hadalens.torch import Net  # noqa: E402
from safetensors.numpy import save_file  # noqa: E402

ROWS, COLS = 32, 46
TOLERANCE = 1e-5  # relative L2: sums of single precision in another order
rng = np.random.default_rng(11)


def conv(name: str, channels: int, **more: Any) -> dict[str, Any]:
    """Return a layer."""
    return {"layer": "conv", "name": name, "channels": channels, **more}


LISTS: dict[str, list[dict[str, Any]]] = {
    "of docs": [
        {"layer": "input", "channels": 3},
        conv("first", 8, activation="relu"),
        {"layer": "pool"},
        conv("low.0", 8, activation="leaky_relu", slope=0.2),
        {"layer": "resize", "resize": "linear", "like": 1},
        {"layer": "concat", "from": [1, 4]},
        conv("last", 3, kernel=1, pad=0),
    ],
    "transposed": [
        {"layer": "input", "channels": 3},
        conv("down", 6, stride=2, bias=0),
        {"layer": "pool", "pool": "mean", "kernel": 3, "stride": 2},
        conv("up", 5, kernel=3, stride=2, pad=1, output_pad=1, transposed=1),
        {"layer": "activation", "activation": "sigmoid"},
        {"layer": "concat", "from": [1, 4]},
        {"layer": "resize", "resize": "nearest", "like": 0},
        {"layer": "dropout", "p": 0.5},
        {"layer": "norm", "name": "norm", "eps": 1e-3},
        conv("last", 3),
    ],
    "cubic": [
        {"layer": "input", "channels": 3},
        conv("a", 4),
        {"layer": "resize", "resize": "cubic", "rows": 40, "cols": 33},
        conv("b", 4),
        {"layer": "resize", "resize": "cubic_aligned", "rows": 21, "cols": 60},
        conv("c", 3),
        {"layer": "resize", "resize": "linear_aligned", "like": 0},
    ],
    "for each colour": [
        {"layer": "input", "channels": 1},
        conv("a", 4, activation="relu"),
        {"layer": "norm", "name": "norm"},
        conv("b", 1),
    ],
}


def model_with(net: Net, file: Path) -> hadalens.Model:
    """Return a model whose filters change nothing, with a net behind them."""
    net.save(file)
    half = np.zeros((1, 3, ROWS, COLS // 2 + 1, 2), np.float32)
    half[..., 0] = 1
    weights = {f"enhance.{name}": np.asarray(value) for name, value in net.state_dict().items()}
    size = f"{ROWS}x{COLS}"
    metadata = {
        "format": "hadalens-model",
        "version": "1",
        "form": "complex",
        "boundary": "circular",
        **dict.fromkeys(("raw", "grid", "window"), size),
        **dict.fromkeys(("alpha", "lambda", "dark", "noise", "refine_steps", "refine_rho"), "0"),
        "enhance": json.dumps(net.description),
    }
    tensors = {"distances_mm": np.array([100.0]), "filter": half, **weights}
    model = file.with_suffix(".model")
    save_file(tensors, model, metadata=metadata)
    return hadalens.Model.load(model)


@pytest.mark.parametrize("name", LISTS)
def test_the_librarys_images(name: str, tmp_path: Path) -> None:
    """A module and the library make the same of an image, before and after saving."""
    description = {"format": "hadalens-net-1", "colours": 3 if "each" in name else 1, "layers": LISTS[name]}
    torch.manual_seed(5)
    net = Net(json.dumps(description)).eval()
    for key, value in net.state_dict().items():
        if key.endswith("running_var"):
            value.copy_(torch.rand_like(value) + 0.5)
        elif "norm" in key and value.is_floating_point():
            value.copy_(torch.randn_like(value))
    raw: npt.NDArray[Any] = rng.random((3, ROWS, COLS)).astype(np.float32)
    model = model_with(net, tmp_path / "net.safetensors")
    got = hadalens.Plan(model, occupied="all").run(raw).stack[0]
    with torch.no_grad():
        want = net(torch.from_numpy(raw[None])).clamp(min=0).numpy()[0]  # light is not negative
        assert want.any()
        assert np.linalg.norm(got - want) < TOLERANCE * np.linalg.norm(want)
        for file in (tmp_path / "net.safetensors", tmp_path / "net.model"):
            again = Net.load(file).eval()(torch.from_numpy(raw[None])).clamp(min=0).numpy()[0]
            np.testing.assert_array_equal(again, want)


def test_what_is_wrong_is_said(tmp_path: Path) -> None:
    """Files without a net, lists that are none, weights that do not fit."""
    save_file({"x": np.zeros(2, np.float32)}, tmp_path / "a.safetensors")
    with pytest.raises(ValueError, match="holds no net"):
        Net.load(tmp_path / "a.safetensors")
    with pytest.raises(ValueError, match="hadalens-net-1"):
        Net({"layers": []})
    with pytest.raises(ValueError, match="layer 1"):
        Net({"format": "hadalens-net-1", "layers": [{"layer": "input", "channels": 1}, {"layer": "none"}]})
    with pytest.raises(ValueError, match="before"):
        Net({"format": "hadalens-net-1", "layers": [{"layer": "input", "channels": 1}, conv("a", 1, **{"from": [1]})]})
    description = {"format": "hadalens-net-1", "layers": [{"layer": "input", "channels": 1}, conv("a", 1)]}
    save_file(
        {"a.weight": np.zeros((1, 1, 3, 3), np.float32)}, tmp_path / "b.safetensors", {"net": json.dumps(description)}
    )
    with pytest.raises(RuntimeError, match=r"a\.bias"):
        Net.load(tmp_path / "b.safetensors")


@pytest.mark.parametrize("shares", [False, True])
def test_a_net_that_sees_the_other_planes(
    shares: bool, model: hadalens.Model, raw: npt.NDArray[Any], tmp_path: Path
) -> None:
    """It has twice the channels: the error says so, `inputs` puts them there, `enhance` does what the library does."""
    torch.manual_seed(3)
    layers = [{"layer": "input", "channels": 6}, conv("a", 8, activation="relu"), conv("b", 3)]
    net = Net({"format": "hadalens-net-1", "shares": shares, "layers": layers}).eval()
    net.save(tmp_path / "net.safetensors")
    enhanced = model.with_enhance(hadalens.Net.load(tmp_path / "net.safetensors"))
    before = hadalens.Plan(model, scene="planes").run(raw)
    found = [depth for depth, there in enumerate(before.report.occupied) if there]
    assert len(found) > 1
    planes = torch.from_numpy(before.stack[found])
    assert net.channels == 6
    with pytest.raises(ValueError, match="inputs"):
        net(planes)
    with pytest.raises(ValueError, match="takes 6"):
        net(planes[:, :1])
    sum_of_others = net.inputs(planes)[:, 3:]
    torch.testing.assert_close(sum_of_others + planes, planes.sum(0, keepdim=True).expand_as(planes))
    got = hadalens.Plan(enhanced, scene="planes").run(raw)
    assert got.report.enhanced
    with torch.no_grad():
        want = net.enhance(planes).numpy()
        alone = net.enhance(planes[:1]).numpy()
    assert np.linalg.norm(got.stack[found] - want) < TOLERANCE * np.linalg.norm(want)
    assert np.array_equal(alone, planes[:1].numpy()) == shares
