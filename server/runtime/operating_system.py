"""Real-time settings of the operating system for the loop, as far as they are granted."""

import ctypes
import gc
import os

PRIORITY = 60
"""SCHED_FIFO priority: above ordinary threads, below the kernel's own."""

_MCL_CURRENT_AND_FUTURE = 3


def prepare() -> list[str]:
    """Ask for real-time scheduling and locked memory; return a notice for each that was denied.

    Garbage collection is frozen and off afterwards: the loop collects in its slack.
    """
    notices = []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (PermissionError, OSError) as error:
        notices.append(
            f"no real-time scheduling ({error.strerror}): expect late ticks under load; "
            "grant CAP_SYS_NICE or an rtprio limit"
        )
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
        notices.append(
            f"memory is not locked ({os.strerror(ctypes.get_errno())}): a page fault can delay a "
            "tick; grant CAP_IPC_LOCK or a memlock limit"
        )
    gc.collect()
    gc.freeze()
    gc.disable()
    return notices


def release() -> None:
    """Unfreeze what `prepare` kept from the garbage collector, before the process ends."""
    gc.unfreeze()
    gc.enable()
