"""The two `oidnDenoise` programs, ours and the real one, and how to run either."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from training.peer import find_binary

ROOT = Path(__file__).resolve().parent.parent
BUILD = Path(os.environ.get("LULL_BUILD", ROOT / "build"))
MSEC = re.compile(r"msec=([\d.]+), hash=")  # of a repetition; loading and set-up print no hash


class PeerError(RuntimeError):
    """A program that failed or is missing; the text is one line."""


@dataclass(frozen=True)
class Run:
    """What one run of a program gave."""

    msec: list[float]  # one per repetition, as the program measured it
    peak: int  # bytes, largest resident set of the process
    output: str


def ours(program: str = "oidnDenoise") -> Path:
    path = BUILD / "bin" / program
    if not path.exists():
        raise PeerError(f"{path} is missing: run make")
    return path


def theirs(program: str = "oidnDenoise") -> Path:
    """A program of Open Image Denoise 2.5.1, from the package pyoidn."""
    denoiser = find_binary()
    if denoiser is None:
        raise PeerError("the package pyoidn is not installed: run make peer")
    path = denoiser.with_name(program)
    if not os.access(path, os.X_OK):
        path.chmod(0o755)
    return path


def run(program: Path, *arguments: str | Path, env: dict[str, str] | None = None,
        limit: float = 600) -> Run:
    """Runs a program to its end. Its peak is polled: the kernel's figure for a child that has ended
    also counts this process, whose pages it had until exec."""
    command = [str(program), *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                               stdin=subprocess.DEVNULL, text=True, errors="replace",
                               env={**os.environ, **(env or {})})
    status, peak, start = Path(f"/proc/{process.pid}/status"), 0, time.monotonic()
    while process.poll() is None:
        try:
            found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text())
            peak = max(peak, int(found[1]) * 1024) if found else peak
        except OSError:
            pass
        if time.monotonic() - start > limit:
            process.kill()
        time.sleep(0.02)
    output = process.stdout.read()
    if process.returncode != 0:
        last = (output.strip().splitlines() or ["no output"])[-1]
        raise PeerError(f"{program.parent.parent.name}/{program.name} "
                        f"ended with status {process.returncode}: {last}")
    return Run([float(m) for m in MSEC.findall(output)], peak, output)


def cpu_line() -> str:
    """Name and vector extensions of this CPU, for the head of a report."""
    wanted = ("avx2", "fma", "avx_vnni", "avx512f", "avx512bw", "avx512_vnni", "amx_int8",
              "asimd", "asimddp", "i8mm")
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return sys.platform
    name = re.search(r"model name\s*:\s*(.*)", text)
    flags = re.search(r"^(?:flags|Features)\s*:\s*(.*)$", text, re.MULTILINE)
    have = [f for f in wanted if f in (flags[1].split() if flags else [])]
    return f"{name[1] if name else 'unknown CPU'}, {os.cpu_count()} CPUs, {' '.join(have)}"
