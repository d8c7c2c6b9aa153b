"""Entry point of the program: an interruption becomes an exit code, not a traceback."""

import atexit
import gc
import sys


def main() -> None:
    """Loads the program and runs it."""
    atexit.register(gc.freeze)  # msgspec 0.22 may crash in the last collection (its issue 717); often on Python 3.12
    try:
        from gloc3.cli import program as cli
    except KeyboardInterrupt:
        sys.exit(130)  # 128 + SIGINT
    cli.main()
