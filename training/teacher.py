"""A trained model whose results are part of the target of another one's training.

What it makes of a noisy tile has neither the noise of a reference of few samples nor a preference
for one of the eight ways a tile can be turned: it is shown each tile turned at random, and a model
that follows it learns the mean over all of them. A tile that it makes worse than it was, one that
was nearly clean, keeps its own target.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training.errors import USAGE, ToolError
from training.loss import distance
from training.result import Result, load_model, read_network
from training.settings import Settings, input_channels, output_channels

VIEWS = 8  # quarter turns, each mirrored or not


def turned(x: Tensor, view: int) -> Tensor:
    """[N,C,H,W], square, in one of VIEWS ways."""
    x = torch.rot90(x, view % 4, (2, 3))
    return x.flip(3) if view >= 4 else x


def turned_back(x: Tensor, view: int) -> Tensor:
    """The inverse of `turned`."""
    return torch.rot90(x.flip(3) if view >= 4 else x, -(view % 4), (2, 3))


class Teacher:
    """The model of --teacher, a result or a .tza or .pt file; it is run and never changes."""

    def __init__(self, settings: Settings, device: torch.device):
        name, self.share, self.seed = settings.teacher, settings.teacher_share, settings.seed
        model = load_teacher(name, settings)
        inputs = model.inputs if settings.family == "K" else input_channels(settings.features)
        outputs = output_channels(settings.main_feature)
        if (model.net.family, model.inputs, model.outputs) != (settings.family, inputs, outputs):
            raise ToolError(f"--teacher {name}: its inputs or outputs are others than the model's",
                            USAGE)
        if model.net.family == "K":
            model.transfer = settings.transfer
        self.model = model.eval().requires_grad_(False).to(
            device, memory_format=torch.channels_last)

    def target(self, x: Tensor, y: Tensor, step: int) -> Tensor:
        """The target of a step: targets y [N,3,H,W] moved to the teacher's results for inputs x."""
        view = int(np.random.default_rng((self.seed, step)).integers(VIEWS))
        with torch.no_grad():
            taught = turned_back(self.model(turned(x, view)), view).to(y.dtype)
            helps = distance(taught, y) < distance(x[:, :y.shape[1]], y)
        return torch.lerp(y, taught, self.share * helps.to(y.dtype))


def load_teacher(name: str, settings: Settings) -> torch.nn.Module:
    path = Path(name)
    if path.suffix not in (".tza", ".pt"):
        model, trained, _ = load_model(Result(settings.results_dir, name))
        if trained.transfer != settings.transfer and model.net.family == "U":
            raise ToolError(f"--teacher {name}: trained with --transfer {trained.transfer}", USAGE)
        return model
    try:
        return read_network(path)
    except ToolError as e:
        raise ToolError(f"--teacher {e}", e.code) from e
