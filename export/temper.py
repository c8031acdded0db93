"""How smooth a K model's results are, without training: `python -m export.temper IN.tza OUT.tza`.

Three numbers of the finest level, the same for every pixel: a factor of the logits of its 5x5
kernels (below 1 they are wider), one of the logarithm of its confidences, and what is added to the
logit of the coarser level's weight. Only scales and one bias of the integer head change.
"""
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from export import kernel
from export.quantize import write_tensors
from export.quantize_kernel import tensors_of
from training import errors


def tempered(model: kernel.IntTrunk, radiance: float = 1.0, confidence: float = 1.0,
             blend: float = 0.0) -> kernel.IntTrunk:
    """The model with its level 0's logits changed: radiance and confidence are factors, blend is
    added. ModelError if its sums could leave 32 bits."""
    made = kernel.IntTrunk(model.net, list(model.layers), model.bilateral)
    at = next(i for i, x in enumerate(made.layers) if x.layer.name == model.net.heads[0])
    head = made.layers[at]
    scale, bias = head.scale.copy(), head.bias.copy()
    scale[:kernel.TAPS] *= np.float32(radiance)
    scale[kernel.CONFIDENCE] *= np.float32(confidence)
    bias[kernel.BLEND] += round(blend / kernel.HEAD_STEP / float(scale[kernel.BLEND]))
    made.layers[at] = replace(head, scale=scale, bias=bias)
    kernel.check_trunk(made, "tempered model")
    return made


def main(argv: list[str]) -> None:
    parser = errors.Parser("export.temper", description=__doc__)
    parser.add_argument("input", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--radiance", type=float, default=1.0, metavar="F")
    parser.add_argument("--confidence", type=float, default=1.0, metavar="F")
    parser.add_argument("--blend", type=float, default=0.0, metavar="L")
    args = parser.parse_args(argv)
    for name in ("radiance", "confidence"):
        if not 0 < getattr(args, name) <= 4:
            raise errors.ToolError(f"--{name} must be above 0 and at most 4", errors.USAGE)
    if not abs(args.blend) <= 8:
        raise errors.ToolError("--blend must be between -8 and 8", errors.USAGE)
    with errors.reading(args.input):
        model = kernel.load(args.input)
        made = tempered(model, args.radiance, args.confidence, args.blend)
    write_tensors(args.output, tensors_of(made))


if __name__ == "__main__":
    errors.run(main)
