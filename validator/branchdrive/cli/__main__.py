"""`python -m branchdrive.cli` runs `branchdrive`.

Python imports from the current folder first, and a dataset may lie there. What it imported before this module is
outside of our control: `branchdrive` and `python -P -m branchdrive.cli` never look there.
"""

import sys
from pathlib import Path

if not sys.flags.safe_path and Path(sys.path[0]) == Path.cwd() != Path(__file__).parents[2]:
    del sys.path[0]

from branchdrive.cli.entry import main

sys.exit(main())
