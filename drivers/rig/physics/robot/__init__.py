"""The robot's own body: brakes and friction, capsules of its links, chassis on wheels."""
