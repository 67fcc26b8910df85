"""`python -m laboratory.campaign`, which `make campaign` runs."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
