"""Layers that oidnDenoise finds in a file: training finds the same."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import OpenEXR
import pytest

from training import split_exr
from training.imageio import read_exr_channels, read_image
from training.layers import find_images

ROLES = {"hdr": "color", "alb": "albedo", "nrm": "normal"}
VIEWS = {"multiView": ["left", "right"]}
ORDER = (["left", "right"], ["right", "left"])


def layer(name: str, components: str = "RGB") -> list[str]:
    return [f"{name}.{c}" if name else c for c in components]


def write(path, *parts: tuple[str, list[str], dict]) -> None:
    """Parts of a file: (name, channels, attributes). No two channels are equal."""
    rng = np.random.default_rng(len(parts))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File([OpenEXR.Part(header | attributes, {
        c: rng.random((24, 40), np.float32) for c in channels}, name)
        for name, channels, attributes in parts]).write(str(path))


def views(name: str, prefix: str, order: list[str]) -> list[tuple[str, list[str], dict]]:
    return [(name.format(layer=title, view=view), layer(prefix.format(layer=title), components),
             {"view": view})
            for title, components in (("VL.Combined", "RGB"), ("VL.Denoising Albedo", "RGB"),
                                      ("VL.Normal", "XYZ")) for view in order]


ONE = {
    "RenderMan": layer("Ci", "rgb") + layer("albedo", "rgb") + layer("Nn", "xyz") + ["Ci.a"],
    "unknown name": layer("Zed") + layer("albedo") + layer("N", "XYZ"),
    "not Cryptomatte": layer("CryptoObject00", "rgb") + layer("Foo", "rgb") + layer("albedo"),
    "not motion": layer("Vector", "XYZ") + layer("velocity") + layer("Shaded"),
    "no XYZ": layer("P", "XYZ") + layer("Shaded"),
    "nested": layer("Foo.Diffuse") + layer("Foo") + layer("Foo.N", "XYZ"),
    "grey": ["Y", "A"] + layer("albedo") + layer("N", "XYZ"),
    "grey by another name": ["luminance", "Z"], "R and G": ["R", "G"], "one": ["shade"],
    "red green blue": [f"v.{c}" for c in ("red", "green", "blue")],
}
STEREO = {
    "blender": [("", [c for n, k in (("VL.Combined", "RGB"), ("VL.Denoising Albedo", "RGB"),
                                     ("VL.Normal", "XYZ")) for v in ("left", "right")
                      for c in layer(f"{n}.{v}", k)], VIEWS)],
    "plain": [("", layer("") + layer("right") + layer("albedo.left") + layer("albedo.right")
               + layer("N.right", "XYZ") + layer("N.left", "XYZ"), VIEWS)],
    "second first": [("", layer("VL.Combined.left") + layer("VL.Combined.right")
                      + layer("albedo.left") + layer("albedo.right"), {"multiView": ORDER[1]})],
    "parts of views": [(f"{n}{v}", layer(""), {"view": v})
                       for n in ("", "albedo.") for v in ("left", "right")],
    **{f"{name}, {order[0]} first": views(name, prefix, order) for order in ORDER
       for name, prefix in (("{layer}-{view}", "{layer}"), ("{layer}_{view}", "{layer}"),
                            ("{layer}.{view}", ""), ("{view}.{layer}", ""))},
}
FILES = {k: [("", names, {})] for k, names in ONE.items()} | STEREO


@pytest.mark.parametrize("kind", FILES)
def test_layers_are_those_of_the_programs(tmp_path, build, kind):
    program = build / "bin" / "oidnDenoise"
    if not program.exists():
        pytest.skip("optional: the programs are not built")
    write(tmp_path / "a_4.exr", *FILES[kind])
    done = subprocess.run([program, "--check", "--json", tmp_path / "a_4.exr"],
                          capture_output=True, text=True)
    told = json.loads(done.stdout)
    if "color" not in told:
        pytest.skip("optional: the programs do not read EXR")
    channels = read_exr_channels(tmp_path / "a_4.exr")
    for feature, role in ROLES.items():
        names = find_images(feature, channels) or ()
        want = told.get(role, {}).get("layer", [])
        if len(FILES[kind]) == 1:
            assert list(names) == want
        else:  # the program's are names in the part
            assert [n.rpartition(".")[2] for n in names] == [n.rpartition(".")[2] for n in want]
    read_image(tmp_path / "a_4.exr")


@pytest.mark.parametrize("kind", STEREO)
def test_a_view_goes_together(tmp_path, kind):
    """The default view, and the one of the colour that was chosen."""
    write(tmp_path / "a_4.exr", *STEREO[kind])
    channels = read_exr_channels(tmp_path / "a_4.exr")
    attributes = STEREO[kind][0][2]
    default = attributes.get("multiView", [attributes.get("view")])[0]
    other = "left" if default == "right" else "right"
    colors = [(default, {})]
    if any(f"Combined.{other}.R" in name for name in channels):
        colors.append((other, {"hdr": f"VL.Combined.{other}"}))
    for view, chosen in colors:
        found = {f: find_images(f, channels, chosen) for f in ROLES}
        assert found["hdr"]
        names = [n for f in found.values() for n in f or ()]
        shown = {v for v in ("left", "right") for n in names if v in n}
        assert shown <= {view}, found
        assert kind in ("second first", "parts of views") or all(found.values())


def test_stereo_files_are_split(tmp_path, capsys):
    """The default view; --layer takes the other one."""
    write(tmp_path / "a.exr", *STEREO["blender"])
    channels = read_exr_channels(tmp_path / "a.exr")
    for args, view in ([], "left"), (["--layer", "VL"], "left"), (["--layer", "right.VL"], "right"):
        split_exr.main([str(tmp_path / "a.exr"), *args])
        for feature, name in ("hdr", "VL.Combined"), ("nrm", "VL.Normal"):
            image = read_image(tmp_path / f"a.{feature}.exr")
            red = "XR"[feature == "hdr"]
            assert np.array_equal(image[..., 0], channels[f"{name}.{view}.{red}"])
    split_exr.main([str(tmp_path / "a.exr"), "--layer", "VL.Combined.right"])
    assert "Not found: a alb nrm z" in capsys.readouterr().out
