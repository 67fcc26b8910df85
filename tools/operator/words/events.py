"""Events as sentences: their cause, and what to do next. Pure."""

from typing import TypedDict

from ....config.errors import printable
from ....protocols.messages.telemetry import Event
from .faults import FAULTS, RESUME
from .refusals import NEXT


class EventWords(TypedDict):
    """Event, cause, and a person's next step; that is empty where there is nothing to do."""

    sentence: str
    next: str


_WORDS: dict[str, tuple[str, str]] = {
    "lease_granted": ("{detail} has the lease and may command.", ""),
    "lease_released": ("{detail} gave the lease back.", "Take control to drive."),
    "lease_expired": (
        "The lease of {detail} ran out: nothing was heard for too long. A moving arm stops.",
        "Take control, then resume.",
    ),
    "protective_stop": ("Protective stop, {detail}.", "Clear it, then resume."),
    "protective_stop_cleared": ("The protective stop is cleared.", "Resume to go on."),
    "stream_expired": ("The stream {detail} fell silent and faded.", ""),
    "insecure": ("Anybody who reaches the daemon may command: {detail}.", "Make certificates."),
    "retiring": ("The daemon ends: it stops the arm and switches the drives off.", "Start it."),
    "device_missing": ("A device is missing: {detail}.", "Is it powered and on the bus?"),
    "sensor_stale": (
        "The sensor {detail} tells nothing new: force control fades.",
        "Check the sensor and its cable.",
    ),
    "sensor_saturated": (
        "A sensor is at an end of its range: {detail}. What it reads is not used, force control "
        "fades.",
        "Take load off it: jog away, or take the payload off.",
    ),
    "sensor_fresh": ("The sensor {detail} tells again.", ""),
    "touched": ("The arm touched something: {detail}.", f"Free the arm, then {RESUME}."),
    "jammed": (
        "Something holds up the motion: {detail}.",
        "Draw back, or search: see whether what is to go in is before its hole.",
    ),
    "held_up": ("The tool is {detail}.", "Draw back, if it is not meant to press."),
    "contact_unstable": (
        "The tool rings on what it touches: {detail}.",
        "Press more gently, or set lower gains of force control.",
    ),
    "force_unchanging": (
        "Nobody leads the tool: {detail}.",
        "Tell the payload, or tare; a hand that comes is followed.",
    ),
    "touch_found": ("Contact is felt again.", ""),
    "giving_way": ("The arm gives way {detail}.", ""),
    "gave_way": ("The arm gave way: {detail}.", f"Look at what it met, then {RESUME}."),
    "still_pushed": ("The arm {detail}.", "Take away what pushes it."),
    "beyond_wall": (
        "Inside its tunnel, {detail}.",
        "Withdraw it slowly, or jog it back; does the cell say where the tunnel is?",
    ),
    "joint_locked": (
        "Joint {detail}: the others bend around it, and the arm may only withdraw.",
        "Withdraw it to the entrance, then see to the drive.",
    ),
    "off_wall": ("Inside its tunnel, {detail}.", ""),
    "wheels_slip": (
        "The wheels slip: {detail}.",
        "See to the ground under them, and whether the base met something, then resume.",
    ),
    "wheels_grip": ("The wheels grip again.", ""),
    "unseen_behind": (
        "Nobody saw the ground behind the base, which goes back slowly: {detail}.",
        "Look there, or turn the base round.",
    ),
    "load_unknown": ("The payload is unknown: force control waits.", "Tell the payload, or tare."),
    "load_unexplained": (
        "The sensor reads a load that nothing explains: {detail}.",
        "Tare, tell the payload, or acknowledge the load.",
    ),
    "payload_differs": (
        "The payload weighs otherwise than it was told: {detail}. The arms hold it where it is.",
        "Is it the right one, and free? Correct the task's payload in the cell.",
    ),
    "load_acknowledged": ("The unexplained load is acknowledged: force control acts on it.", ""),
    "obstacle_stale": (
        "News of an obstacle is stale: {detail}.",
        "Is its sensor running, and does nobody else tell of it?",
    ),
    "obstacle_fresh": ("The obstacle {detail} is told of again.", ""),
    "obstacle_jumped": ("The obstacle {detail} was faster than its bound.", ""),
    "made_way": ("The arm makes way: {detail}.", ""),
    "came_back": ("The arm is back where it was told to stand.", ""),
    "sight_line_lost": ("The arm hides a view: {detail}.", "Move the arm out of the line."),
    "sight_line_free": ("Nothing hides the view {detail} any more.", ""),
    "view_lost": ("The camera's view is lost: {detail}.", "Uncover the tag, or light the scene."),
    "view_found": ("The camera sees the tag again.", ""),
    "frame_lost": ("A frame is no longer told of: {detail}.", "Is its sensor running?"),
    "frame_disputed": (
        "News of a frame contradicts itself and is not believed, as of two senders: {detail}.",
        "Let one sensor alone tell of it, then resume.",
    ),
    "frame_rejected": ("News of a frame is not believed: {detail}.", ""),
    "outside_limit": (
        "A joint stands outside its limits: {detail}.",
        "Jog it back in: it can only be moved that way.",
    ),
    "gain_forced": ("A gain beyond the stable bound was forced: {detail}.", "Watch the tool."),
    "posture_reached": ("The posture is reached.", ""),
    "held_together": ("The arms hold their payload together.", ""),
    "let_go": ("The arms let go of their payload.", ""),
    "stop_worsened": ("What came nearer made the stop fall short: {detail}.", "Move away from it."),
}


def event_words(event: Event) -> EventWords:
    """Return an event as a sentence with its cause, and what to do next."""
    if event.name == "mode":
        return _mode(event)
    if event.name == "stopping":
        return _stopping(event.detail)
    if event.name.endswith("_refused"):
        reason = str(event.values.get("reason", ""))
        return EventWords(sentence=f"Refused: {event.detail}.", next=NEXT.get(reason, ""))
    if event.name in _WORDS:
        sentence, after = _WORDS[event.name]
        said = sentence.format(detail=event.detail).replace(" :", ":").replace(": .", ".")
        return EventWords(sentence=said, next=after)
    cause = str(event.values.get("cause", event.name))
    plain = event.name.replace("_", " ").capitalize()
    said = f"{plain}: {event.detail}." if event.detail else f"{plain}."
    if event.severity == "error":
        return EventWords(
            sentence=f"{said} The drives were stopped.",
            next=FAULTS.get(cause, "Find and mend the cause, reset, then enable."),
        )
    return EventWords(sentence=said, next="")


_MODES = {
    "boot": ("The daemon looks for its devices.", ""),
    "ready": ("The drives are off.", "Take control, then enable."),
    "enabled": ("The drives are on: the arm may move.", ""),
    "stopping": ("The arm is coming to rest.", ""),
    "hold": ("The arm stands, drives on.", "Resume to go on."),
    "fault": ("Fault: the drives stopped the arm.", "Mend the cause, then reset."),
}


def mode_words(mode: str) -> tuple[str, str]:
    """Return a mode as a sentence, and what to do next."""
    return _MODES.get(mode, (mode.capitalize() + ".", ""))


def _mode(event: Event) -> EventWords:
    sentence, after = mode_words(str(event.values.get("mode", "")))
    return EventWords(sentence=sentence, next=after)


_STOPS = {
    "lease run out": (
        "The arm stopped: nothing was heard of the lease's holder for too long.",
        "Take control, then resume.",
    ),
    "protective stop": (
        "The arm stopped: protective stop.",
        "Clear the protective stop, then resume.",
    ),
    "overruns": (
        "The arm stopped: too many periods in a row came late.",
        "See what keeps the daemon's machine busy, then resume.",
    ),
    "daemon ends": ("The arm stopped: the daemon ends.", "Start it again."),
    "hold asked": ("The arm was asked to hold.", "Resume to go on."),
    "sensor stale": (
        "The arm stopped: a sensor that it does not move without tells nothing.",
        "Check the sensor, or take load off it, then resume.",
    ),
    "disable asked": ("The drives were asked off.", "Enable to go on."),
}


def _stopping(reason: str) -> EventWords:
    sentence, after = _STOPS.get(
        reason, (f"The arm stopped: {reason}.", "Mend the cause, then resume.")
    )
    return EventWords(sentence=sentence, next=after)


def event_line(event: Event) -> str:
    """Return an event as one line for the terminal: its sentence, its values, what to do next."""
    words = event_words(event)
    said = words["sentence"]
    if event.detail not in said and event.name != "mode":
        said += f" ({event.detail})"
    shown = {key: value for key, value in event.values.items() if str(value) not in said}
    values = "".join(f" {key}={value}" for key, value in shown.items())
    mark = {"info": " ", "warning": "!", "error": "#"}[event.severity]
    after = f" -> {words['next']}" if words["next"] else ""
    return printable(f"{mark} {event.time_s:9.2f} s {event.name}: {said}{values}{after}")
