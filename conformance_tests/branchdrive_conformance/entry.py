"""Entry point of `branchdrive-conformance`."""

import sys

__all__ = ["main"]


def main() -> int:
    """Run the command with the arguments of this process."""
    try:
        from branchdrive.cli.main import script_main
    except KeyboardInterrupt:
        from branchdrive.exit_code import EXIT_INTERRUPTED

        sys.stderr.write("branchdrive-conformance: interrupted\n")
        return EXIT_INTERRUPTED
    return script_main("branchdrive-conformance", "branchdrive_conformance.command")
