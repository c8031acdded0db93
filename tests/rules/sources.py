"""Shared by the rule tests: the files of the project and how to compile one."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
CC = os.environ.get("CC", "cc")


def tracked_files() -> list[Path]:
    """Files of the project: what git tracks, or (in a release archive) everything but builds."""
    if (ROOT / ".git").exists() and shutil.which("git"):
        listed = subprocess.run(
            ["git", "-c", f"safe.directory={ROOT}", "ls-files", "-z"],
            cwd=ROOT, capture_output=True, text=True, check=True).stdout
        files = [ROOT / name for name in listed.split("\0") if name]
    else:
        files = [p for p in ROOT.rglob("*") if p.relative_to(ROOT).parts[0] != "build"
                 and "__pycache__" not in p.parts]
    return [p for p in files if p.is_file()]


def files_of(*folders: str, suffixes: tuple[str, ...]) -> list[Path]:
    """Tracked files below these folders with one of these endings."""
    tops = [ROOT / f for f in folders]
    return [p for p in tracked_files()
            if p.suffix in suffixes and any(t in p.parents for t in tops)]


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def compile_text(text: str, *flags: str, compiler: str = CC) -> str:
    """Diagnostics of compiling `text` with these flags; empty if it is accepted."""
    done = subprocess.run([compiler, *flags, "-fsyntax-only", "-"], input=text, cwd=ROOT,
                          capture_output=True, text=True)
    return "" if done.returncode == 0 and not done.stderr else done.stderr or "failed"
