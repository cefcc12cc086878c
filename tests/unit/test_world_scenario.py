"""Scenario files: the shipped ones load, and a wrong one says what is wrong."""

from pathlib import Path

import numpy as np
import pytest

from common.config import ConfigError, build, deploy_dir
from common.processes import load_config
from onboard.search.config import SearchConfig
from simulation.world.objects_config import rgb
from simulation.world.path import car_path
from simulation.world.path_config import PathConfig
from simulation.world.scenario import LightConfig, RadioConfig, ScenarioConfig, load_scenario

SHIPPED = sorted(path.stem for path in (deploy_dir() / "scenarios").glob("*.toml"))


def test_the_scenarios_are_shipped() -> None:
    assert {"chase", "calm", "rough", "approach", "rescue"} <= set(SHIPPED)


def test_approach_has_something_of_each_kind_that_a_vehicle_can_fly_at() -> None:
    scenario = load_scenario("approach")
    assert len(scenario.barrels) >= 1 and len(scenario.walls) >= 2 and len(scenario.people) >= 2
    assert not scenario.car.path.waypoints, "the car is parked out of the way"
    walker = car_path(scenario.people[0]).at(np.arange(0.0, 60.0, 0.1))
    speed = np.hypot(*walker.ned_v_m_s.T)
    assert 1.0 < speed.max() <= 1.5
    assert np.hypot(*walker.ned_p_m.T).min() > 5.0, "nobody walks over the landing pad"
    assert scenario.depth.noise_per_m > 0 and scenario.depth.flying > 0


def test_rescue_has_people_inside_the_area_that_its_vehicle_searches() -> None:
    scenario = load_scenario("rescue")
    area = np.array(load_config("osprey").section(SearchConfig).area)
    assert len(scenario.people) >= 5 and len(scenario.barrels) >= 2
    for person in scenario.people:
        places = car_path(person).at(np.arange(0.0, 60.0, 0.5)).ned_p_m
        assert (places > area.min(axis=0)).all() and (places < area.max(axis=0)).all()
        assert np.hypot(*places.T).min() > 1.0, "not on the landing pad"


@pytest.mark.parametrize("name", [name for name in SHIPPED if name not in ("approach", "rescue")])
def test_shipped_scenario_keeps_its_car_slow_and_near(name: str) -> None:
    scenario = load_scenario(name)
    path = car_path(scenario.car)
    motion = path.at(np.arange(0.0, 600.0, 0.1))
    speed = np.hypot(*motion.ned_v_m_s.T)
    assert speed.max() <= (1.0 if name == "calm" else 1.5) + 1e-9
    assert np.hypot(*motion.ned_p_m.T).max() < 25.0
    # It still drives after ten minutes, and starts in view of a vehicle above home.
    assert speed[-600:].max() > 0.5
    assert np.abs(motion.ned_p_m[0]).max() < 2.0


def test_calm_stands_still_first_and_spares_the_picture() -> None:
    scenario = load_scenario("calm")
    assert np.ptp(car_path(scenario.car).at(np.arange(0.0, 20.0, 0.5)).ned_p_m, axis=0).max() == 0.0
    assert scenario.sensor.noise_sigma == 0.0
    assert scenario.radio == RadioConfig()
    assert scenario.radio.block_probability == 0.0
    assert not scenario.occluders


def test_unknown_key_names_file_key_and_suggestion(tmp_path: Path) -> None:
    file = tmp_path / "typo.toml"
    file.write_text("[car.path]\nstart_dealy_s = 3.0\n")
    text = r"typo\.toml\.car\.path: unknown key 'start_dealy_s'; did you mean 'start_delay_s'"
    with pytest.raises(ConfigError, match=text):
        load_scenario(str(file))


def test_unknown_scenario_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="chase"):
        load_scenario("chaise")


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"car": {"path": {"waypoints": [{"north_m": 0, "east_m": 0, "speed_m_s": 2.6}]}}}, "2.5"),
        ({"car": {"roof": "red"}}, "roof"),
        ({"car": {"path": {"waypoints": [{"north_m": 0, "east_m": 0}, {"north_m": 1, "east_m": 0}]}}}, "at least 3"),
        ({"car": {"path": {"waypoints": [{"north_m": n, "east_m": 0} for n in (0, 0, 4)]}}}, "same place"),
        (
            {"car": {"path": {"mode": "ping_pong", "waypoints": [{"north_m": n, "east_m": 0} for n in (0, 4, 1)]}}},
            "170 degrees",
        ),
        ({"light": {"steps": [{"at_s": 5}, {"at_s": 2}]}}, "ascending"),
        ({"light": {"repeat_s": 3, "steps": [{"at_s": 5}]}}, "repeat_s"),
        ({"radio": {"block_probability": 1.2}}, "block_probability"),
    ],
)
def test_values_that_make_no_sense_are_refused(table: dict, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        build(ScenarioConfig, table, "file")


def test_a_parked_car_needs_no_path() -> None:
    assert PathConfig().waypoints == ()
    assert LightConfig().steps == ()
    assert rgb("#0a10ff") == (10, 16, 255)
