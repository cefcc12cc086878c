"""What counts in the benchmarks of the search for people, and what one says without its rival."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import people_association, people_speed
from benchmarks.base import Settings
from benchmarks.people_association import Seen
from benchmarks.people_pose import CHECK_BOXES, Annotated, annotated
from onboard.people.appearance import Look
from onboard.people.identity import Detection
from tests.unit.people_bodies import pose


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
    monkeypatch.setattr(people_speed, "measure", lambda seed, quick: {"node_hz": 12.0})
    outcome = people_speed.run(Settings(seed=4, quick=True))
    assert "Open3D is not installed" in outcome.table[-1]
    assert "speedup" not in outcome.results
    assert 5_000 < outcome.results["points"] < outcome.results["full_points"] < 217_088
    assert {"cloud_ms", "floor_ms", "clusters_ms", "clusters_with_sizes_ms"} <= outcome.results.keys()


def _seen(frame: int, identity: str, x: float, colour: int) -> Seen:
    histograms = np.zeros((3, 4))
    histograms[:, colour] = 1.0
    box = Annotated(frame, 0, 0, 20, 50, True, identity)
    return Seen(box, Detection(pose(), Look(histograms)), (x, 0.0, 20.0, 50.0))


def test_identities_are_scored_as_kept_or_lost():
    """Two people, one box each in three pictures; they walk past each other in the last."""
    sequence = [[_seen(k, "A", 4.0 * k, 0), _seen(k, "B", 100.0 - 4.0 * k, 1)] for k in range(3)]
    assert people_association._by_motion(sequence) == [[1, 2]] * 3
    kept = people_association._scores(sequence, [[1, 2]] * 3)
    assert kept == {"idf1": 1.0, "num_switches": 0.0}
    swapped = people_association._scores(sequence, [[1, 2], [1, 2], [2, 1]])
    assert swapped["num_switches"] == 2.0 and swapped["idf1"] == pytest.approx(2 / 3)
    assert people_association._rank_one(sequence) == [True] * 4
    sequence[2] = [_seen(2, "A", 0.0, 1), _seen(2, "B", 100.0, 1)]
    assert people_association._rank_one(sequence) == [True, True, False, True]


def test_the_annotations_are_what_the_page_says():
    boxes = annotated()
    assert (sum(b.person for b in boxes), sum(not b.person for b in boxes)) == (59, 110)
    others = annotated(CHECK_BOXES)
    assert (sum(b.person for b in others), sum(not b.person for b in others)) == (16, 61)
    assert not {b.frame for b in others} & {b.frame for b in boxes}
    known = [b for b in boxes if b.identity]
    assert len(known) == 43 and len({b.identity for b in known}) == 7 and all(b.person for b in known)
    assert all(b.x >= 0 and b.y >= 0 and b.x + b.w <= 768 and b.y + b.h <= 576 for b in boxes)
