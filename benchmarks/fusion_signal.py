"""Fusion of faulty signals beside each source, their mean, and plain filters (Echeverri 2016, figure 4.6)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from benchmarks.fusion_signals import SOURCES, Signals, make
from onboard.fusion.center import Fusion
from onboard.fusion.config import FusionConfig
from onboard.fusion.motion import MotionFilter
from onboard.fusion.source import Measurement, Source
from onboard.fusion.weights import combine

_RUNS, _QUICK_RUNS = 200, 30
_DURATION_S = 48.0
_CONFIG = FusionConfig(acceleration=1.0, correlation=0.0, delta=1000.0, vote_slope=12.0)
"""The acceleration suits the system: the filter of a source without faults was best with it, on seeds 1000 to 1011 of
an earlier generator. All filters here have it. The sources' errors are independent."""
_START_RATE = 2.0
_GATE = 15.1367
"""χ² with one degree of freedom at 0.9999, as the fusion's own switch."""
_GRACE = 25
"""Samples at the beginning that do not count: every filter is still finding the rate."""


def run(settings: Settings) -> Outcome:
    """Fuse the signals of many seeds."""
    runs = [_figures(make((settings.seed, i), _DURATION_S)) for i in range(_QUICK_RUNS if settings.quick else _RUNS)]
    columns = {name: np.array([figures[name] for figures in runs]) for name in runs[0]}
    best = np.min([columns[f"rmse_source_{name}"] for name in SOURCES], axis=0)
    fused = columns["rmse_fused"]
    results = {name: float(values.mean()) for name, values in columns.items()}
    results |= {
        "rmse_best_source": float(best.mean()),
        "rmse_fused_worst": float(fused.max()),
        "fraction_below_best_source": float((fused < best).mean()),
        "fraction_below_plain_kf": float((fused < columns["rmse_plain_kf"]).mean()),
        "fraction_below_gated_kf": float((fused < columns["rmse_gated_kf"]).mean()),
        "runs": float(len(runs)),
    }
    if settings.plots is not None:
        _draw(make((settings.seed, 0), _DURATION_S), settings.plots)
    plain = {"name": "one Kalman filter over all sources, true fault-free R", "rmse": results["rmse_plain_kf"]}
    return Outcome(results, {**plain, "ratio": results["rmse_plain_kf"] / results["rmse_fused"]})


def _figures(signals: Signals) -> dict[str, float]:
    everyone = range(len(SOURCES))
    single = {name: filtered(signals, [i]) for i, name in enumerate(SOURCES)}
    answers = {
        "rmse_fused": fuse(signals)[0],
        **{f"rmse_source_{name}": answer for name, answer in single.items()},
        "rmse_mean": np.mean(list(single.values()), axis=0),
        "rmse_plain_kf": filtered(signals, everyone),
        "rmse_gated_kf": filtered(signals, everyone, _GATE),
    }
    return {name: _rmse(answer, signals.truth) for name, answer in answers.items()}


def _rmse(answer: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((answer - truth)[_GRACE:] ** 2)))


def filtered(signals: Signals, sources: Sequence[int], gate: float | None = None) -> np.ndarray:
    """Answer (T,) of one standard Kalman filter over some sources with their true fault-free noise.

    Args:
        signals: the run.
        sources: columns that it takes.
        gate: largest squared innovation over its variance that is taken in; None takes everything.
    """
    variances = signals.noise[list(sources), None] ** 2
    answer = np.empty(len(signals.truth))
    one: MotionFilter | None = None
    for index, (t_ns, row) in enumerate(zip(signals.t_ns.tolist(), signals.measured, strict=True)):
        values = row[list(sources), None]
        if one is None:
            value, variance = combine(values, variances, 0.0)
            one = MotionFilter(value, t_ns, np.sqrt(variance), np.array([_START_RATE]))
        one.predict(t_ns, np.array([_CONFIG.acceleration**2]))
        spread = one.covariance[0, 0] + variances[:, 0]
        kept = np.full(len(values), True) if gate is None else (values[:, 0] - one.value[0]) ** 2 / spread <= gate
        if index and kept.any():
            one.update(*combine(values[kept], variances[kept], 0.0))
        answer[index] = one.value[0]
    return answer


def fuse(signals: Signals) -> tuple[np.ndarray, np.ndarray]:
    """Answer (T,) of the fusion, and the variance (T, 4) with which each source counted (eq. 4.8)."""
    fusion = Fusion([Source(name, (noise,)) for name, noise in zip(SOURCES, signals.noise, strict=True)], _CONFIG)
    answer, variances = np.empty(len(signals.truth)), np.empty(signals.measured.shape)
    for index, (t_ns, row) in enumerate(zip(signals.t_ns.tolist(), signals.measured, strict=True)):
        measured = [Measurement(name, t_ns, row[i : i + 1]) for i, name in enumerate(SOURCES)]
        fused = fusion.step(measured, t_ns)
        answer[index] = fused.value[0]
        variances[index] = [fused.sources[name].variance[0] for name in SOURCES]
    return answer, variances


def _draw(signals: Signals, folder: Path) -> None:
    """Figure 4.6: signals and estimates above, the variances of eq. 4.8 below."""
    from matplotlib.figure import Figure

    answer, variances = fuse(signals)
    t_s = signals.t_ns * 1e-9
    figure = Figure(figsize=(11, 9), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    for i, name in enumerate(SOURCES):
        top.plot(t_s, signals.measured[:, i], lw=0.5, alpha=0.7, label=f"source with {name}")
        middle.plot(t_s, filtered(signals, [i]), lw=0.8, label=f"its own filter: {name}")
        bottom.semilogy(t_s, variances[:, i], lw=0.8, label=name)
    middle.plot(t_s, answer, "k", lw=1.4, label="fused")
    middle.plot(t_s, signals.truth, "w--", lw=0.8, label="signal")
    middle.set_facecolor("0.85")
    top.set(title="measurements", ylabel="units")
    middle.set(title="estimates", ylabel="units")
    bottom.set(title="variance with which each source counts (eq. 4.8)", xlabel="s", ylabel="units²")
    for axis in (top, middle, bottom):
        axis.legend(fontsize=7, loc="upper right")
    figure.savefig(folder / "fusion-signal.png", dpi=80)


BENCHMARK = Benchmark("fusion-signal", "fusion of four faulty signals beside each of them and plain filters", run)
