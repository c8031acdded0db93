"""The settings of a script, from the table of options.py.

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
from pathlib import Path
from typing import Any

from training.errors import DATA, USAGE, Parser, ToolError
from training.features import main_feature, parse_layers, short_names
from training.kernel_model import FEATURES as KERNEL_FEATURES
from training.kernel_model import LONE
from training.loss import RT_WEIGHTS
from training.options import (BY_FAMILY, KERNEL_LR, LR_PER_SAMPLE, LR_PER_SAMPLE_DEFAULT,
                              MODEL_BY_NET, MODEL_BY_QUALITY, OPTIONS, POSITIONAL, SCRIPTS, Option)
from training.scan import CHANNELS


# What config.json of a result says beyond the options: what followed from them, or from the data.
DERIVED = ("main_feature", "aux_features", "family", "held_out")


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


def make_parser(script: str, doc: str = "") -> argparse.ArgumentParser:
    """The parser of a script; values that were not given are absent from its namespace."""
    parser = Parser(prog=f"python -m training.{script}", description=doc, allow_abbrev=False,
                    argument_default=argparse.SUPPRESS)
    letter = SCRIPTS[script]
    for option in (o for o in OPTIONS if letter in o.scripts):
        kind, text, default = dict(option.kind), option.text, option.default_for(letter)
        if option.key in BY_FAMILY["U"]:
            default = f"{BY_FAMILY['U'][option.key]}; family K: {BY_FAMILY['K'][option.key]}"
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
        values |= read_config(Path(given["config"]), rows, letter)
    for key, value in given.items():
        check(key if key in POSITIONAL else f"--{key}", value, rows[key])
    values |= given
    for key, count in POSITIONAL.items():
        have = values.get(key) or []
        if key in rows and count and len([have] if isinstance(have, str) else have) != count:
            raise ToolError(f"missing or extra argument: {rows[key].text}", USAGE)
    return Settings(derive(script, values))


def read_config(path: Path, rows: dict[str, Option], script: str) -> dict[str, Any]:
    """The JSON object of a settings file, which may be config.json of a result, checked against the
    script's options. An option without a default may be null."""
    try:
        loaded = json.loads(path.read_text())
    except OSError as e:
        raise ToolError(f"{path}: cannot read ({e.strerror})", DATA) from e
    except ValueError as e:
        raise ToolError(f"{path}: not JSON ({e})", DATA) from e
    if not isinstance(loaded, dict):
        raise ToolError(f"{path}: not a JSON object", DATA)
    loaded = {key: value for key, value in loaded.items() if key not in DERIVED}
    unknown = sorted(set(loaded) - set(rows))
    if unknown:
        raise ToolError(f"{path}: unknown settings: {', '.join(unknown)}", USAGE)
    if isinstance(loaded.get("layers"), dict):
        loaded["layers"] = [f"{feature}={prefix}" for feature, prefix in loaded["layers"].items()]
    for key, value in loaded.items():
        if value is not None or rows[key].default_for(script) is not None:
            check(f"{path}: {key}", value, rows[key])
    return loaded


def check(name: str, value: Any, option: Option) -> None:
    """ToolError if an option, which is called by `name`, does not take a value."""
    if option.is_list and not isinstance(value, list):
        raise ToolError(f"{name}: {value!r} is not a list", USAGE)
    for v in value if option.is_list else [value]:
        if not option.takes(v):
            raise ToolError(f"{name}: {v!r} is not {option.taken}", USAGE)


def unique_id() -> str:
    """<8 hex digits of unix time>.<host name>.<process>: result and data set names sort by time."""
    return f"{int(time.time()):08x}.{socket.gethostname()}.{os.getpid()}"


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


def derive(script: str, v: dict[str, Any]) -> dict[str, Any]:
    """Fill in what follows from other options, and refuse what cannot be."""
    for key in ("train_data", "valid_data", "input_data", "result"):
        if v.get(key):  # files are called after them: no slash at the end, as shells add it
            v[key] = Path(v[key]).as_posix()
    if "features" in v:
        v["features"] = short_names(v["features"])
        v["main_feature"] = main_feature(v["features"])
        v["aux_features"] = [f for f in v["features"] if f != v["main_feature"]]
    if "layers" in v:
        v["layers"] = parse_layers(v["layers"])
    if v.get("shard"):
        v["shard"] = _shard(v["shard"])
    if v.get("time_budget") is not None:
        v["time_budget"] = seconds(v["time_budget"])
    if v.get("clean_aux") and v.get("aux_results"):
        raise ToolError("--clean_aux and --aux_results exclude each other", USAGE)
    if v.get("best") and v.get("num_epochs"):
        raise ToolError("--best and --num_epochs exclude each other", USAGE)
    if "transfer" in v and v["transfer"] is None:
        lightmap = v.get("filter") == "RTLightmap"
        v["transfer"] = {"hdr": "log" if lightmap else "pu", "ldr": "srgb", "alb": "srgb",
                         "z": "log", "sh1": "linear", "nrm": "linear"}[v["main_feature"]]
    if "train_data" in v and v["train_data"] is None and v.get("valid_data") is None:
        v["train_data"] = "train"
        if not v.get("hold_out") and "valid_data" in v:
            v["valid_data"] = "valid"
    if "model" in v:
        _derive_model(v)
    if "msssim_weights" in v and not v["msssim_weights"] and v.get("filter") == "RT":
        v["msssim_weights"] = list(RT_WEIGHTS)
    if script == "train":
        _derive_rates(v)
    if script in ("train", "find_lr"):
        if v["batch_size"] % v["num_devices"]:
            raise ToolError(f"--batch_size {v['batch_size']} does not divide by "
                            f"--num_devices {v['num_devices']}", USAGE)
        if v["tile_size"] < 16 or v["tile_size"] % 16:
            raise ToolError(f"--tile_size {v['tile_size']}: not a multiple of 16", USAGE)
        if v.get("large_tiles") and v["batch_size"] % (4 * v["num_devices"]):
            raise ToolError(f"--large_tiles: a quarter of --batch_size {v['batch_size']} does not "
                            f"divide by --num_devices {v['num_devices']}", USAGE)
        if v.get("quantize_aware") and (others := sorted({"sh1", "z"} & set(v["features"]))):
            raise ToolError(f"--quantize_aware: there are no integer models of {others[0]}", USAGE)
        if v["seed"] is None:
            v["seed"] = time.time_ns() % (1 << 31)
    if script in ("infer", "export", "visualize") and not v["result"]:
        raise ToolError("--result is missing", USAGE)
    return v


def _derive_model(v: dict[str, Any]) -> None:
    """The model, its family, and what follows from that."""
    from training.nets import find_model
    by_net = MODEL_BY_NET.get(v["net"])
    v["model"] = v["model"] or by_net or MODEL_BY_QUALITY[v["quality"]]
    try:
        net, _ = find_model(v["model"])
    except ValueError as e:
        raise ToolError(str(e), USAGE) from e
    if v["net"] not in (None, net.name):
        raise ToolError(f"--model {v['model']} is not of the topology {v['net']}", USAGE)
    v["net"], v["family"] = net.name, net.family
    v |= {k: x for k, x in BY_FAMILY[net.family].items() if k in v and v[k] is None}
    if net.family == "K":
        other = [f for f in v["features"] if f not in KERNEL_FEATURES]
        if other:
            raise ToolError(f"family K takes {' '.join(KERNEL_FEATURES)}, not "
                            f"{' '.join(v['features'])}", USAGE)
        if v["main_feature"] in LONE:
            if v.get("bilateral"):
                raise ToolError("--bilateral is for colour, not for an albedo or normals alone",
                                USAGE)
            v["transfer"] = "linear"  # the network sees these codes (kernel_model.planes)
    elif v["drop_features"] or v["clip"] or v.get("bilateral"):
        raise ToolError("--drop_features, --clip and --bilateral are options of family K", USAGE)


def _derive_rates(v: dict[str, Any]) -> None:
    if v["max_learning_rate"] is None and v["family"] == "K":
        v["max_learning_rate"] = KERNEL_LR * v["batch_size"] ** 0.5
    elif v["max_learning_rate"] is None:
        rate = LR_PER_SAMPLE.get(v["model"], LR_PER_SAMPLE_DEFAULT)
        v["max_learning_rate"] = rate * v["batch_size"]
    if v["learning_rate"] is None:
        v["learning_rate"] = v["max_learning_rate"] / 25
    if v["num_epochs"] < 1:
        raise ToolError("--num_epochs: not positive", USAGE)


def input_channels(features: list[str]) -> int:
    """Channels of a network input; sh1 is seen three channels at a time."""
    return sum(3 if f == "sh1" else CHANNELS[f] for f in features)


def output_channels(main: str) -> int:
    return 1 if main == "z" else 3
