"""Family K as the integers that it will be: quantised as export.quantize_kernel does it, trainable.

`IntegerKernel` computes the trunk with every rounding of docs/arithmetic.md (gradients pass them)
and the filter in floating point, between the same codes as KernelModel.
"""
from __future__ import annotations

from torch import Tensor, nn

from export.kernel import IntTrunk, check_trunk
from training import kernel_model
from training.kernel_filter import STEP
from training.quantize_aware import IntegerHead, IntegerLayer


class IntegerKernel(nn.Module):
    """An integer K model as a torch module: [N,12,H,W] codes of `planes` -> [N,3,H,W] codes; with
    the model's last steps, which the training that it comes from has seen, too."""

    def __init__(self, model: IntTrunk, transfer: str):
        super().__init__()
        self.net, self.transfer, self.bilateral = model.net, transfer, model.bilateral
        self.layers = nn.ModuleList(
            (IntegerHead if x.layer.name in model.net.heads else IntegerLayer)(x)
            for x in model.layers)

    def trunk(self, codes: Tensor) -> list[Tensor]:
        """Input (codes / 255) -> heads by level: logits."""
        maps = {"input": (codes * 255.0).round().to(self.layers[0].weight.dtype)}
        for layer in self.layers:
            skip = maps[layer.layer.skip] if layer.layer.skip else None
            maps[layer.layer.name] = layer(maps[layer.layer.source], skip)
        return [(maps[name] / STEP).to(codes.dtype) for name in self.net.heads]

    def forward(self, x: Tensor) -> Tensor:
        return kernel_model.run(self.trunk, self.transfer, x, bilateral=self.bilateral)

    def integer_model(self) -> IntTrunk:
        """The model as it is now; ModelError if sums could leave 32 bits."""
        model = IntTrunk(self.net, [x.rounded() for x in self.layers], self.bilateral)
        check_trunk(model, "trained model")
        return model
