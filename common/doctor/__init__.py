"""`outrider doctor`: what is wrong with a machine or a running system, each finding with its cure."""
