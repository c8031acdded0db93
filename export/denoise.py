#!/usr/bin/env python3
"""Denoise a picture with the numpy reference: slow, and to the bit what the library gives.

    python -m export.denoise MODEL.tza NOISY.exr OUT.exr [--ldr ...] [--scale S]

The picture is a file with layers, or NAME.hdr.exr with NAME.alb.exr and NAME.nrm.exr beside it. The
number of a U-Net's input channels says which are used; family K takes what there is. (The fp32
models' sums are rounded in an order of numpy's choice, so only integer models give the library's
bits.)
"""
from __future__ import annotations

import math
from pathlib import Path

from export import kernel, reference
from export.calibrate import Kind, add_kind, frame_of, read_picture
from export.graph import read_nets
from export.tza import Reader
from training import errors
from training.errors import STATE, USAGE, ToolError
from training.imageio import replacing, write_exr, write_pfm

WRITERS = {".exr": write_exr, ".pfm": write_pfm}


def family_of(path: Path) -> str:
    """U or K; U of a file that is neither, which reference.load_model refuses."""
    tensors = Reader(path)
    return next((n.family for n in read_nets() if f"{n.key}.weight" in tensors), "U")


def main(argv: list[str]) -> None:
    parser = errors.Parser("python -m export.denoise", description=__doc__)
    parser.add_argument("model", type=Path, metavar="MODEL.tza")
    parser.add_argument("noisy", type=Path, metavar="NOISY")
    parser.add_argument("output", type=Path, metavar="OUT", help=".exr or .pfm")
    parser.add_argument("--scale", type=float, help="of the input (default: auto-exposure if HDR)")
    add_kind(parser)
    args = parser.parse_args(argv)
    if args.output.suffix not in WRITERS:
        raise ToolError(f"{args.output}: the extension must be {' or '.join(WRITERS)}", USAGE)
    if args.scale is not None and math.isnan(args.scale):
        raise ToolError("--scale must be a number", USAGE)
    try:
        is_kernel = family_of(args.model) == "K"
        model = (kernel.load if is_kernel else reference.load_model)(args.model)
    except ValueError as e:
        raise ToolError(str(e), STATE) from e
    except OSError as e:
        raise ToolError(f"{args.model}: cannot read ({e.strerror or e})", STATE) from e
    kind = Kind.of(3 if is_kernel else model.inputs, args.content, args.main)
    optional = ("albedo", "normal") if is_kernel and args.main == "color" else ()
    frame = frame_of(read_picture(args.noisy, kind, optional), kind, args.scale)
    channels = min(next(iter(frame.images.values())).shape[-1], 3)
    image = (kernel.run_frame if is_kernel else reference.denoise)(model, frame, channels)
    with replacing(args.output) as tmp:
        WRITERS[args.output.suffix](tmp, image)


if __name__ == "__main__":
    errors.run(main)
