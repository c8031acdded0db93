"""bench.auto: which model quality `auto` takes, and what its table says of it."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench import auto, oidn


def test_multiply_adds_are_those_of_the_models():
    """Of the built-in models, from the manifest; a larger model for each higher quality."""
    found = auto.multiply_adds()
    assert list(found) == list(auto.QUALITIES)
    assert 1 < found["fast"] < found["balanced"] < found["high"] <= 60


@pytest.mark.parametrize("height, width, windows", [
    (1080, 1920, 5 * 8), (640, 640, 3 * 3), (360, 360, 2 * 2), (4000, 4000, 8 * 8)])
def test_sample_is_that_of_the_library(height, width, windows):
    assert auto.sampled(height, width) == windows * 48 * 48 / (height * width)


def test_small_pictures_are_mirrored():
    image = np.arange(2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)
    large = auto.enlarge(image, 6)
    assert large.shape == (6, 6, 3) and np.array_equal(large[:2, :3], image)
    assert np.array_equal(large[2:4, :3], image[::-1])
    assert np.array_equal(auto.enlarge(large, 4), large)


def test_table(raw, work, capsys):
    assert auto.main([str(raw / "valid"), "--size", "400", "--json", "auto.json"]) == 0
    rows = json.loads(Path("auto.json").read_text())
    table = capsys.readouterr().out
    macs = auto.multiply_adds()
    assert rows and all(row["taken"] in auto.QUALITIES for row in rows)
    for row in rows:
        assert f"| {row['case']} | {row['taken']} |" in table
        assert row["lost"] == row["high"] - row[row["taken"]] == row["high"] - row["auto"]
        sample = sum(macs.values()) * auto.sampled(400, 400)
        assert row["work"] == (macs[row["taken"]] + sample) / macs["high"]


def test_result_must_be_that_of_the_quality_taken(raw, work, monkeypatch):
    def denoise(images, quality, folder):
        return images["hdr"] * (1 if quality == "high" else 0.5), "high"

    monkeypatch.setattr(auto, "denoise", denoise)
    with pytest.raises(oidn.PeerError, match="auto took high, but its result is another one"):
        auto.main([str(raw / "valid"), "--every", "100"])
