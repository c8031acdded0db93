"""training.evaluate on inputs that are cleaner than their files."""

import json
from pathlib import Path

import numpy as np

from training import evaluate


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
