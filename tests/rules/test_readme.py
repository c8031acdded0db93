"""What the README says is so: its C example compiles, its folders exist."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from tests.rules.sources import ROOT, compile_text, tracked_files

README = (ROOT / "README.md").read_text()
HEADERS = "#include <math.h>\n#include <stdio.h>\n#include <stdlib.h>\n"


def test_example_compiles():
    (example,) = re.findall(r"```c\n(.*?)```", README, re.DOTALL)
    errors = compile_text(HEADERS + example, "-std=c11", "-Wall", "-Wextra", "-Werror",
                          "-Wno-missing-prototypes", "-Ilib", "-x", "c")
    assert not errors, errors


def test_named_files_and_folders_exist():
    names = re.findall(r"`((?:[a-z]+/)+[\w.-]*)`", README)
    files = {p.relative_to(ROOT).as_posix() for p in tracked_files()}
    folders = {parent.as_posix() + "/" for f in files for parent in PurePosixPath(f).parents}
    assert len(names) > 8
    assert not [n for n in names if n not in files | folders and not n.startswith("build/")]
