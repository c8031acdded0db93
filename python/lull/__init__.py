"""Denoise path-traced images held in numpy arrays, or in PyTorch tensors of the CPU.

    import lull
    clean = lull.denoise(color, albedo, normal, hdr=True)     # arrays (height, width, 3)

    with lull.Denoiser(quality="balanced", hdr=True, threads=2) as denoiser:
        for color, albedo, normal in frames:                  # keeps memory and threads
            denoiser(color, albedo, normal, out=color)

`denoise` takes what pyoidn's function of that name takes, with the same defaults. The images of a
renderer are used where they lie, whatever the distance of their pixels and rows: slices of an array
(height, width, layers) are not copied, nor are results that go to `out`.

The library is liblull's implementation of the interface of Open Image Denoise: of this package, or
of the tree that it lies in (`make`), or the file that the environment variable LULL_LIBRARY names.
"""
from __future__ import annotations

import ctypes
import operator
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .native import Monitor, load_library

__all__ = ["Cancelled", "Denoiser", "Error", "denoise", "load_library"]

QUALITIES = {"default": 0, "fast": 4, "balanced": 5, "high": 6, "auto": 100}
FORMATS = {np.dtype(np.float32): 0, np.dtype(np.float16): 256}  # and the number of channels
Progress = Callable[[float], Any]


class Error(RuntimeError):
    """The library refused or failed. Bad arguments are a ValueError, want of memory a
    MemoryError."""


class Cancelled(Error):
    """A progress function returned False."""


def _is_tensor(image: Any) -> bool:
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(image, torch.Tensor)


def _array(image: Any, name: str) -> np.ndarray:
    """image as (height, width, channels) of float32 or float16; a view of it where that is so."""
    if _is_tensor(image):
        if image.device.type != "cpu":
            raise ValueError(f"{name}: a tensor on {image.device}; move it to the CPU")
        image = image.detach().numpy()
    if not isinstance(image, np.ndarray):
        raise TypeError(f"{name}: a numpy array or PyTorch tensor is wanted, not "
                        f"{type(image).__name__}")
    native = image.dtype.newbyteorder("=")
    image = image.astype(np.float32 if native == np.float64 else native, copy=False)
    if image.dtype not in FORMATS:
        raise TypeError(f"{name}: {image.dtype} values; float32, float16 or float64 are wanted "
                        "(integers: divide by their largest value)")
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or not 1 <= image.shape[2] <= 4 or 0 in image.shape:
        raise ValueError(f"{name}: shape {image.shape}; (height, width) or (height, width, 1 to 4) "
                         "is wanted")
    return image


def _as_it_lies(image: np.ndarray) -> bool:
    """Whether Open Image Denoise's strides can describe it."""
    height, width, channels = image.shape
    row, pixel, channel = image.strides
    size = image.itemsize
    if width == 1:
        pixel = channels * size
    return ((channel == size or channels == 1) and pixel >= channels * size
            and (row >= width * pixel or height == 1)
            and image.ctypes.data % size == 0 and row % size == 0 and pixel % size == 0)


def _number(name: str, value: Any, kind: Callable[[Any], Any]) -> Any:
    try:
        return kind(value)
    except (TypeError, ValueError):
        kinds = "number" if kind is float else "whole number"
        raise TypeError(f"{name}: {value!r} is not a {kinds}") from None


class Denoiser:
    """A filter with its settings, device and threads, to be called for one frame after another.

    quality      "high", "balanced", "fast", "default" (high), their numbers in oidn.h, or "auto":
                 the least that the frame needs
    hdr          the colour is linear and unbounded; else in [0, 1]
    srgb         the colour (not hdr) is sRGB-encoded; else linear
    clean_aux    albedo and normals have no noise
    panorama     the images are equirectangular panoramas of a whole sphere, whose edges meet
    filter_type  "RT", or "RTLightmap" for light maps (linear, no albedo; normals beside them are 0
                 where there is no surface, and light from the nearest one stands there)
    directional  of RTLightmap: directions in [-1, 1], not radiance
    input_scale  factor on the colour that makes it about 1 where it matters; None: measured
    weights      a TZA file's path or bytes; None: the built-in models
    threads      0: one per core
    max_memory_mb  of the library, None: no limit
    ensemble     1, 2 or 4: the mean of so many orientations, for as many times the time

    Any thread may call it; calls wait for each other. Raises ValueError or TypeError for settings
    that cannot be, Error if the device cannot be had.
    """

    _device = _filter = _pid = _inside = None  # _inside: thread of a running progress function

    def __init__(self, *, quality: str = "high", hdr: bool = False, srgb: bool = False,
                 clean_aux: bool = False, panorama: bool = False, filter_type: str = "RT",
                 directional: bool = False, input_scale: float | None = None,
                 weights: str | os.PathLike | bytes | None = None, threads: int = 0,
                 max_memory_mb: int | None = None, ensemble: int = 1):
        if filter_type not in ("RT", "RTLightmap"):
            raise ValueError(f"filter_type: {filter_type!r} is neither 'RT' nor 'RTLightmap'")
        if quality not in QUALITIES and quality not in QUALITIES.values():
            raise ValueError(f"quality: {quality!r} is none of {', '.join(QUALITIES)}")
        self._lightmap = lightmap = filter_type == "RTLightmap"
        if lightmap and (srgb or clean_aux or panorama):
            raise ValueError("srgb, clean_aux and panorama are of filter_type 'RT'")
        if directional and not lightmap:
            raise ValueError("directional is of filter_type 'RTLightmap'")
        if hdr and srgb:
            raise ValueError("srgb: hdr colours are linear")
        for name, value in (("threads", threads), ("max_memory_mb", max_memory_mb)):
            if value is not None and not 0 <= _number(name, value, operator.index) < 2**31:
                raise ValueError(f"{name}: {value} is negative or too large")
        if ensemble not in (1, 2, 4):
            raise ValueError(f"ensemble: {ensemble} is none of 1, 2, 4")
        self._lock = threading.Lock()
        self._had: set[str] = set()
        self._pid = os.getpid()
        self._lib = lib = load_library()
        self._device = lib.oidnNewDevice(1)
        self._check()
        if threads:
            lib.oidnSetDeviceInt(self._device, b"numThreads", threads)
        lib.oidnCommitDevice(self._device)
        self._check()
        self._filter = lib.oidnNewFilter(self._device, filter_type.encode())
        self._check()
        flags = {"directional": directional} if lightmap else {
            "hdr": hdr, "srgb": srgb, "cleanAux": clean_aux, "panorama": panorama}
        for name, value in flags.items():
            lib.oidnSetFilterBool(self._filter, name.encode(), value)
        lib.oidnSetFilterInt(self._filter, b"quality", int(QUALITIES.get(quality, quality)))
        if ensemble > 1:
            lib.oidnSetFilterInt(self._filter, b"ensemble", ensemble)
        if max_memory_mb is not None:
            lib.oidnSetFilterInt(self._filter, b"maxMemoryMB", max_memory_mb)
        if input_scale is not None:
            lib.oidnSetFilterFloat(self._filter, b"inputScale",
                                   _number("input_scale", input_scale, float))
        if weights is not None:
            self._weights = weights if isinstance(weights, bytes) else Path(weights).read_bytes()
            lib.oidnSetSharedFilterData(self._filter, b"weights", self._weights,
                                        len(self._weights))
        self._check()

    def __call__(self, color: Any = None, albedo: Any = None, normal: Any = None, *,
                 out: Any = None, progress: Progress | None = None) -> Any:
        """The denoised image: of the colour; without one, of the albedo, else of the normals.

        Images: (height, width) or (height, width, channels) of float32, float16 or float64 (which
        is calculated as float32). Of four channels three are denoised, and the fourth, alpha, is
        handed on. Albedo in [0, 1], normals in [-1, 1]. They are not changed, but for `out`.

        out: array for the result, of the same shape; may be one of the inputs. None: a new one, of
        the type of the first image. progress: called with the part done, 0 to 1, by a thread of the
        library; False cancels, an exception cancels and is raised here.

        Raises TypeError or ValueError for images that cannot be taken, MemoryError, Cancelled, and
        Error for everything else.
        """
        given = {k: v for k, v in (("color", color), ("albedo", albedo), ("normal", normal))
                 if v is not None}
        if not given:
            raise ValueError("color, albedo or normal is wanted")
        if self._lightmap and ("albedo" in given or "color" not in given):
            raise ValueError("filter_type 'RTLightmap' takes a color, and a normal beside it")
        first = next(iter(given.values()))
        images = {name: _array(image, name) for name, image in given.items()}
        main = next(iter(images.values()))
        for name, image in images.items():
            if image.shape[:2] != main.shape[:2]:
                raise ValueError(f"{name}: {image.shape[1]}x{image.shape[0]} pixels, where "
                                 f"{next(iter(images))} has {main.shape[1]}x{main.shape[0]}")
        images = {name: image if _as_it_lies(image) else np.ascontiguousarray(image)
                  for name, image in images.items()}
        result = np.empty(main.shape, main.dtype)
        if out is not None:
            target = _array(out, "out")
            if target.shape != main.shape:
                raise ValueError(f"out: shape {target.shape}, where the image has {main.shape}")
            if not target.flags.writeable:
                raise ValueError("out: it cannot be written")
            base = out.detach().numpy() if _is_tensor(out) else out
            if _as_it_lies(target) and np.may_share_memory(target, base):
                result = target
        self._run(images, result, progress)
        if main.shape[2] == 4:
            result[..., 3] = main[..., 3]
        if out is None:
            shaped = result.reshape(first.shape)
            if _is_tensor(first):
                return sys.modules["torch"].from_numpy(shaped).to(first.dtype)
            return shaped.astype(first.dtype, copy=False)
        if result is not target:
            base[...] = result.reshape(base.shape)
        return out

    @property
    def used_quality(self) -> str:
        """Which quality the last frame was denoised with: of interest with "auto"."""
        with self._turn():
            used = self._lib.oidnGetFilterInt(self._filter, b"usedQuality")
            self._check()
        return next(name for name, value in QUALITIES.items() if value == used)

    def close(self) -> None:
        """Gives threads and memory back; further calls are an Error. Also at the end of `with`."""
        if not self._device or os.getpid() != self._pid:  # threads did not come through a fork
            return
        with self._turn(closed=True):
            device, self._device = self._device, None
            flt, self._filter = self._filter, None
            if flt:
                self._lib.oidnReleaseFilter(flt)
            if device:
                self._lib.oidnReleaseDevice(device)

    def __enter__(self) -> Denoiser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()

    def __reduce__(self) -> Any:
        raise TypeError("a Denoiser can be neither copied nor pickled; make another one")

    @contextmanager
    def _turn(self, closed: bool = False) -> Iterator[None]:
        """The lock. Raises Error where waiting for it would not end, and, unless `closed`, if there
        is no filter any more."""
        if os.getpid() != self._pid:
            raise Error("the denoiser is of the parent process; make one after the fork")
        if self._inside == threading.get_ident():
            raise Error("a progress function cannot use the denoiser that called it")
        with self._lock:
            if not self._filter and not closed:
                raise Error("the denoiser is closed")
            yield

    def _check(self) -> None:
        """Raises what the library says of the calls since the last check."""
        text = ctypes.c_char_p()
        code = self._lib.oidnGetDeviceError(self._device, ctypes.byref(text))
        if code:
            kind = {2: ValueError, 4: MemoryError, 6: Cancelled}.get(code, Error)
            raise kind((text.value or b"unknown error").decode(errors="replace"))

    def _run(self, images: dict[str, np.ndarray], result: np.ndarray,
             progress: Progress | None) -> None:
        raised: list[BaseException] = []

        def monitor(_: int, part: float) -> bool:
            self._inside = threading.get_ident()
            try:
                return progress(part) is not False
            except BaseException as err:  # also KeyboardInterrupt: nothing may leave a callback
                raised.append(err)
                return False
            finally:
                self._inside = None

        with self._turn():
            lib, flt = self._lib, self._filter
            for name in self._had - set(images):
                lib.oidnUnsetFilterImage(flt, name.encode())
            self._had = set(images)
            for name, image in {**images, "output": result}.items():
                height, width, channels = image.shape
                lib.oidnSetSharedFilterImage(
                    flt, name.encode(), image.ctypes.data,
                    FORMATS[image.dtype] + min(channels, 3), width, height, 0,
                    image.strides[1] if width > 1 else 0, image.strides[0] if height > 1 else 0)
            call = Monitor(monitor) if progress else Monitor()
            lib.oidnSetFilterProgressMonitorFunction(flt, call, None)
            self._check()
            lib.oidnCommitFilter(flt)
            self._check()
            lib.oidnExecuteFilter(flt)
            try:
                self._check()
            except Cancelled:
                if not raised:
                    raise
            if raised:  # perhaps when all was done, too late to cancel
                raise raised[0]


_cached: tuple[tuple, Denoiser] | None = None
_lock = threading.Lock()


def denoise(color: Any = None, albedo: Any = None, normal: Any = None, *, out: Any = None,
            progress: Progress | None = None, **settings: Any) -> Any:
    """`Denoiser(**settings)(color, albedo, normal, out=out, progress=progress)`.

    The denoiser is kept for the next call with the same settings.
    """
    global _cached
    if isinstance(settings.get("weights"), (str, os.PathLike)):
        settings["weights"] = Path(settings["weights"]).read_bytes()  # they may have changed
    key = (os.getpid(), *sorted(settings.items()))
    with _lock:
        had = _cached
    if had is None or had[0] != key:
        had = (key, Denoiser(**settings))
        with _lock:
            _cached = had
    return had[1](color, albedo, normal, out=out, progress=progress)
