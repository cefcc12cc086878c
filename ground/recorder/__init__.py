"""The recorder: everything that passed on the bus, in MCAP files."""
