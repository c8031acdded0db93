"""What the guides in docs/ say is so: the program of embedding.md compiles and runs, and findings
that input.md names are the doctor's."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.rules.sources import CC, ROOT

DOCS = ROOT / "docs"


def test_program_of_the_embedding_guide(build: Path, tmp_path: Path):
    if "san" in build.name:
        pytest.skip("optional: sanitized builds want their flags")
    blocks = re.findall(r"```c\n(.*?)```", (DOCS / "embedding.md").read_text(), re.DOTALL)
    program = tmp_path / "embedding"
    (tmp_path / "embedding.c").write_text("".join(blocks))
    subprocess.run([CC, "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-Ilib", "-o", program,
                    tmp_path / "embedding.c", build / "lib" / "liblull.a", "-pthread"],
                   cwd=ROOT, check=True)
    done = subprocess.run([program, ROOT / "weights" / "kernel5_8.tza"], capture_output=True,
                          text=True, timeout=300)
    assert (done.stdout, done.returncode) == ("the same bytes\n", 0)


def test_findings_of_the_input_guide():
    table = (DOCS / "input.md").read_text().split("`--check` says")[1]
    named = set(re.findall(r"\| `([a-z-]+)`", table))
    kinds = set(re.findall(r'"([a-z-]+)"', (ROOT / "apps" / "doctor.c").read_text()))
    assert len(named) > 3
    assert not named - kinds
