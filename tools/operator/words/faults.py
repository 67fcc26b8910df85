"""Faults: what a person does next, by the cause that the event names."""

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
