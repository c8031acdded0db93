#!/usr/bin/env python3
"""Show a training in TensorBoard.

    python -m training.visualize -r my_result [--port 6006]
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.visualize", run_name="__main__", alter_sys=True))

import subprocess
import sys

from training import errors
from training.errors import DEPENDENCY, STATE, ToolError
from training.result import Result
from training.settings import Settings, parse


def command(settings: Settings) -> list[str]:
    """The command line of TensorBoard for a result; names with spaces and quotes are safe."""
    result = Result(settings.results_dir, settings.result)
    if not result.folder.is_dir():
        raise ToolError(f"result '{result.name}' does not exist in {result.folder.parent}", STATE)
    log = result.folder / "log"
    if not log.is_dir():
        raise ToolError(f"{log}: no log yet", STATE)
    return [sys.executable, "-m", "tensorboard.main", f"--logdir={log}", f"--port={settings.port}"]


def main(argv: list[str]) -> None:
    settings = parse("visualize", argv, __doc__)
    call = command(settings)
    try:
        import tensorboard  # noqa: F401
    except ImportError as e:
        raise ToolError("the package tensorboard is not installed", DEPENDENCY) from e
    status = subprocess.run(call).returncode
    if status:
        raise ToolError(f"tensorboard ended with status {status}", DEPENDENCY)


if __name__ == "__main__":
    errors.run(main)
