"""When does a sampled force loop stay stable? The bound, and the delays that enter it.

A sampled integrator with `d` periods of delay is stable iff K T < 2 sin(π / (2(2d + 1))), where K
is K_F k_e for force control against a wall (Williams 1997, section 2.5, sampled).
"""

import math


def sampled_bound(delay_periods: float) -> float:
    """Return the greatest stable K T of a sampled integrator behind a delay [1]."""
    return 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay_periods + 1.0)))
