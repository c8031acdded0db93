#!/usr/bin/env python3
"""Prints what meson.build needs to know of the source lists, one `NAME words` line for each.

    tests/read_lists.py ROOT

The lists are make assignments (`NAME := words`, `NAME += words`, continued by a backslash, with
`$(NAME)` of a variable above); nothing else of make's language is allowed in them, so that two
builds can read one list.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ASSIGNMENT = re.compile(r"^(\w+)\s*(:=|\+=|=)\s*(.*)$")
REFERENCE = re.compile(r"\$\((\w+)\)")


def read_lists(root: Path) -> dict[str, list[str]]:
    """Variables of all */sources.mk by name."""
    lists: dict[str, list[str]] = {"TESTS": []}
    files = [root / f / "sources.mk" for f in ("lib", "ports", "oidn", "apps")]
    for path in files + sorted(root.glob("tests/*/sources.mk")):
        text = re.sub(r"\\\n", " ", path.read_text())
        for line in text.splitlines():
            line = line.partition("#")[0].strip()
            if not line:
                continue
            match = ASSIGNMENT.match(line)
            if not match:
                raise ValueError(f"{path}: not a plain assignment: {line}")
            name, operator = match[1], match[2]
            words = REFERENCE.sub(lambda m: " ".join(lists.get(m[1], [])), match[3]).split()
            if any("$" in word for word in words):
                raise ValueError(f"{path}: not a plain assignment: {line}")
            lists[name] = (lists.get(name, []) if operator == "+=" else []) + words
    return lists


def main() -> int:
    root = Path(sys.argv[1])
    try:
        lists = read_lists(root)
    except (OSError, ValueError) as error:
        print(f"read_lists: {error}", file=sys.stderr)
        return 1
    config = (root / "oidn/include/OpenImageDenoise/config.h").read_text()
    numbers = [re.search(rf"^#define OIDN_VERSION_{part}\s+(\d+)", config, re.MULTILINE)[1]
               for part in ("MAJOR", "MINOR", "PATCH")]
    lists["OIDN_VERSION"] = [".".join(numbers)]
    for name, pattern in (("TEMPLATES", "oidn/packaging/*.in"), ("MAN_PAGES", "apps/man/*.1"),
                          ("WEIGHTS", "weights/*.tza")):
        lists[name] = [p.relative_to(root).as_posix() for p in sorted(root.glob(pattern))]
    print("\n".join(" ".join([name, *words]) for name, words in lists.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
