"""Raw data sets: which files belong together, which one is the reference, what does not fit.

Naming scheme (Open Image Denoise's): `<group>_<version>.<feature>.<ext>`, where version is a
sample count (`4`, `0004`, `4spp`) or one of ref, reference, gt, target; feature is hdr, ldr,
sh1x/y/z, alb, nrm or z. Ours in addition: a seed (`<group>_4spp_s2.hdr.exr`), other formats than
EXR, and files with all features as layers (`<group>_4spp.exr`). All versions of a group share a
folder. Links to folders are followed, but no folder is read twice.
"""
from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from training.errors import DATA, ToolError

FEATURES = ("hdr", "ldr", "sh1", "alb", "nrm", "z")  # order of the channels in a network input
MAIN_FEATURES = ("hdr", "ldr", "sh1")
ALIASES = {"albedo": "alb", "normal": "nrm", "depth": "z"}
CHANNELS = {"hdr": 3, "ldr": 3, "sh1": 9, "alb": 3, "nrm": 3, "z": 1}
REFERENCE_WORDS = ("gt", "ref", "reference", "target")
EXTENSIONS = ("exr", "pfm", "phm", "hdr", "png")

_SPLIT = re.compile(
    r"(?P<stem>.+?)(?:\.(?P<feature>hdr|ldr|sh1[xyz]|alb|nrm|z|a))?\.(?P<ext>"
    + "|".join(EXTENSIONS) + ")", re.I)
_VERSION = re.compile(
    r"(?P<group>.+)_(?P<version>\d+(?:spp)?|" + "|".join(REFERENCE_WORDS)
    + r")(?:_s(?P<seed>\d+))?", re.I)
NO_NAME = "name is not <picture>_<version>[.<feature>]"
NO_UTF8 = "name is not UTF-8"
NO_FEATURE = "no feature in the name, and no EXR with layers"


@dataclass
class Version:
    """One render of a group: `name` is its path in the data set without feature and extension."""

    name: str
    spp: int | None  # None: reference by word, or no version suffix at all
    word: str | None
    seed: int = 0
    files: dict[str, Path] = field(default_factory=dict)  # feature, or `*` for a multichannel file

    @property
    def order(self) -> tuple:
        """Ascending quality: counts by value, then reference words."""
        return (self.word is not None, self.spp or 0, self.word or "", self.seed)

    def missing(self, features: list[str]) -> list[str]:
        """Features without a file (a multichannel file is taken to hold all until it is read)."""
        if "*" in self.files:
            return []
        parts = [p for f in features for p in (("sh1x", "sh1y", "sh1z") if f == "sh1" else (f,))]
        return [p for p in parts if p not in self.files]


@dataclass
class Group:
    """Renders of one picture: noisy `inputs`, best last, and the `target`, if there is one."""

    name: str
    inputs: list[Version]
    target: Version | None


@dataclass
class Scan:
    """A data set folder: its groups, and what was left out and why."""

    root: Path
    groups: list[Group]
    left_out: list[tuple[str, str]]  # (name, reason)

    def summary(self) -> list[str]:
        """Lines for people: counts, sample-count histogram, what was left out."""
        spp = Counter(v.spp for g in self.groups for v in g.inputs)
        ref = Counter(g.target.word or f"{g.target.spp}spp" for g in self.groups if g.target)
        pairs = sum(len(g.inputs) for g in self.groups if g.target)
        lines = [f"{self.root}: {len(self.groups)} groups, {pairs} (input, target) pairs",
                 "  inputs by samples per pixel: " + _histogram(spp),
                 "  targets: " + _histogram(ref)]
        reasons = Counter(reason for _, reason in self.left_out)
        for reason, count in sorted(reasons.items()):
            example = next(n for n, r in self.left_out if r == reason)
            lines.append(f"  left out: {count} x {reason} (e.g. {example})")
        return lines


def _histogram(counts: Counter) -> str:
    keys = sorted(counts, key=lambda k: (k is None, k))
    return ", ".join(f"{'?' if k is None else k}: {counts[k]}" for k in keys) or "none"


def list_files(root: Path) -> Iterator[Path]:
    """The files below `root` but hidden ones, which are still being written; each folder once,
    however many links lead to it (one upwards would lead there again and again)."""
    seen = set()
    for folder, folders, files in os.walk(root, followlinks=True):
        if (real := os.path.realpath(folder)) in seen:
            folders.clear()
            continue
        seen.add(real)
        links_last = sorted((os.path.islink(os.path.join(folder, f)), f) for f in folders)
        folders[:] = [f for _, f in links_last if not f.startswith(".")]
        yield from (Path(folder) / f for f in files if not f.startswith("."))


def read_names(root: Path) -> tuple[dict[str, list[Version]], list[tuple[str, str]]]:
    """(every render below `root` by group name (a path relative to root), in file name order; files
    that look like renders but for their names, and why they are left out)."""
    if not root.is_dir():
        raise ToolError(f"{root}: no such data set folder", DATA)
    groups: dict[str, dict[str, Version]] = {}
    left_out = []
    for path in sorted(list_files(root)):
        split = _SPLIT.fullmatch(path.name)
        if not split:
            continue
        kind = split["ext"].lower()
        match = _VERSION.fullmatch(split["stem"])
        feature = (split["feature"] or "*").lower()
        folder = path.parent.relative_to(root)
        shown = (folder / path.name).as_posix()
        escaped = shown.encode("utf-8", "backslashreplace").decode()
        if escaped != shown:  # no file of ours could hold it
            left_out.append((escaped, NO_UTF8))
            continue
        if feature == "a":  # alpha, as split_exr writes it: nothing is trained on it
            continue
        if feature == "*" and not (match and kind == "exr"):
            if kind != "png":  # those without a feature are previews
                left_out.append((shown, NO_FEATURE if match else NO_NAME))
            continue
        name = (folder / split["stem"]).as_posix()
        group = group_of(name)
        version = groups.setdefault(group, {}).get(name)
        if version is None:
            text = match["version"].lower() if match else ""
            digits = re.match(r"\d+", text)
            version = Version(name, int(digits[0]) if digits else None,
                              text if text in REFERENCE_WORDS else None,
                              int(match["seed"] or 0) if match else 0)
            groups[group][name] = version
        known = version.files.get(feature)
        if known is None or EXTENSIONS.index(kind) < EXTENSIONS.index(known.suffix[1:].lower()):
            version.files[feature] = path
    return {g: list(v.values()) for g, v in groups.items()}, left_out


def group_of(version: str) -> str:
    """The name of the group that a version is of, both relative to the data set."""
    folder, slash, stem = version.rpartition("/")
    match = _VERSION.fullmatch(stem)
    return folder + slash + (match["group"] if match else stem)


def list_versions(root: Path) -> dict[str, list[Version]]:
    """Every render below `root`, as of read_names."""
    return read_names(root)[0]


def scan(root: Path, features: list[str], target_features: list[str] | None = None,
         need_target: bool = True) -> Scan:
    """The groups of a data set that hold `features`; the target only needs `target_features`.

    The reference of a group is the version with a reference word, else the highest sample count.
    Incomplete versions are left out one by one and listed, not with their whole group; so are files
    of other names.
    """
    target_features = target_features or features[:1]
    groups = []
    renders, left_out = read_names(root)
    for name, versions in renders.items():
        versions = sorted(versions, key=lambda v: v.order)
        target = versions.pop() if len(versions) > 1 or versions[0].word else None
        if target is not None and target.missing(target_features):
            lacks = " ".join(target.missing(target_features))
            left_out.append((target.name, f"reference lacks {lacks}"))
            target = None
            if need_target:
                continue
        inputs = []
        for v in versions:
            if v.missing(features):
                left_out.append((v.name, f"lacks {' '.join(v.missing(features))}"))
            else:
                inputs.append(v)
        if need_target and target is None:
            left_out.append((name, "no reference (a single version)"))
        elif not inputs:
            left_out.append((name, "no complete noisy version"))
        else:
            groups.append(Group(name, inputs, target))
    return Scan(root, groups, left_out)


def hold_out(names: Iterable[str], count: int) -> set[str]:
    """Which of the groups of a data set, by name, are held out of a training: `count` of them
    spread evenly over the order of their files, but no more than half. It depends on nothing else:
    all that can be scanned count, whether they can be read or not."""
    ordered = sorted(names, key=lambda n: f"{n}_".split("/"))
    count = min(count, len(ordered) // 2)
    places = (round((i + 0.5) * len(ordered) / count) for i in range(count))
    return {ordered[min(i, len(ordered) - 1)] for i in places}
