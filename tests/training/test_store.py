"""Preprocessed data sets: what is in them, shards, and which one a training takes."""

import json
import math
import mmap
import os
from pathlib import Path

import numpy as np
import pytest

from export.tza import Reader
from tests.training.tools import make_raw, picture
from training import color, preprocess
from training.data import Batches
from training.errors import ToolError
from training.imageio import write_image
from training.settings import parse
from training.store import find_stored, list_stored, read_pictures

F = ["hdr", "alb", "nrm"]


def test_preprocessed_set(raw, work, capsys):
    """Layout of the files, the channels of input and target, and reading it back."""
    preprocess.main(["hdr", "albedo", "nrm", "-f", "RT", "-D", str(raw), "-t", "train"])
    (folder,) = Path("preproc").iterdir()
    assert folder.name.startswith("train.")
    images, samples = Reader(folder / "images.tza"), json.loads(
        (folder / "samples.json").read_text())
    assert len(samples) == 10 and samples[0] == ["scene0/view0_0001spp", "scene0/view0_ref"]
    source, target = (images[n] for n in samples[0])
    assert source.shape == (48, 64, 9) and target.shape == (48, 64, 3)
    assert source.dtype == np.float16 and images.layouts[samples[0][0]] == "hwc"
    clean = picture(0)["hdr"]
    want = color.pu_forward(clean * color.autoexposure(clean))
    assert np.abs(target - want).max() < 1e-3
    config = json.loads((folder / "config.json").read_text())
    assert config["features"] == F and config["transfer"] == "pu"
    assert "5 groups, 10 (input, target) pairs" in capsys.readouterr().out

    preprocess.main(["hdr", "-f", "RT", "-D", str(raw), "-t", "train"])
    two = parse("train", ["hdr", "-t", "train"])
    assert find_stored(two, "train").features == ["hdr"]  # fewest channels
    three = parse("train", ["hdr", "nrm", "-t", "train"])
    pictures = read_pictures(find_stored(three, "train"), three.features, "hdr", False)
    assert pictures[0].inputs[0].shape == (48, 64, 6)
    assert np.array_equal(pictures[0].inputs[0][..., 3:], source[..., 6:])
    log = parse("train", ["hdr", "-t", "train", "-x", "log"])
    with pytest.raises(ToolError, match="no matching preprocessed data set 'train'"):
        find_stored(log, "train")
    (folder / "config.json").unlink()  # incomplete: ignored
    with pytest.raises(ToolError):
        find_stored(three, "train")


@pytest.mark.parametrize("features", [["hdr"], ["hdr", "alb"], F])
def test_a_stored_set_stays_on_disk(raw, work, features):
    """Sets that fit in no memory serve trainings with some of their features, too."""
    preprocess.main([*F, "-D", str(raw), "-t", "train"])
    s = parse("train", [*features, "-t", "train"])
    for one in read_pictures(find_stored(s, "train"), features, "hdr", False):
        for array in (*one.inputs, one.target):
            assert array.shape[-1] == (3 if array is one.target else 3 * len(features))
            while isinstance(array, np.ndarray):
                array = array.base
            assert isinstance(array, mmap.mmap)


def test_clean_aux_set(raw, work):
    preprocess.main(["hdr", "alb", "--clean_aux", "-D", str(raw), "-t", "valid"])
    s = parse("train", ["hdr", "alb", "--clean_aux", "-t", "valid", "--ts", "32", "-s", "1"])
    pictures = read_pictures(find_stored(s, "valid"), s.features, "hdr", True)
    assert pictures[0].inputs[0].shape[-1] == 3 and pictures[0].target.shape[-1] == 6
    x, y = Batches(pictures, s.features, "hdr", "pu", 2, 32, 1, clean_aux=True)[0]
    assert x.shape == (2, 6, 32, 32) and y.shape == (2, 3, 32, 32)


def test_shards_are_the_whole_set_and_resume(raw, work, capsys):
    args = ["hdr", "alb", "nrm", "-D", str(raw), "-t", "train"]
    preprocess.main([*args, "--shard", "0/2"])
    s = parse("train", [*F, "-t", "train"])
    with pytest.raises(ToolError, match=r"shards \[1\] are missing"):
        find_stored(s, "train")
    preprocess.main([*args, "--shard", "1/2"])
    capsys.readouterr()
    preprocess.main([*args, "--shard", "0/2"])
    assert "done already" in capsys.readouterr().out
    preprocess.main(args)
    sets = [read_pictures(st_, F, "hdr", False) for st_ in
            (find_stored(s, "train"), find_stored(s.replace(train_data="train"), "train"))]
    whole = {p.name: p for p in sets[0]}
    assert len(whole) == 5 and {p.name for p in sets[1]} == set(whole)


def test_a_shard_that_two_processes_make_at_once(raw, work, capsys, monkeypatch):
    """As where a queue starts a job twice: the later one finds the part done."""
    args = ["hdr", "-D", str(raw), "-t", "train", "--shard", "0/2"]
    write = preprocess._write

    def slow(*given):
        monkeypatch.setattr(preprocess, "_write", write)
        monkeypatch.setattr(os, "getpid", lambda: 1)
        preprocess.main(args)  # the other one begins later and is faster
        return write(*given)

    monkeypatch.setattr(preprocess, "_write", slow)
    preprocess.main(args)
    assert capsys.readouterr().out.endswith(": done already\n")
    assert len(list(Path("preproc").iterdir())) == 1  # hidden ones as well


def test_names_of_data_sets_may_begin_alike(raw, work):
    """`a.valid` is not a set `a` with the id `valid`, though config.json may not say so."""
    for name in ("a", "a.valid", "[a]"):
        make_raw(work / "data" / name, 1 if name == "a" else 2)
        preprocess.main(["hdr", "-D", "data", "-t", name])
    s = parse("train", ["hdr", "-t", "a"])
    for name, groups in ("a", 1), ("a.valid", 2), ("[a]", 2):
        stored = find_stored(s, name)
        assert len(read_pictures(stored, ["hdr"], "hdr", False)) == groups
    for folder in Path("preproc").iterdir():
        config = json.loads((folder / "config.json").read_text())
        del config["data"]
        (folder / "config.json").write_text(json.dumps(config))
    assert len(list_stored(Path("preproc"), "a")[0]) == 1
    assert len(list_stored(Path("preproc"), "a.valid")[0]) == 1


def test_changed_renders_are_preprocessed_anew(work, capsys):
    """Shards, too; and of several sets the last one serves, sharded or not."""
    make_raw(work / "data" / "train", 2, spp=(4,))
    args = ["hdr", "-D", "data", "-t", "train"]
    s = parse("train", ["hdr", "-t", "train"])

    def last() -> float:
        """Darkest code of the targets of the set that a training would take."""
        pictures = read_pictures(find_stored(s, "train"), ["hdr"], "hdr", False)
        assert len(pictures) == 2
        return min(float(p.target.min()) for p in pictures)

    before = math.inf
    for i, sharded in enumerate((True, True, False, True)):
        for g in range(2):
            image = picture(g)["hdr"]
            image[:16] *= 0.5**i
            write_image(work / f"data/train/scene{g}/view{g}_ref.hdr.exr", image)
        capsys.readouterr()
        for shard in ("0/2", "1/2") if sharded else ("",):
            preprocess.main([*args, "--shard", shard] if shard else args)
        assert "done already" not in capsys.readouterr().out
        assert last() < before
        before = last()


def test_preprocess_leaves_nothing_half_written(tmp_path, work, fails):
    make_raw(tmp_path / "data" / "train", 2)
    broken = tmp_path / "data" / "train" / "scene0" / "view0_0004spp.hdr.exr"
    broken.write_bytes(broken.read_bytes()[:300])
    preprocess.main(["hdr", "-D", "data", "-t", "train"])  # the others are there
    (folder,) = Path("preproc").iterdir()
    assert len(json.loads((folder / "samples.json").read_text())) == 3
    code, message = fails(preprocess.main, ["hdr", "-D", "data", "-t", "nothing"])
    assert code == 3 and "no data set found" in message
    (work / "file").touch()
    code, _ = fails(preprocess.main, ["hdr", "-D", "data", "-t", "train", "-P", "file"])
    assert code == 5 and len(list(Path("preproc").iterdir())) == 1


def test_a_slash_at_the_end_of_a_name_is_no_part_of_it(raw, work):
    """As shells complete names of folders: preprocessed sets were hidden folders within folders."""
    preprocess.main(["hdr", "-D", str(raw), "-t", "train/"])
    (folder,) = Path("preproc").iterdir()
    assert folder.name.startswith("train.") and (folder / "images.tza").exists()
    for name in "train", "./train/":
        s = parse("train", ["hdr", "-t", name, "-r", "a/"])
        assert find_stored(s, s.train_data).folders == (folder,) and s.result == "a"
