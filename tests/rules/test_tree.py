"""The tree itself: nothing of anybody's machine in it, nothing large, the limits of house style."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.rules.sources import ROOT, files_of, name_of, tracked_files

FILE_LIMIT = 4 * 1024 * 1024  # bytes of any file
WEIGHTS_LIMIT = 2_000_000  # bytes of all weights
C_LINES, PYTHON_LINES, COLUMNS = 600, 350, 100

# Written in pieces, so that this file does not match itself.
MACHINE = re.compile(r"(^|[^\w.~-])/(" + "|".join(["wo" "rk", "fa" "rm", "ro" "ot", "ho" "me",
                     "opt/ve" "nv", "opt/py" "pi", "opt/whe" "els", "tm" "p"]) + r")/")
HOSTS = re.compile("|".join(["pypi" r"\.org", "python" r"hosted\.org", "download.py" r"torch\.org",
                             "npm" r"js\.(org|com)", "deb.deb" r"ian\.org", "crates" r"\.io",
                             "archive.ub" r"untu\.com", "proxy.go" r"lang\.org"]))


def texts() -> list[tuple[Path, str]]:
    """Tracked files that are text."""
    found = []
    for path in tracked_files():
        raw = path.read_bytes()
        if b"\0" not in raw[:8000]:
            found.append((path, raw.decode("utf-8", errors="replace")))
    assert len(found) > 20
    return found


def hits(pattern: re.Pattern[str]) -> list[str]:
    return [f"{name_of(path)}:{number}: {line.strip()[:100]}" for path, text in texts()
            for number, line in enumerate(text.splitlines(), 1) if pattern.search(line)]


def test_no_paths_of_a_machine():
    found = hits(MACHINE)
    assert not found, "\n".join(found)


def test_no_package_registries():
    found = hits(HOSTS)
    assert not found, "\n".join(found)


def test_no_large_files():
    assert not [name_of(p) for p in tracked_files() if p.stat().st_size > FILE_LIMIT]
    weights = [p for p in tracked_files() if p.suffix == ".tza" and p.parent.name == "weights"]
    assert sum(p.stat().st_size for p in weights) <= WEIGHTS_LIMIT


def test_file_lengths_and_columns():
    wrong = []
    for path, text in texts():
        lines = text.splitlines()
        limit = {".c": C_LINES, ".h": C_LINES, ".py": PYTHON_LINES}.get(path.suffix)
        if limit is None or path.name == "oidn.hpp":
            continue
        if len(lines) > limit:
            wrong.append(f"{name_of(path)}: {len(lines)} lines, {limit} at most")
        wrong += [f"{name_of(path)}:{n}: {len(line)} columns" for n, line in enumerate(lines, 1)
                  if len(line) > COLUMNS]
        if path.suffix in (".c", ".h") and "\t" in text:
            wrong.append(f"{name_of(path)}: tabs")
    assert not wrong, "\n".join(wrong)


def test_all_sources_are_listed():
    """Every C file of the product stands in a sources.mk, and every file listed exists."""
    lists = [p for p in tracked_files() if p.name == "sources.mk"]
    listed = {name for p in lists for name in re.findall(r"[\w/.-]+\.c\b", p.read_text())}
    present = {name_of(p) for p in files_of("lib", "ports", "oidn", "apps", suffixes=(".c",))}
    assert present
    assert not present - listed, "in no sources.mk"
    assert not [name for name in listed if not (ROOT / name).is_file()], "listed but missing"


def test_python_style():
    assert shutil.which("ruff") or (Path(sys.executable).parent / "ruff").exists()
    done = subprocess.run([sys.executable, "-m", "ruff", "check", "--no-cache", "."], cwd=ROOT,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
