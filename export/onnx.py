"""ONNX files of family U networks, written without any package (protobuf by hand, opset 11).

Fixed input size, batch 1; tensors `input` and `output`; the network alone: exposure and transfer
functions are the caller's.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np

from training.nets import DirectNet

IR_VERSION, OPSET, FLOAT, HALF = 6, 11, 1, 10  # FLOAT, HALF: TensorProto.DataType
INT, INTS, STRING = 2, 7, 3  # AttributeProto.AttributeType


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes(out + bytes([value]))


def _field(number: int, value: int | bytes | str) -> bytes:
    """One protobuf field: an integer, or bytes with their length."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    value = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def _tensor(name: str, array: np.ndarray) -> bytes:
    kind = HALF if array.dtype == np.float16 else FLOAT
    return (b"".join(_field(1, d) for d in array.shape) + _field(2, kind) + _field(8, name)
            + _field(9, array.tobytes()))


def _value(name: str, shape: tuple[int, ...], kind: int) -> bytes:
    dims = b"".join(_field(1, _field(1, d)) for d in shape)
    return _field(1, name) + _field(2, _field(1, _field(1, kind) + _field(2, dims)))


def _node(op: str, inputs: list[str], output: str, **attributes) -> bytes:
    body = b"".join(_field(1, i) for i in inputs) + _field(2, output) + _field(3, output)
    body += _field(4, op)
    for name, value in attributes.items():
        attribute = _field(1, name)
        if isinstance(value, int):
            attribute += _field(3, value) + _field(20, INT)
        elif isinstance(value, str):
            attribute += _field(4, value) + _field(20, STRING)
        else:
            attribute += b"".join(_field(8, v) for v in value) + _field(20, INTS)
        body += _field(5, attribute)
    return body


def write_onnx(path: Path, model: DirectNet, height: int, width: int, params: bool = True,
               half: bool = False) -> None:
    """Write `model` for inputs [1,Cin,height,width]; params: with the weights inside."""
    dtype = np.dtype(np.float16 if half else np.float32)
    kind = HALF if half else FLOAT
    nodes, names = [], {"input": "input"}
    scales = np.array([1, 1, 2, 2], np.float32)
    last = model.net.layers[-1].name
    for layer in model.net.layers:
        source = names[layer.source]
        if layer.up:
            nodes.append(_node("Resize", [source, "roi", "scales"], f"{layer.name}.up",
                               mode="nearest", coordinate_transformation_mode="asymmetric",
                               nearest_mode="floor"))
            source = f"{layer.name}.up"
        if layer.skip:
            nodes.append(_node("Concat", [source, names[layer.skip]], f"{layer.name}.cat", axis=1))
            source = f"{layer.name}.cat"
        out = "output" if layer.name == last else f"{layer.name}.conv"
        nodes.append(_node("Conv", [source, f"{layer.name}.weight", f"{layer.name}.bias"], out,
                           kernel_shape=[3, 3], pads=[1, 1, 1, 1], strides=[1, 1]))
        if layer.name != last:
            nodes.append(_node("Relu", [out], f"{layer.name}.relu"))
            out = f"{layer.name}.relu"
        if layer.pool:
            nodes.append(_node("MaxPool", [out], f"{layer.name}.pool", kernel_shape=[2, 2],
                               strides=[2, 2]))
            out = f"{layer.name}.pool"
        names[layer.name] = out
    tensors = {k: v.detach().cpu().numpy().astype(dtype) for k, v in model.state_dict().items()}
    graph = b"".join(_field(1, n) for n in nodes) + _field(2, model.net.name)
    graph += _field(5, _tensor("roi", scales[:0])) + _field(5, _tensor("scales", scales))
    inputs = [_value("input", (1, model.inputs, height, width), kind)]
    for name, array in tensors.items():
        if params:
            graph += _field(5, _tensor(name, array))
        else:
            inputs.append(_value(name, array.shape, kind))
    graph += b"".join(_field(11, i) for i in inputs)
    graph += _field(12, _value("output", (1, model.outputs, height, width), kind))
    body = _field(1, IR_VERSION) + _field(2, "lull") + _field(7, graph)
    path.write_bytes(body + _field(8, _field(1, "") + _field(2, OPSET)))
