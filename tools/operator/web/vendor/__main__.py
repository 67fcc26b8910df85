"""Entry point of `python -m telerobot.tools.operator.web.vendor`."""

import sys

from .fetch import main

if __name__ == "__main__":
    sys.exit(main())
