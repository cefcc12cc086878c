"""Configuration: frozen, typed sections read from TOML, validated once, unknown keys refused with a suggestion.

A section is a `Section` subclass that lives beside what it configures (`onboard/helm/config.py`); the table
`SECTIONS` in `common.processes` names them all as strings, so that loading a file imports no heavy library.
Field types may carry a range: `Annotated[float, msgspec.Meta(gt=0)]`. Each field has a docstring with unit and range.
"""

from __future__ import annotations

import importlib
import math
import re
import tomllib
import types
import typing
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction = Annotated[float, msgspec.Meta(ge=0, le=1)]
Port = Annotated[int, msgspec.Meta(ge=1, le=65535)]


class ConfigError(ValueError):
    """A configuration that cannot be used; the text names the file, the key, what was got and what was expected."""


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every configuration section. `check` may raise ConfigError for relations between fields."""

    def check(self) -> None:
        """Raise ConfigError when fields contradict each other."""


S = TypeVar("S", bound=Section)
_MISSING = re.compile(r"Object missing required field `(\w+)`( - at `.*`)?")


def deploy_dir() -> Path:
    """Folder of the vehicle and scenario files: beside the packages in a checkout, inside `common` when installed."""
    installed = Path(__file__).parent / "deploy"
    return installed if installed.is_dir() else Path(__file__).parent.parent / "deploy"


def find_file(name: str, folder: str) -> Path:
    """Path of a TOML file: a path as given, or the name of a file in `deploy/<folder>` (`kite` or `kite.toml`).

    Raises:
        ConfigError: no such file; the text lists the names that exist.
    """
    path = Path(name)
    shipped = deploy_dir() / folder / (name if name.endswith(".toml") else f"{name}.toml")
    for candidate in (path, shipped):
        if candidate.is_file():
            return candidate
    known = ", ".join(sorted(p.stem for p in (deploy_dir() / folder).glob("*.toml")))
    raise ConfigError(f"{folder[:-1]} file: got {name!r}, which does not exist; expected a path or one of: {known}")


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file.

    Raises:
        ConfigError: unreadable, or not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML ({error})") from None


def build(kind: type[S], data: Mapping[str, Any], where: str) -> S:
    """Section of a type from plain data (a TOML table).

    Args:
        kind: the section's class.
        data: the table.
        where: file and section, for error texts.

    Raises:
        ConfigError: unknown key (with a suggestion), wrong type, value out of range, or fields in contradiction.
    """
    _refuse_unknown(kind, data, where)
    try:
        section = msgspec.convert(dict(data), kind, strict=False)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {_in_our_words(str(error))}") from None
    _check_all(section, where)
    return section


def _in_our_words(error: str) -> str:
    missing = _MISSING.fullmatch(error)
    if missing is None:
        return error
    return f"key {missing[1]!r} is missing{missing[2] or ''}; it has no default, so set it"


def _check_all(value: Any, where: str) -> None:
    if isinstance(value, Section):
        for name in value.__struct_fields__:
            _check_all(getattr(value, name), f"{where}.{name}")
        try:
            value.check()
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from None
    elif isinstance(value, dict):
        for key, item in value.items():
            _check_all(item, f"{where}.{key}")
    elif isinstance(value, (tuple, list)):
        for index, item in enumerate(value):
            _check_all(item, f"{where}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}: got {value}, expected a finite number")


def _refuse_unknown(kind: Any, data: Any, where: str) -> None:
    """Walk data beside the type and raise for the first key that no section declares."""
    origin = typing.get_origin(kind)
    if origin is Annotated:
        _refuse_unknown(typing.get_args(kind)[0], data, where)
    elif origin in (typing.Union, types.UnionType):
        for option in typing.get_args(kind):
            if isinstance(option, type) and issubclass(option, Section):
                _refuse_unknown(option, data, where)
    elif origin is dict and isinstance(data, Mapping):
        for key, item in data.items():
            _refuse_unknown(typing.get_args(kind)[1], item, f"{where}.{key}")
    elif origin in (tuple, list) and isinstance(data, list):
        for index, item in enumerate(data):
            _refuse_unknown(typing.get_args(kind)[0], item, f"{where}[{index}]")
    elif isinstance(kind, type) and issubclass(kind, Section) and isinstance(data, Mapping):
        hints = typing.get_type_hints(kind, include_extras=True)
        for key, item in data.items():
            if key not in kind.__struct_fields__:
                raise ConfigError(f"{where}: {unknown_key_text(key, kind.__struct_fields__)}")
            _refuse_unknown(hints[key], item, f"{where}.{key}")


def unknown_key_text(key: str, known: typing.Iterable[str]) -> str:
    """Error text for a key that is not among the known ones, with the nearest of them."""
    known = tuple(known)
    near = get_close_matches(key, known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"expected one of: {', '.join(known)}"
    return f"unknown key {key!r}; {hint}"


class Config:
    """All sections of one run. Sections are built on first use, after every table was checked at loading.

    Args:
        tables: section name to plain data; absent sections have their defaults.
        sections: section name to `module:Class`.
        where: file name, for error texts.

    Raises:
        ConfigError: as `build`, for any section.
    """

    def __init__(self, tables: Mapping[str, Any], sections: Mapping[str, str], where: str = "defaults"):
        for name in tables:
            if name not in sections:
                raise ConfigError(f"{where}: {unknown_key_text(name, sections)}")
        self._built = {
            name: build(load_object(target), tables.get(name, {}), f"{where} [{name}]")
            for name, target in sections.items()
        }

    def section(self, kind: type[S]) -> S:
        """The section of this class."""
        for section in self._built.values():
            if type(section) is kind:
                return section
        raise KeyError(f"no section of type {kind.__name__} is registered in common.processes.SECTIONS")

    @property
    def modules(self) -> tuple[str, ...]:
        """Modules of the sections' classes: who has imported them unpickles this at once."""
        return tuple(sorted({type(section).__module__ for section in self._built.values()}))

    def resolved(self) -> dict[str, Any]:
        """Every section as plain data, defaults included: what the log shows and the recording keeps."""
        return {name: msgspec.to_builtins(section) for name, section in self._built.items()}


def load_object(target: str) -> Any:
    """The object that `module:name` names, imported now."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def apply_overrides(tables: dict[str, Any], overrides: typing.Iterable[str]) -> dict[str, Any]:
    """Tables with `section.key=value` texts applied; values are read as TOML, else as plain text.

    Raises:
        ConfigError: a text without `=` or without a section.
    """
    for text in overrides:
        path, separator, raw = text.partition("=")
        keys = path.strip().split(".")
        if not separator or len(keys) < 2:
            raise ConfigError(f"--set: got {text!r}, expected section.key=value")
        try:
            value = tomllib.loads(f"v = {raw.strip()}")["v"]
        except tomllib.TOMLDecodeError:
            value = raw.strip()
        table = tables
        for key in keys[:-1]:
            table = table.setdefault(key, {})
            if not isinstance(table, dict):
                raise ConfigError(f"--set: {path!r} goes through {key!r}, which is not a section")
        table[keys[-1]] = value
    return tables
