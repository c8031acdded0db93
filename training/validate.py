"""Validation during training: the training loss, and PSNR, SSIM and FLIP by samples per pixel.

FLIP needs the package flip-evaluator and is left out without it.
"""
from __future__ import annotations

import functools
import importlib.util
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from training import color, kernel_model, metrics
from training.console import Bar
from training.data import Picture
from training.errors import ToolError
from training.interrupt import Interrupted
from training.scan import CHANNELS
from training.settings import Settings

EXAMPLES = 4  # pictures in TensorBoard


@dataclass
class Scores:
    """Means over all tiles: loss, metrics of the output and of the noisy input, and by spp."""

    loss: float = math.nan
    metrics: dict[str, float] = field(default_factory=dict)
    noisy: dict[str, float] = field(default_factory=dict)
    by_spp: dict[int, dict[str, float]] = field(default_factory=dict)
    examples: list[np.ndarray] = field(default_factory=list)  # [H,3W,3]: noisy, output, target


def tiles(height: int, width: int, tile: int) -> list[tuple[int, int, int]]:
    """(y, x, side) of a centred grid of full tiles; smaller ones in pictures that hold none."""
    t = min(tile, height // 16 * 16, width // 16 * 16)
    if t == 0:
        return []
    ny, nx = height // t, width // t
    oy, ox = (height - ny * t) // 2, (width - nx * t) // 2
    return [(oy + i * t, ox + j * t, t) for i in range(ny) for j in range(nx)]


def require_tiles(valid: list[Picture], tile: int) -> None:
    """ToolError if there are pictures, and none is large enough to validate on."""
    if valid and not any(tiles(*p.target.shape[:2], tile) for p in valid):
        raise ToolError("the validation pictures are smaller than 16x16 pixels")


@contextmanager
def averaged(model: torch.nn.Module, ema: list[Tensor]):
    """The model with its averaged weights for a while."""
    params = list(model.parameters())
    kept = [p.detach().clone() for p in params] if ema else []
    with torch.no_grad():
        for p, e in zip(params, ema):
            p.copy_(e)
        try:
            yield
        finally:
            for p, k in zip(params, kept):
                p.copy_(k)


def validate(model: torch.nn.Module, ema: list[Tensor], valid: list[Picture], settings: Settings,
             loss_of: Callable, team, bar: Bar, check: Callable) -> Scores:
    """Rank 0 does the work; all ranks get its loss. `check` is called before each tile; what it
    raises, Interrupted, all ranks raise."""
    scores, stopped = Scores(), False
    if team.rank == 0:
        try:
            with averaged(model, ema), torch.no_grad():
                scores = score(model, valid, settings, loss_of, team.device, bar, check)
        except Interrupted:
            stopped = True
    if team.same(stopped):
        raise Interrupted
    if team.rank == 0:
        m, n = scores.metrics, scores.noisy
        bar.title = "Valid"
        bar.end(f"valid_loss={scores.loss:.6f}, psnr={m['psnr']:.2f} (noisy {n['psnr']:.2f}), "
                f"ssim={m['ssim']:.4f} ({n['ssim']:.4f})"
                + (f", flip={m['flip']:.4f} ({n['flip']:.4f})" if "flip" in m else ""))
    scores.loss = team.same(scores.loss)
    return scores


def score(model, valid: list[Picture], settings: Settings, loss_of: Callable, device,
          bar: Bar, check: Callable) -> Scores:
    transfer = color.TRANSFERS[settings.transfer]
    m = CHANNELS[settings.main_feature]
    names = metric_names()
    losses, rows, noisy, by_spp, examples = [], [], [], defaultdict(list), []
    for done, picture in enumerate(valid):
        bar.show("Valid", done / len(valid))
        grid = tiles(*picture.target.shape[:2], settings.tile_size)
        for codes, spp in zip(picture.inputs, picture.weights):
            for y, x, t in grid:
                check()
                cut = np.s_[y:y + t, x:x + t]
                target = picture.target[cut].astype(np.float32)
                source = codes[cut].astype(np.float32)
                if settings.clean_aux:
                    source = np.concatenate([source[..., :m], target[..., m:]], -1)
                for part in range(0, m, 3):  # sh1 is three runs
                    take = slice(part, min(part + 3, m))
                    a = np.concatenate([source[..., take], source[..., m:]], -1)
                    if settings.get("family") == "K":
                        a = kernel_model.planes(a, settings.features)
                    out = model(_chw(a).to(device, memory_format=torch.channels_last)).float()
                    want = _chw(target[..., take]).to(device)
                    losses.append(float(loss_of(out, want)))
                    shown = [_shown(v, transfer, settings.main_feature) for v in
                             (_hwc(out), target[..., take], source[..., take])]
                    rows.append(values(shown[0], shown[1], names))
                    noisy.append(values(shown[2], shown[1], names))
                    by_spp[int(spp)].append(rows[-1])
                    if part == 0 and (y, x) == grid[0][:2] and len(examples) < EXAMPLES:
                        examples.append(np.concatenate([shown[2], shown[0], shown[1]], 1))

    def mean(of: list) -> dict[str, float]:
        return dict(zip(names, np.mean(of, 0)))

    return Scores(float(np.mean(losses)), mean(rows), mean(noisy),
                  {k: mean(v) for k, v in sorted(by_spp.items())}, examples)


@functools.cache
def metric_names() -> tuple[str, ...]:
    """What is measured; says once if FLIP cannot be."""
    if importlib.util.find_spec("flip_evaluator"):
        return "psnr", "ssim", "flip"
    print("FLIP is left out: the package flip-evaluator is not installed")
    return "psnr", "ssim"


def values(image: np.ndarray, target: np.ndarray, names: tuple[str, ...]) -> list[float]:
    """Metrics by name."""
    return [*metrics.limited(metrics.measure(image, target, list(names))).values()]


def _chw(image: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]


def _hwc(x: Tensor) -> np.ndarray:
    return x[0].detach().cpu().numpy().transpose(1, 2, 0)


def _shown(codes: np.ndarray, transfer: color.Transfer, feature: str) -> np.ndarray:
    image = transfer.inverse(np.maximum(codes, 0.0))
    if feature in ("nrm", "sh1"):
        image = image * 2 - 1
    return metrics.to_display(image, feature)


class Board:
    """TensorBoard, if the package is there: scalars by epoch, and example pictures. Where its log
    cannot be written, on a full disk, it ends there, and the training does not."""

    def __init__(self, folder: Path, settings: Settings, enabled: bool = True):
        self.writer, self.folder, self.enabled = None, folder, enabled

    def _open(self) -> None:
        if not self.enabled or self.writer is not None:
            return
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            print("TensorBoard is not installed: no log is written")
            self.enabled = False
            return
        self.writer = SummaryWriter(str(self.folder))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as e:
            self.writer, self.enabled = None, False
            print(f"Warning: {self.folder}: cannot write ({e.strerror or e}); the log ends here",
                  file=sys.stderr)

    def scalars(self, epoch: int, **values: float) -> None:
        with self._writing():
            self._open()
            for name, value in values.items():
                if self.writer:
                    self.writer.add_scalar(name, value, epoch)

    def validation(self, epoch: int, scores: Scores) -> None:
        if not self.enabled:
            return
        self.scalars(epoch, valid_loss=scores.loss,
                     **{f"valid_{k}": v for k, v in scores.metrics.items()})
        for spp, values in scores.by_spp.items():
            self.scalars(epoch, **{f"valid_{k}/{spp}spp": v for k, v in values.items()})
        with self._writing():
            for i, image in enumerate(scores.examples if self.writer else ()):
                image = np.repeat(image, 3, -1) if image.shape[-1] == 1 else image
                self.writer.add_image(f"noisy output target/{i}", image, epoch, dataformats="HWC")

    def close(self) -> None:
        with self._writing():
            if self.writer:
                self.writer.close()
