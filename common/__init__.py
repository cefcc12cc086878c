"""What both sides share: messages, topics, bus, configuration, node framework, geometry, trackers."""

import os as _os

__version__ = "0.1.0"

# One thread a process for linear algebra, unless the user says otherwise: few cores are shared by many processes, and
# on a busy machine a pool that waits for its slowest thread makes Struck ten times slower. Here, and not where trackers
# are made, since the libraries look once, when they are loaded.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    _os.environ.setdefault(_name, "1")
