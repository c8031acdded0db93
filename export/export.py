#!/usr/bin/env python3
"""Export a training result.

    python -m export.export -r my_result                     fp16 weights (TZA) for lull and OIDN
    python -m export.export -r my_result --int8              the integer model, for lull
    python -m export.export -r my_result package             the result as a zip file
    python -m export.export -r my_result onnx|onnx_noparams  the network for other runtimes
    python -m export.export -r weights.pt                    fp16 weights of a state dict
"""
from __future__ import annotations

import zipfile
from pathlib import Path

import torch

from export.kernel import find_net
from export.onnx import write_onnx
from export.tza import TzaError, write_weights
from training import errors
from training.errors import STATE, USAGE, ToolError
from training.imageio import replacing
from training.nets import from_tensors
from training.result import Result, load_model, read_weights
from training.settings import Settings, parse

ONNX_SIZE = (1088, 1920)  # height and width of the exported graph


def main(argv: list[str]) -> None:
    settings = parse("export", argv, __doc__)
    if settings.int8 and settings.target != "weights":
        raise ToolError("--int8 goes with the target weights", USAGE)
    if settings.prune and not settings.int8:
        raise ToolError("--prune goes with --int8", USAGE)
    print(f"PyTorch: {torch.__version__}")
    result = Result(settings.results_dir, settings.result)
    if state_file(settings):
        if settings.target != "weights" or settings.int8:
            raise ToolError(f"{settings.result}: of a state dict there are fp16 weights only; "
                            "export.quantize_kernel makes integers", USAGE)
    else:
        result.require()
    path = TARGETS[settings.target](result, settings)
    print(f"Saved: {path}")


def state_file(settings: Settings) -> Path | None:
    """The state dict (.pt) that --result names instead of a result."""
    path = Path(settings.result)
    return path if path.suffix == ".pt" and path.is_file() else None


def output_path(result: Result, settings: Settings, extension: str) -> Path:
    """--output, or the result's folder and name; with the epoch if one was asked for."""
    if settings.output:
        return Path(settings.output)
    if path := state_file(settings):
        return path.with_suffix(extension)
    epoch = settings.num_epochs
    mark = f"_{epoch}" if epoch and epoch > 0 else ""
    return result.folder / f"{result.folder.name}{mark}{extension}"


def export_integer(result: Result, settings: Settings) -> Path:
    """The integer model (docs/arithmetic.md, docs/kernel-prediction.md)."""
    from export.quantize import write_tensors
    from training.integer_stage import integer_weights
    path = output_path(result, settings, ".int8.tza")
    try:
        write_tensors(path, integer_weights(result, settings))
    except ValueError as e:
        raise ToolError(f"{path}: {e}", STATE) from e
    return path


def export_weights(result: Result, settings: Settings) -> Path:
    """Every tensor as fp16, named and laid out as Open Image Denoise reads it."""
    if settings.int8:
        return export_integer(result, settings)
    if source := state_file(settings):
        state = read_weights(source)
        try:
            from_tensors(state)
        except (KeyError, ValueError, RuntimeError) as e:
            raise ToolError(f"{source}: not the weights of a network "
                            f"({str(e).splitlines()[0]})", STATE) from e
    else:
        state = load_model(result, settings.num_epochs, settings.best,
                           settings.weights)[0].state_dict()
    path = output_path(result, settings, ".tza")
    tensors = {k: v.detach().contiguous().cpu().numpy() for k, v in state.items()}
    try:
        with replacing(path) as tmp:
            write_weights(tmp, tensors)
    except TzaError as e:
        raise ToolError(f"{path}: {e}", STATE) from e
    for name, tensor in tensors.items():
        print(f"{name} {tuple(tensor.shape)}")
    if find_net(tensors):
        print("A model of family K: oidnDenoise and the library run it as integers only (--int8)")
    return path


def export_package(result: Result, settings: Settings) -> Path:
    """config.json, the latest checkpoint (and best.pth) and the log, in the result's folder."""
    path = Path(settings.output or result.folder.parent / f"{result.folder.name}.zip")
    files = [result.folder / "config.json", result.checkpoints / "latest",
             result.checkpoints / f"checkpoint_{result.latest_epoch()}.pth",
             result.checkpoints / "best.pth", result.checkpoints / "integer.pth",
             *sorted((result.folder / "log").glob("events.out.*"))]
    with replacing(path) as tmp, zipfile.ZipFile(tmp, "w", zipfile.ZIP_DEFLATED) as z:
        for f in files:
            if f.exists():
                z.write(f, f.relative_to(result.folder.parent))
    return path


def export_onnx(result: Result, settings: Settings, params: bool = True) -> Path:
    """The network alone (no exposure, no transfer function) with a fixed size."""
    model, _, _ = load_model(result, settings.num_epochs, settings.best, settings.weights)
    if model.net.family != "U":
        raise ToolError("ONNX files hold networks of family U only; a model of family K is a "
                        "network and a filter", USAGE)
    path = output_path(result, settings, ".onnx" if params else ".noparams.onnx")
    with replacing(path) as tmp:
        write_onnx(tmp, model, *ONNX_SIZE, params=params, half=settings.device == "cuda")
    return path


TARGETS = {"weights": export_weights, "package": export_package, "onnx": export_onnx,
           "onnx_noparams": lambda r, s: export_onnx(r, s, params=False)}


if __name__ == "__main__":
    errors.run(main)
