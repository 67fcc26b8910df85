"""Where a scanner listens."""

from ...config.schema.sensors.scanner import Scanner


def host_and_port(scanner: Scanner) -> tuple[str, int]:
    """Return host and port of a scanner's address, `tcp/HOST:PORT`."""
    host, _, port = scanner.address.removeprefix("tcp/").rpartition(":")
    return host, int(port)
