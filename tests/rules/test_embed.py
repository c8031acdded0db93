"""weights/embed.c: sources that become a string lose comments and indentation, and no line."""
from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

SOURCE = """/* One,
   two. */
int a; /* three */
    int b = 4 / 2;
\tint c = 4 /* / * */ / 2; /**/
#define D(x) \\
        x

    /* four *//* five *//*/ six */ e
"""
WANTED = """

int a;\x20
int b = 4 / 2;
\tint c = 4  / 2;\x20
#define D(x) \\
x

e
"""


def text_of(path: Path) -> str:
    """The string in a file that embed made."""
    numbers = re.search(r"\{(.*)\}", path.read_text(), re.S)[1]
    made = bytes(int(x) for x in re.findall(r"\d+", numbers))
    assert made.endswith(b"\0")
    return made[:-1].decode()


def test_sources_lose_comments_and_indentation(root, build, tmp_path):
    embed = build / "host" / "embed"
    if not embed.exists():
        pytest.skip("optional: weights/embed.c is not built")
    (tmp_path / "a.c").write_text(SOURCE)
    (tmp_path / "b.c").write_text("x\n")
    subprocess.run([embed, "--text", "name", "out.c", "a.c", "b.c"], cwd=tmp_path, check=True)
    assert text_of(tmp_path / "out.c") == WANTED + "x\n"
    kernels = sorted((root / "ports" / "opencl").glob("*.cl"))
    subprocess.run([embed, "--text", "name", tmp_path / "out.c", *kernels], check=True)
    text = text_of(tmp_path / "out.c")
    assert text.count("\n") == sum(path.read_text().count("\n") for path in kernels)
    assert "/*" not in text and "*/" not in text and "\n " not in text
