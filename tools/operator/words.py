"""Operators' words for events, faults, limits, passages and refusals."""

from typing import TypedDict

from ...config.errors import printable
from ...protocols.messages import requests
from ...protocols.messages.telemetry import Event, State

# --- Faults: what a person does next, by the cause that the event names ---------------------------
RESUME = "resume"

FAULTS = {
    "following_error": "Free the joint of what holds it, reset, then enable.",
    "state_lost": "Look at the drive that left its state, reset, then enable.",
    "bus_error": "Check the bus: plug, termination, power. Then reset.",
    "bus_silent": "Check the bus: plug, termination, power. Then reset.",
    "heartbeat": "Check the device's power and cable, then reset.",
    "emergency": "Read the drive's error code in the event, mend it, then reset.",
    "drive_fault": "Read the drive's error code in the event, mend it, then reset.",
    "second_master": "Switch the other master off, then reset.",
    "foreign_pdo": "Find who else sends with that identifier, switch it off, then reset.",
}


# --- Limits that act, in words: from the names of telemetry's `limits` ----------------------------
_LIMIT_WORDS = {
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
    "self_motion_speed": "The joints are not quick enough for the self-motion that is asked for.",
    "arm_angle_singular": "No spare motion turns the elbow here: lead the tool on a little.",
    "no_spare_joint": "No spare joint answers the self-motion that is asked for.",
}


def limit_words(name: str) -> str:
    """Return one limit as a sentence; `name` is `KIND` or `KIND:WHICH`."""
    kind, _, which = name.partition(":")
    if kind in _LIMIT_WORDS:
        return _LIMIT_WORDS[kind].format(which or "a joint")
    plain = kind.replace("_", " ")
    return f"Limited: {plain}" + (f" ({which})." if which else ".")


# --- Passage of a contour ahead, in words: from the phase and the reason that a scanner tells -----
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


# --- Refusals in words: why, and what to do next --------------------------------------------------
NEXT = {
    "no_lease": "Take control first (the lease).",
    "wrong_proof": "Take control again (the lease).",
    "old_epoch": "The lease has changed hands: take it again.",
    "old_picture": "The network was too slow: try again.",
    "future_picture": "The daemon has started anew: try again.",
    "before_enable": "It was sent before the arm was enabled: send it again.",
    "not_enabled": "Enable the arm first.",
    "lease_taken": "Ask its holder to release it, or wait until it runs out.",
    "protective_stop": "Clear the protective stop, then resume.",
    "not_yours": "Who asked for the stop clears it, or the lease's holder.",
    "anothers_obstacle": "See who else tells of an obstacle of that name, and stop one of them.",
    "unnamed_sender": "With certificates a sensor tells of obstacles under its own name.",
    "sensor_stale": "Wait for fresh data of the sensor, then resume.",
    "touched": "Look at what the arm touches; resume once it is free.",
    "still_wrong": "Mend the cause that the message names, then reset.",
    "no_spare_joint": "Leave an axis of the tool free, or jog the joints.",
    "unstable_gain": "Choose a smaller gain.",
    "unstable_frame": "Put the MRF nearer to the tool's tip, or lower the gains about its axes.",
    "unstable_payload": "Tell a payload that the loop can carry, or slow it down.",
    "no_answer": "The daemon did not answer: is it running?",
    "not_certified": "The certificate or login that was used does not allow it.",
}
"""Next step for a person, by the reason's name."""


def refusal_words(reply: requests.Reply) -> str:
    """Return a refusal as sentences: its detail, and what to do next.

    The detail is left as it is: it may begin with the name of a person or of a field.
    """
    said = reply.detail or reply.reason.replace("_", " ")
    return f"{said.rstrip('.')}. {NEXT.get(reply.reason, '')}".strip()


# --- Events as sentences: their cause, and what to do next. Pure ----------------------------------
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
    "device_unwell": (
        "A device tells nothing that can be used, {detail}.",
        "The arm goes on without it: look at its cable, power and range.",
    ),
    "device_well": ("{detail} tells again.", ""),
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
    "arm_angle_reached": ("The elbow is where it was to go: {detail}.", ""),
    "arm_angle_unreachable": (
        "The elbow does not get to {detail}.",
        "Lead the tool elsewhere, or choose another angle.",
    ),
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


# --- Why the arm does what it does now, in one sentence, and what to do next. Pure ----------------
CAUSES = ("stopping",)  # events that say why the arm stopped, beside errors


def is_cause(event: Event) -> bool:
    """Return whether an event says why the arm stopped."""
    return event.severity == "error" or event.name in CAUSES


def why(state: State, cause: Event | None) -> EventWords:
    """Return why the arm is in its mode; `cause` is the newest event that said why it stopped."""
    if state.mode == "fault":
        sentence, after = mode_words("fault")
        words = EventWords(sentence=sentence, next=after) if cause is None else event_words(cause)
        if state.protective_stop:
            words["next"] += " A protective stop is set, too: clear it."
        return words
    if state.protective_stop:
        return EventWords(
            sentence="Protective stop: the arm may not move.",
            next="Clear it, then resume." if state.mode == "hold" else "Clear it.",
        )
    if cause is not None and state.mode in ("stopping", "hold"):
        return event_words(cause)
    sentence, after = mode_words(state.mode)
    if state.mode in ("ready", "hold") and state.lease_holder is not None:
        after = f"{state.lease_holder} has the lease and may go on."
    return EventWords(sentence=sentence, next=after)
