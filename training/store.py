"""Preprocessed data sets: <preproc_dir>/<data set>.<uid>/{images.tza,samples.json,config.json}.

images.tza holds one fp16 tensor [H,W,C] per image (network codes, layout hwc), samples.json the
pairs [input name, target name], config.json the settings; config.json is written last, so a folder
without it is incomplete and never used. Both toolkits read each other's sets. A set made with
--shard i/n is n folders, <data set>.<uid>.<i>of<n>. Ours say the name of the data set as `data` in
config.json, as names may have dots, and as `left_out` which of its groups could not be read.
"""
from __future__ import annotations

import glob
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from export.tza import Reader, TzaError
from training.data import Picture
from training.errors import STATE, ToolError
from training.features import main_feature
from training.scan import FEATURES, group_of
from training.settings import Settings

_SHARD = re.compile(r"(?P<key>.+)\.(?P<i>\d+)of(?P<n>\d+)")
_UID = re.compile(r"[0-9a-f]{8}\..+")  # settings.unique_id, and that of a shard


@dataclass(frozen=True)
class Stored:
    """A complete data set on disk: its folders (more than one if it was sharded) and settings."""

    folders: tuple[Path, ...]
    config: dict[str, Any]
    left_out: tuple[str, ...] = ()  # groups that could not be read

    @property
    def features(self) -> list[str]:
        return [f for f in FEATURES if f in self.config["features"]]

    @property
    def made(self) -> tuple[int, str]:
        """When it was complete, in ns; of equal ones the names tell."""
        times = [(f / "config.json").stat().st_mtime_ns for f in self.folders]
        return max(times), self.folders[0].name


def list_stored(preproc_dir: Path, name: str) -> tuple[list[Stored], list[str]]:
    """(complete sets called `name`, remarks on incomplete ones)."""
    sets: dict[str, dict[int, tuple[Path, dict]]] = {}
    counts: dict[str, int] = {}
    remarks = []
    for folder in sorted(preproc_dir.glob(f"{glob.escape(name)}.*")):
        if not (folder / "config.json").is_file():
            continue
        try:
            config = {"clean_aux": False, "aux_results": [],
                      **json.loads((folder / "config.json").read_text())}
        except (OSError, ValueError, TypeError) as e:
            remarks.append(f"{folder}: unreadable config.json ({e})")
            continue
        if not _is_of(folder, config, name):
            continue
        shard = _SHARD.fullmatch(folder.name)
        key = shard["key"] + f" in {shard['n']} shards" if shard else folder.name
        sets.setdefault(key, {})[int(shard["i"]) if shard else 0] = folder, config
        counts[key] = int(shard["n"]) if shard else 1
    stored = []
    for key, parts in sets.items():
        missing = [i for i in range(counts[key]) if i not in parts]
        if missing:
            remarks.append(f"{key}: shards {missing} are missing")
            continue
        paths = tuple(parts[i][0] for i in sorted(parts))
        left_out = [n for _, config in parts.values() for n in config.get("left_out", [])]
        stored.append(Stored(paths, parts[0][1], tuple(left_out)))
    return stored, remarks


def _is_of(folder: Path, config: dict[str, Any], name: str) -> bool:
    """Whether a folder <name>.* is of the data set `name`, not of one that is called <name>.more;
    where config.json does not say so (Open Image Denoise's), by what follows the name."""
    if "data" in config:
        return config["data"] == name
    return bool(_UID.fullmatch(folder.name.removeprefix(f"{Path(name).name}.")))


def find_stored(settings: Settings, name: str) -> Stored:
    """The data set that serves a training: same main feature, transfer and aux treatment, at least
    its features; of several the one of fewest channels, then the newest."""
    root = Path(settings.preproc_dir)
    stored, remarks = list_stored(root, name)
    fits = []
    for s in stored:
        c = s.config
        if (main_feature(s.features) == settings.main_feature
                and set(settings.features) <= set(s.features)
                and bool(c["clean_aux"]) == bool(settings.clean_aux)
                and c.get("transfer") == settings.transfer
                and set(settings.aux_results) <= set(c["aux_results"])
                and bool(settings.aux_results) == bool(c["aux_results"])):
            fits.append(s)
    if not fits:
        found = [f"{s.folders[0].name} ({' '.join(s.features)}, {s.config.get('transfer')})"
                 for s in stored]
        detail = "; ".join(found + remarks) or "none of that name"
        raise ToolError(f"no matching preprocessed data set '{name}' in {root} for "
                        f"{' '.join(settings.features)} ({detail})", STATE)
    fewest = min(len(s.features) for s in fits)
    return max((s for s in fits if len(s.features) == fewest), key=lambda s: s.made)


def read_pictures(stored: Stored, features: list[str], main: str,
                  clean_aux: bool) -> list[Picture]:
    """Groups of a stored data set with the channels of `features`; arrays are memory mapped, but
    for features that do not follow each other (hdr and nrm of hdr, alb and nrm), which are read."""
    full = [(f, 9 if f == "sh1" else 1 if f == "z" else 3) for f in stored.features]
    keep, at = [], 0
    for f, n in full:
        keep += range(at, at + n) if f in features else []
        at += n
    main_count = dict(full)[main]
    pictures: dict[str, Picture] = {}
    for folder in stored.folders:
        try:
            images = Reader(folder / "images.tza")
            pairs = json.loads((folder / "samples.json").read_text())
            for source, target in pairs:
                picture = pictures.setdefault(target, Picture(group_of(target), [], [], _pick(
                    images[target], keep, at, main_count), target_spp=_spp(target, math.inf)))
                picture.inputs.append(_pick(images[source], keep, at, main_count))
                picture.weights.append(_spp(source, 1.0))
                picture.names.append(source)
        except (OSError, TzaError, ValueError, KeyError, IndexError) as e:
            raise ToolError(f"{folder}: damaged data set ({e})", STATE) from e
    return list(pictures.values())


def _pick(image: np.ndarray, keep: list[int], full: int, main_count: int) -> np.ndarray:
    """The wanted channels; an image without aux channels has main_count of them."""
    channels = image.shape[-1]
    if channels == len(keep) == full:
        return image
    if channels == full:
        first = len(keep)
        return image[..., :first] if keep == list(range(first)) else image[..., keep]
    if channels == main_count:
        return image
    raise ValueError(f"an image of {channels} channels where {main_count} or {full} belong")


def _spp(name: str, unknown: float) -> float:
    match = re.search(r"_(\d+)(?:spp)?(?:_s\d+)?$", name, re.I)
    return float(match[1]) if match else unknown
