"""What stands in for the things that a desk lacks: a world with a camera, and an autopilot."""
