"""The signals and courses of the fusion's benchmarks, and that fusion holds what they ask on one short run."""

from __future__ import annotations

import numpy as np

from benchmarks.fusion_depth import course
from benchmarks.fusion_signal import filtered, fuse
from benchmarks.fusion_signals import SOURCES, make


def test_signals_have_the_faults_that_their_names_say() -> None:
    signals = make((3, 1), 24.0)
    errors = (signals.measured - signals.truth[:, None]) / signals.noise
    share_far = (np.abs(errors) > 5.0).mean(axis=0)
    by_name = dict(zip(SOURCES, share_far, strict=True))
    assert by_name["noise"] == 0.0
    assert 0.005 < by_name["spikes"] < 0.06
    assert by_name["drift"] > 0.1
    assert by_name["shocks"] > 0.05
    jumps = (np.abs(np.diff(errors, axis=0)) > 10.0).sum(axis=0)
    assert jumps[2] <= 2, "a drift begins without a jump"
    assert jumps[1] > 10
    np.testing.assert_array_equal(make((3, 1), 24.0).measured, signals.measured)
    assert not np.array_equal(make((4, 1), 24.0).measured, signals.measured)


def test_fused_signal_is_nearer_than_each_source_and_than_one_plain_filter() -> None:
    signals = make((11, 0), 24.0)
    answer, variances = fuse(signals)

    def rmse(estimate: np.ndarray) -> float:
        return float(np.sqrt(np.mean((estimate - signals.truth)[25:] ** 2)))

    assert rmse(answer) < min(rmse(filtered(signals, [i])) for i in range(len(SOURCES)))
    assert rmse(answer) < 0.5 * rmse(filtered(signals, range(len(SOURCES))))
    shocked = np.abs(signals.measured[:, 3] - signals.truth) > 0.45
    assert np.median(variances[shocked, 3]) > 100 * np.median(variances[~shocked, 3])


def test_course_passes_the_limit_and_its_pixels_fade() -> None:
    one = course((5, 0))
    empty = (one.patches_m == 0).mean(axis=(1, 2))
    assert one.z_m.min() < 0.75
    assert one.z_m.max() > 1.35
    assert empty[one.z_m < 0.85].mean() < 0.1
    assert empty[one.z_m > 1.2].mean() > 0.9
