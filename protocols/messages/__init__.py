"""Messages that cross Zenoh, field by field."""
