"""training.evaluate with references that have noise themselves, and on clipped inputs."""

import json
from pathlib import Path

import numpy as np
import pytest

from training import color, evaluate
from training.errors import ToolError
from training.features import load
from training.imageio import write_exr


def scored(work, name, *more):
    evaluate.main([*more, "--no_oidn", "--metric", "psnr", "--json", name])
    return json.loads((work / name).read_text())


def test_scores_without_the_noise_of_references(work, root):
    """--less_reference: what the reference's own noise adds to every error is taken off. Here the
    truth is known: the input's error is that of its 16 samples, and no longer 16/15 of it."""
    rng, truth = np.random.default_rng(3), np.full((64, 64, 3), 0.5, np.float32)
    (work / "set" / "a").mkdir(parents=True)
    for spp in (16, 240):
        image = truth * (1 + 0.1 * rng.normal(size=truth.shape).astype(np.float32) * spp**-0.5)
        write_exr(work / "set" / "a" / f"a_{spp:04d}spp.hdr.exr", image)
    args = [f"{root / 'weights' / 'rt_hdr_w16.tza'}=hdr", "--images", str(work / "set")]
    plain, less = (scored(work, f"{len(more)}.json", *args, *more)[0]
                   for more in ((), ("--less_reference",)))
    for method in ("noisy", "lull"):
        apart = [10 ** (-row[method]["psnr"] / 10) for row in (plain, less)]
        noise = 10 ** (-plain["noisy"]["psnr"] / 10) / 16
        assert apart[0] - apart[1] == pytest.approx(noise, rel=1e-6)
    assert less["noisy"]["psnr"] - plain["noisy"]["psnr"] == pytest.approx(0.28, abs=0.001)


def test_only_psnr_is_scored_without_the_noise_of_references(raw, root):
    with pytest.raises(ToolError, match="--less_reference: is about psnr"):
        evaluate.main([f"{root / 'weights' / 'rt_hdr_w16.tza'}=hdr", "--images", str(raw),
                       "--less_reference", "--metric", "ssim"])


def test_references_without_a_count_have_no_known_noise(raw):
    case = evaluate.find_cases(raw / "valid")[0]
    with pytest.raises(ToolError, match=f"{case.name}: --less_reference needs sample counts"):
        evaluate.noise_of_reference(case, 20.0)


def test_clipped_inputs_are_made_of_hdr_pictures(raw, root):
    """ldr: exposed for the reference, clipped after the noise; metrics are taken on that."""
    case = evaluate.find_cases(raw / "valid")[0]
    source, target = (load(v, ["hdr"])["hdr"] for v in (case.source, case.target))
    exposure = color.autoexposure(target)
    seen = {}

    class Network:
        features = ["ldr", "alb"]

        def run(self, images):
            seen.update(images)
            return np.clip(target * exposure, 0, 1)

    row = evaluate.evaluate(case, Path("any.tza"), Network(), None, ["psnr", "mse"])
    assert sorted(seen) == ["alb", "ldr"]
    assert np.array_equal(seen["ldr"], np.clip(source * exposure, 0, 1))
    assert row["lull"]["mse"] == 0 and row["noisy"]["psnr"] < 40


def test_clipped_pictures_through_the_program(raw, work, root):
    evaluate.main([f"{root / 'weights' / 'kernel5_8.tza'}=ldr,alb,nrm", "--images",
                   str(raw / "valid"), "--no_oidn", "--metric", "psnr", "--spp", "4",
                   "--json", "ldr.json"])
    rows = json.loads(Path("ldr.json").read_text())
    assert len(rows) == 2 and all(r["lull"]["psnr"] > r["noisy"]["psnr"] + 2 for r in rows)
