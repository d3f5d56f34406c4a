"""Entry point of `branchdrive-conformance`."""

import sys

__all__ = ["main"]


def main() -> int:
    """Run the command with the arguments of this process."""
    try:
        from branchdrive.cli.main import script_main
    except KeyboardInterrupt:
        sys.stderr.write("branchdrive-conformance: interrupted\n")
        return 130
    return script_main("branchdrive-conformance", "branchdrive_conformance.command")
