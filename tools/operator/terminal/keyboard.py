"""Keys from a terminal: typed keys and held keys. Pure: time is an argument.

A terminal never says that a key was released; it only repeats one that is held: first after a
delay (250 to 660 ms, as the desktop is set), then some 30 times a second. So a key counts as held

- from its first press for `first_s`, which bridges the delay before the first repeat,
- from every repeat for `REPEAT_S`, which bridges a repeat or two that came late.

`first_s` is learnt: two presses that are followed by a quick third were a press and its first
repeat, and their distance is this terminal's delay. A terminal repeats the newest key only.
"""

from collections import deque

FIRST_S = 0.55
"""Time for which a first press counts as held while the terminal's delay is unknown [s]."""

REPEAT_S = 0.18
"""Time for which a key counts as held after a repeat [s]."""

QUICK_S = 0.1
"""Presses closer than this are repeats, no fingers [s]."""

DELAYS_S = (0.15, 0.9)
"""Range of a terminal's delay before the first repeat [s]."""

MARGIN_S = 0.08
"""Added to the delay that was learnt [s]."""

SEQUENCES = {
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\t": "tab", " ": "space", "\x03": "ctrl-c", "\x04": "ctrl-d",
}  # fmt: skip


class Decoder:
    """Turns what the terminal sends into key names; unknown sequences are passed over."""

    def __init__(self) -> None:
        self._left = ""

    def keys(self, data: bytes) -> list[str]:
        """Return the keys in `data`; a sequence that is not complete waits for the next call."""
        text = self._left + data.decode("utf-8", "replace")
        self._left = ""
        keys: list[str] = []
        while text:
            if text[0] == "\x1b":
                length = _sequence_length(text)
                if length is None:
                    self._left = text
                    break
            else:
                length = 1
            name = SEQUENCES.get(text[:length], text[:length])
            if name.isprintable():
                keys.append(name)
            text = text[length:]
        return keys


def _sequence_length(text: str) -> int | None:
    """Return the length of the escape sequence that `text` begins with, None if it goes on."""
    if len(text) == 1:
        return None
    if text[1] == "O":
        return 3 if len(text) > 2 else None
    if text[1] != "[":
        return 1
    for i, c in enumerate(text[2:], 2):
        if "@" <= c <= "~":
            return i + 1
    return None


class HeldKeys:
    """Which keys are held, told from their presses and repeats."""

    def __init__(self) -> None:
        self.first_s = FIRST_S
        """Time for which a first press counts as held [s]; learnt."""
        self._until: dict[str, float] = {}
        self._presses: dict[str, deque[float]] = {}

    def press(self, key: str, now_s: float) -> None:
        """Take in a press or a repeat."""
        repeated = self._until.get(key, now_s) > now_s
        self._until[key] = now_s + (REPEAT_S if repeated else self.first_s)
        presses = self._presses.setdefault(key, deque(maxlen=3))
        presses.append(now_s)
        if len(presses) == 3:
            delay = presses[1] - presses[0]
            quick = presses[2] - presses[1] < QUICK_S
            if quick and DELAYS_S[0] < delay < DELAYS_S[1]:
                self.first_s = delay + MARGIN_S

    def held(self, now_s: float) -> set[str]:
        """Return the keys that are held now."""
        self._until = {key: until for key, until in self._until.items() if until > now_s}
        return set(self._until)

    def release(self, *keys: str) -> None:
        """Count keys as released, all of them when none is named."""
        for key in keys or tuple(self._until):
            self._until.pop(key, None)
