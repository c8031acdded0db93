"""The library, and those of its functions that the package calls."""
from __future__ import annotations

import ctypes
import os
import sys
import threading
from pathlib import Path

FILE = {"darwin": "libOpenImageDenoise.2.dylib", "win32": "OpenImageDenoise.dll"}.get(
    sys.platform, "libOpenImageDenoise.so.2")

Monitor = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_double)
_p, _s, _n, _i = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int
_PROTOTYPES = {  # of oidn.h: result, arguments
    "oidnNewDevice": (_p, _i), "oidnCommitDevice": (None, _p), "oidnReleaseDevice": (None, _p),
    "oidnSetDeviceInt": (None, _p, _s, _i),
    "oidnGetDeviceError": (_i, _p, ctypes.POINTER(_s)),
    "oidnNewFilter": (_p, _p, _s), "oidnReleaseFilter": (None, _p),
    "oidnSetSharedFilterImage": (None, _p, _s, _p, _i, _n, _n, _n, _n, _n),
    "oidnUnsetFilterImage": (None, _p, _s),
    "oidnSetSharedFilterData": (None, _p, _s, _p, _n),
    "oidnSetFilterBool": (None, _p, _s, ctypes.c_bool), "oidnSetFilterInt": (None, _p, _s, _i),
    "oidnSetFilterFloat": (None, _p, _s, ctypes.c_float), "oidnGetFilterInt": (_i, _p, _s),
    "oidnSetFilterProgressMonitorFunction": (None, _p, Monitor, _p),
    "oidnCommitFilter": (None, _p), "oidnExecuteFilter": (None, _p),
}


def _places() -> list[Path]:
    named = os.environ.get("LULL_LIBRARY")
    here = Path(__file__).resolve().parent
    return [Path(named)] if named else [here / FILE, here.parent.parent / "build" / "lib" / FILE]


_loaded: ctypes.CDLL | None = None
_lock = threading.Lock()


def load_library() -> ctypes.CDLL:
    """The library, loaded at the first call. Raises ImportError if there is none."""
    global _loaded
    with _lock:
        if _loaded is None:
            found = [p for p in _places() if p.exists()]
            if not found:
                raise ImportError("lull: no library: none of " + ", ".join(map(str, _places())))
            try:
                lib = ctypes.CDLL(str(found[0]))
                for name, (result, *arguments) in _PROTOTYPES.items():
                    function = getattr(lib, name)
                    function.restype, function.argtypes = result, arguments
            except (OSError, AttributeError) as err:
                raise ImportError(f"lull: {found[0]}: {err}") from None
            _loaded = lib
    return _loaded
