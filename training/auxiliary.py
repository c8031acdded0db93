"""Prefilters: results that denoise one auxiliary feature before the main network sees it."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from training import color, nets
from training.errors import STATE, ToolError
from training.result import Result, load_model
from training.scan import CHANNELS
from training.settings import Settings


@dataclass
class Prefilter:
    """A network for one feature of the encoded input."""

    name: str
    feature: str
    model: torch.nn.Module
    transfer: color.Transfer

    def apply(self, image: np.ndarray, features: list[str]) -> np.ndarray:
        """[H,W,C] encoded features -> the same with this feature denoised."""
        if self.feature not in features:
            return image
        at = sum(CHANNELS[f] for f in features[:features.index(self.feature)])
        part = image[..., at:at + CHANNELS[self.feature]].astype(np.float32)
        # aux codes are linear; the feature's own network sees them through its transfer function
        codes = self.transfer.forward(part)
        result = self.transfer.inverse(np.maximum(run_network(self.model, codes), 0.0))
        out = image.copy()
        out[..., at:at + part.shape[-1]] = np.clip(result, 0.0, 1.0)
        return out


def load_prefilters(settings: Settings, device: str | torch.device = "cpu") -> list[Prefilter]:
    """The prefilters that --aux_results names, on a device."""
    prefilters = []
    for name in settings.aux_results:
        model, trained, _ = load_model(Result(settings.results_dir, name))
        features = trained.features
        if len(features) != 1 or features[0] not in settings.aux_features:
            raise ToolError(f"result {name} does not correspond to an auxiliary feature", STATE)
        # depth as a feature is in log codes already; the others are linear
        transfer = "linear" if features[0] == "z" else trained.transfer
        prefilters.append(Prefilter(name, features[0], model.to(device),
                                    color.TRANSFERS[transfer]))
    return prefilters


def prefiltered(image: np.ndarray, features: list[str],
                prefilters: list[Prefilter]) -> np.ndarray:
    """[H,W,C] encoded features after all prefilters."""
    for p in prefilters:
        image = p.apply(image, features)
    return image


def run_network(model: torch.nn.Module, codes: np.ndarray) -> np.ndarray:
    """[H,W,C] network codes -> [H,W,Cout], padded on the way as the model needs it."""
    h, w = codes.shape[:2]
    device = next(model.parameters()).device
    x = torch.from_numpy(np.ascontiguousarray(codes.transpose(2, 0, 1), np.float32))[None]
    with torch.no_grad():
        y = model(nets.pad_to(x.to(device), getattr(model, "align", nets.ALIGN)))[0, :, :h, :w]
    return y.float().cpu().numpy().transpose(1, 2, 0)
