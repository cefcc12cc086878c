"""Step responses of the simulated autopilot beside those that PX4 showed, and beside the loop that was fitted to PX4.

The responses are measured without noise, so that they are the control loop's own and the same for each seed. The same
steps are then flown with the estimate's errors at their default size, which the seed draws: their scatter says how far
a single noisy reading, PX4's included, can be trusted.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from benchmarks.base import Benchmark, Outcome, Settings
from simulation.autopilot.response import (
    CASES,
    DT_S,
    Band,
    States,
    StepCase,
    configured,
    crossing_s,
    fitted_loop,
    fly,
    hovering,
    measured,
    shares,
)

_NOISY_FLIGHTS, _QUICK_NOISY_FLIGHTS = 16, 6
_MARKS = {"t10_s": 0.10, "t50_s": 0.50, "t63_s": 0.63, "t90_s": 0.90}

Figures = dict[str, dict[str, float]]
"""Figure by case and name."""


def run(settings: Settings) -> Outcome:
    """Fly every step without noise, then with the noise of several seeds."""
    responses = _responses(None)
    ours = _figures(responses)
    count = _QUICK_NOISY_FLIGHTS if settings.quick else _NOISY_FLIGHTS
    noisy = [_figures(_responses(1000 * settings.seed + index)) for index in range(count)]
    scatter = {
        case.name: {name: float(np.std([flown[case.name][name] for flown in noisy])) for name in case.px4}
        for case in CASES
    }
    rms = {case.name: _rms_percent(case, responses[case.name]) for case in CASES if _is_fitted(case)}
    worst = {
        name: max(abs(c.px4[n].deviation(ours[c.name][n])) for c, n in _each() if n == name) for _, name in _each()
    }
    results = {
        **_flat(ours),
        **{f"rms_percent_{name}": value for name, value in rms.items()},
        "worst_deviation_percent": 100.0 * max(v for n, v in worst.items() if n != "overshoot_percent"),
        "worst_overshoot_deviation_percent": 100.0 * worst["overshoot_percent"],
        **{f"noise_std_{name}": value for name, value in _flat(scatter).items()},
        "noisy_flights": float(count),
    }
    paper = {_name(name, case): case.px4[name].nominal for case, name in _each()}
    if settings.plots is not None:
        _plot(settings.plots / "autopilot.png", responses)
    return Outcome(results, _baseline(ours), paper, tuple(_table(ours, scatter, rms)))


def _each() -> list[tuple[StepCase, str]]:
    """Every figure that PX4 has."""
    return [(case, name) for case in CASES for name in case.px4]


def _name(figure: str, case: StepCase) -> str:
    return f"{figure}_{case.name}"


def _flat(figures: Figures) -> dict[str, float]:
    return {_name(name, case): figures[case.name][name] for case, name in _each()}


def _responses(seed: int | None) -> dict[str, States]:
    """True states of each step by its name; without noise where no seed is given."""
    drags = {case.drag_n_s_m for case in CASES}
    vehicles = {drag: hovering(configured(drag, seed)) for drag in drags}
    return {case.name: fly(case, vehicles[case.drag_n_s_m]) for case in CASES}


def _figures(responses: dict[str, States]) -> Figures:
    """Figures of each step; a share that is never reached counts as reached at the end of the watch."""
    return {
        case.name: {name: min(v, case.duration_s) if name in _MARKS else v for name, v in found.items()}
        for case in CASES
        for found in [measured(case, responses[case.name])]
    }


def _is_fitted(case: StepCase) -> bool:
    return case.name.startswith(("start", "stop"))


def _rms_percent(case: StepCase, states: States) -> float:
    """Root mean square of the speed's difference to the fitted loop's, percent of the step of 2 m/s."""
    difference = np.array([case.response(s) for s in states]) - np.array(fitted_loop(case))
    return float(100.0 * np.sqrt(np.mean(difference**2)) / abs(case.size))


def _loop_shares(case: StepCase) -> list[float]:
    speeds = fitted_loop(case)
    size = -speeds[0] if case.before is not None else case.size
    return [(speed - speeds[0]) / size for speed in speeds]


def _baseline(ours: Figures) -> dict[str, str | float]:
    """The fitted loop's own figures, and how its times compare with ours."""
    figures: dict[str, float] = {}
    ratios: list[float] = []
    for case in filter(_is_fitted, CASES):
        response = _loop_shares(case)
        for name in case.px4.keys() & _MARKS.keys():
            value = min(crossing_s(response, _MARKS[name]), case.duration_s)
            figures[_name(name, case)] = value
            ratios.append(ours[case.name][name] / value)
    name = "loop fitted to PX4 within 2 to 4 % RMS: 1.8 e + 0.4 int e - 0.2 dv/dt, two lags of 0.14 s"
    return {"name": name, "version": "1", **dict(sorted(figures.items())), "ratio": float(np.median(ratios))}


def _table(ours: Figures, scatter: Figures, rms: dict[str, float]) -> list[str]:
    """Ours, PX4's, the deviation, and what noise does to a single reading."""
    lines = [f"  {'step':34} {'figure':18} {'ours':>8} {'PX4':>10} {'deviation':>10} {'noise':>8}"]
    for case in CASES:
        for index, (name, band) in enumerate(case.px4.items()):
            value = ours[case.name][name]
            lines.append(
                f"  {case.doc if index == 0 else '':34} {name:18} {value:8.3f} {_shown(band):>10} "
                f"{band.deviation(value):+10.1%} {scatter[case.name][name]:8.3f}"
            )
        if case.name in rms:
            lines.append(f"  {'':34} {'rms_percent':18} {rms[case.name]:8.3f}            to the fitted loop")
    lines.append("  deviation: to the nearer end of PX4's range; noise: standard deviation over flights with noise")
    return lines


def _shown(band: Band) -> str:
    if math.isinf(band.high):
        return f"> {band.low:g}"
    return f"{band.low:g}" if band.low == band.high else f"{band.low:g}..{band.high:g}"


def _plot(path: Path, responses: dict[str, States]) -> None:
    """Each step: ours, the fitted loop, and PX4's readings."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 7), layout="constrained")
    axes = list(figure.subplots(2, 4).flat)
    for axis, case in zip(axes, CASES, strict=False):
        t_s = np.arange(len(responses[case.name])) * DT_S
        axis.plot(t_s, shares(case, responses[case.name]), label="ours", color="C0")
        if _is_fitted(case):
            axis.plot(t_s, _loop_shares(case), "--", label="loop fitted to PX4", color="C1")
        marks = [(band.nominal, _MARKS[name]) for name, band in case.px4.items() if name in _MARKS]
        axis.plot(*zip(*marks, strict=True), "o", color="black", ms=5, label="PX4")
        overshoot = case.px4.get("overshoot_percent")
        if overshoot is not None:
            axis.axhspan(1 + overshoot.low / 100, 1 + overshoot.high / 100 + 0.002, color="0.8", label="PX4's peak")
        axis.set_title(case.doc, fontsize=10)
        axis.set_xlabel("s after the step")
        axis.set_ylabel("share of the step")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, loc="lower right")
    for unused in axes[len(CASES) :]:
        unused.set_axis_off()
    figure.savefig(path, dpi=110)


BENCHMARK = Benchmark("autopilot", "step responses of the simulated autopilot beside PX4's", run)
