"""Training of filters and nets from pairs as the command does it: held-out pairs, checkpoints, a log."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Unpack

from ._fit import monitored
from ._native import (
    Monitor,
    Options,
    Progress,
    ffi,
    keep_error,
    lib,
    record,
)
from ._pairs import Dataset, Pairs, as_dataset
from ._trainer import Augment, Stage, TrainOptions, Validation, train_options
from .device import Device, contexts
from .model import Model, as_model
from .net import Net


@dataclass(frozen=True)
class TrainState:
    """How far :func:`train` is, for its callback.

    Attributes:
        event: "begins", "timed", "validated" or "ends".
        step, steps: done, and of all.
        loss: of the last good step.
        validation: at "validated", what was found.
        better: it is the best so far.
        best_psnr, best_step: the best so far.

    """

    event: str
    step: int
    steps: int
    seconds: float
    seconds_per_step: float
    loss: float
    better: bool
    best_psnr: float
    best_step: int
    validation: Validation | None


class _TrainMonitor(Monitor):
    def __init__(self, progress: Progress | bool | None, tell: Callable[[TrainState], None] | None) -> None:
        super().__init__(progress)
        self.tell = tell


@ffi.def_extern(onerror=keep_error)  # type: ignore[untyped-decorator]
def py_train_task_tell(user: Any, state: Any) -> None:
    """Tell how far a training is."""
    monitor = ffi.from_handle(user)
    if monitor.tell is not None:
        last = None
        if state.event == lib.HADA_TRAIN_VALIDATED and state.row_count:
            last = record(Validation, state.rows[state.row_count - 1].result[0])
        monitor.tell(record(TrainState, state[0], validation=last))


def train(
    pairs: Dataset | Pairs | str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    model: Model | str | os.PathLike[str] | None = None,
    stage: Stage = "enhance",
    context: Device | Sequence[Device] | None = None,
    net: Net | Literal["compact", "paper"] | None = None,
    augment: Augment | None = None,
    epochs: int | None = None,
    hold_out: float | None = None,
    log: str | os.PathLike[str] | None = None,
    resume: bool = False,
    restart: bool = False,
    validate_every: int | None = None,
    show_every: int | None = None,
    save_every: int | None = None,
    validate_pairs: int | None = None,
    patience: int | None = None,
    keep: Literal["auto", "best", "last"] = "auto",
    tell: Callable[[TrainState], None] | None = None,
    channel_axis: int | None = None,
    full_scale: float | None = None,
    progress: Progress | bool | None = None,
    **options: Unpack[TrainOptions],
) -> Path:
    """Train as ``hadalens train`` does: pairs held out, validations, checkpoints, a log, the best parameters kept.

    Args:
        pairs: a folder, a :class:`Dataset`, or pairs.
        output: the file to write, of the model ("conventional": of the net).
        model: what training begins with, or its file; None: the exact fit of the pairs, made first.
        stage, context, net, augment, options: as of a :class:`Trainer`.
        epochs: how often every pair is seen, in place of the option steps.
        hold_out: pairs of each depth to validate with, a number or a share; None: an eighth.
        log: folder of the log and the checkpoint; None: OUTPUT.log.
        resume: go on from the checkpoint there.
        restart: begin anew where there is one.
        validate_every, show_every, save_every: steps between validations, pictures and checkpoints; None: chosen.
        validate_pairs: looked at, at most; 0: all.
        patience: ends after so many validations without a better one; 0: never.
        keep: which parameters are written.
        tell: called with a :class:`TrainState`.
        channel_axis: of arrays of three axes; None: the first.
        full_scale: of raw frames, as of :func:`fit`.
        progress: a function (what, done, total, note), or True for tqdm's bars.

    Returns:
        The file.

    Raises:
        KeyboardInterrupt: Ctrl-C; the checkpoint is written first.

    Example:
        >>> file = hadalens.train("camera", "better.model", model=model, steps=2000, progress=True)
        >>> better = hadalens.Model.load(file)

    """
    data = as_dataset(pairs, channel_axis, full_scale=full_scale)
    used = contexts(context)
    given = None if model is None else as_model(model)
    monitor = _TrainMonitor(progress, tell)
    task = Options(
        "hada_train_task",
        options=train_options(stage, augment, net, options),
        epochs=epochs,
        model=None if given is None else given._c,
        hold_out=hold_out,
        output=output,
        log=log,
        resume=resume,
        restart=restart,
        validate_every=validate_every,
        show_every=show_every,
        save_every=save_every,
        validate_pairs=validate_pairs,
        patience=patience,
        keep=keep,
        tell=lib.py_train_task_tell,
        user=monitor.user,
        monitor=monitor.options,
    )
    array = ffi.new("hada_context *[]", [one._c for one in used])
    monitored(monitor, data, lib.hada_train_run, array, len(used), data._c, task.c)
    return Path(output)
