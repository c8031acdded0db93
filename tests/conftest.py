"""Fixtures that every folder of tests may use."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def root() -> Path:
    """Top of the tree."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def version(root: Path) -> str:
    """Of the library, as its header says."""
    header = (root / "lib" / "lull.h").read_text()
    return ".".join(re.findall(r"define LULL_VERSION_\w+ (\d+)", header))


@pytest.fixture(scope="session")
def build(root: Path) -> Path:
    """Build folder under test: what tests/run.py was given, or build/."""
    return Path(os.environ.get("LULL_BUILD", root / "build"))
