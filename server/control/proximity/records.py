"""Arrays that belong together, as the kernels of this room take them: plain tuples in one order."""

from typing import Final

from ..compiled import ARRAY3, ARRAY4, FLAGS, FLAGS2, INDEX, MATRIX, ROW, TABLE, VECTOR, record
from ..scene import Flags, Index
from ..spatial import Array

Tree = tuple[Index, Flags, Array, Array]
TREE: Final = record(INDEX, FLAGS, ARRAY4, MATRIX)
"""`forest.Tree`."""

Roots = tuple[Array, Array]
ROOTS: Final = record(ARRAY4, ARRAY3)
"""Attitudes (s, r, 3, 3) and places (s, r, 3) [m] of roots in World; s = 1 where none moves."""

Placed = tuple[Array, Array, Array]
PLACED: Final = record(ARRAY4, ARRAY4, ARRAY3)
"""`capsules.Placed`."""

Bodies = tuple[Array, Flags, Flags]
BODIES: Final = record(VECTOR, FLAGS2, FLAGS)
"""Radii of capsules (c,) [m], which joints move them (c, n), which joints are prismatic (n,)."""

Pairs = tuple[Index, Index]
PAIRS: Final = record(INDEX, INDEX)
"""Of k pairs: the capsule `first` (k,) and the thing `second` (k,), as `distance.py` counts it."""

Obstacles = tuple[Array, Array, Array, Array, Array]
OBSTACLES: Final = record(MATRIX, MATRIX, ARRAY3, MATRIX, MATRIX)
"""`Scene.segments`: ends (m, 3) of rounds; attitudes (b, 3, 3), centres and half sides (b, 3)."""

Near = tuple[Array, Array, Array]
NEAREST: Final = record(VECTOR, MATRIX, MATRIX)
"""`gaps.Nearest`."""
MEASURED: Final = record(ROW, TABLE, TABLE)
"""The same, to be filled in."""

Motion = tuple[Array, Array, Array, Array]
MOTION: Final = record(VECTOR, MATRIX, VECTOR, MATRIX)
"""`clearance`, `velocity`, `speed` and `observed` of a `Scene`."""
