"""Where a scanner listens."""

from ...config.schema.sensors.scanner import ScannerSection


def host_and_port(scanner: ScannerSection) -> tuple[str, int]:
    """Return host and port of a scanner's address, `tcp/HOST:PORT`."""
    host, _, port = scanner.address.removeprefix("tcp/").rpartition(":")
    return host, int(port)
