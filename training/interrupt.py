"""Ctrl-C and SIGTERM, as requests that are heard where nothing is half done."""
from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator

from training.errors import STATE, ToolError

AGAIN = 2.0  # seconds: what comes sooner is the same request, which a launcher has passed on, too


class Interrupted(KeyboardInterrupt):
    """A request, where what is done can be saved."""


def forget_loaders() -> None:
    """From here on, loaders that end are no failures, which DataLoader takes them for."""
    with contextlib.suppress(ValueError, AttributeError):  # not in the main thread; Windows
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)


@contextlib.contextmanager
def watched_loaders() -> Iterator[None]:
    """That a loader has died a RuntimeError of PyTorch says at any moment, or what becomes of a
    batch that is still with it; here it is a ToolError."""
    try:
        yield
    except (RuntimeError, ConnectionError, EOFError) as e:
        if isinstance(e, RuntimeError) and not str(e).startswith("DataLoader worker"):
            raise
        forget_loaders()
        raise ToolError("a loader process has died, as where memory or /dev/shm is full; fewer "
                        "--num_loaders take less of both", STATE) from e


class Interrupts:
    """Until closed, SIGINT and SIGTERM only set `asked`, which is to be looked at where stopping
    does no harm. A second request is a KeyboardInterrupt wherever it falls."""

    def __init__(self):
        self.since: float | None = None
        self.waits, self.kept = False, {}
        if threading.current_thread() is threading.main_thread():
            self.kept = {number: signal.signal(number, self._hear)
                         for number in (signal.SIGINT, signal.SIGTERM)}

    @property
    def asked(self) -> bool:
        return self.since is not None

    def check(self) -> None:
        """Interrupted if there was a request."""
        if self.asked:
            raise Interrupted

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """Within, for waits, a request is Interrupted wherever it falls."""
        self.waits = True
        try:
            self.check()
            yield
        finally:
            self.waits = False

    def _hear(self, *_) -> None:
        if self.since is None:
            self.since = time.monotonic()
        elif time.monotonic() - self.since > AGAIN:
            raise KeyboardInterrupt
        if self.waits:
            raise Interrupted

    def close(self) -> None:
        for number, handler in self.kept.items():
            signal.signal(number, handler)

    def __enter__(self) -> Interrupts:
        return self

    def __exit__(self, *exc) -> None:
        self.close()
