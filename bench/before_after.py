"""Makes the README's picture: demo/ noisy, denoised by build/bin/oidnDenoise, and its reference.

    python -m bench.before_after [OUTPUT.png]        (default docs/before-after.png)
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from bench import oidn, pictures
from training import color
from training.imageio import read_exr, replacing, write_image

GAP = 4  # white pixels between the pictures


def main() -> int:
    output = Path(sys.argv[1]) if len(sys.argv) > 1 else oidn.ROOT / "docs" / "before-after.png"
    noisy = pictures.demo()
    reference = noisy.with_name(noisy.name.rpartition("_")[0] + "_ref.exr")
    try:
        with tempfile.TemporaryDirectory() as scratch:
            denoised = Path(scratch) / "out.exr"
            oidn.run(oidn.ours(), noisy, "-o", denoised)
            images = [read_exr(path) for path in (noisy, denoised, reference)]
        exposure = color.autoexposure(images[-1])
        shown = [color.display(image, exposure) for image in images]
        gap = np.ones((shown[0].shape[0], GAP, 3), np.float32)
        row = np.concatenate([shown[0], gap, shown[1], gap, shown[2]], 1)
        with replacing(output) as temporary:
            write_image(temporary, row)
    except (oidn.PeerError, OSError) as error:
        print(f"before_after: {error}", file=sys.stderr)
        return 1
    print(f"written: {output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
