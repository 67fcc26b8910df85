"""`python -m laboratory.equipment.pictures`."""

import sys

try:
    from .stills import main
except ImportError as error:
    sys.exit(f"telerobot: pictures of the page need the package {error.name}")

sys.exit(main())
