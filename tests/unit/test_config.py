"""Configuration: what is read, and that every mistake is named with file, key, what was got and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import pytest

from common.config import (
    Config,
    ConfigError,
    Fraction,
    Port,
    Positive,
    Section,
    apply_overrides,
    build,
    deploy_dir,
    find_file,
    read_toml,
)
from common.processes import PROCESSES, SECTIONS, load_config, process


class Lens(Section, frozen=True, kw_only=True):
    """Part of a section."""

    focal_px: Positive = 400.0
    """Focal length, px."""
    name: str = "plain"
    """Name."""


class Sensor(Section, frozen=True, kw_only=True):
    """A section with everything that sections have."""

    rate_hz: Positive = 20.0
    """Rate, Hz."""
    port: Port = 8080
    """Port."""
    share: Fraction = 0.5
    """A share."""
    steps: Annotated[int, msgspec.Meta(ge=1)] = 3
    """A count."""
    lens: Lens = Lens()
    """A nested section."""
    spares: tuple[Lens, ...] = ()
    """Nested sections in a row."""
    by_name: dict[str, Lens] = {}
    """Nested sections by name."""
    low_m: float = 1.0
    """Lower bound, m."""
    high_m: float = 2.0
    """Upper bound, m."""

    def check(self) -> None:
        """The bounds are in order."""
        if self.low_m >= self.high_m:
            raise ConfigError(f"low_m: got {self.low_m}, expected less than high_m ({self.high_m})")


SENSOR = {"sensor": f"{__name__}:Sensor"}


def test_defaults_hold_without_a_table() -> None:
    assert Config({}, SENSOR).section(Sensor) == Sensor()


def test_values_are_read_and_nested() -> None:
    table = {"rate_hz": 10, "lens": {"focal_px": 300}, "spares": [{"name": "wide"}], "by_name": {"left": {}}}

    sensor = build(Sensor, table, "kite [sensor]")

    assert sensor.rate_hz == 10.0
    assert sensor.lens == Lens(focal_px=300.0)
    assert sensor.spares == (Lens(name="wide"),)
    assert sensor.by_name == {"left": Lens()}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"rate": 10}, r"kite \[sensor\]: unknown key 'rate'; did you mean 'rate_hz'\?"),
        ({"zzz": 10}, r"unknown key 'zzz'; expected one of: rate_hz, port"),
        ({"lens": {"focal": 1.0}}, r"kite \[sensor\]\.lens: unknown key 'focal'; did you mean 'focal_px'\?"),
        ({"spares": [{}, {"nam": "x"}]}, r"\.spares\[1\]: unknown key 'nam'; did you mean 'name'\?"),
        ({"by_name": {"left": {"nme": "x"}}}, r"\.by_name\.left: unknown key 'nme'; did you mean 'name'\?"),
        ({"rate_hz": "quick"}, r"kite \[sensor\]: .*`float`.*rate_hz"),
        ({"rate_hz": 0}, r"> 0.*rate_hz"),
        ({"rate_hz": -1.0}, r"> 0.*rate_hz"),
        ({"share": 1.2}, r"<= 1.*share"),
        ({"port": 70_000}, r"<= 65535.*port"),
        ({"steps": 2.5}, r"`int`.*steps"),
        ({"lens": 3}, r"`object`, got `int`.*lens"),
        ({"low_m": 3.0}, r"kite \[sensor\]: low_m: got 3.0, expected less than high_m \(2.0\)"),
    ],
)
def test_a_wrong_table_is_one_clear_error(table: dict, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as error:
        build(Sensor, table, "kite [sensor]")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("key", ["sensor.rate_hz", "sensor.high_m", "sensor.lens.focal_px"])
def test_numbers_are_finite(key: str, value: str) -> None:
    tables = apply_overrides({}, [f"{key}={value}"])

    with pytest.raises(ConfigError, match=key.rpartition(".")[2]):
        Config(tables, SENSOR)


def test_an_unknown_section_gets_a_suggestion() -> None:
    with pytest.raises(ConfigError, match=r"kite\.toml: unknown key 'sensr'; did you mean 'sensor'\?"):
        Config({"sensr": {}}, SENSOR, "kite.toml")


def test_a_section_that_is_not_registered_is_a_programming_error() -> None:
    with pytest.raises(KeyError, match="Lens"):
        Config({}, SENSOR).section(Lens)


def test_the_resolved_configuration_is_plain_and_complete() -> None:
    resolved = Config({"sensor": {"rate_hz": 5}}, SENSOR).resolved()

    assert resolved["sensor"]["rate_hz"] == 5.0
    assert resolved["sensor"]["lens"] == {"focal_px": 400.0, "name": "plain"}
    assert Config(resolved, SENSOR).resolved() == resolved, "it can be read again"


def test_overrides_are_toml_or_plain_text() -> None:
    tables = apply_overrides(
        {"sensor": {"rate_hz": 1.0, "port": 1}},
        [
            "sensor.rate_hz=30",
            "sensor.lens.name=fish eye",
            "sensor.lens.focal_px = 2.5",
            'bus.vehicle="a b"',
            "sensor.spares=[{name='x'}]",
            "world.deep.down=true",
        ],
    )

    assert tables == {
        "sensor": {"rate_hz": 30, "port": 1, "lens": {"name": "fish eye", "focal_px": 2.5}, "spares": [{"name": "x"}]},
        "bus": {"vehicle": "a b"},
        "world": {"deep": {"down": True}},
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sensor.rate_hz", "got 'sensor.rate_hz', expected section.key=value"),
        ("rate_hz=3", "got 'rate_hz=3', expected section.key=value"),
        ("sensor.rate_hz.x=3", "goes through 'rate_hz', which is not a section"),
    ],
)
def test_a_wrong_override_is_named(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        apply_overrides({"sensor": {"rate_hz": 1.0}}, [text])


def test_files_are_found_by_path_or_name(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[sensor]\n")

    assert find_file(str(mine), "vehicles") == mine
    shipped = deploy_dir() / "vehicles" / "kite.toml"
    assert find_file("kite", "vehicles") == find_file("kite.toml", "vehicles") == shipped
    with pytest.raises(ConfigError, match=r"vehicle file: got 'kyte', which does not exist; .*one of: .*kite"):
        find_file("kyte", "vehicles")


def test_files_that_are_no_toml_are_refused(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("[sensor\n")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")

    with pytest.raises(ConfigError, match=r"broken\.toml: not valid TOML .*line 1"):
        read_toml(broken)
    with pytest.raises(ConfigError, match=r"binary\.toml: cannot be read"):
        read_toml(binary)
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        read_toml(tmp_path / "none.toml")


# ---------------------------------------------------------------- the files and sections that we ship


@pytest.mark.parametrize("file", sorted(p.stem for p in (deploy_dir() / "vehicles").glob("*.toml")))
def test_every_shipped_vehicle_file_is_valid(file: str) -> None:
    assert set(load_config(file).resolved()) == set(SECTIONS)


def test_each_section_is_of_its_own_type() -> None:
    assert len(set(SECTIONS.values())) == len(SECTIONS)
    assert len({name for name in SECTIONS if name}) == len(load_config(None).resolved())


def test_a_wrong_process_name_gets_a_suggestion() -> None:
    with pytest.raises(ConfigError, match=r"unknown key 'persuit'; did you mean 'pursuit'\?"):
        process("persuit")
    assert process("pursuit") is PROCESSES["pursuit"]


def test_a_missing_key_without_a_default_is_named() -> None:
    with pytest.raises(ConfigError, match=r"people\]: key 'decoder' is missing - at `\$\.detector`; it has no default"):
        load_config(None, ["people.detector.file=people.onnx"])
