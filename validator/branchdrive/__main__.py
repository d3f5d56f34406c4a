"""`python -m branchdrive` runs `branchdrive`, see `branchdrive.cli.__main__`."""

import branchdrive.cli.__main__  # noqa: F401
