"""The package of python/, on the library of the build under test."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.apps.tools import scene


@pytest.fixture(scope="session")
def library(build: Path) -> Path:
    names = ("libOpenImageDenoise.so.2", "libOpenImageDenoise.2.dylib", "OpenImageDenoise.dll")
    found = [build / "lib" / n for n in names if (build / "lib" / n).exists()]
    assert found, f"no shared library in {build / 'lib'}"
    return found[0]


@pytest.fixture(scope="session")
def lull(root: Path, library: Path) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LULL_LIBRARY", str(library))
        spec = importlib.util.spec_from_file_location("lull", root / "python/lull/__init__.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules["lull"] = module
        spec.loader.exec_module(module)
        module.load_library()
    return module


@pytest.fixture(scope="module")
def frame() -> dict[str, np.ndarray]:
    return {k: v for k, v in scene(90, 120).items() if k != "clean"}


@pytest.fixture(scope="module")
def clean(lull, frame) -> np.ndarray:
    """The frame, denoised."""
    return lull.denoise(**frame, hdr=True)
