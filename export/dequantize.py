"""Float weights of an integer model, to train on from: the inverse of the quantisers."""
from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from export import kernel
from export.fold import FOLD
from export.reference import IntModel, Part, int_model

# Of a 3x3 kernel's nine taps: the 16 of its four phases, and the least-squares way back.
PHASES = np.einsum("pdy,qex->pqdeyx", FOLD, FOLD).reshape(16, 9)
WHOLE = np.linalg.pinv(PHASES)


def whole_kernels(weight: np.ndarray) -> np.ndarray:
    """[4*O,C,2,2] of four phases -> [O,C,3,3], which fold to them as nearly as they can."""
    o, c = weight.shape[0] // 4, weight.shape[1]
    phases = weight.reshape(4, o, c, 4).transpose(1, 2, 0, 3).reshape(o, c, 16)
    return (phases @ WHOLE.T).reshape(o, c, 3, 3)


def scaled(part: Part, step: np.ndarray, shift: int) -> np.ndarray:
    """[O,I,3,3] weights on values for integer ones on codes, each worth step[I]."""
    weight = part.weight.astype(np.float64)
    weight = whole_kernels(weight) if part.up else weight
    return weight / step[part.channels, None, None] * (2.0**-shift if part.wide else 1.0)


def read_integer(tensors: Mapping[str, np.ndarray], file: str) -> IntModel:
    """An integer model of any family. ModelError if it is none."""
    is_kernel = kernel.find_net(tensors)
    return kernel.int_trunk(tensors, file) if is_kernel else int_model(tensors, file)


def as_floats(tensors: Mapping[str, np.ndarray], file: str) -> Mapping[str, np.ndarray]:
    """`float_tensors` of an integer model; others as they are."""
    is_integer = any(t.dtype == np.int8 for t in tensors.values())
    return float_tensors(tensors, file) if is_integer else tensors


def float_tensors(tensors: Mapping[str, np.ndarray], file: str) -> dict[str, np.ndarray]:
    """Weights `[O,I,k,k]` and biases `[O]`, float32, of the network that an integer model stands
    for; values between layers are codes over the largest code, where quantising ended them.

    Layers lose no more than float32 rounds, but for upsampled ones: four phases, rounded apart,
    become one kernel again. ModelError if the tensors are no integer model.
    """
    model = read_integer(tensors, file)
    heads = getattr(model.net, "heads", ())
    steps = {"input": 1 / model.input_scale.astype(np.float64)}
    out = {}
    for x in model.layers:
        name = x.layer.name
        step = (kernel.HEAD_STEP if name in heads
                else float(model.output_scale) if not heads and name == model.net.last.name
                else 1 / x.out_max)
        steps[name] = np.full(x.outputs, step)
        unit = (x.scale.astype(np.float64) * step)[:, None, None, None]
        weight = unit * np.concatenate([scaled(p, steps[p.name], x.shift) for p in x.parts()], 1)
        out[f"{name}.weight"] = weight[:, :, 1:2, 1:2] if name in heads else weight
        out[f"{name}.bias"] = unit[:, 0, 0, 0] * x.bias
    return {k: v.astype(np.float32) for k, v in out.items()}
