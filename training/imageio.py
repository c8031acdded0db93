"""Image files: EXR (OpenEXR package), PFM, PHM, Radiance HDR, PNG. [H,W,C], top row first.

Float formats come back as float32 as stored; 8 and 16 bit formats as float32 in [0,1], as encoded.
Writers go to a temporary name and rename, so that no half-written file is ever seen.
"""
from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from collections.abc import Iterator

import numpy as np

from training.errors import DATA, DEPENDENCY, OUTPUT, ToolError

LINEAR_FORMATS = ("exr", "pfm", "phm", "hdr")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` that becomes `path` when the block ends well."""
    path = Path(path)
    tmp = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield tmp
        os.replace(tmp, path)
    except OSError as e:
        raise ToolError(f"{path}: cannot write ({e.strerror or e})", OUTPUT) from e
    finally:
        tmp.unlink(missing_ok=True)


def _openexr():
    try:
        import OpenEXR
    except ImportError as e:
        raise ToolError("EXR files need the package OpenEXR", DEPENDENCY) from e
    return OpenEXR


def read_exr_channels(path: Path) -> dict[str, np.ndarray]:
    """All channels of all parts by name, [H,W] float32; later parts are prefixed by their name."""
    exr = _openexr()
    try:
        with exr.File(str(path), separate_channels=True) as f:
            channels = {}
            for i, part in enumerate(f.parts):
                prefix = f"{part.name()}." if i and part.name() else ""
                for name, c in part.channels.items():
                    key = name if name.startswith(prefix) else prefix + name
                    channels.setdefault(key, np.asarray(c.pixels, np.float32))
    except ToolError:
        raise
    except Exception as e:  # the package raises plain RuntimeError and ValueError
        raise ToolError(f"{path}: cannot read ({str(e).splitlines()[0] if str(e) else e!r})",
                        DATA) from e
    if not channels:
        raise ToolError(f"{path}: holds no channels", DATA)
    return channels


def read_exr(path: Path) -> np.ndarray:
    """The picture of an EXR: R,G,B, else Y, else X,Y,Z, else its only channels, [H,W,C<=3]."""
    channels = read_exr_channels(path)
    for names in (("R", "G", "B"), ("Y",), ("X", "Y", "Z"), ("Z",)):
        if all(n in channels for n in names):
            return np.stack([channels[n] for n in names], -1)
    layers = {n.rpartition(".")[0] for n in channels}
    if len(layers) > 1:
        raise ToolError(f"{path}: several layers and no R,G,B among them "
                        f"({', '.join(channels)})", DATA)
    tails = {n.rpartition(".")[2].upper(): n for n in channels}
    for tail in ("RGB", "XYZ"):
        if all(t in tails for t in tail):
            return np.stack([channels[tails[t]] for t in tail], -1)
    return np.stack(list(channels.values())[:3], -1)


def read_image(path: Path) -> np.ndarray:
    """Any supported image by its extension."""
    return read_exr(path)
