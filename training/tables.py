"""Tables of scores, and the reports that hold them."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from training.errors import DATA, ToolError
from training.imageio import replacing

MARKS = ("<!-- scores -->", "<!-- /scores -->")


def table(rows: list[dict], pictures: list[dict]) -> list[str]:
    """Markdown: one line per row, then the means over all pictures."""
    oidn = all("oidn" in r for r in rows)
    methods = ["noisy", "lull"] + (["oidn"] if oidn else [])
    metric = list(rows[0]["lull"])
    titles = {"noisy": "noisy", "lull": "lull", "oidn": "OIDN 2.5.1"}
    head = [f"{n.upper()} {titles[m]}" for n in metric for m in methods]
    lines = ["| picture | " + " | ".join(head) + " |", "|---|" + "---:|" * len(head)]
    mean = {"case": f"**mean of {len(pictures)}**"} | {
        m: {n: float(np.mean([r[m][n] for r in pictures])) for n in metric} for m in methods}
    for r in [*rows, mean]:
        cells = [f"{r[m][n]:.2f}" if n == "psnr" else f"{r[m][n]:.4f}"
                 for n in metric for m in methods]
        lines.append(f"| {r['case']} | " + " | ".join(cells) + " |")
    return lines


def verdict(rows: list[dict]) -> str:
    """How many cases improve, in words."""
    names = [n for n in rows[0]["lull"] if n in ("psnr", "ssim")]
    worse = [r["case"] for r in rows if any(r["lull"][n] <= r["noisy"][n] for n in names)]
    better = len(rows) - len(worse)
    text = f"{better} of {len(rows)} pictures are better than their input"
    text += f" in {' and '.join(names).upper().replace('AND', 'and')}" if names else ""
    text += f" (not: {', '.join(worse)})." if worse else "."
    far = [r["case"] for r in rows if "agreement" in r
           and (r["agreement"][0] > 0.003 or r["agreement"][1])]
    if "agreement" in rows[0]:
        mean = float(np.mean([r["agreement"][0] for r in rows]))
        text += f" OIDN 2.5.1 running the same weights differs by {mean:.1e} on average" \
                f" ({len(far)} pictures beyond its tolerance of 3e-3)."
    return text


def by_spp(rows: list[dict]) -> list[dict]:
    """Means per sample count, as rows."""
    merged = []
    for spp in sorted({r["spp"] or 0 for r in rows}):  # names may have none
        part = [r for r in rows if (r["spp"] or 0) == spp]
        row = {"case": f"{spp or '?'} spp ({len(part)})"}
        for m in ("noisy", "lull", "oidn"):
            if all(m in r for r in part):
                row[m] = {n: float(np.mean([r[m][n] for r in part])) for n in part[0][m]}
        merged.append(row)
    return merged


def write_report(path: Path, text: str) -> None:
    """Replace what stands between the marks; a new file gets them."""
    old = path.read_text("utf-8") if path.exists() else "\n".join(MARKS) + "\n"
    if not all(m in old for m in MARKS):
        raise ToolError(f"{path}: has no marks {MARKS[0]} and {MARKS[1]}", DATA)
    before, _, rest = old.partition(MARKS[0])
    after = rest.partition(MARKS[1])[2]
    with replacing(path) as tmp:
        tmp.write_text(f"{before}{MARKS[0]}\n{text}\n{MARKS[1]}{after}", "utf-8")
