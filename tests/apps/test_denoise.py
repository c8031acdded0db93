"""oidnDenoise: options, result lines, comparisons, JSON."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.apps import tools as t
from tests.apps.tools import ALL

H, W = 48, 64  # of the fixture frame


WEIGHTS = Path(__file__).parents[2] / "weights"


def test_result_lines(denoise, identity, frame):
    done = denoise(*ALL, "-w", identity[9], "-o", "out.pfm", "-n", 3)
    assert (done.code, done.err) == (0, "")
    number = r"[0-9.e+-]+"
    expected = (
        rf"Initializing device\n  device=CPU, version=\d+\.\d+\.\d+, msec={number}\n"
        rf"Loading input\nResolution: {W}x{H}\n"
        rf"Initializing filter\n  filter=RT, msec={number}\n"
        rf"(Denoising\n  msec={number}, hash=([0-9a-f]{{8}})\n){{3}}"
        rf"Saving output\n"
    )
    found = re.fullmatch(expected, done.out)
    assert found, done.out
    assert len(set(re.findall("hash=(.*)", done.out))) == 1


@pytest.mark.parametrize("kind", ["float", "half"])
def test_hash_is_fnv1a_of_the_pixels(denoise, identity, frame, work, kind):
    extension = "phm" if kind == "half" else "pfm"
    done = denoise(*ALL, "-w", identity[9], "-o", f"out.{extension}", "-t", kind, "--json")
    pixels = t.read_pfm(work / f"out.{extension}").tobytes()
    assert done.json["runs"][0]["hash"] == t.fnv1a(pixels)


def test_json_is_one_object(denoise, identity, frame):
    done = denoise(*ALL, "-w", identity[9], "-o", "out.pfm", "-n", 2, "--json")
    assert done.code == 0 and done.err == "" and done.out.count("\n") == 1
    report = done.json
    assert (report["width"], report["height"], report["channels"]) == (W, H, 3)
    assert report["filter"] == "RT" and report["device"] == "CPU"
    assert report["color"] == {"file": "color.pfm", "type": "float"}
    assert len(report["runs"]) == 2 and all(r["msec"] > 0 for r in report["runs"])
    assert report["outputs"] == ["out.pfm"] and report["exit_code"] == 0
    assert report["peak_memory_bytes"] > 1e5


def test_srgb_does_not_matter_to_light_maps(denoise, identity, frame):
    arguments = "--hdr", "color.pfm", "-f", "RTLightmap", "-w", identity[3], "--json"
    runs = [denoise(*arguments, *more).json["runs"][0]["hash"] for more in ((), ("--srgb",))]
    assert runs[0] == runs[1]


def test_json_of_a_failure(denoise, work):
    done = denoise("--hdr", 'no"\\such.pfm', "--json")
    assert done.code == 2
    assert done.json["exit_code"] == 2 and 'no"\\such.pfm' in done.json["error"]


SETS = {"hdr alb nrm": ALL, "hdr alb": ALL[:4], "hdr": ALL[:2], "hdr nrm": ALL[:2] + ALL[4:],
        "ldr alb nrm": ("--ldr", "color.pfm", *ALL[2:]), "alb": ALL[2:4], "nrm": ALL[4:],
        "alb srgb": (*ALL[2:4], "--srgb")}
ALONE = {"alb": "kernel5_alb", "nrm": "kernel5_nrm", "alb srgb": "kernel5_alb"}
CHOSEN = {"high": "kernel5_32", "balanced": "kernel5_12", "fast": "kernel5_8"}


@pytest.mark.parametrize("images", SETS)
@pytest.mark.parametrize("quality", CHOSEN)
def test_which_model_is_built_in_for_what(denoise, frame, quality, images):
    """The one that weights/builtin.def names for the quality and the images that there are."""
    chosen = denoise(*SETS[images], "-q", quality, "-o", "a.pfm", "--json")
    file = WEIGHTS / f"{ALONE.get(images, CHOSEN[quality])}.tza"
    given = denoise(*SETS[images], "-w", file, "-o", "b.pfm", "--json")
    assert (chosen.code, given.code) == (0, 0)
    assert chosen.json["runs"][0]["hash"] == given.json["runs"][0]["hash"]


def test_auto_says_what_it_takes(denoise, work):
    """The bytes of that quality: the least for a smooth frame, the highest for a small one."""
    for size, taken in (400, "fast"), (100, "high"):
        t.write_pfm(work / "smooth.pfm", np.full((size, size, 3), 0.5, np.float32))
        done = denoise("--hdr", "smooth.pfm", "-q", "auto")
        given = denoise("--hdr", "smooth.pfm", "-q", taken, "--json").json["runs"][0]
        told = re.search(rf"\n  msec=[^,]+, hash={given['hash']}\n  quality=(\w+)\n", done.out)
        assert told and told[1] == taken and "quality" not in given
        run = denoise("--hdr", "smooth.pfm", "-q", "auto", "--json").json["runs"][0]
        assert (run["hash"], run["quality"]) == (given["hash"], taken)


# Every option under every name, with a value that must be accepted.
OPTIONS = [
    *(f"{name} cpu" for name in ("-d", "--dev", "--device")),
    "-d 0",
    "-d default",
    *(f"{name} RT" for name in ("-f", "--filter")),
    *(
        f"{name} 0.5"
        for name in ("--is", "--input_scale", "--input-scale", "--inputScale", "--inputscale")
    ),
    "--clean_aux",
    "--clean-aux",
    "--cleanAux",
    "--cleanaux",
    *(f"{name} x.pfm" for name in ("-o", "--out", "--output")),
    *(
        f"{name} {value}"
        for name in ("-t", "--type")
        for value in ("float", "f", "fp32", "half", "h", "fp16")
    ),
    *(
        f"{name} {value}"
        for name in ("-q", "--quality")
        for value in ("default", "h", "high", "b", "balanced", "f", "fast", "auto", "FAST", "High")
    ),
    "-d CPU",
    "-t Half",
    "--buffer HOST",
    "--is nan",
    "-n 2",
    "--threads 1",
    "--affinity 0",
    "--affinity 1",
    "--maxmem 1000",
    "--maxMemoryMB 1000",
    "--maxmem -1",
    "--ensemble 1",
    "--ensemble 4",
    "--inplace",
    "--inplace -n 3",
    "--inplace --buffer host",
    "--buffer host",
    "--buffer device",
    "--buffer managed",
    "-v 0",
    "--verbose 0",
    "---threads 1",
    "-threads 1",
    "--threads=1",
    "--no_aux",
]


@pytest.mark.parametrize("option", OPTIONS)
def test_option_is_accepted(denoise, identity, frame, option):
    done = denoise(*ALL, "-w", identity[9], *option.split())
    assert done.code == 0, done.err


@pytest.mark.parametrize(
    "option",
    ["--inplace", "--inplace -n 3", "--buffer host", "--inplace --buffer device", "--threads 1"],
)
def test_where_images_are_does_not_matter(denoise, identity, frame, option):
    plain = denoise(*ALL, "-w", identity[9], "--json").json["runs"]
    other = denoise(*ALL, "-w", identity[9], "--json", *option.split()).json["runs"]
    assert {r["hash"] for r in other} == {plain[0]["hash"]}


def test_ensembles(denoise, frame, work):
    """The mean of orientations, whatever memory the images are in; and with a wrong number."""
    hashes = {}
    for options in ("", "--ensemble 1", "--ensemble 2", "--ensemble 2 --inplace -n 2",
                    "--ensemble 2 --buffer device", "--ensemble 4"):  # fmt: skip
        runs = denoise(*ALL, "--json", *options.split()).json["runs"]
        (hashes[options],) = {r["hash"] for r in runs}
    one, same, two, in_place, in_buffers, four = hashes.values()
    assert one == same and two == in_place == in_buffers and len({one, two, four}) == 3
    for number in "0", "3", "5", "two":
        done = denoise(*ALL, "--ensemble", number)
        assert done.code == 1 and number in done.error and "ensemble" in done.error


def test_panoramas(denoise, frame, work):
    """Other bytes than of a plain image, the same in any memory; of no light map."""
    hashes = set()
    for options in ("", "--inplace -n 2", "--buffer device"):
        runs = denoise(*ALL, "--json", "--panorama", *options.split()).json["runs"]
        hashes |= {r["hash"] for r in runs}
    assert len(hashes) == 1
    assert hashes.isdisjoint(r["hash"] for r in denoise(*ALL, "--json").json["runs"])
    done = denoise("--hdr", "color.pfm", "-f", "RTLightmap", "--panorama")
    assert done.code == 1 and "--panorama" in done.error


@pytest.mark.parametrize("names", ["--alb --nrm", "--albedo --normal"])
def test_names_of_auxiliary_images(denoise, identity, frame, names):
    alb, nrm = names.split()
    done = denoise("--hdr", "color.pfm", alb, "albedo.pfm", nrm, "normal.pfm", "-w", identity[9])
    assert done.code == 0, done.err


@pytest.mark.parametrize(
    "arguments, words", [("", "usage:"), ("--help", "usage:"), ("-h", "usage:")]
)
def test_help(denoise, work, arguments, words):
    done = denoise(*arguments.split())
    assert done.code == 1 and words in done.out
    for option in (
        "--hdr --ldr --dir --srgb --alb --nrm --clean_aux --is -o --ref --maxerror -t -q "
        "-w -n --threads --affinity --maxmem --ensemble --panorama --inplace --buffer -v --ld "
        "-f -d".split()
    ):
        assert option in done.out, option


@pytest.mark.parametrize("name", ["--ld", "--list_devices", "--list-devices", "--listDevices"])
def test_list_of_devices(denoise, name):
    done = denoise(name)
    assert done.code == 0 and re.match(r"Device 0\n  Name: .+\n  Type: CPU\n", done.out)


def test_frames_must_be_a_list(denoise, work):
    for text in "x", "3-1", "1-", "-1", "1-9x0", "1,,2", "1-99999999":
        done = denoise("--hdr", "a.####.pfm", "--frames", text)
        assert done.code == 1 and text in done.error


# ---- What is denoised ----------------------------------------------------------------------------


def test_values_of_each_content(denoise, identity, frame, work):
    """Weights that change nothing leave each kind of image as the rules of its content make it."""
    three = ("-w", identity[3], "-o", "out.pfm")
    color, albedo, normal = frame["color"], frame["albedo"], frame["normal"]
    for arguments, expected in (
        (("--hdr", "color.pfm"), color),
        (("--ldr", "color.pfm"), color.clip(0, 1)),
        (("--ldr", "color.pfm", "--srgb"), color.clip(0, 1)),
        (("--alb", "albedo.pfm"), albedo),
        (("--nrm", "normal.pfm"), normal),
        (("color.pfm",), color),
        (("--hdr", "color.pfm", "-f", "RTLightmap"), color),
        (("--dir", "normal.pfm", "-f", "RTLightmap"), normal),
        (("--hdr", "color.pfm", "--is", "0.01"), color),
    ):
        done = denoise(*arguments, *three)
        assert done.code == 0, (arguments, done.err)
        error = np.abs(t.read_pfm(work / "out.pfm") - expected)
        assert (error <= 2e-5 + 1e-5 * np.abs(expected)).all(), (arguments, error.max())


def test_single_bad_values_are_fine(denoise, identity, work):
    image = t.noise(H, W)
    image[3, 4] = np.nan
    image[5, 6, 1] = np.inf
    t.write_pfm(work / "in.pfm", image)
    done = denoise("--hdr", "in.pfm", "-w", identity[3], "-o", "out.pfm", "--is", "1")
    assert done.code == 0 and np.isfinite(t.read_pfm(work / "out.pfm")[6:]).all()


def test_strength_mixes_the_result_with_the_input(denoise, frame, work):
    image = frame["color"].copy()
    image[3, 4] = np.nan, np.inf, -np.inf
    t.write_pfm(work / "in.pfm", image)

    def run(*options) -> np.ndarray:
        done = denoise("--hdr", "in.pfm", "-o", "out.pfm", "-q", "fast", *options)
        assert done.code == 0, done.err
        return t.read_pfm(work / "out.pfm")

    whole, good = run(), np.isfinite(image)
    assert np.array_equal(run("--strength", 1), whole)
    assert np.array_equal(run("--strength", 0)[good], image[good])
    half = run("--strength", 0.5)
    assert np.allclose(half[good], (0.5 * (image + whole))[good], rtol=1e-5)
    assert np.array_equal(half[~good], whole[~good])
    for more in (["--inplace"], ["--inplace", "-n", 2], ["--buffer", "device"], ["-n", 3]):
        assert np.array_equal(run("--strength", 0.5, *more), half)


@pytest.mark.parametrize("value", ["-0.1", "1.5", "nan", "much"])
def test_impossible_strengths(denoise, frame, work, value):
    done = denoise("--hdr", "color.pfm", "-o", "out.pfm", "--strength", value)
    assert done.code == 1 and "--strength" in done.error and not (work / "out.pfm").exists()


def test_negative_input_scale(denoise, frame, work):
    done = denoise("--hdr", "color.pfm", "-o", "out.pfm", "--is", "-1")
    assert done.code == 1 and "--is" in done.error and not (work / "out.pfm").exists()


# ---- Comparison ----------------------------------------------------------------------------------


def metric(expected: np.ndarray, actual: np.ndarray) -> tuple[float, int]:
    """Average error and outliers as the contract of oidnDenoise defines them."""
    difference = np.abs(expected - actual)
    relative = difference / (np.abs(expected) + np.abs(actual) + 0.01)
    return float(relative.mean()), int((~((difference <= 0.02) | (relative <= 0.05))).sum())


def test_reference_equal(denoise, identity, frame, work):
    done = denoise("--hdr", "color.pfm", "-w", identity[3], "-r", "color.pfm")
    assert done.code == 0
    assert re.search(rf"Verifying output\n  values={H * W * 3}, errors=0, avgerror=", done.out)
    assert not list(work.glob("denoise_*"))


@pytest.mark.parametrize("name", ["-r", "--ref", "--reference"])
def test_reference_different(denoise, identity, frame, work, name):
    done = denoise("--hdr", "color.pfm", "-w", identity[3], name, "clean.pfm", "-n", 2)
    assert done.code == 3
    average, _ = metric(frame["clean"], frame["color"])
    found = re.search(r"values=(\d+), errors=(\d+), avgerror=(\S+)\n", done.out)
    assert found and found[1] == found[2] == str(H * W * 3)  # over the limit all count
    assert float(found[3]) == pytest.approx(average, rel=1e-3)
    lines = done.err.splitlines()
    assert lines[-1] == "Error: output does not match the reference" and len(lines) == 6
    assert all(re.fullmatch(r"  error i=\d+, expect=\S+, actual=\S+", line) for line in lines[:5])
    for name, image in (("in", "color"), ("out", "color"), ("ref", "clean")):
        saved = t.read_pfm(work / f"denoise_{name}.pfm")
        assert np.allclose(saved, frame[image], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["--maxerror", "--maxError", "--max_error", "--maxerr"])
def test_outliers_fail_whatever_the_average(denoise, identity, frame, name):
    average, outliers = metric(frame["clean"], frame["color"])
    done = denoise("--hdr", "color.pfm", "-w", identity[3], "-r", "clean.pfm", name, average + 0.1)
    found = re.search(r"errors=(\d+),", done.out)
    assert done.code == 3 and abs(int(found[1]) - outliers) <= 2


def test_normals_have_a_wider_limit(denoise, identity, frame, work):
    off = frame["normal"] + 0.0005 * np.sign(t.noise(H, W) - 0.5)
    t.write_pfm(work / "off.pfm", off)
    average, outliers = metric(off, frame["normal"])
    assert 0.003 < average < 0.05 and not outliers
    assert denoise("--nrm", "normal.pfm", "-w", identity[3], "-r", "off.pfm").code == 0
    t.write_pfm(work / "one.pfm", np.abs(frame["normal"]))
    t.write_pfm(work / "two.pfm", np.abs(frame["normal"]) + 0.0005)
    assert denoise("--hdr", "one.pfm", "-w", identity[3], "-r", "two.pfm").code == 3


def test_reference_of_another_size(denoise, identity, frame, work):
    t.write_pfm(work / "small.pfm", t.noise(8, 8))
    done = denoise("--hdr", "color.pfm", "-w", identity[3], "-r", "small.pfm")
    assert done.code == 2 and "small.pfm" in done.error
