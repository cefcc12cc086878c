"""The demonstration: all three sides on one machine, an operator's stand-in, and a judgement of the chase."""
