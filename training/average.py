#!/usr/bin/env python3
"""The weighted mean of the weights of several trainings of one model, as a state dict:

    python -m training.average OUT.pt RESULT:3 RESULT [-R results]

Of trainings that began with the same weights the mean is often better than each, and a share of one
brings a part of what it learnt. Results (their averaged weights), .pt or .tza files; a number
after a colon is how much one counts, 1 unless told. The filter's last steps (export.bilateral) are
those of the first. export.quantize_kernel makes integers of OUT.pt, train --init goes on from it.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.average", run_name="__main__", alter_sys=True))

import math
from pathlib import Path

import torch

from export.kernel import BILATERAL
from training import errors
from training.errors import STATE, USAGE, ToolError
from training.result import last_steps_of, save_state, weights_of


def main(argv: list[str]) -> None:
    parser = errors.Parser("training.average", description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("source", nargs="+", help="NAME or NAME:SHARE")
    parser.add_argument("-R", "--results_dir", default="results")
    args = parser.parse_args(argv)
    if args.output.suffix != ".pt":
        raise ToolError(f"{args.output}: the output is a state dict, .pt", USAGE)
    sources = [share_of(text) for text in args.source]
    total = sum(share for _, share in sources)
    models = [weights_of(name, args.results_dir) for name, _ in sources]
    steps = [last_steps_of(name, args.results_dir) for name, _ in sources]
    shapes = [{k: v.shape for k, v in model.items()} for model in models]
    for (name, _), shape in zip(sources, shapes):
        if shape != shapes[0]:
            raise ToolError(f"{name}: of another model than {sources[0][0]}", STATE)
    mean = {k: sum(model[k].double() * (share / total)
                   for model, (_, share) in zip(models, sources)).float() for k in models[0]}
    if len(set(steps)) > 1:
        print("Last steps of the filter: " + ", ".join(
            f"{name} {n}" for (name, _), n in zip(sources, steps)) + f"; the mean has {steps[0]}")
    if steps[0]:
        mean[BILATERAL] = torch.tensor([float(steps[0])])
    save_state(args.output, mean)
    print(f"Saved: {args.output}")


def share_of(text: str) -> tuple[str, float]:
    """NAME or NAME:SHARE."""
    name, colon, number = text.rpartition(":")
    if not colon:
        return text, 1.0
    try:
        share = float(number)
    except ValueError:
        return text, 1.0  # a colon of the name
    if not (math.isfinite(share) and share > 0):
        raise ToolError(f"{text}: a share is a number above 0", USAGE)
    return name, share


if __name__ == "__main__":
    errors.run(main)
