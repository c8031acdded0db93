"""The commands that render data sets. Skipped where Mitsuba is missing."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from training.errors import ToolError
from training.imageio import read_image
from training.scan import list_versions
from training.scenes import backend

pytest.importorskip("mitsuba", reason="optional: the package mitsuba is not installed")
try:
    backend.find_llvm()
except ToolError as old:  # in CI a failure
    pytest.skip(str(old), allow_module_level=True)

SEED = "20"
SMALL = ["--size", "16", "--spp", "1,2", "--ref", "4", "--threads", "2"]

SCENE = """<scene version="3.0.0">
 <default name="red" value="0.3"/>
 <integrator type="path"><integer name="max_depth" value="4"/></integrator>
 <sensor type="perspective"><float name="fov" value="45"/>
  <transform name="to_world"><lookat origin="0,-4,1.5" target="0,0,0.5" up="0,0,1"/></transform>
  <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
 </sensor>
 <shape type="rectangle"><transform name="to_world"><scale value="50"/></transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="$red,0.5,0.2"/></bsdf></shape>
 <shape type="sphere"><point name="center" x="0" y="0" z="0.5"/><float name="radius" value="0.5"/>
  <bsdf type="conductor"/></shape>
 <emitter type="constant"/>
</scene>
"""


def command(root: Path, *args) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", f"training.scenes.{args[0]}",
                           *map(str, args[1:])], cwd=root, capture_output=True, text=True,
                          timeout=600)


def one_line(run: subprocess.CompletedProcess, code: int, *words: str) -> None:
    assert run.returncode == code, run.stderr
    assert len(run.stderr.strip().splitlines()) == 1, run.stderr
    for word in words:
        assert word in run.stderr


@pytest.fixture(scope="module")
def rendered(root, tmp_path_factory) -> tuple[Path, subprocess.CompletedProcess]:
    out = tmp_path_factory.mktemp("scenes") / "data"
    run = command(root, "render", out, "--seeds", f"{SEED},21", *SMALL)
    assert run.returncode == 0, run.stderr
    return out, run


def files(folder: Path) -> set[str]:
    return {p.name for p in folder.iterdir()}


def test_files_and_manifest(rendered):
    out, _ = rendered
    assert files(out) == {"render.json", "s00020", "s00021"}
    for name in ("s00020", "s00021"):
        expected = {f"{name}_{n:04d}spp.{k}.exr" for n in (1, 2, 4) for k in ("hdr", "alb", "nrm")}
        assert files(out / name) == expected | {"manifest.json"}
        m = json.loads((out / name / "manifest.json").read_text())
        assert m["noisy"] == [1, 2] and m["target"] == 4 and m["size"] == [16, 16]
        for path in (out / name).glob("*.exr"):
            a = read_image(path)
            assert a.shape == (16, 16, 3) and np.isfinite(a).all()
            if ".alb." in path.name:
                assert a.min() >= 0 and a.max() <= 1
            elif ".nrm." in path.name:
                assert np.linalg.norm(a, axis=-1).max() <= 1.01 and a.std() > 0.05
            else:
                assert a.min() >= 0 and a.mean() > 0


def test_levels_have_noise_of_their_own(rendered):
    out, _ = rendered
    a, b, t = (read_image(out / "s00020" / f"s00020_{n:04d}spp.hdr.exr") for n in (1, 2, 4))
    assert (a != b).mean() > 0.2 and (b != t).mean() > 0.2


def test_finished_scenes_are_skipped(root, rendered):
    out, _ = rendered
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*.exr")}
    run = command(root, "render", out, "--seeds", f"{SEED},21", *SMALL)
    assert run.returncode == 0 and "0 scenes to render, 2 finished before" in run.stdout
    assert before == {p: p.stat().st_mtime_ns for p in out.rglob("*.exr")}


def test_other_options_are_refused(root, rendered):
    out, _ = rendered
    run = command(root, "render", out, "--seeds", "30", *SMALL, "--size", "32")
    one_line(run, 4, "render.json", "size")
    assert not (out / "s00030").exists()


def test_seed_gives_the_same_bytes(root, rendered, tmp_path):
    """In a process of its own, in another shard, after the rest of a killed run."""
    out, _ = rendered
    (tmp_path / ".s00021.tmp1").mkdir()
    run = command(root, "render", tmp_path, "--seeds", f"{SEED}:22", "--shard", "1/2", *SMALL)
    assert run.returncode == 0, run.stderr
    assert files(tmp_path) == {"render.json", "s00021"}
    for path in sorted((out / "s00021").glob("*.exr")):
        a, b = read_image(path), read_image(tmp_path / "s00021" / path.name)
        assert np.array_equal(a, b), path.name


def test_unfinished_scenes_are_no_training_data(rendered, tmp_path):
    out, _ = rendered
    shutil.copytree(out, tmp_path / "data")
    (tmp_path / "data" / "s00020").rename(tmp_path / "data" / ".s00020.tmp77")
    assert set(list_versions(tmp_path / "data")) == {"s00021/s00021"}


def test_features_without_light(root, rendered, tmp_path):
    """Of the same scenes, as far as their light does not decide that they are worth it."""
    out, _ = rendered
    run = command(root, "render", tmp_path, "--seeds", f"{SEED},21", *SMALL[:-4], "--ref", "256",
                  "--threads", "2", "--no_light")
    assert run.returncode == 0, run.stderr
    for name in ("s00020", "s00021"):
        expected = {f"{name}_{n:04d}spp.{k}.exr" for n in (1, 2, 256) for k in ("alb", "nrm")}
        assert files(tmp_path / name) == expected | {"manifest.json"}
        for kind in ("alb", "nrm"):
            one, many = (read_image(tmp_path / name / f"{name}_{n:04d}spp.{kind}.exr")
                         for n in (1, 256))
            assert many.std() > 0.01 and (one != many).any()
            lit = read_image(out / name / f"{name}_0004spp.{kind}.exr")
            assert np.abs(lit - many).mean() < 0.15
    run = command(root, "render", out, "--seeds", SEED, *SMALL, "--no_light")
    one_line(run, 4, "render.json", "no_light")
    run = command(root, "render", tmp_path / "c", *SMALL, "--no_light", "--unaimed", "0.5")
    one_line(run, 2, "--unaimed", "--no_light")
    assert not (tmp_path / "c").exists()


def test_windows_and_unaimed_paths(root, rendered, tmp_path):
    """A part of the frame, with other noise; a share of 0 changes nothing (as `rendered` shows)."""
    out, _ = rendered
    run = command(root, "render", tmp_path, "--seeds", f"{SEED},21", *SMALL, "--windows", "1",
                  "--unaimed", "1")
    assert run.returncode == 0, run.stderr
    for name in ("s00020", "s00021"):
        old, new = (json.loads((p / name / "manifest.json").read_text()) for p in (out, tmp_path))
        assert old["window"] == 1 and 1.5 <= new["window"] <= 5
        assert old["aimed"] is None and new["aimed"] in (None, 0, 1)
        assert new["attempt"] != old["attempt"] or new["layout"] == old["layout"]
        a, b = (read_image(p / name / f"{name}_0004spp.nrm.exr") for p in (out, tmp_path))
        assert not np.array_equal(a, b)


@pytest.mark.parametrize("threads", ["1", "2"])
def test_assets_are_used(root, tmp_path, threads):
    """With one thread, too, with which Mitsuba's reading of EXR never ends."""
    from training.scenes import files as write
    from training.scenes import mesh, shapes
    stock = tmp_path / "stock"
    stock.mkdir()
    mesh.write_ply(str(stock / "ring.ply"), shapes.torus().moved(mesh.scale(40)))
    sky = np.ones((8, 16, 3), np.float32) * (0.2, 0.5, 1.0)
    write.write_exr(stock / "sky.exr", sky)
    run = command(root, "render", tmp_path / "out", "--seeds", SEED, "--assets", stock, *SMALL,
                  "--threads", threads)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "out" / "s00020" / "manifest.json").exists()
    (stock / "bad.ply").write_text("no mesh")
    run = command(root, "render", tmp_path / "new", "--seeds", SEED, "--assets", stock, *SMALL)
    one_line(run, 3, "bad.ply")


@pytest.mark.parametrize("extra, code, word", [
    (["--seeds", "x"], 2, "--seeds"), (["--spp", "8", "--ref", "8"], 2, "--ref"),
    (["--assets", "missing"], 3, "--assets"), (["--shard", "3/2"], 2, "--shard"),
    (["--windows", "2"], 2, "--windows")])
def test_wrong_options(root, tmp_path, extra, code, word):
    run = command(root, "render", tmp_path / "out", *SMALL, "--seeds", SEED, *extra)
    one_line(run, code, word)
    assert not list(tmp_path.rglob("*.exr"))


def test_missing_llvm(root, tmp_path, monkeypatch):
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "libLLVM.so"))
    one_line(command(root, "render", tmp_path / "out", *SMALL), 6, "DRJIT_LIBLLVM_PATH")


def test_llvm_is_new_enough(tmp_path, monkeypatch):
    """The newest is taken; where all are too old Mitsuba would end the process half-way."""
    monkeypatch.setattr(backend, "_LLVM_PLACES", (str(tmp_path / "libLLVM*.so*"),))
    (tmp_path / "libLLVM.so").write_text("")
    assert backend.find_llvm() is None
    for name in ("libLLVM-14.so.1", "libLLVM-15.so"):
        (tmp_path / name).write_text("")
    with pytest.raises(ToolError, match="libLLVM-15.so: too old") as error:
        backend.find_llvm()
    assert error.value.code == 6
    (tmp_path / "libLLVM.so.19.1").write_text("")
    assert backend.find_llvm() == str(tmp_path / "libLLVM.so.19.1")


def test_unwritable_output(root, tmp_path):
    (tmp_path / "file").write_text("")
    one_line(command(root, "render", tmp_path / "file" / "out", *SMALL), 5, "file")


@pytest.fixture(scope="module")
def own_scene(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("own") / "my scene.xml"
    path.write_text(SCENE)
    return path


def test_a_scene_with_an_environment_by_one_thread(root, tmp_path):
    """Mitsuba's reading of EXR never ends with one."""
    from training.scenes import files as write
    write.write_exr(tmp_path / "sky.exr", np.ones((8, 16, 3), np.float32))
    sky = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    scene = SCENE.replace('<emitter type="constant"/>', sky)
    (tmp_path / "open.xml").write_text(scene)
    run = command(root, "render_scene", tmp_path / "open.xml", tmp_path / "out", "--spp", "1",
                  "--ref", "2", "--threads", "1")
    assert run.returncode == 0, run.stderr
    assert files(tmp_path / "out") == {"open"}


def test_own_scene(root, own_scene, tmp_path):
    args = ["render_scene", own_scene, tmp_path, "--spp", "1", "--ref", "2", "--views", "2",
            "-D", "red=0.6", "--threads", "2"]
    run = command(root, *args)
    assert run.returncode == 0, run.stderr
    assert files(tmp_path) == {"my-scene-c0v0", "my-scene-c0v1"}
    albedo = read_image(tmp_path / "my-scene-c0v0" / "my-scene-c0v0_0001spp.alb.exr")
    normal = read_image(tmp_path / "my-scene-c0v0" / "my-scene-c0v0_0001spp.nrm.exr")
    assert albedo.shape == (16, 24, 3)
    assert albedo[15, 0] == pytest.approx([0.6, 0.5, 0.2], abs=1e-3)
    assert normal[15, 0] == pytest.approx([0, 0, 1], abs=1e-3)
    assert albedo[0, 0] == pytest.approx(0, abs=1e-2), "the background"
    other = read_image(tmp_path / "my-scene-c0v1" / "my-scene-c0v1_0001spp.alb.exr")
    assert np.abs(albedo - other).max() > 0.1, "seen from elsewhere"
    again = command(root, *args)
    assert again.returncode == 0 and again.stdout.count("finished before") == 2
    one_line(command(root, *args, "-D", "red=0.2"), 4, "define")
    other = tmp_path / "of another folder" / own_scene.name
    other.parent.mkdir()
    other.write_text(SCENE.replace("conductor", "diffuse"))
    one_line(command(root, "render_scene", other, *args[2:]), 4, "scene")


def test_own_scene_errors(root, own_scene, tmp_path):
    one_line(command(root, "render_scene", tmp_path / "no.xml", tmp_path / "o"), 3, "no.xml")
    broken = tmp_path / "broken.xml"
    broken.write_text("<scene version='3.0.0'><shape type='nonsense'/></scene>")
    one_line(command(root, "render_scene", broken, tmp_path / "o"), 3, "broken.xml")
    run = command(root, "render_scene", own_scene, tmp_path / "o", "--sensors", "3")
    one_line(run, 2, "--sensors")
    assert not list(tmp_path.rglob("*.exr"))
