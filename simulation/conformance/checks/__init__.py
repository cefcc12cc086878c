"""The checks, by where the vehicle is while they run."""
