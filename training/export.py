#!/usr/bin/env python3
"""The script `export` of the toolkit; its code is export/export.py."""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.export", run_name="__main__", alter_sys=True))

from export.export import main
from training import errors

if __name__ == "__main__":
    errors.run(main)
