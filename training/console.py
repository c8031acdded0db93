"""Progress on the console."""
from __future__ import annotations

import sys
import time

WIDTH = 50


class Bar:
    """A bar redrawn in place on terminals; elsewhere only its final line appears."""

    def __init__(self, enabled: bool = True):
        self.enabled, self.live = enabled, enabled and sys.stdout.isatty()
        self.title, self.drawn = "", 0.0

    def show(self, title: str, fraction: float) -> None:
        self.title = title
        now = time.monotonic()
        if not self.live or (now - self.drawn < 0.1 and fraction < 1):
            return
        self.drawn = now
        done = round(WIDTH * fraction)
        sys.stdout.write(f"\r{title}: [{'=' * done}{'.' * (WIDTH - done)}] {fraction:6.1%}")
        sys.stdout.flush()

    def end(self, text: str) -> None:
        """Replace the bar by a line of text."""
        if self.enabled:
            blank = " " * (WIDTH + 12)
            sys.stdout.write(f"\r{self.title}: {text}{blank}\n" if self.live
                             else f"{self.title}: {text}\n")
            sys.stdout.flush()


def duration(seconds: float) -> str:
    """1d 2h, 2h 10m, 3m 5s or 4.2s."""
    if seconds < 60:
        return f"{seconds:.1f}s"
    minutes, s = divmod(int(seconds), 60)
    hours, m = divmod(minutes, 60)
    days, h = divmod(hours, 24)
    return f"{days}d {h}h" if days else f"{hours}h {m}m" if hours else f"{m}m {s}s"
