"""`pip install ./python`: the wheel, and the package that it installs."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.apps.tools import scene

CODE = """
import sys, numpy, lull
images = numpy.load("frame.npz")
numpy.save("out.npy", lull.denoise(images["color"], images["albedo"], images["normal"], hdr=True))
print(lull.__file__)
"""


@pytest.fixture(scope="module")
def wheel(root: Path, build: Path, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    done = subprocess.run([sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", folder,
                           root / "python"], capture_output=True, text=True,
                          env={**os.environ, "BUILD": str(build.resolve().relative_to(root))
                               if build.resolve().is_relative_to(root) else str(build.resolve())})
    if done.returncode and "setuptools" in done.stderr and "make" not in done.stderr:
        pytest.skip("optional: pip does not get setuptools here")
    assert done.returncode == 0, done.stderr
    (made,) = folder.glob("*.whl")
    return made


def test_wheel(wheel, library, version):
    name, own, *tag = wheel.stem.split("-")
    assert (name, tag[:2]) == ("lull", ["py3", "none"]) and tag[2] != "any"
    assert own == version
    with zipfile.ZipFile(wheel) as z:
        files = {n for n in z.namelist() if n.startswith("lull/")}
        assert files == {"lull/__init__.py", "lull/native.py", f"lull/{library.name}"}
        assert z.read(f"lull/{library.name}") == library.read_bytes()
    assert wheel.stat().st_size < 1_500_000


def test_installed_package(lull, wheel, tmp_path):
    subprocess.run([sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "-q",
                    "--target", tmp_path / "site", wheel], check=True)
    frame = {k: v for k, v in scene(64, 80).items() if k != "clean"}
    np.savez(tmp_path / "frame.npz", **frame)
    env = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    env.pop("LULL_LIBRARY", None)
    done = subprocess.run([sys.executable, "-c", CODE], cwd=tmp_path, env=env, capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()) == tmp_path / "site" / "lull" / "__init__.py"
    assert np.array_equal(np.load(tmp_path / "out.npy"), lull.denoise(**frame, hdr=True))
