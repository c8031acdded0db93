#!/usr/bin/env python3
"""Let a model of family K smooth along its result and give back what that lacks, or no longer:

    python -m export.bilateral IN.tza OUT.tza

The filter's steps 6 to 8, averages along edges and some of the input in 9, and the grain of albedo
and normals, which goes before the network (docs/kernel-prediction.md), have no trained weights: a
file asks for them by the tensor `bilateral.scale`, a single 3, or 1 for 6, 8 and 9, 2 for 6 and 9,
5 for these two and the grain. IN and OUT: .tza, integer; they may be the same.
"""
from __future__ import annotations

from pathlib import Path

from export import kernel
from export.quantize import write_tensors
from export.quantize_kernel import tensors_of
from training import errors


def main(argv: list[str]) -> None:
    parser = errors.Parser("export.bilateral", description=__doc__)
    parser.add_argument("input", type=Path)
    parser.add_argument("output", type=Path)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--correct", action="store_true",
                       help="without regression (step 7), and the grain of features stays")
    which.add_argument("--smooth", action="store_true",
                       help="the same without correction (step 8)")
    which.add_argument("--clean", action="store_true",
                       help="as --smooth, and without the grain of features")
    which.add_argument("--off", action="store_true", help="no longer")
    args = parser.parse_args(argv)
    with errors.reading(args.input):
        model = kernel.load(args.input)
    if model.is_alone:
        raise errors.ToolError(f"{args.input}: is for an albedo or normals alone, which have no "
                               "such steps", errors.STATE)
    model.bilateral = (0 if args.off else kernel.SMOOTH if args.smooth else
                       kernel.CLEAN_AND_SMOOTH if args.clean else
                       kernel.SMOOTH_AND_CORRECT if args.correct else kernel.ALL_STEPS)
    write_tensors(args.output, tensors_of(model))


if __name__ == "__main__":
    errors.run(main)
