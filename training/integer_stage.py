"""From a trained result to integers: calibration on its own data, and quantisation-aware training.

The stage after a training (`--quantize_aware`) is resumed like the training itself; its state is
checkpoints/integer.pth. `export --int8` takes its model, or quantises the weights if there is none.
"""
from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import torch

from export import kernel, synthetic
from export.calibrate import SYNTHETIC, SYNTHETIC_SIZE, middle
from export.prune import active_channels, without_silent
from export.quantize import integer_tensors
from export.quantize_kernel import (
    OPTIONS,
    KernelQuantizer,
    calibration_input,
    tensors_of,
    varied,
)
from export.quantizer import Options, Quantizer, transfer_top
from export.reference import float_model
from training import color
from training.augment import Augment
from training.data import Batches, Picture
from training.errors import STATE, USAGE, ToolError
from training.features import encode
from training.kernel_integer import IntegerKernel
from training.kernel_model import LONE
from training.loss import loss_of_settings
from training.pictures import read_raw, scan_set
from training.quantize_aware import IntegerNet, fine_tune, held_out, judge
from training.result import Result, load_model, save_state
from training.scan import CHANNELS
from training.settings import Settings
from training.store import find_stored, read_pictures

CALIBRATION = 12  # pictures
METHOD = 3  # of the integer stage: states of another one are not continued
CONTENTS = {("hdr", "pu"): "hdr", ("hdr", "log"): "lightmap-hdr", ("ldr", "srgb"): "ldr",
            ("ldr", "linear"): "srgb"}
FEATURES = {"hdr": "color", "ldr": "color", "alb": "albedo", "nrm": "normal"}


def quantize(tensors: dict[str, torch.Tensor], settings: Settings, pictures: list[Picture],
             prune: int = 0):
    """Weights of a training as an integer model, IntModel or IntTrunk.

    prune: pictures in which a channel of family K must be above 0 somewhere to stay; 0: all stay.
    """
    arrays = {k: np.asarray(v.detach().cpu().float(), np.float16) for k, v in tensors.items()}
    if settings.get("family", "U") == "K":
        net = kernel.find_trunk(arrays, settings.result)
        if prune:
            codes = spread_codes(pictures, prune)
            active = active_channels(kernel.FloatTrunk(net, arrays), (
                kernel_input(x, settings, i) for i, x in enumerate(codes)))
            arrays = without_silent(net, arrays, active, net.heads)
        inputs = [middle(kernel_input(x, settings, i))
                  for i, x in enumerate(spread_codes(pictures, CALIBRATION))]
        model = KernelQuantizer(kernel.FloatTrunk(net, arrays), inputs, OPTIONS).run()
        model.bilateral = settings.get("bilateral") or (
            kernel.ALONE if settings.main_feature in LONE else 0)
        return model
    if prune:
        raise ToolError("--prune is for family K", USAGE)
    codes = [middle(x) for x in spread_codes(pictures, CALIBRATION)]
    model = float_model(arrays, settings.result)
    inputs = [np.pad(x, ((0, -x.shape[0] % 16), (0, -x.shape[1] % 16), (0, 0))) for x in codes]
    top = transfer_top(CONTENTS.get((settings.main_feature, settings.transfer), "ldr"))
    return Quantizer(model, inputs, Options(input_top=top, output_top=top)).run()


def spread_codes(pictures: list[Picture], count: int) -> Iterator[np.ndarray]:
    """Codes of inputs of so many of the pictures, evenly spread, of few and of many samples; the
    features of their references where they have none themselves."""
    chosen = pictures[::max(len(pictures) // count, 1)][:count]
    for i, p in enumerate(chosen):
        x = p.inputs[i % len(p.inputs)]
        yield np.concatenate([x, p.target[..., x.shape[-1]:]], -1).astype(np.float32)


def kernel_input(codes: np.ndarray, settings: Settings, index: int) -> np.ndarray:
    """Calibration input of family K from the codes of a picture; features and content change."""
    images, at = {}, 0
    for feature in settings.features:
        part = codes[..., at:at + CHANNELS[feature]]
        at += CHANNELS[feature]
        if feature == settings.main_feature:  # an albedo or normals alone, too
            images["color"] = color.TRANSFERS[settings.transfer].inverse(part).astype(np.float32)
        else:
            images[FEATURES[feature]] = (part * 2 - 1 if feature == "nrm" else part).astype(
                np.float32)
    if settings.main_feature in LONE:
        images["normal"] = images["color"] * 2 - 1
    if settings.main_feature != "hdr":
        return calibration_input(images, "ldr")
    return calibration_input(*varied(images, index, not settings.get("drop_features")))


def calibration_pictures(settings: Settings, count: int = CALIBRATION,
                         say: Callable = print) -> list[Picture]:
    """At least `count` pictures of the data that a result was trained on, if it has so many and is
    here, else built-in synthetic ones."""
    s = settings
    try:
        if not s.get("raw"):
            return read_pictures(find_stored(s, s.train_data), s.features, s.main_feature, False)
        found = scan_set(s, s.train_data)
        found.groups = found.groups[::max(len(found.groups) // count, 1)][:count]
        pictures = read_raw(found, s, say)
        if pictures:
            return pictures
    except ToolError as e:
        say(f"the training data is not here ({e})")
    say("calibrating on built-in synthetic pictures")
    return [synthetic_picture(s, seed, spp) for seed, spp in SYNTHETIC]


def synthetic_picture(settings: Settings, seed: int, spp: int) -> Picture:
    made = synthetic.noisy(SYNTHETIC_SIZE, seed, spp)
    images = {f: made[FEATURES[f]] for f in settings.features if f in FEATURES}
    if settings.main_feature == "ldr":
        images["ldr"] = np.clip(images["ldr"], 0, 1)
    hdr = settings.main_feature == "hdr"
    codes = np.clip(encode(images, settings.main_feature, settings.transfer,
                           color.autoexposure(images["hdr"]) if hdr else 1.0), 0, 1)
    return Picture(f"synthetic {seed}", [codes], [float(spp)], codes)


def tensors_of_model(model) -> dict[str, np.ndarray]:
    """The tensors of an integer model's file."""
    return tensors_of(model) if isinstance(model, kernel.IntTrunk) else integer_tensors(model)


def fingerprint(tensors: dict[str, torch.Tensor]) -> str:
    """Of weights, to know them again."""
    digest = hashlib.sha256()
    for name, value in tensors.items():
        digest.update(name.encode() + value.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def read_stage(result: Result) -> dict | None:
    """The state of a result's integer stage, if it has one."""
    path = result.checkpoints / "integer.pth"
    if not path.exists():
        return None
    try:
        return torch.load(path, weights_only=True)
    except Exception as e:  # a damaged file shows as one of many kinds of exception
        raise ToolError(f"{path}: damaged checkpoint ({type(e).__name__})", STATE) from e


def quantize_aware(result: Result, settings: Settings, pictures: list[Picture],
                   say: Callable = print) -> None:
    """Trains the integer model of a result's averaged weights for `quantize_aware` steps."""
    s = settings
    original = load_model(result)[0]
    float_tensors = original.state_dict()
    same = {"weights": fingerprint(float_tensors), "steps": s.quantize_aware,
            "rate": s.quantize_rate, "method": METHOD}
    state = read_stage(result)
    if state and state["same"] != same:
        state = None
    if state and state["tensors"] is not None:
        say("Integer model: trained before")
        return
    say(f"Integer model: {s.quantize_aware} steps" + (f" from {state['step']}" if state else ""))
    model = quantize(float_tensors, s, pictures)
    family = s.get("family", "U")
    net = IntegerKernel(model, s.transfer) if family == "K" else IntegerNet(model)
    augment = Augment.of(s)
    if s.main_feature == "hdr" and not augment.exposure:
        augment = replace(augment, exposure=1.0)
    batches = Batches(pictures, s.features, s.main_feature, s.transfer, s.batch_size, s.tile_size,
                      s.seed + 1, augment, s.clean_aux, family=family)

    def save(stage: dict, tensors: dict | None = None) -> None:
        save_state(result.checkpoints / "integer.pth", {"same": same, "tensors": tensors, **stage})

    kept: dict = {}
    held, loss = held_out(batches), loss_of_settings(s)
    tuned = fine_tune(net, batches, held, s.quantize_aware, s.quantize_rate, loss, say, state,
                      lambda stage: (kept.update(stage), save(stage)))
    say(f"Integer model: loss {tuned.least:.6f} on tiles held out, that of step {tuned.step}; "
        f"without training {tuned.before:.6f}, in floating point "
        f"{judge(original, held, loss):.6f}")
    arrays = tensors_of_model(net.integer_model())
    save(kept or state, {k: torch.from_numpy(np.array(v)) for k, v in arrays.items()})


def integer_weights(result: Result, settings: Settings) -> dict[str, np.ndarray]:
    """Tensors of the integer model of a result: of its own stage where that belongs to the wanted
    checkpoint, else quantised now."""
    model, trained, _ = load_model(result, settings.num_epochs, settings.best, settings.weights)
    if others := sorted({"sh1", "z"} & set(trained.features)):
        raise ToolError(f"{settings.result}: there are no integer models of {others[0]}", STATE)
    tensors = model.state_dict()
    stage = read_stage(result)
    if stage and stage["tensors"] is not None and stage["same"]["weights"] == fingerprint(tensors):
        if settings.prune:
            raise ToolError(f"{settings.result}: its integer model is trained already, --prune "
                            "comes too late", USAGE)
        print("the model of the quantisation-aware training")
        return {k: v.numpy() for k, v in stage["tensors"].items()}
    if stage and stage["tensors"] is None and stage["same"]["weights"] == fingerprint(tensors):
        print(f"the quantisation-aware training is not finished (step {stage['step']} of "
              f"{stage['same']['steps']}): the weights are quantised without it")
    pictures = calibration_pictures(trained, max(CALIBRATION, settings.prune))
    return tensors_of_model(quantize(tensors, trained, pictures, settings.prune))
