"""The network that daemon, operators, sensors and the rig's judge share: Zenoh's sessions."""
