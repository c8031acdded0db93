"""Command-line options that the scene commands share, and their values."""

from __future__ import annotations

import argparse
import json
import os
import re

from training import errors
from training.errors import DATA, OUTPUT, STATE, USAGE, ToolError


def parser(module: str, description: str, size: int, spp: str, pick: int
           ) -> argparse.ArgumentParser:
    """A parser of OUT and of what every maker of pictures takes; size, spp, pick: defaults."""
    p = errors.Parser(prog=module, description=description)
    p.add_argument("out", metavar="OUT", help="folder of the data set; made if missing")
    p.add_argument("--seeds", default="0:100", help="0:500 (end excluded), 7, or 3,7,20:40")
    p.add_argument("--size", default=str(size), help="pixels: 256 or 320x208 (width x height)")
    p.add_argument("--spp", default=spp, help="sample counts of the noisy images")
    p.add_argument("--pick", type=int, default=pick, metavar="N",
                   help="how many of the counts a picture gets, drawn per seed (0 = all)")
    p.add_argument("--shard", default="0/1", metavar="i/n",
                   help="the i-th of n shares of the seeds, i from 0")
    p.add_argument("--bits", default="10,10", metavar="N,T",
                   help="mantissa bits kept in noisy files and targets (fewer = smaller files)")
    return p


def check(args: argparse.Namespace, least: int = 8) -> list[int]:
    """Seeds of this shard; raises ToolError where a common option is wrong.

    least: of width and height.
    """
    seeds = shard(seed_list(args.seeds), args.shard)
    bit_pair(args.bits)
    count_list(args.spp, "--spp")
    if min(size_pair(args.size)) < least:
        raise ToolError(f"--size must be at least {least}", USAGE)
    if args.pick < 0:
        raise ToolError("--pick must be at least 0", USAGE)
    return seeds


def make_folder(out: str) -> None:
    """OUT, made if missing."""
    try:
        os.makedirs(out, exist_ok=True)
    except OSError as err:
        raise ToolError(f"{out}: {err.strerror}", OUTPUT) from None


def unfinished(out: str, seeds: list[int], letter: str, noun: str,
               wanted: dict | None = None) -> list[int]:
    """Those of the seeds whose group (letter and number) OUT does not hold; says how many."""
    todo = [s for s in seeds if not is_finished(out, f"{letter}{s:05d}", wanted or {})]
    print(f"{len(todo)} {noun}, {len(seeds) - len(todo)} finished before", flush=True)
    return todo


def kept(args: argparse.Namespace) -> dict:
    """The options that decide what a seed gives."""
    return {k: v for k, v in vars(args).items() if k not in ("out", "seeds", "shard")}


def is_finished(out: str, group: str, wanted: dict) -> bool:
    """Whether OUT holds a group; ToolError if it was made with other options than `wanted`, which
    its manifest keeps as "options" (older ones do not)."""
    path = os.path.join(out, group, "manifest.json")
    try:
        with open(path) as f:
            had = json.load(f).get("options", wanted)
    except FileNotFoundError:
        return False
    except (OSError, ValueError, AttributeError) as err:
        raise ToolError(f"{path}: cannot read ({err})", DATA) from None
    check_same(path, "group was made", had, wanted)
    return True


def check_same(path: str, made: str, had: dict, wanted: dict) -> None:
    """ToolError unless what a file says has the options that are wanted; made: of what, how."""
    for k, v in wanted.items():
        if had.get(k) != v:
            raise ToolError(f"{path}: this {made} with {k} = {had.get(k)}, not {v}; use another "
                            "OUT", STATE)


def seed_list(text: str) -> list[int]:
    """"0:500" (end excluded), "7" or "1,5,9:12" to a sorted list."""
    out: set[int] = set()
    try:
        for part in text.split(","):
            a, _, b = part.partition(":")
            out |= set(range(int(a), int(b))) if b else {int(a)}
    except ValueError:
        raise ToolError(f"--seeds: cannot read {text!r} (wanted: 0:500 or 1,5,9:12)",
                        USAGE) from None
    if not out or min(out) < 0 or max(out) > 9_999_999:
        raise ToolError(f"--seeds: {text!r} is empty or outside 0..9999999", USAGE)
    return sorted(out)


def count_list(text: str, option: str, least: int = 1) -> list[int]:
    """"1,2,4" to a sorted list of integers >= least."""
    try:
        out = sorted({int(x) for x in text.split(",")})
    except ValueError:
        raise ToolError(f"{option}: cannot read {text!r} (wanted: 1,2,4,8)", USAGE) from None
    if out[0] < least:
        raise ToolError(f"{option}: {text!r} holds a count below {least}", USAGE)
    return out


def bit_pair(text: str) -> tuple[int, int]:
    """"6,8" to mantissa bits of noisy files and of targets."""
    try:
        a, b = (int(x) for x in text.split(","))
    except ValueError:
        a = b = 0
    if not (2 <= a <= 10 and 2 <= b <= 10):
        raise ToolError(f"--bits: cannot read {text!r} (wanted: two of 2..10, as 6,8)", USAGE)
    return a, b


def plain(name: str) -> str:
    """A name as a part of names of groups: letters, digits and dashes."""
    return re.sub(r"[^A-Za-z0-9-]+", "-", name)


def shard(items: list, text: str) -> list:
    """Every n-th item beginning with the i-th, of "i/n"."""
    try:
        i, n = (int(x) for x in text.split("/"))
    except ValueError:
        raise ToolError(f"--shard: cannot read {text!r} (wanted: i/n, i from 0)", USAGE) from None
    if not 0 <= i < n:
        raise ToolError(f"--shard: {text!r} must have 0 <= i < n", USAGE)
    return items[i::n]


def size_pair(text: str) -> tuple[int, int]:
    """"640x480" or "256" to width and height."""
    try:
        a, x, b = text.partition("x")
        w, h = int(a), int(b if x else a)
    except ValueError:
        w = h = 0
    if not (8 <= w <= 16384 and 8 <= h <= 16384):
        raise ToolError(f"--size: cannot read {text!r} (wanted: 256 or 640x480, at least 8)", USAGE)
    return w, h
