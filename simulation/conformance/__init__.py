"""Contract tests of an autopilot's MAVLink surface, against any URL: what PX4 was measured to do, and what differs."""
