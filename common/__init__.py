"""What both sides share: messages, topics, bus, configuration, node framework, geometry, trackers."""

__version__ = "0.1.0"
