#!/usr/bin/env python3
"""The script `export` of the toolkit; its code is export/export.py."""
from __future__ import annotations

from export.export import main
from training import errors

if __name__ == "__main__":
    errors.run(main)
