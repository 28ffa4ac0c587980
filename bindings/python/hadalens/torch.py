"""Nets of Hadalens as PyTorch modules, with the same weights and the same output; cameras as modules.

A net is a list of layers with weights by PyTorch's names (``docs/explanation/nets.md``); :class:`Net` runs any such
list. On the same input it gives what the library gives, within 1e-5 (relative L2) in single precision: sums are taken
in another order.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from . import operators
from ._files import PathLike, extra, replaced
from .model import Model, as_model

with extra("torch"):
    import torch
    import torch.nn.functional as F  # noqa: N812  PyTorch's own habit
    from torch import Tensor, nn
    from torch.utils.checkpoint import checkpoint

    from . import _refinement

__all__ = ["Adjoint", "Forward", "Linear", "Net", "Refine"]

RESIZE: dict[str, dict[str, Any]] = {
    "nearest": {"mode": "nearest"},
    "linear": {"mode": "bilinear", "align_corners": False},
    "linear_aligned": {"mode": "bilinear", "align_corners": True},
    "cubic": {"mode": "bicubic", "align_corners": False},
    "cubic_aligned": {"mode": "bicubic", "align_corners": True},
}
COUNTER = ".num_batches_tracked"  # of PyTorch's batch norms alone


class Net(nn.Module):  # type: ignore[misc]  # which is Any to the type checker
    """A net of Hadalens.

    Takes and gives ``(N, C, Y, X)``: planes in linear intensity. A net for several depths has twice as many input
    channels as a plane (:attr:`channels`): beside each plane it sees the sum of the frame's other planes, which
    :meth:`inputs` puts there. :meth:`enhance` does all that the library does with the planes of a frame.

    ``state_dict()`` has the names and layouts of the net's file (and a counter for each batch norm), so
    ``torch.save(net.state_dict(), path)`` exports it, and a module of your own with these names loads it.

    Args:
        description: the list of layers, as a net's file holds it: JSON text, or what it means. Weights start as PyTorch
            starts them.

    Example:
        >>> net = hadalens.torch.Net.load("enhance.safetensors")   # of a net's file, or of a model that holds a net
        >>> planes = torch.from_numpy(hadalens.Plan(model, enhance=False).run(raw).stack)
        >>> better = net.eval().enhance(planes)
        >>> net.save("tuned.safetensors")                          # which the library loads

    """

    def __init__(self, description: str | dict[str, Any]) -> None:
        """Make the layers."""
        super().__init__()
        self.description: dict[str, Any] = json.loads(description) if isinstance(description, str) else description
        if self.description.get("format") != "hadalens-net-1":
            raise ValueError("this is not the description of a net (format hadalens-net-1)")
        self.colours: int = self.description.get("colours", 1)
        self.layers: list[dict[str, Any]] = [_complete(i, layer) for i, layer in enumerate(self.description["layers"])]
        channels: list[int] = []
        for layer in self.layers:
            before = [channels[i] for i in layer["from"]]
            for name, module in _modules(layer, before, self.colours):
                _put(self, name, module)
            channels.append(_channels(layer, before))

    @classmethod
    def load(cls, path: PathLike) -> Net:
        """From a net's file, or from a model file that holds a net.

        Raises:
            ValueError: where the file holds no net.
            RuntimeError: where its weights do not fit its list of layers.

        """
        with extra("torch"):
            from safetensors import safe_open

        with safe_open(str(path), "pt") as file:
            metadata = file.metadata() or {}
            prefix = "" if "net" in metadata else "enhance."
            description = metadata.get("net") or metadata.get("enhance")
            if description is None:
                raise ValueError(f"{path} holds no net: its metadata have neither net nor enhance")
            net = cls(description)
            names = net.state_dict().keys() & {name.removeprefix(prefix) for name in file.keys()}  # noqa: SIM118
            net.load_state_dict({name: file.get_tensor(prefix + name).float() for name in names})
        return net

    def save(self, path: PathLike) -> None:
        """Write a net's file, which the library loads."""
        with extra("torch"):
            from safetensors.torch import save_file

        weights = {name: value.detach().cpu().contiguous() for name, value in self.state_dict().items()}
        weights = {name: value for name, value in weights.items() if not name.endswith(COUNTER)}
        with replaced(path) as beside:
            save_file(weights, str(beside), metadata={"net": json.dumps(self.description)})

    @property
    def channels(self) -> int:
        """Channels of the images that the net takes; twice a plane's where it sees the others too."""
        return int(self.layers[0]["channels"]) * self.colours

    def inputs(self, planes: Tensor) -> Tensor:
        """Return what the net takes of the planes ``(Z, C, Y, X)`` of one frame.

        That is each plane, and of a net with twice the channels beside it the sum of the others.

        Raises:
            ValueError: the planes have other channels than the net is for.

        """
        count = planes.shape[1]
        if self.channels == 2 * count:
            return torch.cat([planes, planes.sum(0, keepdim=True) - planes], 1)
        self._check(count)
        return planes

    def enhance(self, planes: Tensor) -> Tensor:
        """Return enhanced planes of those ``(Z, C, Y, X)`` of one frame that are refined together, as the library does.

        A net that sees the other planes shares the light out among the planes: that of their sum, which it enhances as
        well unless it is made to share alone (docs/explanation/nets.md). Light that no plane claims is split equally.

        """
        beside, shares = self.inputs(planes), self.description.get("shares", False)
        if beside is planes or len(planes) == 1:
            return planes if shares and beside is not planes else self(beside).clamp(min=0)
        whole = planes.sum(0, keepdim=True)
        if not shares:
            whole = self(torch.cat([whole, torch.zeros_like(whole)], 1)).clamp(min=0)
        bright = planes.abs().amax((1, 2, 3), keepdim=True) > 0  # planes of zeros stay such
        out = self(beside).clamp(min=0) * bright
        claimed = out.sum(0, keepdim=True)
        return torch.where(claimed > 0, out * (whole / claimed.clamp(min=1e-38)), whole / len(planes))

    def _check(self, count: int) -> None:
        if count == self.channels:
            return
        told = f"images of {count} channels, and this net takes {self.channels}"
        if self.channels == 2 * count:
            told += ": beside each plane it sees the sum of the others; net.inputs(planes) puts them there"
        raise ValueError(told)

    def forward(self, image: Tensor) -> Tensor:
        """Images ``(N, C, Y, X)`` of any size that the list of layers can take.

        Raises:
            ValueError: the images have other channels than the net takes (:meth:`inputs`).

        """
        self._check(image.shape[1])
        rows, cols = image.shape[-2:]
        images = image.reshape(-1, image.shape[1] // self.colours, rows, cols)
        values: list[Tensor] = []
        for layer in self.layers:
            values.append(self._run(layer, values, images))
        out = values[-1]
        return out.reshape(image.shape[0], -1, *out.shape[-2:])

    def _run(self, layer: dict[str, Any], values: list[Tensor], images: Tensor) -> Tensor:
        kind = layer["layer"]
        if kind == "input":
            return images
        x = values[layer["from"][0]]
        if kind == "conv":
            return _activate(self._module(layer)(x), layer)
        if kind == "linear":
            return _activate(self._module(layer)(x.flatten(1)), layer)[:, :, None, None]
        if kind == "activation":
            return _activate(x, layer)
        if kind == "pool":
            pool = F.max_pool2d if layer["pool"] == "max" else F.avg_pool2d
            return pool(x, layer["kernel"], layer["stride"])
        if kind == "resize":
            like = layer["like"]
            size = values[like].shape[-2:] if like >= 0 else (layer["rows"], layer["cols"])
            return F.interpolate(x, size=size, **RESIZE[layer["resize"]])
        if kind == "concat":
            return torch.cat([_to_size(values[i], x.shape[-2:]) for i in layer["from"]], 1)
        if kind == "norm":
            if self.colours == 1:
                return self._module(layer)(x)
            parts = x.unflatten(0, (-1, self.colours)).unbind(1)
            return torch.stack([self._module(layer, str(i))(part) for i, part in enumerate(parts)], 1).flatten(0, 1)
        return F.dropout(x, layer["p"], self.training)

    def _module(self, layer: dict[str, Any], *more: str) -> Any:
        return self.get_submodule(".".join([layer["name"], *more]))


# What holds where a layer says nothing (docs/explanation/nets.md).
USUAL: dict[str, dict[str, Any]] = {
    "input": {},
    "conv": {
        "kernel": 3,
        "stride": 1,
        "pad": 1,
        "bias": 1,
        "activation": "none",
        "slope": 0.0,
        "transposed": 0,
        "output_pad": 0,
    },
    "linear": {"bias": 1, "activation": "none", "slope": 0.0},
    "activation": {"activation": "none", "slope": 0.0},
    "pool": {"pool": "max", "kernel": 2, "stride": 2},
    "resize": {"resize": "nearest", "like": -1},
    "concat": {},
    "norm": {"eps": 1e-5, "momentum": 0.1},
    "dropout": {"p": 0.0},
}


def _complete(index: int, layer: dict[str, Any]) -> dict[str, Any]:
    kind = layer.get("layer")
    if kind not in USUAL or (kind == "input") != (index == 0):
        raise ValueError(f"layer {index} of the net is of no kind that can stand there: {kind}")
    inputs = layer.get("from", index - 1)
    inputs = [] if kind == "input" else [inputs] if isinstance(inputs, int) else list(inputs)
    if any(not 0 <= i < index for i in inputs):
        raise ValueError(f"layer {index} of the net takes a layer that does not stand before it")
    return {**USUAL[kind], **layer, "from": inputs}


def _channels(layer: dict[str, Any], before: list[int]) -> int:
    if layer["layer"] in ("input", "conv", "linear"):
        return int(layer["channels"])
    return sum(before)


def _modules(layer: dict[str, Any], before: list[int], colours: int) -> list[tuple[str, nn.Module]]:
    """The modules of a layer that has weights, by their names."""
    kind = layer["layer"]
    if kind == "conv":
        shape = (before[0], layer["channels"], layer["kernel"], layer["stride"], layer["pad"])
        bias = bool(layer["bias"])
        if layer["transposed"]:
            return [(layer["name"], nn.ConvTranspose2d(*shape, layer["output_pad"], bias=bias))]
        return [(layer["name"], nn.Conv2d(*shape, bias=bias))]
    if kind == "linear":
        return [(layer["name"], nn.Linear(layer["in"], layer["channels"], bool(layer["bias"])))]
    if kind == "norm":
        norms = [nn.BatchNorm2d(before[0], layer["eps"], layer["momentum"]) for _ in range(colours)]
        if colours == 1:
            return [(layer["name"], norms[0])]
        return [(f"{layer['name']}.{i}", norm) for i, norm in enumerate(norms)]
    return []


def _put(root: nn.Module, name: str, module: nn.Module) -> None:
    """Modules by names with points stand in modules of their own, as in any state dict."""
    *parents, last = name.split(".")
    for part in parents:
        if part not in dict(root.named_children()):
            root.add_module(part, nn.Module())
        root = root.get_submodule(part)
    root.add_module(last, module)


def _activate(x: Tensor, layer: dict[str, Any]) -> Tensor:
    kind = layer["activation"]
    if kind == "relu":
        return F.relu(x)
    if kind == "leaky_relu":
        return F.leaky_relu(x, layer["slope"])
    return torch.sigmoid(x) if kind == "sigmoid" else x


def _to_size(x: Tensor, size: torch.Size) -> Tensor:
    """Cropped, or filled up with zeros at the bottom and right."""
    return F.pad(x, (0, size[1] - x.shape[3], 0, size[0] - x.shape[2]))


class _Camera(nn.Module):  # type: ignore[misc]  # which is Any to the type checker
    """What a camera does to a scene: sizes, and transfer functions as a buffer."""

    otf: Any

    def __init__(self, model: operators.Forward | Model | PathLike, depths: list[int] | None = None) -> None:
        """Take them from a model, its file, or the operator of NumPy; in single precision: ``.double()`` is exact."""
        super().__init__()
        self.operator = model if isinstance(model, operators.Forward) else operators.Forward(model)
        self._depths = slice(None) if depths is None else depths
        self.register_buffer("otf", self._exact().float(), persistent=False)

    def _exact(self) -> Tensor:
        return torch.view_as_real(torch.from_numpy(self.operator.otf[self._depths]))

    def _apply(self, change: Any) -> Any:
        """Make the transfer functions anew of the exact ones, so that no precision is lost on the way."""
        super()._apply(change)
        self.otf = self._exact().to(self.otf)
        return self

    def _through(self, image: Tensor, top: int, left: int, adjoint: bool) -> Tensor:
        """Return the light on the whole grid of images whose first pixel stands at (top, left)."""
        rows, cols = self.operator.grid
        high, wide = image.shape[-2:]
        spectrum = torch.fft.rfft2(F.pad(image, (left, cols - left - wide, top, rows - top - high)))
        otf = torch.view_as_complex(self.otf)
        seen = otf.conj() * spectrum[:, None] if adjoint else (otf * spectrum).sum(1)
        return torch.fft.irfft2(seen, s=(rows, cols))

    def _frames(self, planes: Tensor) -> Tensor:
        operator = self.operator
        if planes.ndim == 4 and operator.planes_shape[0] == 1:
            planes = planes[:, None]
        if planes.ndim != 5 or tuple(planes.shape[1:]) != operator.planes_shape:
            raise ValueError(f"planes of {tuple(planes.shape)}: (N, *{operator.planes_shape}) is needed")
        _, rows, cols = operator.frame_shape
        return self._through(planes, *operator.origin, adjoint=False)[..., :rows, :cols]

    def _planes(self, frames: Tensor) -> Tensor:
        operator = self._check(frames)
        (top, left), (rows, cols) = operator.origin, operator.planes_shape[2:]
        return self._through(frames, 0, 0, adjoint=True)[..., top : top + rows, left : left + cols]

    def _check(self, frames: Tensor) -> operators.Forward:
        if frames.ndim != 4 or tuple(frames.shape[1:]) != self.operator.frame_shape:
            raise ValueError(f"frames of {tuple(frames.shape)}: (N, *{self.operator.frame_shape}) is needed")
        return self.operator


class Forward(_Camera):
    """Frames ``(N, C, Y, X)`` of planes ``(N, Z, C, Y, X)``, as :class:`hadalens.operators.Forward` has them.

    Plain PyTorch: any device, gradients of any order, no OpenCL. Of one depth planes may be ``(N, C, Y, X)``.

    Args:
        model: a :class:`hadalens.Model` with transfer functions, its file, or a :class:`hadalens.operators.Forward`.

    Example:
        >>> camera = hadalens.torch.Forward("camera.model").to("cuda")
        >>> loss = (camera(planes) - frames).square().mean()

    """

    def forward(self, planes: Tensor) -> Tensor:
        """Return the frames."""
        return self._frames(planes)


class Adjoint(_Camera):
    """Planes ``(N, Z, C, Y, X)`` that the transpose of :class:`Forward` makes of frames ``(N, C, Y, X)``."""

    def forward(self, frames: Tensor) -> Tensor:
        """Return the planes."""
        return self._planes(frames)


class Linear(nn.Module):  # type: ignore[misc]  # which is Any to the type checker
    """Planes ``(N, Z, C, Y, X)`` that a model's linear filters make of frames ``(N, C, Y, X)``, as ``Plan(refine=0)``.

    Plain PyTorch: any device, with gradients. The filters are a parameter, ``(Z, C, rows, columns // 2 + 1, 2)``, so
    they can be learned on; :meth:`hadalens.Model.from_filters` takes them back. Frames are above their dark level.

    Args:
        model: a :class:`hadalens.Model` or its file.
        clip: values below zero become zero, as the library's do.

    Example:
        >>> linear = hadalens.torch.Linear("camera.model")
        >>> loss = (linear(frames) - planes).square().mean()
        >>> learned = torch.view_as_complex(linear.filters.detach()).numpy()

    """

    def __init__(self, model: Model | PathLike, *, clip: bool = True) -> None:
        """Take the filters and the sizes."""
        super().__init__()
        model = as_model(model)
        info = model.info
        self.frame_shape = (info.channels, info.raw_rows, info.raw_cols)
        self.window = (info.window_rows, info.window_cols)
        self.grid = (info.grid_rows, info.grid_cols)
        self.split, self.clip = info.form == "split", clip
        self.filters = nn.Parameter(torch.view_as_real(torch.from_numpy(model.filters.copy())))

    def forward(self, frames: Tensor) -> Tensor:
        """Return the planes."""
        if frames.ndim != 4 or tuple(frames.shape[1:]) != self.frame_shape:
            raise ValueError(f"frames of {tuple(frames.shape)}: (N, *{self.frame_shape}) is needed")
        high, wide = self.window
        spectrum = torch.fft.rfft2(frames, s=self.grid)[:, None]
        if self.split:
            light = torch.view_as_complex(self.filters * torch.view_as_real(spectrum))
        else:
            light = torch.view_as_complex(self.filters) * spectrum
        top, left = (self.frame_shape[1] - high) // 2, (self.frame_shape[2] - wide) // 2
        planes = torch.fft.irfft2(light, s=self.grid)[..., top : top + high, left : left + wide]
        return planes.relu() if self.clip else planes


class Refine(_Camera):
    """Planes ``(N, Z, C, Y, X)`` that together explain frames ``(N, C, Y, X)``: the library's refinement, unrolled.

    Plain PyTorch: any device, gradients for frames and parameters, no OpenCL. It gives what

        ``Plan(model, refine=steps, refine_tv=tv, occupied=depths, dark=0.0, skip=())``

    gives, within 1e-5 (relative L2) in single precision: so many steps of ADMM with total variation, the last three
    of them (or half of few) with the learned regulariser, and the crosstalk of several depths. What a plan decides by
    looking at a frame is not in it: which depths are occupied, when to stop, a weight found from the frame or scaled by
    its noise, surfaces, values that are saturated or weighed, mosaics, nets; nor is the prior of a Wiener filter, which
    plans of a fitted model have with ``tv=0``. Frames are above their dark level.

    The parameters are natural logarithms of factors, which begin at 0: ``tv`` of each step's weight of total
    variation, ``rho`` of each step's penalty, ``noise`` of what each of the last steps takes for noise. Gradients are
    those of the steps as they are computed; second derivatives miss a part where total variation couples colours.

    Args:
        model: a :class:`hadalens.Model` with transfer functions, or its file.
        steps: None: the model's.
        depths: which of the model's depths are refined, near to far; None: all. The planes are these.
        tv: weight of total variation, 0 for none; None: the model's. A model of a point spread function alone has none:
            ``Plan(model).run(frame).report.refine_tv`` is the one that a frame chooses.
        colour: weight of colour differences; None: the model's.
        ridge: strength of the learned regulariser, 0 for none; None: the model's.
        crosstalk: as of :class:`hadalens.Plan`.
        checkpoint: steps are computed again for gradients, which takes the memory of one step instead of all.

    Raises:
        ValueError: the model has no such weight or no such depths.

    Example:
        >>> refine = hadalens.torch.Refine("camera.model")
        >>> loss = (refine(frames) - planes).square().mean()      # learns two numbers a step, as unrolled ADMM does

    """

    def __init__(
        self,
        model: Model | PathLike,
        *,
        steps: int | None = None,
        depths: Sequence[int] | None = None,
        tv: float | None = None,
        colour: float | None = None,
        ridge: float | None = None,
        crosstalk: float = _refinement.CROSSTALK,
        checkpoint: bool = False,
    ) -> None:
        """Take what the model says, and plan the steps."""
        model = as_model(model)
        info = model.info
        every = list(range(info.depths))
        chosen = every if depths is None else list(depths)
        if not chosen or sorted({*chosen} & {*every}) != chosen:
            raise ValueError(f"depths={depths}: a list of depths from 0 to {every[-1]}, near to far, is needed")
        super().__init__(model, chosen)
        self.depths = chosen
        steps = info.refine_steps if steps is None else steps
        tv = info.refine_tv if tv is None else tv
        ridge = info.refine_ridge if ridge is None else ridge
        if steps < 1:
            raise ValueError(f"steps={steps}: one at least is needed; where the model's are 0 refinement does not pay")
        if tv < 0:
            raise ValueError(
                "the model has no weight of total variation: tv is needed (hadalens.torch.Refine says how)"
            )
        self.gain = float((abs(self.operator.otf[..., 0, 0]) ** 2).max()) or 1.0
        self.weight, self.crosstalk, self.checkpoint = tv, crosstalk, checkpoint
        self.colour = info.refine_colour if colour is None else colour
        self.cropped = info.boundary == "padded"
        self.schedule = _refinement.schedule(info, self.gain, tv, ridge, len(self.depths), steps)
        self.tv = nn.Parameter(torch.zeros(len(self.schedule.rho) if tv > 0 else 0))
        self.rho = nn.Parameter(torch.zeros(steps))
        self.noise = nn.Parameter(torch.zeros(len(self.schedule.ridge_rho)))

    def forward(self, frames: Tensor) -> Tensor:
        """Return the planes."""
        operator = self._check(frames)
        square = frames.square().mean((1, 2, 3)).clamp(min=_refinement.FAINT)[:, None, None, None, None]
        light = (self.gain * frames.shape[1] * square).sqrt()
        rows, cols = operator.grid
        data = F.pad(frames, (0, cols - frames.shape[-1], 0, rows - frames.shape[-2]))
        u = frames.new_zeros(len(frames), len(self.depths), *operator.planes_shape[1:])
        state = (u, None, torch.stack([u, u]), data if self.cropped else None, torch.zeros_like(data))
        before = None
        for step, usual in enumerate(self.schedule.rho + self.schedule.ridge_rho):
            rho = usual * self.rho[step].exp()
            last = step - len(self.schedule.rho)
            level = light * self.weight * self.tv[step].exp() / rho if self.weight and last < 0 else None
            if last >= 0:
                level = self.schedule.noise * square.sqrt() * self.noise[last].exp()
            keep = None if last >= 0 or before is None else before / rho
            relaxation = self.schedule.relaxation[step] if last < 0 else 1.0
            arguments = (data, state, rho, keep, relaxation, level, last >= 0)
            if self.checkpoint and torch.is_grad_enabled():
                state = checkpoint(self._step, *arguments, use_reentrant=False)
            else:
                state = self._step(*arguments)
            before = rho
        planes: Tensor = state[0]
        return _refinement.fade(planes, self.crosstalk) if self.crosstalk > 0 and len(self.depths) > 1 else planes

    def _step(
        self,
        data: Tensor,
        state: tuple[Any, ...],
        rho: Tensor,
        keep: Tensor | None,
        relaxation: float,
        level: Tensor | None,
        ridge: bool,
    ) -> tuple[Any, ...]:
        """Go on from planes u, the spectra of w, the duals, and of a crop v and its dual e."""
        u, w, duals, v, e = state
        otf = torch.view_as_complex(self.otf)
        (top, left), (rows, cols) = self.operator.origin, self.operator.grid
        high, wide = u.shape[-2:]
        spectra = torch.fft.rfft2(F.pad(u, (left, cols - left - wide, top, rows - top - high)))
        dual = torch.zeros_like(spectra) if keep is None or w is None else keep * (w - spectra)
        given = torch.fft.rfft2(data if v is None else v - e)
        there = spectra - dual
        power = (otf.real.square() + otf.imag.square()).sum(0)
        mu = self.schedule.mu
        error = (given - (otf * there).sum(1)) / (rho / mu + power)
        x = there + otf.conj() * error[:, None]
        if v is not None:
            seen = torch.fft.irfft2((otf * x).sum(1), s=(rows, cols))
            a = relaxation * seen + (1 - relaxation) * v + e
            tall, broad = self.operator.frame_shape[1:]
            e = F.pad((a - data)[..., :tall, :broad] / (1 + mu), (0, cols - broad, 0, rows - tall))
            v = a - e
        w = relaxation * x + (1 - relaxation) * spectra + dual
        image = torch.fft.irfft2(w, s=(rows, cols))[..., top : top + high, left : left + wide]
        if ridge:
            assert level is not None
            return _refinement.ridge(image, level), w, duals, v, e
        if level is None:
            return image.relu(), w, duals, v, e
        u, duals = _refinement.total_variation(image, duals, level, self.colour)
        return u, w, duals, v, e
