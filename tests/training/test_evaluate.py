"""training.evaluate on inputs that are cleaner than their files, and on clipped ones."""

import json
from pathlib import Path

import numpy as np

from training import color, evaluate
from training.features import load


def test_inputs_of_less_noise(raw, work, root):
    """--as_spp: inputs like those of more samples, a quarter of the noise for 16 times as many."""
    args = [f"{root / 'weights' / 'rt_hdr_w16.tza'}=hdr", "--images", str(raw / "valid"),
            "--no_oidn", "--metric", "psnr", "--spp", "4"]
    evaluate.main([*args, "--json", "as4.json"])
    evaluate.main([*args, "--as_spp", "64", "--json", "as64.json"])
    a, b = (json.loads(Path(f).read_text()) for f in ("as4.json", "as64.json"))
    assert len(a) == len(b) == 2
    for x, y in zip(a, b):
        assert x["case"] == y["case"]
        assert 9 < y["noisy"]["psnr"] - x["noisy"]["psnr"] < 16  # 12 dB where nothing is clipped


def test_noise_shrinks_around_the_target():
    target = np.full((4, 4, 3), 2.0, np.float32)
    image = target + np.linspace(-3, 3, 48, dtype=np.float32).reshape(4, 4, 3)
    out = evaluate.with_less_noise(image, target, 0.25)
    assert out.dtype == np.float32 and np.allclose(out - target, 0.25 * (image - target))
    assert np.array_equal(evaluate.with_less_noise(image, target, 1.0), np.maximum(image, 0))


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
