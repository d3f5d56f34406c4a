"""Entry point of ``python -m branchdrive.contract.generate``."""

from __future__ import annotations

import sys

from branchdrive.contract.generate import main

sys.exit(main())
