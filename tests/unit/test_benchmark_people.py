"""What counts in the benchmark `people-speed`, and what it says without its rival."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import people_speed
from benchmarks.base import Settings


def test_agreement_is_the_overlap_of_the_best_match():
    theirs = np.repeat([0, 1, -1, 2], [40, 40, 10, 5]).astype(np.int32)
    assert people_speed._agreement(theirs, theirs) == [1.0, 1.0]
    ours = theirs.copy()
    ours[30:40] = 1
    assert people_speed._agreement(ours, theirs) == [pytest.approx(30 / 40), pytest.approx(40 / 50)]
    assert people_speed._agreement(np.full(95, -1, np.int32), theirs) == [0.0, 0.0]


def test_without_open3d_it_says_so_and_measures_ours(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(people_speed, "_open3d", lambda: None)
    monkeypatch.setattr(people_speed, "_QUICK_SCENES", 1)
    monkeypatch.setattr(people_speed, "_REPEATS", 1)
    outcome = people_speed.run(Settings(seed=4, quick=True))
    assert "Open3D is not installed" in outcome.table[-1]
    assert "speedup" not in outcome.results
    assert 5_000 < outcome.results["points"] < outcome.results["full_points"] < 217_088
    assert {"cloud_ms", "floor_ms", "clusters_ms", "clusters_with_sizes_ms"} <= outcome.results.keys()
