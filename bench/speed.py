"""Speed and memory of our oidnDenoise beside the real Open Image Denoise 2.5.1, in one run.

    python -m bench.speed [--size 1920x1080] [--threads 2] [--rounds 5] [--ports avx2,...]

The same base U-Net (hdr, albedo, normal) for both, as fp32 and as int8;
then the built-in models of both. Rounds alternate between the programs; each runs for three
seconds, at least three frames and at most twelve, of which the first does not count; the figure is
the median of the rounds' medians. The memory is the peak resident set less four images of 12 bytes
a pixel (three inputs and the output).
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from bench import oidn, peer, pictures
from bench.randomnet import write_random

FEWEST, MOST = 3, 12  # frames of a run
ENSEMBLES = "2", "4"  # orientations that high quality is measured with, too
RUN_MSEC = 3000
IMAGE_BYTES = 4 * 3 * 4  # of one pixel: colour, albedo, normal, output as float


@dataclass
class Entry:
    """One competitor: a program with its options, and what was measured."""

    name: str
    program: Path
    options: tuple[str | Path, ...] = ()
    env: dict[str, str] = field(default_factory=dict)
    msec: list[float] = field(default_factory=list)
    frames: int = FEWEST  # of a run
    working: dict[int, int] = field(default_factory=dict)  # image height -> bytes
    error: str = ""


def entries(folder: Path, ports: list[str]) -> list[Entry]:
    """Competitors; the first is the one that ratios refer to."""
    mode = next(m for m in peer.MODES if m.name == "hdr+alb+nrm")
    sample = pictures.sizes()[0]
    fp16 = write_random(folder / "unet.tza", "unet", peer.codes(mode, sample))
    found = [Entry("OIDN fp32 unet", oidn.theirs(), ("-w", fp16))]
    int8 = folder / "unet_int8.tza"
    subprocess.run([sys.executable, "-m", "export.quantize", fp16, int8], check=True,
                   cwd=oidn.ROOT, stdout=subprocess.DEVNULL)
    for name, weights in (("lull fp32 unet", fp16), ("lull int8 unet", int8)):
        found.append(Entry(name, oidn.ours(), ("-w", weights)))
        found += [Entry(f"{name} {port}", oidn.ours(), ("-w", weights), {"LULL_PORTS": port})
                  for port in ports]
    for quality in ("fast", "balanced", "high"):
        found.append(Entry(f"OIDN built-in {quality}", oidn.theirs(), ("-q", quality)))
        found.append(Entry(f"lull built-in {quality}", oidn.ours(), ("-q", quality)))
        found += [Entry(f"lull built-in {quality} {port}", oidn.ours(), ("-q", quality),
                        {"LULL_PORTS": port}) for port in ports]
    found += [Entry(f"lull built-in high, mean of {n}", oidn.ours(), ("--ensemble", n))
              for n in ENSEMBLES]
    return found


def write_inputs(folder: Path, width: int, height: int) -> list[str | Path]:
    """A render of this size as PFM files; the options that name them."""
    picture = pictures.mirrored(pictures.sizes()[0], width, height)
    images = {"hdr": picture.color, "alb": picture.albedo, "nrm": picture.normal}
    return pictures.write_inputs(folder, images, str(height))


def settle(entry: Entry) -> None:
    """Chooses how many frames a run has by the time of the first, which does not count."""
    if entry.msec:
        entry.frames = max(FEWEST, min(MOST, round(RUN_MSEC / entry.msec[0])))
    entry.msec.clear()


def measure(entry: Entry, inputs: list[str | Path], pixels: int, height: int, threads: int,
            repeats: int) -> None:
    """One run of a competitor: appends its time, and notes its working memory."""
    if entry.error:
        return
    try:
        run = oidn.run(entry.program, "-d", "cpu", "--threads", str(threads), *inputs,
                       *entry.options, "-n", str(repeats), env=entry.env)
    except oidn.PeerError as error:
        entry.error = str(error)
        return
    if repeats > 1:
        entry.msec.append(statistics.median(run.msec[1:]))  # the first warms up
    working = run.peak - pixels * IMAGE_BYTES
    entry.working[height] = max(working, entry.working.get(height, 0))


def report(found: list[Entry], megapixels: float, height: int) -> None:
    base = statistics.median(found[0].msec) if found[0].msec else float("nan")
    print(f"{'':30} {'msec':>9} {'ms/MP':>8} {'speed':>7}   {'MB':>7} {'MB, 2x height':>14}")
    for e in found:
        if e.error or not e.msec:
            print(f"{e.name:30} failed: {e.error}")
            continue
        msec = statistics.median(e.msec)
        print(f"{e.name:30} {msec:9.1f} {msec / megapixels:8.1f} {base / msec:6.2f}x   "
              f"{e.working[height] / 1e6:7.1f} {e.working[2 * height] / 1e6:14.1f}")
    print("speed: OIDN fp32 unet = 1; MB: peak resident set above the image buffers")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--ports", default="", help="also pin lull to these ports (LULL_PORTS)")
    parser.add_argument("--only", default="", help="only entries whose name has this text")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    print(oidn.cpu_line())
    try:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            found = entries(folder, [p for p in args.ports.split(",") if p])
            found = found[:1] + [e for e in found[1:] if args.only in e.name]
            inputs = write_inputs(folder, width, height)
            tall = write_inputs(folder, width, 2 * height)
            for entry in found:
                measure(entry, inputs, width * height, height, args.threads, entry.frames)
                settle(entry)
            for _ in range(args.rounds):
                for entry in found:
                    measure(entry, inputs, width * height, height, args.threads, entry.frames)
            for entry in found:
                measure(entry, tall, 2 * width * height, 2 * height, args.threads, 1)
    except (oidn.PeerError, FileNotFoundError, subprocess.CalledProcessError) as error:
        print(f"bench-peer: {error}", file=sys.stderr)
        return 2
    print(f"{width}x{height}, {args.threads} threads, medians of {args.rounds} alternating runs")
    report(found, width * height / 1e6, height)
    return 1 if any(e.error for e in found) else 0


if __name__ == "__main__":
    sys.exit(main())
