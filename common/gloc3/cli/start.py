"""Entry point of the program: an interruption becomes an exit code, not a traceback."""

import sys


def main() -> None:
    """Loads the program and runs it."""
    try:
        from gloc3.cli import program as cli
    except KeyboardInterrupt:
        sys.exit(130)  # 128 + SIGINT
    cli.main()
