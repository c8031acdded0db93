"""Parsing of command-line values that the scene commands share."""

from __future__ import annotations

from training.errors import USAGE, ToolError


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
