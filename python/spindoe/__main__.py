"""The command ``spindoe``."""

from __future__ import annotations

import signal
import sys

from . import _native


def main() -> int:
    """Runs the command with the process' arguments; returns its exit code."""
    # Python's handler only notes Ctrl-C for when Python runs again; the command is not Python.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.command(["spindoe", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
