"""Certificates of an authority, for two cells, and the sessions that show them."""

from datetime import UTC, datetime

import pytest
import zenoh
from telerobot.drivers.network.authority import Authority
from telerobot.drivers.network.certificates import certificate, read
from telerobot.drivers.network.identity import Identity
from telerobot.protocols.roles import Grant

HOSTS = ("localhost", "127.0.0.1", "::1")
ALL_SENSORS = tuple(f"pa10/sensor/{of}" for of in ("vision", "obstacle", "contour", "frame"))
HOLDERS = {
    "daemon-pa10": ("pa10/daemon",),
    "daemon-ur5e": ("ur5e/daemon",),
    "router-hub": ("pa10/router", "ur5e/router"),
    "operator-ann": ("pa10/operator",),
    "operator-both": ("pa10/operator", "ur5e/operator"),
    "observer-bob": ("pa10/observer",),
    "sensor-vision": ("pa10/sensor/vision",),
    "sensor-lidar": ("pa10/sensor/obstacle", "pa10/sensor/frame"),
    "rig-pa10": ("pa10/rig", "pa10/sensor/frame"),
    "judge-pa10": ("pa10/judge", "pa10/operator", *ALL_SENSORS),
    "operator-lost": ("pa10/operator",),
}


class Zone:
    """A folder of certificates, and all that was opened with them."""

    def __init__(self, folder, holders=HOLDERS):
        self.folder = folder
        self._open = []
        self.authority = Authority.make(folder, datetime.now(UTC))
        for name, what in holders.items():
            self.certify(name, *what)

    def certify(self, name, *what, hosts=HOSTS, now=None, days=700):
        grants = [Grant.parse(f"telerobot:{each}") for each in what]
        self.authority.certify(name, grants, hosts, now or datetime.now(UTC), days)

    def identity(self, name):
        return Identity(self.folder, certificate(read(self.folder / f"{name}.crt")))

    def open(self, config):
        session = zenoh.open(config)
        self._open.append(session)
        return session

    def close(self):
        for session in reversed(self._open):
            session.close()


@pytest.fixture
def zone(tmp_path):
    """Return the certificates of `HOLDERS`; the daemon does not know `operator-lost`."""
    made = Zone(tmp_path / "keys")
    yield made
    made.close()
