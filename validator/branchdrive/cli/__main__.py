"""`python -m branchdrive.cli` runs `branchdrive`."""

import sys

from branchdrive.cli.main import main

sys.exit(main())
