"""bench.chart: its sets, its tables, and the built-in models in floating point."""

import xml.etree.ElementTree as ET

import pytest

from bench import chart, oidn, speed
from training.errors import ToolError


def few(folder):
    """Our own programs in the place of all others: OIDN may not be installed here."""
    path = chart.manifest.FOLDER / chart.auto.built_in()["fast"]
    return [chart.Method("noisy", "input"),
            chart.Method("OIDN balanced", "oidn", speed.Entry("", oidn.ours(), ("-q", "high"))),
            chart.Method("lull fast", "lull", speed.Entry("", oidn.ours(), ("-q", "fast")),
                         bytes=path.stat().st_size),
            chart.Method("lull fast, floats", "lull", denoiser=chart.in_floats(path))]


def rows_of(text: str, title: str) -> dict[str, list[str]]:
    """Rows of the first table below a heading, by their first cell; that of the head is ''."""
    part = text.partition(f"\n## {title}\n")[2].partition("\n## ")[0].partition("PSNR of each")[0]
    cells = [[c.strip() for c in line.split("|")[1:-1]] for line in part.splitlines()
             if line.startswith("|") and "---" not in line]
    return {row[0]: row[1:] for row in cells}


def test_every_folder_is_a_set(raw, tmp_path, monkeypatch):
    monkeypatch.setattr(chart, "methods", few)
    monkeypatch.setattr(chart, "DOCS", tmp_path)
    assert chart.main(["--images", f"boxes={raw / 'valid'}", "--held_out", f"{raw / 'train'}:2",
                       "--size", "64x48", "--threads", "1", "--rounds", "1"]) == 0
    text = (tmp_path / "chart.md").read_text()
    for title in ("boxes", "train"):
        rows = rows_of(text, title)
        assert rows.pop("") == ["ms/MP", "PSNR", "SSIM", "FLIP", "relMSE", "1 spp", "4 spp"]
        assert set(rows) == {"noisy", "OIDN balanced", "lull fast", "lull fast, floats"}
        assert rows["noisy"][0] == rows["lull fast, floats"][0] == ""  # not measured
        psnr = {name: [float(v) for v in (row[1], *row[5:])] for name, row in rows.items()}
        for mean, *by_count in psnr.values():
            assert mean == pytest.approx(sum(by_count) / 2, abs=0.011)
        assert psnr["lull fast"][0] > psnr["noisy"][0] + 3
        # what integers lose, see docs/models.md
        assert psnr["lull fast"][0] > psnr["lull fast, floats"][0] - 0.05
    drawing = ET.fromstring((tmp_path / "chart.svg").read_text())
    titles = [t.text for t in drawing.iter("{http://www.w3.org/2000/svg}text")
              if t.get("font-weight") == "bold"]
    assert [t.split(":")[0] for t in titles] == ["boxes"] * 3 + ["train"] * 3


def test_pictures_without_counts_are_listed(raw):
    """Where samples are not stated there are no columns for them, but a row for each picture."""
    group, = chart.find_sets([str(raw / "valid")], [])
    assert group.name == "valid" and group.counts() == [1, 4]
    group.cases[0].source = group.cases[0].source.__class__(
        **{**vars(group.cases[0].source), "spp": 0})
    noisy = chart.Method("noisy", "input")
    for k, case in enumerate(group.cases):
        noisy.scores[id(case)] = dict.fromkeys(chart.NAMES, float(k))
    lines = chart.set_table([noisy], group)
    assert "| | ms/MP | PSNR | SSIM | FLIP | relMSE |" in lines
    assert [line for line in lines if line.startswith(f"| {group.cases[2].name} |")] == [
        f"| {group.cases[2].name} | 2.00 |"]


def test_a_set_of_nothing_is_an_error(raw, tmp_path):
    with pytest.raises(ToolError):
        chart.find_sets([str(tmp_path)], [])
    for file in (raw / "valid").rglob("*.hdr.exr"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(ToolError, match="bare: no picture with a reference, albedo and normal"):
        chart.find_sets([f"bare={tmp_path}"], [])
