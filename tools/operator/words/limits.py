"""Limits that act, in words: from the names of telemetry's `limits`."""

_WORDS = {
    "tool_speed": "The tool is at its speed bound.",
    "contact": "The tool goes gently: force control rang on what it touched.",
    "joint_speed": "A joint is at its speed bound: the motion is slowed, its direction kept.",
    "joint_limit": "Joint {0} is near the end of its range.",
    "leash": "Joint {0} lags behind its command: something resists it, so the arm slows.",
    "singularity": "The arm is near a singularity, where it can hardly move some way.",
    "verified_stop": "The stop that was verified took over: going on was not safe.",
    "workspace": "The tool is at the edge of its workspace.",
    "clearance": "Clearance: {0} must not come nearer.",
    "gap": "Clearance: {0} must not come nearer.",
    "torque": "Joint {0} is at its torque bound.",
    "disturbance": "Joint {0} feels a torque that no sensor explains.",
    "barriers_softened": "Two bounds oppose each other: the nearest motion is taken.",
    "barriers_slow": "Two bounds oppose each other: the arm slows.",
    "barriers_stand": "Two bounds oppose each other: the arm stands.",
    "acceleration": "The tool is at its acceleration bound.",
    "together": "The arms that hold the payload slow, so that they stay together.",
    "wall": "A link is near the wall of its tunnel.",
    "held_back": "Clearances hold the base where the reflex saw a way: back off.",
    "no_headway": "The base waits, and the reflex comes to no end: back off.",
    "off_station": "The arm has made way for something, and comes back when it can.",
    "locked": "Joint {0} does not follow: the others bend around it, and the arm only withdraws.",
    "unseen_behind": "Nobody saw the ground behind the base: it goes back slowly.",
    "near": "Near {0}: the tool slows.",
}


def limit_words(name: str) -> str:
    """Return one limit as a sentence; `name` is `KIND` or `KIND:WHICH`."""
    kind, _, which = name.partition(":")
    if kind in _WORDS:
        return _WORDS[kind].format(which or "a joint")
    plain = kind.replace("_", " ")
    return f"Limited: {plain}" + (f" ({which})." if which else ".")
