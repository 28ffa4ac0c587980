"""Training of filters and nets from pairs by gradients, step by step."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias, TypedDict, Unpack

from ._arrays import Float32, NewImage, copy_of
from ._native import (
    Handle,
    Options,
    Owner,
    call,
    check_names,
    ffi,
    lib,
    path,
    record,
    value_of,
    word,
)
from ._pairs import Dataset, Pairs, as_dataset
from .device import Device, contexts, default
from .model import Model, as_model
from .net import Net

Stage: TypeAlias = Literal["filters", "enhance", "adversarial", "conventional"]


@dataclass(frozen=True)
class Step:
    """What a step did; terms are weighted means over its pairs, NaN where a term is off."""

    step: int
    loss: float
    mse: float
    perceptual: float
    adversarial: float
    variation: float
    discriminator: float
    norm: float
    rate: float
    discriminator_only: bool
    rolled_back: bool
    seconds: float


@dataclass(frozen=True)
class Validation:
    """Means over held-out pairs (PSNR in dB, peak 1), of what the parameters give and of what they start from."""

    pairs: int
    psnr: float
    ssim: float
    mae: float
    sharpness: float
    psnr_before: float
    ssim_before: float
    mae_before: float
    sharpness_before: float
    sharpness_truth: float


@dataclass(frozen=True)
class Augment:
    """Changes of a pair, drawn anew each time it is seen.

    Attributes:
        shift: frame and scene move together by up to so many pixels (circular boundary only).
        flips: 1: left and right, 2: top and bottom, 3: both; for optics that are symmetric in this way only.
        noise: standard deviation added to the frame, as a share of its maximum.
        exposure: both are scaled by a factor from 1 - exposure to 1 + exposure.
        plane_flips: reconstructed plane and scene are flipped together; None: the stage's own.

    """

    shift: int = 0
    flips: int = 0
    noise: float = 0.0
    exposure: float = 0.0
    plane_flips: int | None = None


class TrainOptions(TypedDict, total=False):
    """Members of hada_train_options (hadalens/train.h), by their names."""

    seed: int
    form: Literal["complex", "split"]
    random_start: bool
    new_net: bool
    discriminator: Literal["patch", "paper"]
    net_rows: int
    net_cols: int
    steps: int
    batch: int
    at_once: int
    recompute: bool
    rule: Literal["adam", "rmsprop"]
    rate: float
    filter_rate: float
    discriminator_rate: float
    schedule: Literal["constant", "cosine"]
    last_rate: float
    warmup: int
    clip: float
    discriminator_steps: int
    mse: float
    perceptual: float
    adversarial: float
    variation: float
    variation_squared: bool
    vgg: str | os.PathLike[str]
    compose: float


def train_options(stage: Stage, augment: Augment | None, net: Net | str | None, given: TrainOptions) -> Options:
    """Return hada_train_options."""
    check_names(given, TrainOptions.__annotations__, "training")
    options = Options("hada_train_options", value_of("hada_stage", stage, "stage"))
    options.set(**given)
    if augment is not None:
        options.set(augment=Options("hada_augment", **vars(augment)))
    if isinstance(net, Net):
        options.kept.append(net)
        options.set(net_given=net._c, new_net=True)
    elif net is not None:
        options.set(net=net, new_net=True)
    return options


class Trainer(Handle):
    """Trains step by step; the same pairs, options and device give the same bits, also after going on from a file.

    Args:
        model: filters, sizes and (where it has one) the net that training begins with; or its file.
        pairs: a folder, a :class:`Dataset`, or pairs, to learn from.
        stage: "filters" (the filters alone, the paper's method), "enhance" (a net behind the filters), "adversarial"
            (the same against a discriminator), "conventional" (a net without filters).
        held_out: pairs to validate with; None: none.
        context: a device, or several that share the pairs of a step; None: :meth:`Context.default`.
        net: a preset ("compact", "paper") or a :class:`Net` to begin with, in place of the model's.
        augment: changes of the pairs.
        channel_axis, full_scale: as of :func:`fit`.
        options: steps, batch, rate, seed and the other members of hada_train_options (hadalens/train.h) by their
            names; words for its enumerations.

    Example:
        >>> trainer = hadalens.Trainer(model, "camera", steps=2000, batch=4)
        >>> for step in trainer:
        ...     if step.step % 100 == 0:
        ...         print(step.step, step.loss, trainer.validate().psnr)
        >>> trainer.model().save("better.model")

    """

    def __init__(
        self,
        model: Model | str | os.PathLike[str],
        pairs: Dataset | Pairs | str | os.PathLike[str],
        *,
        stage: Stage = "enhance",
        held_out: Dataset | Pairs | str | os.PathLike[str] | None = None,
        context: Device | Sequence[Device] | None = None,
        net: Net | Literal["compact", "paper"] | None = None,
        augment: Augment | None = None,
        channel_axis: int | None = None,
        full_scale: float | None = None,
        **options: Unpack[TrainOptions],
    ) -> None:
        """Make the trainer, at step 0."""
        chosen = train_options(stage, augment, net, options)
        model, used = as_model(model), contexts(context)
        given = [data for data in (pairs, held_out) if data is not None]
        self._data = [as_dataset(data, channel_axis, full_scale=full_scale) for data in given]
        kept = ([one._own for one in used], model._own, [data._own for data in self._data])
        owner = Owner("hada_trainer", lib.hada_trainer_destroy, *kept)
        array = ffi.new("hada_context *[]", [one._c for one in used])
        self._owner = owner
        self._run(
            lib.hada_trainer_create,
            owner.pointer,
            array,
            len(used),
            model._c,
            self._data[0]._c,
            self._data[1]._c if held_out is not None else ffi.NULL,
            chosen.c,
        )
        self.steps = int(self._info.options.steps)

    def _run(self, function: Callable[..., int], *arguments: Any) -> None:
        """Call C; what reading pairs raised comes first."""
        try:
            call(function, *arguments)
        except Exception as failed:
            for data in self._data:
                if data._reader is not None and data._reader.error is not None:
                    raise data._reader.error from failed
            raise

    @property
    def _info(self) -> Any:
        info = ffi.new("hada_trainer_info *", {"size": ffi.sizeof("hada_trainer_info")})
        call(lib.hada_trainer_get_info, self._c, info)
        return info

    @staticmethod
    def bytes(
        model: Model | str | os.PathLike[str],
        *,
        stage: Stage = "enhance",
        context: Device | None = None,
        net: Net | Literal["compact", "paper"] | None = None,
        **options: Unpack[TrainOptions],
    ) -> int:
        """Return the device memory that training would take."""
        out, chosen, model = ffi.new("uint64_t *"), train_options(stage, None, net, options), as_model(model)
        call(lib.hada_trainer_bytes, default(context)._c, model._c, chosen.c, out)
        return int(out[0])

    def step(self) -> Step:
        """Do one step.

        Raises:
            NumericError: ten steps were rolled back without a good one between.

        """
        report = ffi.new("hada_step_report *", {"size": ffi.sizeof("hada_step_report")})
        self._run(lib.hada_trainer_step, self._c, report)
        return record(Step, report[0])

    def __iter__(self) -> Iterator[Step]:
        """Do the steps that are left, one at a time."""
        while self.done < self.steps:
            yield self.step()

    def __len__(self) -> int:
        """Return the number of all steps."""
        return self.steps

    @property
    def done(self) -> int:
        """Steps done."""
        return int(self._info.steps)

    def _shown(self) -> str:
        return f"step {self.done} of {self.steps}"

    @property
    def seen(self) -> int:
        """Pairs seen on the way."""
        return int(self._info.seen)

    @property
    def options(self) -> dict[str, int | float | str]:
        """Options as the trainer understood them: numbers, and words of enumerations."""
        struct = self._info.options[0]
        found: dict[str, int | float | str] = {}
        for name, field in ffi.typeof(struct).fields:
            if field.type.kind == "enum":
                found[name] = word(field.type.cname.removeprefix("enum "), int(getattr(struct, name)))
            elif field.type.kind == "primitive" and name != "size":
                found[name] = getattr(struct, name)
        return found

    def validate(self, most: int = 0) -> Validation:
        """Look at held-out pairs, `most` of them, evenly chosen (0: all)."""
        out = ffi.new("hada_validation *", {"size": ffi.sizeof("hada_validation")})
        self._run(lib.hada_trainer_validate, self._c, most, out)
        return record(Validation, out[0])

    def show(self, pair: int) -> tuple[Float32, Float32, Float32, Float32]:
        """Return raw frame, plane before the net, output and truth of a held-out pair, each (C, Y, X)."""
        images = NewImage(4)
        self._run(lib.hada_trainer_show, self._c, pair, *(images.c + i for i in range(4)))
        raw, before, after, truth = (copy_of(images.c[i]) for i in range(4))
        return raw, before, after, truth

    def model(self) -> Model:
        """Return the parameters as they are now, as a model ("conventional" has none, but a net)."""
        owner = Owner("hada_model", lib.hada_model_destroy)
        call(lib.hada_trainer_model, self._c, owner.pointer)
        return Model._of(owner)

    def net(self) -> Net:
        """Return the net as it is now."""
        owner = Owner("hada_net", lib.hada_net_destroy)
        call(lib.hada_trainer_net, self._c, owner.pointer)
        return Net._of(owner)

    def first_net(self) -> Net | None:
        """Return the net that is trained, with its first values; None where none is."""
        net = self._info.net
        return None if net == ffi.NULL else Net._copy(net)

    def save(self, name: str | os.PathLike[str]) -> Path:
        """Write a checkpoint: everything that going on with the same bits needs. Returns its path."""
        call(lib.hada_trainer_save, self._c, path(name))
        return Path(name)

    def load(self, name: str | os.PathLike[str]) -> Self:
        """Go on from a checkpoint of a trainer like this one.

        Raises:
            ModelError: model, stage, nets, rule, seed or batch differ; the message says which.

        """
        call(lib.hada_trainer_load, self._c, path(name))
        return self
