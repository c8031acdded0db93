"""What older CPUs would show, on one that has more.

    python -m bench.older [--isa avx2|sse4.1] [--rounds 5] [--threads 2] [--size 1920x1080]

lull held to its port for AVX2 or SSE4.1 (LULL_PORTS), Open Image Denoise to its kernels for the
same, in alternating rounds. Open Image Denoise has no setting for that; ISPC, which compiles its
kernels, asks the CPU once and keeps the answer in variables that begin as -1. In a copy of the
library they begin as that answer; that it took it shows in what the program prints of itself.
"""
from __future__ import annotations

import argparse
import os
import re
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from bench import oidn

VARIABLE, UNKNOWN = "__system_best_isa", -1
ISAS = {"avx2": (5, "AVX2", "avx2"), "sse4.1": (1, "SSE4.1", "sse41")}  # ISPC's, its name, our port
QUALITIES = ("fast", "balanced", "high")


def run(*command: object) -> str:
    return subprocess.run([str(x) for x in command], capture_output=True, text=True,
                          check=True).stdout


def hold(library: Path, isa: int) -> None:
    """Sets ISPC's variables in a library, a 64-bit ELF file, by what nm and readelf tell."""
    found = re.search(r"\.data\s+PROGBITS\s+([0-9a-f]+)\s+([0-9a-f]+)",
                      run("readelf", "-SW", library))
    symbols = re.findall(rf"^([0-9a-f]+) \w {VARIABLE}$", run("nm", library), re.M)
    if not found or not symbols:
        raise oidn.PeerError(f"{library}: no variables of ISPC")
    address, offset = (int(x, 16) for x in found.groups())
    data = bytearray(library.read_bytes())
    for symbol in symbols:
        at = int(symbol, 16) - address + offset
        if struct.unpack_from("<i", data, at)[0] != UNKNOWN:
            raise oidn.PeerError(f"{library}: {VARIABLE} is not {UNKNOWN}")
        struct.pack_into("<i", data, at, isa)
    library.write_bytes(data)


def milliseconds(program: Path, quality: str, args: argparse.Namespace, env: dict[str, str],
                 frames: int) -> float:
    """Of one frame."""
    text = subprocess.run([program, "-r", f"RT.hdr_alb_nrm.{args.size}", "-s",
                           *args.size.split("x"), "-q", quality, "-n", str(frames), "--threads",
                           str(args.threads), "-v", "2"], text=True, capture_output=True,
                          check=True, env=os.environ | env).stdout
    name = ISAS[args.isa][1]
    if "LD_LIBRARY_PATH" in env and not re.search(rf"ISA\s*: {re.escape(name)}$", text, re.M):
        raise oidn.PeerError(f"{program} does not say that it uses {name}")
    return float(re.search(r"([\d.]+) msec/image", text)[1])


def compare(folder: Path, args: argparse.Namespace) -> list[list[float]]:
    """Rounds of milliseconds: Open Image Denoise balanced, then lull's qualities."""
    theirs = folder / "bin" / "oidnBenchmark"
    held = {"LD_LIBRARY_PATH": str(folder / "lib")}
    ours = oidn.ours("oidnBenchmark")
    rounds = []
    for _ in range(args.rounds):
        rounds.append([milliseconds(theirs, "b", args, held, 2)])
        port = {"LULL_PORTS": ISAS[args.isa][2]}
        rounds[-1] += [milliseconds(ours, q[0], args, port, 6) for q in QUALITIES]
        print(" ".join(f"{ms:.1f}" for ms in rounds[-1]), flush=True)
    return rounds


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser("bench.older", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--isa", default="avx2", choices=ISAS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--size", default="1920x1080", metavar="WxH")
    args = parser.parse_args(argv)
    try:
        binary = oidn.theirs("oidnBenchmark")
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(shutil.copytree(binary.parent.parent, Path(folder) / "oidn"))
            for library in (copy / "lib").glob("libOpenImageDenoise_device_cpu.so*"):
                if not library.is_symlink():
                    hold(library, ISAS[args.isa][0])
            rounds = compare(copy, args)
    except (oidn.PeerError, OSError, subprocess.CalledProcessError) as error:
        print(f"bench-older: {error}", file=sys.stderr)
        return 2
    for i, quality in enumerate(QUALITIES, 1):
        ratio, ms = (statistics.median(v) for v in zip(*((r[0] / r[i], r[i]) for r in rounds)))
        print(f"{quality}: {ratio:.1f} times OIDN balanced, {ms:.1f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
