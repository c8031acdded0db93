"""Options of all scripts in one table, and the settings that come out of them.

Names, defaults and derived defaults are Open Image Denoise's where it has the option. Precedence:
command line, then the JSON file of --config, then defaults (theirs lets the file win). Unknown keys
in the file are errors. Values never change after parsing: a Settings is frozen.
"""
from __future__ import annotations

import argparse
import json
import os
import re
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from training.errors import DATA, USAGE, ToolError
from training.features import main_feature
from training.loss import LOSSES, RT_WEIGHTS
from training.scan import ALIASES, CHANNELS, FEATURES

SCRIPTS = {"preprocess": "P", "train": "T", "find_lr": "L", "infer": "I", "export": "X",
           "visualize": "V", "convert_image": "C", "compare_image": "Q", "split_exr": "Z",
           "doctor": "D"}
MODEL_BY_QUALITY = {"high": "unet_large", "balanced": "unet", "fast": "unet_small"}
LR_PER_SAMPLE = {"unet_large": 2.679e-6, "unet_xl": 2.679e-6}  # of a batch; others:
LR_PER_SAMPLE_DEFAULT = 3.125e-6
METRICS = ("psnr", "mse", "ssim", "msssim", "flip")
POSITIONAL = {"features": 0, "target": 0, "input": 1, "images": 2}  # 0: may be missing


@dataclass(frozen=True)
class Option:
    """One row: spellings, the scripts that take it, its default (or one per script), argparse's."""

    names: str
    scripts: str
    default: Any
    text: str
    kind: dict

    @property
    def key(self) -> str:
        first = self.names.split()[0]
        return first.lstrip("-").replace("-", "_")

    def default_for(self, script: str) -> Any:
        return self.default.get(script) if isinstance(self.default, dict) else self.default


def _o(names: str, scripts: str, default: Any, text: str, **kind) -> Option:
    return Option(names, scripts, default, text, kind)


FLAG = {"action": "store_true"}
MANY = {"nargs": "*"}
INT, FLOAT = {"type": int}, {"type": float}

OPTIONS = (
    _o("features", "PTLD", [], f"input features: {' '.join(FEATURES)}", **MANY),
    _o("target", "X", "weights", "what to export", nargs="?",
       choices=("weights", "package", "onnx", "onnx_noparams")),
    _o("input", "Z", None, "EXR image to split"),
    _o("images", "CQ", None, "two images", nargs=2),
    _o("--config -c", "PTLIXVCQZD", None, "JSON file with settings (the command line wins)"),
    _o("--clean_aux", "PTL", False, "take auxiliary features from the reference", **FLAG),
    _o("--filter -f", "PTL", None, "filter to train for: picks defaults",
       choices=("RT", "RTLightmap")),
    _o("--quality -q", "PTL", "high", "picks the default model", choices=tuple(MODEL_BY_QUALITY)),
    _o("--preproc_dir -P", "PTL", "preproc", "folder of preprocessed data sets"),
    _o("--train_data -t", "PTL", None, "training data set (default: train)"),
    _o("--valid_data -v", "PT", None, "validation data set (default: valid)"),
    _o("--hold_out", "T", 0, "validate on this many groups of the training data set", **INT),
    _o("--raw", "TL", False, "train on the raw data set in memory, without preprocessing", **FLAG),
    _o("--layers", "PTLID", [], "layers of multichannel EXR files: feature=prefix", **MANY),
    _o("--shard", "P", None, "work on part i of n of the groups: i/n, i from 0"),
    _o("--transfer -x", "PTL", None, "transfer function of the main feature",
       choices=("linear", "srgb", "pu", "log")),
    _o("--data_dir -D", "PTLID", "data", "folder of raw data sets"),
    _o("--results_dir -R", "PTLIXV", "results", "folder of results"),
    _o("--result -r", "TLIXV", None, "name of the result"),
    _o("--aux_results -a", "PTLI", [], "results that prefilter auxiliary features", **MANY),
    _o("--num_epochs --epochs -e", "PTIX", {"T": 2000}, "epochs to train, or checkpoint", **INT),
    _o("--num_valid_epochs --valid_epochs", "T", 10, "validate every n epochs", **INT),
    _o("--num_save_epochs --save_epochs", "T", 10, "save a checkpoint every n epochs", **INT),
    _o("--learning_rate --lr", "TL", {"L": 1e-8}, "initial learning rate", **FLOAT),
    _o("--max_learning_rate --max_lr", "TL", {"L": 0.1}, "largest learning rate", **FLOAT),
    _o("--learning_rate_warmup --lr_warmup", "T", 0.15, "share of the cycle that rises", **FLOAT),
    _o("--compile", "T", None, "torch.compile mode (default: reduce-overhead on cuda)",
       choices=("disable", "default", "reduce-overhead", "max-autotune")),
    _o("--batch_size --bs -b", "TL", 16, "batch size over all devices", **INT),
    _o("--num_loaders --loaders -j", "TL", 4, "loader processes per device, or 0", **INT),
    _o("--precision -p", "TL", None, "training precision", choices=("fp32", "mixed")),
    _o("--model -m", "TL", None, "model of configs/models.json, or topology:width,width,..."),
    _o("--loss -l", "TL", "l1_msssim", "loss function", choices=LOSSES),
    _o("--msssim_weights", "TL", None, "MS-SSIM exponents, finest scale first", nargs="*",
       type=float),
    _o("--tile_size --ts", "TL", 256, "side of the training tiles", **INT),
    _o("--seed -s", "TL", None, "seed of the random numbers (default: from the clock)", **INT),
    _o("--num_steps", "L", None, "steps of the sweep (default: one epoch, at least 100)", **INT),
    _o("--time_budget --time-budget", "T", None, "end after this time, e.g. 30m, 2h, 90s"),
    _o("--ema", "T", 0.999, "decay of the averaged weights; 0: none", **FLOAT),
    _o("--init", "T", None, "start from the weights of a result or a .tza file"),
    _o("--exposure_jitter", "TL", 0.0, "random exposure of hdr tiles, +- stops", **FLOAT),
    _o("--average_inputs", "TL", 0.0, "share of inputs averaged over the group", **FLOAT),
    _o("--blend_target", "TL", 0.0, "share of inputs blended towards the target", **FLOAT),
    _o("--mix_clean_aux", "TL", 0.0, "share of inputs with the target's features", **FLOAT),
    _o("--normal_signs", "TL", 0.0, "share of tiles with random signs of normals", **FLOAT),
    _o("--metric -M", "IQ", ["psnr", "ssim"], "metrics", nargs="*", choices=METRICS),
    _o("--input_data -i", "ID", {"I": "test", "D": "train"}, "raw data set to read"),
    _o("--output_dir -O", "I", "infer", "folder of denoised images"),
    _o("--output_suffix -o", "I", None, "suffix of denoised images (default: the result's name)"),
    _o("--format -F", "I", ["exr"], "formats of denoised images", nargs="*"),
    _o("--save_all", "I", False, "save input and target as well", **FLAG),
    _o("--output -o", "X", None, "output file"),
    _o("--weights", "IX", "ema", "which weights of a checkpoint", choices=("ema", "raw")),
    _o("--best", "IX", False, "the checkpoint of the best validation", **FLAG),
    _o("--port", "V", 6006, "port of TensorBoard", **INT),
    _o("--exposure -E", "CQ", 1.0, "linear scale before tone mapping", **FLOAT),
    _o("--layer", "Z", None, "EXR layer to split"),
    _o("--device -d", "PTLIX", None, "device", choices=("cpu", "cuda", "mps")),
    _o("--device_id -k", "PTLIX", 0, "first device", **INT),
    _o("--num_devices -n", "PTLIX", 1, "processes for data parallel training", **INT),
    _o("--threads", "PTLI", 0, "CPU threads per process; 0: PyTorch's choice", **INT),
    _o("--deterministic --det", "PTLIX", {"P": True, "I": True, "X": True, "T": False, "L": False},
       "deterministic algorithms", **FLAG),
)


class Settings:
    """Frozen attributes: the values of all options of a script, and what was derived from them."""

    def __init__(self, values: dict[str, Any]):
        object.__setattr__(self, "_values", dict(values))

    def __getattr__(self, key: str) -> Any:
        try:
            return self._values[key]
        except KeyError:
            raise AttributeError(key) from None

    def __setattr__(self, key: str, value: Any) -> None:
        raise AttributeError(f"settings are frozen ({key})")

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __reduce__(self):
        return Settings, (self._values,)

    def get(self, key: str, default: Any = None) -> Any:
        return self._values.get(key, default)

    def replace(self, **changes: Any) -> Settings:
        return Settings({**self._values, **changes})

    def to_dict(self) -> dict[str, Any]:
        return dict(self._values)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        raise ToolError(f"{message} (--help lists the options)", USAGE)


def make_parser(script: str, doc: str = "") -> argparse.ArgumentParser:
    """The parser of a script; values that were not given are absent from its namespace."""
    parser = _Parser(prog=f"python -m training.{script}", description=doc, allow_abbrev=False,
                     argument_default=argparse.SUPPRESS)
    letter = SCRIPTS[script]
    for option in (o for o in OPTIONS if letter in o.scripts):
        kind, text, default = dict(option.kind), option.text, option.default_for(letter)
        if default not in (None, [], False):
            shown = " ".join(map(str, default)) if isinstance(default, list) else default
            text += f" (default: {shown})"
        if option.names[0] == "-":
            kind["dest"] = option.key
        else:  # whether it is there is checked once the file is read
            kind |= {"nargs": "*" if kind.get("nargs") in ("*", 2) else "?", "default": None}
        parser.add_argument(*option.names.split(), help=text.replace("%", "%%"), **kind)
    return parser


def parse(script: str, argv: list[str], doc: str = "", **more: Any) -> Settings:
    """Settings of a script from its command line; `more`: options that need no table row."""
    letter = SCRIPTS[script]
    given = vars(make_parser(script, doc).parse_args(argv))
    given = {k: v for k, v in given.items() if v is not None and not (k in POSITIONAL and v == [])}
    rows = {o.key: o for o in OPTIONS if letter in o.scripts}
    values = {key: o.default_for(letter) for key, o in rows.items()} | more
    if given.get("config"):
        values |= read_config(Path(given["config"]), rows)
    values |= given
    for key, count in POSITIONAL.items():
        have = values.get(key) or []
        if key in rows and count and len([have] if isinstance(have, str) else have) != count:
            raise ToolError(f"missing or extra argument: {rows[key].text}", USAGE)
    return Settings(derive(script, values))


def read_config(path: Path, rows: dict[str, Option]) -> dict[str, Any]:
    """The JSON object of a settings file, with every key checked against the script's options."""
    try:
        loaded = json.loads(path.read_text())
    except OSError as e:
        raise ToolError(f"{path}: cannot read ({e.strerror})", DATA) from e
    except ValueError as e:
        raise ToolError(f"{path}: not JSON ({e})", DATA) from e
    if not isinstance(loaded, dict):
        raise ToolError(f"{path}: not a JSON object", DATA)
    unknown = sorted(set(loaded) - set(rows))
    if unknown:
        raise ToolError(f"{path}: unknown settings: {', '.join(unknown)}", USAGE)
    for key, value in loaded.items():
        choices = rows[key].kind.get("choices")
        for v in value if isinstance(value, list) else [value]:
            if choices and v is not None and v not in choices:
                raise ToolError(f"{path}: {key}: '{v}' is not one of {', '.join(choices)}", USAGE)
    return loaded


def unique_id() -> str:
    """<8 hex digits of unix time>.<host name>.<process>: result and data set names sort by time."""
    return f"{int(time.time()):08x}.{socket.gethostname()}.{os.getpid()}"


def _features(names: list[str]) -> list[str]:
    """Short names, without repeats, in the order in which networks get them."""
    short = [ALIASES.get(n.lower(), n.lower()) for n in names]
    wrong = [n for n in short if n not in FEATURES]
    if wrong:
        raise ToolError(f"unknown feature '{wrong[0]}' (known: {' '.join(FEATURES)})", USAGE)
    return [f for f in FEATURES if f in short]


def seconds(text: str) -> float:
    """'90', '90s', '30m', '2h' or '1d' in seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d*)?)\s*([smhd]?)", str(text).strip())
    if not match or float(match[1]) <= 0:
        raise ToolError(f"'{text}' is not a time such as 90s, 30m or 2h", USAGE)
    return float(match[1]) * {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}[match[2]]


def _shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if not match or not 0 <= int(match[1]) < int(match[2]):
        raise ToolError(f"--shard {text}: not i/n with 0 <= i < n", USAGE)
    return int(match[1]), int(match[2])


def _layers(rows: list[str]) -> dict[str, str]:
    layers = {}
    for row in rows:
        feature, equals, prefix = row.partition("=")
        if not equals:
            raise ToolError(f"--layers {row}: not feature=prefix", USAGE)
        layers[_features([feature])[0]] = prefix
    return layers


def derive(script: str, v: dict[str, Any]) -> dict[str, Any]:
    """Fill in what follows from other options, and refuse what cannot be."""
    if "features" in v:
        v["features"] = _features(v["features"])
        v["main_feature"] = main_feature(v["features"])
        v["aux_features"] = [f for f in v["features"] if f != v["main_feature"]]
    if "layers" in v and not isinstance(v["layers"], dict):
        v["layers"] = _layers(v["layers"])
    if v.get("shard"):
        v["shard"] = _shard(v["shard"])
    if v.get("time_budget") is not None:
        v["time_budget"] = seconds(v["time_budget"])
    if v.get("clean_aux") and v.get("aux_results"):
        raise ToolError("--clean_aux and --aux_results exclude each other", USAGE)
    if "transfer" in v and v["transfer"] is None:
        lightmap = v.get("filter") == "RTLightmap"
        v["transfer"] = {"hdr": "log" if lightmap else "pu", "ldr": "srgb", "alb": "srgb",
                         "z": "log", "sh1": "linear", "nrm": "linear"}[v["main_feature"]]
    if "train_data" in v and v["train_data"] is None and v.get("valid_data") is None:
        v["train_data"] = "train"
        if not v.get("hold_out") and "valid_data" in v:
            v["valid_data"] = "valid"
    if "model" in v:
        v["model"] = v["model"] or MODEL_BY_QUALITY[v["quality"]]
    if "msssim_weights" in v and not v["msssim_weights"] and v.get("filter") == "RT":
        v["msssim_weights"] = list(RT_WEIGHTS)
    if script == "train":
        _derive_rates(v)
    if script in ("train", "find_lr"):
        if v["batch_size"] < 1 or v["batch_size"] % max(v["num_devices"], 1):
            raise ToolError(f"--batch_size {v['batch_size']} does not divide by "
                            f"--num_devices {v['num_devices']}", USAGE)
        if v["tile_size"] < 16 or v["tile_size"] % 16:
            raise ToolError(f"--tile_size {v['tile_size']}: not a multiple of 16", USAGE)
        if v["seed"] is None:
            v["seed"] = time.time_ns() % (1 << 31)
    if script in ("infer", "export", "visualize") and not v["result"]:
        raise ToolError("--result is missing", USAGE)
    return v


def _derive_rates(v: dict[str, Any]) -> None:
    if v["max_learning_rate"] is None:
        rate = LR_PER_SAMPLE.get(v["model"], LR_PER_SAMPLE_DEFAULT)
        v["max_learning_rate"] = rate * v["batch_size"]
    if v["learning_rate"] is None:
        v["learning_rate"] = v["max_learning_rate"] / 25
    if not 0 <= v["learning_rate_warmup"] < 1:
        raise ToolError("--learning_rate_warmup: not in [0,1)", USAGE)
    if v["num_epochs"] < 1:
        raise ToolError("--num_epochs: not positive", USAGE)


def input_channels(features: list[str]) -> int:
    """Channels of a network input; sh1 is seen three channels at a time."""
    return sum(3 if f == "sh1" else CHANNELS[f] for f in features)


def output_channels(main: str) -> int:
    return 1 if main == "z" else 3
