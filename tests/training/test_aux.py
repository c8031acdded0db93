"""Features that are not the noisy ones: the reference's (--clean_aux), prefiltered ones."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from export import export
from export.tza import Reader
from tests.training.test_kernel_train import TINY as TINY_K
from tests.training.tools import QUICK, make_raw
from training import preprocess, train
from training.integer_stage import calibration_pictures, spread_codes
from training.result import Result

ALL = ["hdr", "alb", "nrm"]


def without_features(root: Path) -> Path:
    """A raw data set whose references alone have features."""
    make_raw(root)
    for path in [*root.rglob("*spp.alb.exr"), *root.rglob("*spp.nrm.exr")]:
        path.unlink()
    return root


def model_state(name: str, epoch: int) -> dict[str, torch.Tensor]:
    return Result("results", name).load(epoch)["model_state"]


def test_clean_features_are_the_references_alone(work):
    """As in Open Image Denoise's toolkit, inputs need not have any."""
    without_features(work / "data" / "train")
    args = [*ALL, "--clean_aux", "-t", "train", "-s", "3", *QUICK, "-e", "2"]
    preprocess.main(args[:6])
    train.main([*args, "-r", "a"])
    train.main([*args, "-r", "b", "--raw"])
    a, b = model_state("a", 2), model_state("b", 2)
    assert all(torch.equal(a[k], b[k]) for k in a)


@pytest.mark.parametrize("stored", [False, True])
@pytest.mark.parametrize("model", [[], ["-m", TINY_K]])
def test_integers_of_a_training_with_clean_features(work, model, stored):
    """Of its own stage, and of weights that are quantised when they are exported."""
    without_features(work / "data" / "train")
    args = [*ALL, "--clean_aux", "-t", "train"]
    if stored:
        preprocess.main(args)
    train.main([*args, "-s", "3", *QUICK, *model, "-e", "1", "-r", "a", "--quantize_aware", "2",
                *([] if stored else ["--raw"])])
    export.main(["-r", "a", "--int8", "-o", "a.tza"])
    export.main(["-r", "a", "--int8", "-o", "raw.tza", "--weights", "raw"])
    assert {t.dtype for t in Reader("raw.tza").values()} >= {np.dtype(np.int8)}
    pictures = calibration_pictures(Result("results", "a").config())
    assert len(pictures) == 5
    for picture, codes in zip(pictures, spread_codes(pictures, 5), strict=True):
        assert picture.inputs[0].shape[-1] == 3 and codes.shape[-1] == 9
        assert np.array_equal(codes[..., 3:], picture.target[..., 3:])


def test_prefiltered_features_of_raw_data(raw, work):
    """A training on the raw folder sees what preprocess would store."""
    data = ["-D", str(raw), "-t", "train"]
    train.main(["alb", "--raw", *data, "-s", "1", *QUICK, "-e", "1", "-r", "alb"])
    preprocess.main([*ALL, *data, "-a", "alb"])
    args = [*ALL, *data, "-s", "3", *QUICK, "-e", "2"]
    train.main([*args, "-a", "alb", "-r", "a"])
    train.main([*args, "-a", "alb", "-r", "b", "--raw"])
    train.main([*args, "-r", "plain", "--raw"])
    a, b, plain = (model_state(name, 2) for name in ("a", "b", "plain"))
    assert all(torch.equal(a[k], b[k]) for k in a)
    assert not all(torch.equal(a[k], plain[k]) for k in a)
    stored, read = (calibration_pictures(Result("results", name).config()) for name in "ab")
    assert np.array_equal(stored[0].inputs[0], read[0].inputs[0])


def test_preprocessing_heeds_threads_and_device(raw, work, fails):
    args = [*ALL, "-D", str(raw), "-t", "train"]
    before = torch.get_num_threads()
    try:
        preprocess.main([*args, "--threads", str(before + 1)])
        assert torch.get_num_threads() == before + 1
    finally:
        torch.set_num_threads(before)
    if not torch.cuda.is_available():
        assert fails(preprocess.main, [*args, "-d", "cuda"]) == (
            2, "device 'cuda' is not available")


def test_references_without_features_cannot_be_mixed_in(raw, work, capsys):
    """A line says so; preprocessed sets keep none of references, as the original's."""
    data = ["-D", str(raw), "-t", "train"]
    preprocess.main([*ALL, *data])
    args = [*ALL, *data, *QUICK, "-e", "1", "--mix_clean_aux", "0.5"]
    for name, more, said in (("a", [], True), ("b", ["--raw"], False)):
        capsys.readouterr()
        train.main([*args, *more, "-r", name])
        assert ("--mix_clean_aux: no reference has features" in capsys.readouterr().out) is said
