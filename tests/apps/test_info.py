"""lullInfo: processor, weights, images, comparison."""

from __future__ import annotations

import os
import re
import subprocess

import numpy as np
import pytest

from export import golden_int
from export.quantize import integer_tensors, write_integer
from tests.apps import tools as t


def test_processor_and_ports(info):
    done = info()
    assert done.code == 0 and done.out.startswith("lull ") and "\nCPU: " in done.out
    report = info("--json").json
    ports = {p["name"]: p["available"] for p in report["ports"]}
    assert ports["scalar"] is True and report["cpu"]


def test_ports_are_pinned_by_the_environment(info, monkeypatch):
    monkeypatch.setenv("LULL_PORTS", "scalar")
    ports = info("--json").json["ports"]
    assert [p["name"] for p in ports if p["allowed"]] == ["scalar"]
    assert set(info("--json").json["kernels"].values()) == {"scalar"}
    monkeypatch.delenv("LULL_PORTS")
    assert all(p["allowed"] for p in info("--json").json["ports"])


def test_kernels_are_filled_by_the_strongest_port(info):
    report = info("--json").json
    runs = [p["name"] for p in report["ports"] if p["available"]]
    assert report["kernels"]["conv_int"] == runs[-1]
    rows = (golden_int.ROOT / "lib" / "kernels.def").read_text()
    assert list(report["kernels"]) == re.findall(r"^KERNEL\((\w+)", rows, re.MULTILINE)


def test_memory_of_a_base_network(info, work, monkeypatch):
    """int8, 1920 wide: at most 40 MB, 8 MB row by row without computing anything twice, and height
    changes neither."""
    monkeypatch.setattr(golden_int, "random_weights",  # as good as others, and at once
                        lambda rng, shape, *_: np.zeros(shape, np.int8))
    widths = (32, 32, 48, 64, 80, 96, 96, 112, 112, 96, 96, 64, 64, 64, 32)
    case = golden_int.Case("base", "unet", 16, 16, 9, widths, 7, middle=("dec_conv1a",))
    model = golden_int.random_model(case, golden_int.random_input(case))
    write_integer(work / "base.tza", integer_tensors(model))
    low, high = (info("base.tza", "--json", "-s", 1920, h).json["files"][0] for h in (1080, 8640))
    assert low["integer"] and low["macs_per_pixel"] == 125406
    assert low["plan_bytes"] <= 40e6 and low["plan_streamed_bytes"] <= 8e6
    assert low["plan_minimum_bytes"] < 1.2e6
    for name in ("plan_bytes", "plan_streamed_bytes", "plan_minimum_bytes"):
        assert high[name] <= low[name] + 8192, name  # auto-exposure keeps one number a bin row


@pytest.mark.parametrize("name, kmac", [("kernel5_8", 7.7), ("kernel5_12", 14.2),
                                        ("kernel5_32", 56.4)])
def test_built_in_weights(info, name, kmac):
    report = info(golden_int.ROOT / "weights" / f"{name}.tza", "--json").json["files"][0]
    assert abs(report["macs_per_pixel"] / 1000 - kmac) < 0.05
    assert 1e6 < report["plan_minimum_bytes"] <= report["plan_bytes"] <= 40e6  # it was 0


def test_memory_of_the_balanced_model(info, monkeypatch):
    """At most 10 MB above the images, whichever port runs it (patches took 10.4)."""
    for port in [p["name"] for p in info("--json").json["ports"] if p["available"]]:
        monkeypatch.setenv("LULL_PORTS", port)
        report = info(golden_int.ROOT / "weights" / "kernel5_12.tza", "--json").json["files"][0]
        assert (report["width"], report["height"]) == (1920, 1080)
        assert report["plan_bytes"] <= 10e6, port


def test_shipped_models_are_told_without_files(info):
    """Each with the figures that its file gives, and memory for 1920x1080."""
    root = golden_int.ROOT / "weights"
    names = t.built_in(golden_int.ROOT)
    models = info("--json").json["models"]
    assert [m["file"] for m in models] == names and names
    for m in models:
        from_file = info(root / m["file"], "--json").json["files"][0]
        assert from_file | {"file": m["file"]} == m
        assert (m["width"], m["height"]) == (1920, 1080)
        assert m["file_bytes"] == (root / m["file"]).stat().st_size and m["plan_bytes"] > 1e6
    assert sum(m["file_bytes"] for m in models) <= 900e3
    text = info().out
    assert all(f"{name}: kernel5, " in text for name in names) and "MB of working memory" in text


def test_weights(info, identity):
    report = info(identity[9], "--json", "-s", 640, 480).json["files"][0]
    assert (report["network"], report["inputs"], report["integer"]) == ("unet", 9, False)
    assert report["file_bytes"] == identity[9].stat().st_size
    assert report["plan_bytes"] >= report["plan_minimum_bytes"] > 0
    tall = info(identity[9], "--json", "-s", 640, 4800).json["files"][0]
    assert tall["plan_minimum_bytes"] < 1.05 * report["plan_minimum_bytes"]
    # One layer at full size has 9 input channels, and so on: counted by hand for four channels.
    per_level = [
        9 * 4 + 4 * 4 + (4 + 9) * 4 + 4 * 4 + 4 * 3,
        16 + 32 + 16,
        16 + 32 + 16,
        16 + 32 + 16,
        32,
    ]
    assert report["macs_per_pixel"] == sum(9 * n / 4**i for i, n in enumerate(per_level)) // 1


def test_bad_weights(info, work):
    (work / "bad.tza").write_bytes(b"\xd7\x41\x02\0" + bytes(60))
    done = info("bad.tza")
    assert done.code == 2 and "bad.tza" in done.error


def test_image(info, work):
    image = t.noise(20, 30)
    image[0, 0, 0] = np.nan
    t.write_pfm(work / "in.pfm", image)
    report = info("in.pfm", "--json").json["files"][0]
    assert (report["width"], report["height"], report["channels"]) == (30, 20, 3)
    color = report["color"]
    assert color["nonfinite"] == 1 and color["type"] == "float"
    assert color["min"] == pytest.approx(np.nanmin(image))
    assert color["max"] == pytest.approx(np.nanmax(image))
    assert color["mean"] == pytest.approx(np.nanmean(image), rel=1e-5)
    assert color["hash"] == t.fnv1a(image.tobytes())
    assert "30x20, 3 channels" in info("in.pfm").out


def test_layers_of_an_image(info, work, exr):
    images = t.scene(20, 30)
    channels = t.planes("", images["color"]) | t.planes("albedo.", images["albedo"])
    t.write_exr(work / "in.exr", channels)
    report = info("in.exr", "--json").json["files"][0]
    assert report["albedo"]["layer"] == ["albedo.R", "albedo.G", "albedo.B"]
    assert report["color"]["type"] == "half" and "normal" not in report


def test_compare(info, work):
    reference, image = t.noise(40, 50, seed=1) * 4, t.noise(40, 50, seed=2) * 4
    for name, pixels in ("ref", reference), ("a", image), ("same", reference):
        t.write_pfm(work / f"{name}.pfm", pixels)
    done = info("--compare", "ref.pfm", "a.pfm", "same.pfm", "--json")
    assert done.code == 0
    first, second = done.json["files"]
    luminance = np.sort((reference @ np.float32([0.2127, 0.7152, 0.0722])).ravel())
    scale = 0.8 / luminance[int(0.97 * (luminance.size - 1))]
    shown = [t.srgb_encode(np.clip(x * scale, 0, 1)) for x in (reference, image)]
    psnr = -10 * np.log10(np.mean((shown[0] - shown[1]) ** 2))
    assert first["psnr"] == pytest.approx(psnr, abs=1e-3)
    difference = np.abs(reference - image)
    average = (difference / (reference + image + 0.01)).mean()
    assert first["avgerror"] == pytest.approx(average, rel=1e-4)
    assert (second["errors"], second["avgerror"], second["psnr"]) == (0, 0, None)


def test_compare_errors(info, work):
    t.write_pfm(work / "a.pfm", t.noise(4, 5))
    t.write_pfm(work / "b.pfm", t.noise(4, 6))
    assert info("--compare", "a.pfm", "b.pfm").code == 2
    assert info("--compare", "none.pfm", "b.pfm").code == 2
    assert info("none.pfm").code == 2
    assert "a.pfm" in info("--compare", "a.pfm").error  # and nothing to compare with it
    assert info("--nonsense").code == 1 and info("--help").code == 1


def test_files_without_colour(info, work, exr):
    images = t.scene(20, 30)
    channels = t.planes("albedo.", images["albedo"]) | t.planes("normal.", images["normal"], "XYZ")
    t.write_exr(work / "aux.exr", channels)
    done = info("aux.exr")
    assert done.code == 0 and "aux.exr: 30x20, 3 channels\n" in done.out
    assert "  albedo (albedo.R " in done.out and "  normal (normal.X " in done.out
    report = info("aux.exr", "--json").json["files"][0]
    assert report["width"] == 30 and "color" not in report and report["normal"]["type"] == "half"
    plane = images["albedo"][..., 0]
    t.write_exr(work / "depth.exr", {"depth.Z": plane, "id.a": plane})
    done = info("depth.exr")
    assert done.code == 2 and "no color layer" in done.error


def test_text_that_cannot_be_printed(build, work):
    if not os.path.exists("/dev/full"):
        pytest.skip("optional: no /dev/full")
    t.write_pfm(work / "a.pfm", t.noise(4, 4))
    for command in ("lullInfo", "lullInfo a.pfm", "lullInfo --json", "oidnDenoise a.pfm --check",
                    "oidnDenoise a.pfm", "oidnDenoise --ld", "oidnBenchmark -l",
                    "oidnBenchmark --ld"):
        program, *arguments = command.split()
        with open("/dev/full", "w") as full:
            done = subprocess.run([build / "bin" / program, *arguments], stdout=full,
                                  stderr=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 4 and "standard output" in done.stderr
