"""Passage of a contour ahead, in words: from the phase and the reason that a scanner tells."""

_PHASES = {
    "clear": "The way ahead is clear.",
    "undecided": "Something is ahead: the arm waits for another sweep.",
    "folding": "The arm folds to pass below what is ahead.",
    "folded": "The arm is folded: the base may pass.",
    "returning": "The arm goes back to how it was.",
    "refused": "There is no way through.",
}

_REASONS = {
    "base_blocked": "The base itself does not pass: drive round it.",
    "column_blocked": "The arm's foot does not pass: drive round it.",
    "no_posture": "No posture of the arm passes: drive round it.",
    "no_way": "The arm finds no free way to the posture that would pass: back off.",
    "sequence_f1": "The tool finds no free place: drive round it.",
    "sequence_f2": "The elbow finds no free place while the tool stands: drive round it.",
    "sequence_f3": "The tool does not get behind the elbow: drive round it.",
    "sequence_stuck": "Tool and elbow go round in circles: drive round it.",
    "held_back": "Clearances hold the base where the reflex saw a way: back off.",
    "no_headway": "The base waits, and the reflex comes to no end: back off.",
    "held_up": "The arm was held up on its way: look at what it met.",
}


def passage_words(phase: str, reason: str) -> str:
    """Return a phase of the passage as a sentence, with why there is no way."""
    said = _PHASES.get(phase, phase.replace("_", " ").capitalize() + ".")
    because = _REASONS.get(reason, reason.replace("_", " "))
    return f"{said} {because}".strip()
