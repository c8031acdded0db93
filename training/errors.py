"""Errors of the toolkit: one line on stderr, an exit code per kind."""
from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

USAGE, DATA, STATE, OUTPUT, DEPENDENCY = 2, 3, 4, 5, 6
INTERRUPTED = 130


class ToolError(Exception):
    """A failure the user can act on. `code` is the exit status:

    2 wrong option; 3 data missing, unreadable or inconsistent; 4 a result, checkpoint or data set
    that is missing or does not fit; 5 output that cannot be written; 6 a package is missing.
    """

    def __init__(self, message: str, code: int = DATA):
        super().__init__(message)
        self.code = code


class Parser(argparse.ArgumentParser):
    """Wrong options are ToolErrors, and the lines of a description stay as they are."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, formatter_class=argparse.RawDescriptionHelpFormatter, **kwargs)

    def error(self, message: str):
        raise ToolError(f"{message} (--help lists the options)", USAGE)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """ToolErrors of what fails inside: files (`path`, unless the failure names one) that cannot
    be read, and what they hold that does not fit (ValueError)."""
    try:
        yield
    except OSError as e:
        raise ToolError(f"{e.filename or path}: cannot read ({e.strerror})", DATA) from e
    except ValueError as e:
        raise ToolError(str(e), STATE) from e


def set_up_output() -> None:
    """Logs show progress as it happens, and escapes in place of letters that they cannot hold."""
    if hasattr(sys.stdout, "reconfigure"):
        escaped = "backslashreplace" if sys.stdout.errors == "strict" else None
        sys.stdout.reconfigure(line_buffering=True, errors=escaped)


def run(main: Callable[[list[str]], object], argv: list[str] | None = None) -> None:
    """Run a script's main and leave the process: with 0, or one line on stderr and a code."""
    if threading.current_thread() is threading.main_thread():  # as Ctrl-C: what is done is saved
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    set_up_output()
    try:
        main(sys.argv[1:] if argv is None else argv)
    except ToolError as e:
        print(f"Error: {e}", file=sys.stderr)
        sys.exit(e.code)
    except KeyboardInterrupt:
        print("Error: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.exit(1)
    sys.exit(0)
