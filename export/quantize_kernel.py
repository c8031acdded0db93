"""Quantises a K model: `python -m export.quantize_kernel IN.tza OUT.tza --calib IMAGE.exr ...`"""
from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from export import kernel, pixels
from export.quantizer import Options, Quantizer
from export.reference import NARROW_MAX
from export.tza import Reader, write_weights


class KernelQuantizer(Quantizer):
    """The trunk's quantiser: input and heads have fixed steps, everything is narrow."""

    def __init__(self, model: kernel.FloatTrunk, inputs: Sequence[np.ndarray], options: Options):
        super().__init__(model, inputs, options)
        self.wide = set()

    def _steps(self, name: str, channels: int) -> np.ndarray:
        if name == "input":
            return np.full(channels, 1 / NARROW_MAX)
        if name in self.net.heads:
            return np.full(channels, kernel.HEAD_STEP)
        return super()._steps(name, channels)

    def _fit_output(self, layer, unit) -> None:
        if layer.name not in self.net.heads:
            super()._fit_output(layer, unit)

    def run(self) -> kernel.IntTrunk:
        names = [("input", kernel.INPUTS)] + [
            (x.name, len(self.source.tensors[f"{x.name}.bias"])) for x in self.net.layers]
        self.steps = {name: self._steps(name, o) for name, o in names}
        self.model = kernel.IntTrunk(self.net, [])
        self.codes = [{"input": self.model.codes(x)} for x in self.inputs]
        for layer in self.net.layers:
            made = self._layer(layer)
            self.model.layers.append(made)
            for maps in self.codes:
                maps[layer.name] = made.run(maps)
        return self.model


def tensors_of(model: kernel.IntTrunk) -> dict[str, np.ndarray]:
    """The tensors of a K model's file."""
    out = {}
    for x in model.layers:
        name = x.layer.name
        is_head = name in model.net.heads
        out[f"{name}.weight"] = x.weight[:, :, 1:2, 1:2] if is_head else x.weight
        if x.skip is not None:
            out[f"{name}.skip.weight"] = x.skip
        out[f"{name}.bias"], out[f"{name}.scale"] = x.bias, x.scale
    return out


def calibration_input(images: dict[str, np.ndarray], content: str = "hdr") -> np.ndarray:
    """Padded network input (codes / 255) [H,W,12] of a frame's images by feature."""
    frame = pixels.Frame(images, content)
    color = pixels.sanitize(images["color"], frame.input_scale(), 0.0, pixels.MAX)
    albedo, normal = images.get("albedo"), images.get("normal")
    if albedo is not None:
        albedo = pixels.sanitize(albedo, 1.0, 0.0, 1.0)
    if normal is not None:
        normal = pixels.sanitize(normal, 1.0, -1.0, 1.0)
    codes = kernel.encode(color, albedo, normal, not frame.rule().is_hdr)
    h, w, _ = codes.shape
    codes = np.pad(codes, ((0, -h % kernel.ALIGN), (0, -w % kernel.ALIGN), (0, 0)), mode="edge")
    return codes.astype(np.float32) / np.float32(255)
