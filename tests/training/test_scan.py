"""Naming scheme, reference choice, completeness, summary, doctor."""

import os

import numpy as np
import pytest
from tests.training.tools import make_raw, noisy, picture, write_features
from hypothesis import given
from hypothesis import strategies as st

from training import doctor
from training.imageio import write_exr, write_image
from training.scan import Version, group_of, hold_out, list_versions, scan


def touch(root, *names):
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_reference_is_chosen_by_number(tmp_path):
    """`_4` sorts after `_1024` as text; the reference is still the 1024."""
    touch(tmp_path, "a_4.hdr.exr", "a_16spp.hdr.exr", "a_1024.hdr.exr")
    (group,) = scan(tmp_path, ["hdr"]).groups
    assert group.target.name == "a_1024"
    assert [v.spp for v in group.inputs] == [4, 16]


@pytest.mark.parametrize("word", ["ref", "reference", "gt", "target", "REF"])
def test_reference_words_win(tmp_path, word):
    touch(tmp_path, "d/a_4096spp.hdr.exr", f"d/a_{word}.hdr.exr")
    (group,) = scan(tmp_path, ["hdr"]).groups
    assert group.name == "d/a" and group.target.word == word.lower()
    assert [v.spp for v in group.inputs] == [4096]


@given(st.lists(st.integers(1, 100000), min_size=2, max_size=6, unique=True))
def test_order_is_numeric(counts):
    versions = sorted((Version(f"a_{n}", n, None) for n in counts), key=lambda v: v.order)
    assert [v.spp for v in versions] == sorted(counts)


def test_incomplete_versions_are_listed_one_by_one(tmp_path):
    touch(tmp_path, *(f"a_{n}.{f}.exr" for n in ("1", "4", "ref") for f in ("hdr", "alb")),
          "a_1.nrm.exr", "b_1.hdr.exr", "c_ref.hdr.exr", "d_4.alb.exr", "d_ref.hdr.exr")
    found = scan(tmp_path, ["hdr", "alb", "nrm"], ["hdr"])
    assert [g.name for g in found.groups] == ["a"]
    assert [v.spp for v in found.groups[0].inputs] == [1]  # 4 spp lacks nrm, 1 spp stays
    reasons = dict(found.left_out)
    assert reasons["a_4"] == "lacks nrm"
    assert reasons["b"].startswith("no reference")
    assert reasons["c"] == "no complete noisy version"
    assert reasons["d_4"] == "lacks hdr nrm"
    assert any("left out: 1 x lacks nrm (e.g. a_4)" in line for line in found.summary())


def test_seeds_formats_and_multichannel(tmp_path):
    touch(tmp_path, "a_4spp_s1.hdr.exr", "a_4spp_s2.hdr.exr", "a_ref.hdr.exr", "b_4.ldr.png",
          "b_4.ldr.exr", "b_ref.ldr.png", "c_4.exr", "c_ref.exr", "readme.exr", "x.png", "y.txt")
    versions = list_versions(tmp_path)
    assert set(versions) == {"a", "b", "c"}
    assert [v.seed for v in versions["a"]] == [1, 2, 0]
    assert versions["b"][0].files["ldr"].suffix == ".exr"  # float before 8 bit
    assert scan(tmp_path, ["hdr", "alb"]).groups[0].name == "c"  # all layers in one file


def test_single_pictures_are_inputs_without_reference(tmp_path):
    touch(tmp_path, "photo.hdr.exr", "a_4.hdr.exr")
    groups = scan(tmp_path, ["hdr"], need_target=False).groups
    assert [(g.name, g.target) for g in groups] == [("a", None), ("photo", None)]
    assert scan(tmp_path, ["hdr"]).groups == []


def test_linked_folders_are_read(tmp_path):
    touch(tmp_path / "real", "a_4.hdr.exr", "a_ref.hdr.exr")
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "link").symlink_to(tmp_path / "real")
    assert [g.name for g in scan(tmp_path / "set", ["hdr"]).groups] == ["link/a"]


def test_links_in_a_circle_are_read_once(tmp_path):
    touch(tmp_path, "sub/a_4.hdr.exr", "sub/a_ref.hdr.exr")
    (tmp_path / "sub" / "loop").symlink_to("..")
    (tmp_path / "again").symlink_to("sub")
    assert [g.name for g in scan(tmp_path, ["hdr"]).groups] == ["sub/a"]


def test_other_names_are_left_out_aloud(tmp_path, capsys, fails):
    """A name that is nearly one of a render may be meant as one; PNG without feature may not."""
    clean = picture(3)
    for spp in (4, 16):
        write_features(tmp_path / "d", f"a_{spp}spp", noisy(clean, spp, 1))
    write_features(tmp_path / "d", "a_ref", clean)
    strange = ["a.0008.exr", "a_8samples.exr", "a_8spp_v2.exr", "sub/a_8spp.depth.exr"]
    touch(tmp_path / "d", *strange, "a_8spp.pfm", "a_8spp.png", "sheet.png", ".a_8x.exr", "a.txt")
    found = scan(tmp_path / "d", ["hdr"])
    assert [len(g.inputs) for g in found.groups] == [2]
    assert sorted(n for n, r in found.left_out if "<version>" in r) == strange
    assert dict(found.left_out).pop("a_8spp.pfm").startswith("no feature")
    assert len(found.left_out) == 5
    assert "left out: 4 x name is not" in "\n".join(found.summary())
    assert fails(doctor.main, ["hdr", "-D", str(tmp_path), "-i", "d"]) == (
        3, "5 findings in 1 groups")
    assert "a_8samples.exr: name is not" in capsys.readouterr().out


def test_hold_out_is_spread():
    names = [f"s{i:03}" for i in range(100)]
    assert sorted(hold_out(names, 4)) == ["s012", "s038", "s062", "s088"]
    assert hold_out(reversed(names), 4) == hold_out(names, 4)
    assert hold_out(["a"], 3) == hold_out([], 3) == hold_out(names, 0) == set()
    assert len(hold_out(names[:4], 12)) == 2  # not nearly all of a few
    assert len(hold_out(names[:13], 12)) == 6


def test_hold_out_counts_in_the_order_of_files(tmp_path):
    """Of names without leading zeros, too, where that of the groups would be another one."""
    names = ["a-b/v", "a/v1", "a/v10", "a/v2", "x", "x-1"]
    touch(tmp_path, *(f"{n}_{v}.hdr.exr" for n in names for v in ("4", "ref")))
    groups = [g.name for g in scan(tmp_path, ["hdr"]).groups]
    assert groups == ["a/v10", "a/v1", "a/v2", "a-b/v", "x-1", "x"]
    assert hold_out(sorted(groups), 3) == {groups[i] for i in (1, 3, 5)}
    assert [group_of(f"{n}_0004spp_s2") for n in names] == names


def breakage(kind, images):
    """A noisy version with something wrong, and the word that the doctor says."""
    images = {k: v.copy() for k, v in images.items()}
    if kind == "encoded":
        images["nrm"] = images["nrm"] * 0.5 + 0.5
        return images, "looks encoded"
    if kind == "albedo":
        images["alb"] = images["alb"] * 3
        return images, "above 1"
    if kind == "nan":
        images["hdr"][3, 4] = np.nan
        return images, "1 pixels with NaN"
    if kind == "negative":
        images["hdr"][3, 4] = -1
        return images, "negative values"
    if kind == "bright":
        images["hdr"] *= 8
        return images, "times as bright"
    images["hdr"] = images["hdr"][::-1, ::-1].copy()
    return images, "does not look like its reference"


@pytest.mark.parametrize("kind", ["encoded", "albedo", "nan", "negative", "bright", "view"])
def test_doctor_finds_it(tmp_path, capsys, fails, kind):
    clean = picture(3)
    for n in (4, 16):
        write_features(tmp_path / "d", f"a_{n}", noisy(clean, n, 1))
    write_features(tmp_path / "d", "a_ref", clean)
    args = ["hdr", "alb", "nrm", "-D", str(tmp_path), "-i", "d"]
    doctor.main(args)
    assert "nothing found" in capsys.readouterr().out
    broken, words = breakage(kind, noisy(clean, 8, 1))
    write_features(tmp_path / "d", "a_8", broken)
    code, message = fails(doctor.main, args)
    assert code == 3 and "findings in 1 groups" in message
    out = capsys.readouterr().out
    assert words in out and "a_8" in out and "a_4:" not in out


def test_doctor_knows_noise_and_lamps(tmp_path, capsys):
    """One sample in twenty finds all light; a tenth of the albedo is of emitters, far above 1."""
    clean, rng = picture(3), np.random.default_rng(5)
    for n in (1, 2):
        images = noisy(clean, 4, n)
        found = rng.random((*clean["hdr"].shape[:2], 1)) < 0.05 * n
        images["hdr"] = (clean["hdr"] * found / (0.05 * n)).astype(np.float32)
        images["alb"] = images["alb"].copy()
        images["alb"][:5] = 8e8
        write_features(tmp_path / "d", f"a_{n}", images)
    write_features(tmp_path / "d", "a_ref", clean)
    doctor.main(["hdr", "alb", "nrm", "-D", str(tmp_path), "-i", "d"])
    assert "nothing found" in capsys.readouterr().out


def test_doctor_goes_on_after_a_cut_multichannel_file(tmp_path, capsys, fails):
    names = [f"{layer}{c}" for layer, cs in (("", "RGB"), ("albedo.", "RGB"), ("normal.", "XYZ"))
             for c in cs]
    folder = tmp_path / "d"
    folder.mkdir()
    for name in ("a_4", "a_16", "a_ref", "b_4", "b_ref"):
        write_exr(folder / f"{name}.exr", np.ones((32, 32, 9), np.float32), tuple(names))
    cut = folder / "a_4.exr"
    cut.write_bytes(cut.read_bytes()[:-100])
    code, message = fails(doctor.main, ["hdr", "alb", "nrm", "-D", str(tmp_path), "-i", "d"])
    out = capsys.readouterr().out
    assert code == 3 and "findings in 2 groups" in message
    assert "a_4.exr" in out and "b_ref" in out  # whose normals all look encoded


def test_doctor_on_references(tmp_path, capsys, fails):
    """A reference noisier than its input, one that is its input, two sizes in a group."""
    clean = picture(4)
    write_features(tmp_path / "d", "a_4", noisy(clean, 512, 1))
    write_features(tmp_path / "d", "a_ref", noisy(clean, 1, 2))
    write_features(tmp_path / "d", "b_4", clean)
    write_features(tmp_path / "d", "b_ref", clean)
    write_features(tmp_path / "d", "c_4", {"hdr": clean["hdr"][:-2]})
    write_features(tmp_path / "d", "c_ref", {"hdr": clean["hdr"]})
    fails(doctor.main, ["hdr", "-D", str(tmp_path), "-i", "d"])
    out = capsys.readouterr().out
    assert "a_4: less noisy than its reference" in out
    assert "b_4: identical with its reference" in out
    assert "c_4: 64x46 pixels, c_ref has 64x48" in out
    write_image(tmp_path / "e" / "a_4.hdr.exr", clean["hdr"])
    assert fails(doctor.main, ["hdr", "-D", str(tmp_path), "-i", "nothing"])[0] == 3


@pytest.mark.parametrize("encoding", ["utf-8:strict", "ascii"])
def test_names_that_output_cannot_hold(script, tmp_path, encoding):
    """Names are told with escapes; files whose names are not UTF-8 are left out."""
    make_raw(tmp_path / "data" / "d\u00e9", 1)
    folder = tmp_path / "data" / "d\u00e9" / "scene0"
    for path in sorted(folder.iterdir()):
        os.link(path, os.fsencode(folder) + b"/\xe8_" + path.name.rpartition("_")[2].encode())
    done = script("doctor", "hdr", "alb", "nrm", "-D", "data", "-i", "d\u00e9", cwd=tmp_path,
                  env=os.environ | {"PYTHONIOENCODING": encoding})
    assert done.returncode == 3 and done.stderr == "Error: 9 findings in 1 groups\n"
    assert done.stdout.count("\\udce8_0004spp.hdr.exr: name is not UTF-8") == 1
