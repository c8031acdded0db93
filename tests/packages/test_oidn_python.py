"""The Python package oidn (PyPI, made for OIDN 1.4.3) with this library in the place of the one it
brings, which it loads from its own folder."""
from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.apps import tools

SPEC = importlib.util.find_spec("oidn") if sys.platform == "linux" else None
FOUND = SPEC and SPEC.origin  # a folder of that name without a module is none
pytestmark = pytest.mark.skipif(not FOUND, reason="optional: the package oidn is not installed")

SCRIPT = """
import sys
import numpy as np
import oidn
images = np.load(sys.argv[1])
h, w, _ = images["color"].shape
device = oidn.NewDevice()
oidn.CommitDevice(device)
rt = oidn.NewFilter(device, "RT")
kept = {name: np.ascontiguousarray(images[name]) for name in ("color", "albedo", "normal")}
kept["output"] = np.zeros((h, w, 3), np.float32)
for name, image in kept.items():
    oidn.SetSharedFilterImage(rt, name, image, oidn.FORMAT_FLOAT3, w, h)
oidn.CommitFilter(rt)
oidn.ExecuteFilter(rt)
assert oidn.GetDeviceError(device) == 0
oidn.ReleaseFilter(rt)
oidn.ReleaseDevice(device)
np.save(sys.argv[2], kept["output"])
"""


def test_the_package_denoises_with_it(build: Path, tmp_path: Path):
    shutil.copytree(Path(FOUND).parent, tmp_path / "oidn",
                    ignore=shutil.ignore_patterns("*.so*", "__pycache__"))
    folder = tmp_path / "oidn" / "lib.linux.x64"
    folder.mkdir(exist_ok=True)
    shutil.copy(build / "lib" / "libOpenImageDenoise.so", folder / "libOpenImageDenoise.so.1.4.3")
    images = tools.scene()
    images["color"] = images["color"].clip(0, 1)  # the package has no way to say `hdr`
    np.savez(tmp_path / "in.npz", **images)
    env = {**os.environ, "PYTHONPATH": str(tmp_path), "OIDN_VERBOSE": "2"}
    done = subprocess.run([sys.executable, "-c", SCRIPT, tmp_path / "in.npz", tmp_path / "out.npy"],
                          cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "Network: kernel5" in done.stdout + done.stderr, done.stderr
    clean = images["clean"].clip(0, 1)
    before, after = (np.square(x - clean).mean()
                     for x in (images["color"], np.load(tmp_path / "out.npy")))
    assert after < 0.25 * before
