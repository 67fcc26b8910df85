"""`python -m telerobot.tools.pictures`."""

import sys

from .stills import main

sys.exit(main())
