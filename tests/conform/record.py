"""Runs the conformance tests with their table rows and benchmark, and keeps the results in
docs/ports.md: `make conform`. Only the standard library.

    tests/conform/record.py [--build build] [--cross] [--no-bench]

--cross also runs the conformance programs that tests/conform/test_cross.sh and test_wasm.sh left
below BUILD, in qemu and Node. A run replaces the rows of the same port and place; other rows stay.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
DOC = ROOT / "docs" / "ports.md"
EMULATED = re.compile(r"qemu|emulated")
# Folder below the build -> what runs its programs.
RUNNERS = {"cross-aarch64": ["qemu-aarch64"], "cross-armhf": ["qemu-arm"],
           "wasm": ["node", "--no-warnings", "tests/conform/run_wasi.mjs"]}
HEAD = ["| port | where it ran | kernels | date | CPU flags |", "|---|---|---|---|---|"]


def port_names() -> list[str]:
    return re.findall(r"^PORT\((\w+)\)", (ROOT / "lib/ports.def").read_text(), re.MULTILINE)


def run(program: Path, *args: str, runner: list[str] | None = None, where: str = "") -> str:
    """Output of a conformance program; exits if it fails."""
    env = dict(os.environ, **({"LULL_CONFORM_WHERE": where} if where else {}))
    command = [*(runner or []), str(program), *args]
    done = subprocess.run(command, capture_output=True, text=True, env=env, cwd=ROOT)
    if done.returncode != 0:
        sys.exit(f"record.py: {' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr}")
    return done.stdout


def rows_of(output: str) -> list[list[str]]:
    """[port, where, kernels, date, flags] of each row printed."""
    found = []
    for line in output.splitlines():
        if line.startswith("ROW |"):
            port, kernels, where, date, flags = [c.strip() for c in line[5:].strip(" |").split("|")]
            found.append([port, where, kernels, date, flags])
    return found


def section(text: str, name: str) -> str:
    match = re.search(rf"<!-- {name} -->\n(.*?)<!-- end -->", text, re.DOTALL)
    if not match:
        sys.exit(f"record.py: {DOC.name} has no section '{name}'")
    return match[1]


def replace(text: str, name: str, content: str) -> str:
    old = section(text, name)
    return text.replace(f"<!-- {name} -->\n{old}", f"<!-- {name} -->\n{content}")


def merged(old: str, new: list[list[str]]) -> str:
    """The table with these rows in it, and a remark for each port that no real CPU has run."""
    lines = [line.strip("| ") for line in old.splitlines() if line not in HEAD and "**" not in line]
    kept = [[c.strip() for c in line.split("|")] for line in lines if line]
    keys = {(row[0], row[1]) for row in new}
    rows = [row for row in kept if (row[0], row[1]) not in keys] + new
    for port in port_names():
        if not any(r[0] == port and not EMULATED.search(r[1]) for r in rows):
            rows.append([port, "**no real CPU so far**", "", "", ""])
    order = {name: i for i, name in enumerate(port_names())}
    rows.sort(key=lambda r: (order.get(r[0], 99), bool(EMULATED.search(r[1])), r[1]))
    return "\n".join(HEAD + [f"| {' | '.join(row)} |" for row in rows]) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", default="build", help="build folder (default: build)")
    parser.add_argument("--cross", action="store_true",
                        help="also what test_cross.sh and test_wasm.sh built")
    parser.add_argument("--no-bench", action="store_true", help="leave the speeds as they are")
    args = parser.parse_args()
    build = (ROOT / args.build).resolve()

    text = DOC.read_text()
    rows = rows_of(run(build / "test/conform", "--row"))
    rows += rows_of(run(build / "test/conform_emulated", "--row"))
    for folder, runner in RUNNERS.items() if args.cross else ():
        program, name = build / folder / "test/conform", runner[0]
        if not program.exists() or not shutil.which(name):
            print(f"record.py: no {program.name} in {folder}, or no {name}", file=sys.stderr)
            continue
        version = subprocess.run([name, "--version"], capture_output=True, text=True).stdout
        number = re.search(r"(?:version |^v)(\d+\.\d+)", version)
        where = f"{name} {number[1] if number else ''}".strip()
        rows += rows_of(run(program, "--row", runner=runner, where=where))
    text = replace(text, "table", merged(section(text, "table"), rows))
    if not args.no_bench:
        speeds = run(build / "test/conform", "--bench")
        cpu = next(row for row in rows if row[0] == "scalar")
        text = replace(text, "speed", f"{cpu[1]}, {cpu[3]}:\n\n```\n{speeds}```\n")
    new = DOC.with_suffix(".new")
    new.write_text(text)
    new.replace(DOC)
    print(section(text, "table"), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
