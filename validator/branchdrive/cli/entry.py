"""Entry points of the commands: an interrupt while they are loaded is one line, as it is at any later time.

Nothing is imported before that is caught.
"""

import sys

__all__ = ["main", "validate_main"]


def main() -> int:
    """Entry point of `branchdrive`."""
    try:
        from branchdrive.cli import main as commands
    except KeyboardInterrupt:
        return _interrupted("branchdrive")
    return commands.main()


def validate_main() -> int:
    """Entry point of `branchdrive-validate`."""
    try:
        from branchdrive.cli import main as commands
    except KeyboardInterrupt:
        return _interrupted("branchdrive-validate")
    return commands.validate_main()


def _interrupted(prog: str) -> int:
    """Tell of the interrupt; returns the exit code."""
    from branchdrive.exit_code import EXIT_INTERRUPTED

    if sys.stderr is not None:
        sys.stderr.write(f"{prog}: interrupted\n")
    return EXIT_INTERRUPTED
