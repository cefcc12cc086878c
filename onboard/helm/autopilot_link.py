"""The one place that talks to the autopilot, through MAVSDK.

Threads: MAVSDK's callback thread only stores messages (a blocking MAVSDK call there would deadlock all callbacks); one
worker does everything that blocks; the control loop polls, sends and queues, and never waits.
Setpoints go through `mavlink_direct`, one message a call: MAVSDK's Offboard plugin would stream the last one on from a
C++ thread while Python hangs. So do commands, as the autopilot's dialect words them: MAVSDK's Action plugin decides by
itself what a takeoff or a hold is on each autopilot (and its `arm_force` sends a forced disarm).
"""

from __future__ import annotations

import json
import logging
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe, log_unsubscribe
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.param import Param

from common.config import ConfigError
from onboard.helm.actions import Action, ActionResult
from onboard.helm.dialect.base import UNKNOWN, Command, Dialect, Kind
from onboard.helm.dialect.registry import AUTO, UnfitAutopilot, recognise
from onboard.helm.setpoint import LocalSetpoint
from onboard.helm.telemetry import LINK_LOST_S, Telemetry, TelemetryDecoder

log = logging.getLogger(__name__)

_COMPONENT = 1
_HEARTBEAT, _ATTITUDE = "HEARTBEAT", "ATTITUDE_QUATERNION"
_SET_MESSAGE_INTERVAL = 511
_ACCEPTED = 0
_RESULTS = {1: "TEMPORARILY_REJECTED", 2: "DENIED", 3: "UNSUPPORTED", 4: "FAILED", 6: "CANCELLED"}
_CURES = {
    "WRONG_TYPE": "it is of the other type; configure 1 for an integer parameter, 1.0 for a float",
    "TIMEOUT": "no answer; does this version of the autopilot have it?",
}
_ATTITUDES = 100
_PATIENCE = 10  # looks of 0.5 s


class AutopilotLink:
    """The link to one autopilot (`onboard.helm.actions.Link`).

    Args:
        url: MAVSDK connection URL.
        dialect: `helm.dialect`: `auto`, or the name of the dialect to take.
        listen_only: neither command nor write nor ask for rates; parameters can be read.

    Raises:
        ConfigError: the URL cannot be opened.
    """

    def __init__(self, url: str, dialect: str = AUTO, listen_only: bool = False):
        self._url, self._wanted, self._listen_only = url, dialect, listen_only
        mavsdk_log = _MavsdkLog()
        log_subscribe(mavsdk_log)
        self._mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
        result = self._mavsdk.add_any_connection(url)
        if result != 0:
            self._mavsdk.destroy()
            log_unsubscribe()
            raise ConfigError(
                f"helm.autopilot_url: {url} cannot be opened ({mavsdk_log.newest_error or result.name}); "
                "check host, port or device"
            )
        mavsdk_log.to_warnings()
        self._lock = threading.Lock()
        self._attitudes: deque[tuple[int, str, str]] = deque(maxlen=_ATTITUDES)
        self._newest: dict[str, tuple[int, str, str]] = {}
        self._decoder = TelemetryDecoder()
        self._system_id = 0
        self._direct: MavlinkDirect | None = None
        self._param: Param | None = None
        self._heartbeat: str | None = None
        self._recognised: tuple[int, int] | None = None
        self._dialect: Dialect = UNKNOWN
        self._unfit = ""
        self._fault = ""
        self._subscribed: set[str] = set()
        self._heard_ns = 0
        self._started_ns = time.monotonic_ns()
        self._todo: queue.Queue[Action] = queue.Queue()
        self._done: deque[ActionResult] = deque()
        self._counts = {"messages": 0.0, "send_failures": 0.0, "actions": 0.0}
        self._stop = threading.Event()
        self._worker = threading.Thread(target=self._work, name="helm-link", daemon=True)
        self._worker.start()

    # ------------------------------------------------------------ control loop

    def poll(self, t_ns: int) -> Telemetry:
        """Newest telemetry, with every attitude since the last call (at most 100)."""
        dialect = self._dialect
        if dialect is not self._decoder.dialect:
            self._decoder = TelemetryDecoder(dialect)
        if dialect is UNKNOWN:
            return Telemetry(unfit=self._unfit)
        with self._lock:
            arrived = list(self._attitudes)
            self._attitudes.clear()
            arrived.extend(self._newest.values())
            self._newest.clear()
        arrived.sort()
        samples = [self._decoder.feed(name, fields, at) for at, name, fields in arrived]
        if self._decoder.now.found and self._decoder.now.age_s(t_ns) > LINK_LOST_S:
            lost = replace(self._decoder.now, attitudes=())
            self._decoder.forget()
            return lost
        return replace(self._decoder.now, attitudes=tuple(s for s in samples if s is not None))

    def send(self, setpoint: LocalSetpoint) -> bool:
        """Send one setpoint now; False when there is no autopilot or MAVSDK refused."""
        direct, dialect = self._direct, self._dialect
        if direct is None or dialect is UNKNOWN or self._listen_only:
            return False
        fields = dialect.setpoint(setpoint) | {
            "time_boot_ms": (time.monotonic_ns() - self._started_ns) // 1_000_000 & 0xFFFFFFFF,
            "target_system": self._system_id,
            "target_component": _COMPONENT,
        }
        return self.tell("SET_POSITION_TARGET_LOCAL_NED", fields)

    def tell(self, name: str, fields: Mapping[str, Any]) -> bool:
        """Send one message that needs no answer now; False when there is no autopilot or MAVSDK refused."""
        direct = self._direct
        if direct is None or self._listen_only:
            return False
        message = MavlinkMessage(name, 0, 0, self._system_id, _COMPONENT, json.dumps(fields))
        try:
            direct.send_message(message)
        except (MavsdkError, RuntimeError):
            self._counts["send_failures"] += 1
            return False
        return True

    def submit(self, action: Action) -> None:
        """Queue an action for the worker.

        Raises:
            ValueError: the link only listens, and this would change something.
        """
        if self._listen_only and (action.kind is not Kind.PARAMETERS or action.write):
            raise ValueError(f"submit: got {action.kind}, expected the reading of parameters: this link only listens")
        self._todo.put(action)

    def results(self) -> list[ActionResult]:
        """Results since the last call, oldest first."""
        out: list[ActionResult] = []
        while self._done:
            out.append(self._done.popleft())
        return out

    def metrics(self) -> dict[str, float]:
        """Messages, failures, the autopilot clock's drift."""
        return {
            **self._counts,
            "malformed": float(self._decoder.malformed),
            "clock_drift": self._decoder.clock.drift,
            "clock_restarts": float(self._decoder.clock.restarts),
        }

    def close(self, hold: bool) -> None:
        """End the link; with `hold`, ask the autopilot to hold first instead of leaving it to its loss failsafe."""
        if hold:
            self.submit(Action(Kind.HOLD))
            deadline = time.monotonic() + 1.5
            while time.monotonic() < deadline and not any(r.action.kind is Kind.HOLD for r in self._done):
                time.sleep(0.01)
        self._stop.set()
        self._worker.join(4.0)
        self._direct = None
        self._mavsdk.destroy()
        log_unsubscribe()

    # ------------------------------------------------------------ MAVSDK's callback thread

    def _store(self, message: MavlinkMessage, _user: Any) -> None:
        now_ns = time.monotonic_ns()
        if message.system_id != self._system_id or message.component_id != _COMPONENT:
            return
        self._heard_ns = now_ns
        entry = (now_ns, message.message_name, message.fields_json)
        with self._lock:
            self._counts["messages"] += 1
            if message.message_name == _HEARTBEAT:
                self._heartbeat = message.fields_json
            if message.message_name == _ATTITUDE:
                self._attitudes.append(entry)
            else:
                self._newest[message.message_name] = entry

    # ------------------------------------------------------------ worker

    def _work(self) -> None:
        rates_set, looked = False, 0
        while not self._stop.is_set():
            if self._direct is None:
                rates_set = False
                system = self._mavsdk.first_autopilot(0.5)
                if system is not None:
                    self._attach(system)
                elif (looked := looked + 1) == _PATIENCE:
                    log.warning("no autopilot at %s yet; start it, or set helm.autopilot_url; still looking", self._url)
                continue
            silent = time.monotonic_ns() - self._heard_ns > LINK_LOST_S * 1e9
            if silent:
                rates_set = False
                self._look_for_another()
            elif self._recognise(self._direct):
                rates_set = False
            elif not rates_set and self._dialect is not UNKNOWN and not self._listen_only:
                rates_set = True
                self._set_rates(self._direct)
            try:
                action = self._todo.get(timeout=0.2)
            except queue.Empty:
                continue
            self._done.append(self._perform(action))

    def _attach(self, system: Any) -> None:
        """Make a system the one that is read and commanded."""
        self._system_id = system.get_system_id()
        self._param = Param(system)
        self._heartbeat, self._recognised, self._dialect = None, None, UNKNOWN
        direct = MavlinkDirect(system)
        direct.subscribe_message(_HEARTBEAT, self._store)
        self._subscribed = {_HEARTBEAT}
        self._heard_ns = time.monotonic_ns()
        self._direct = direct

    def _recognise(self, direct: MavlinkDirect) -> bool:
        """Take the dialect that the newest heartbeat calls for; whether that was news."""
        if self._heartbeat is None:
            return False
        try:
            heartbeat = json.loads(self._heartbeat)
            heard = (int(heartbeat["autopilot"]), int(heartbeat["type"]))
        except (ValueError, KeyError, TypeError):
            return False  # counted as malformed where it is decoded
        if heard == self._recognised:
            return False
        self._recognised = heard
        try:
            dialect, self._unfit = recognise(*heard, self._wanted), ""
        except UnfitAutopilot as error:
            self._dialect, self._unfit = UNKNOWN, f"{self._url}: {error}"
            log.error("%s", self._unfit)
            return True
        for name in dialect.messages:
            if name not in self._subscribed:
                self._subscribed.add(name)
                direct.subscribe_message(name, self._store)
        self._dialect = dialect
        log.info("autopilot found at %s, system %d: %s", self._url, self._system_id, dialect.title)
        return True

    def _look_for_another(self) -> None:
        """The autopilot is silent: take up one that speaks under another system id (after an exchange or a reset)."""
        for system in self._mavsdk.get_systems():
            if system.has_autopilot() and system.is_connected() and system.get_system_id() != self._system_id:
                old, self._direct = self._direct, None
                if old is not None:
                    old.destroy()
                self._attach(system)
                return

    def _set_rates(self, direct: MavlinkDirect) -> None:
        for message_id, rate_hz in self._dialect.rates_hz:
            ok, text = self._command(direct, Command(_SET_MESSAGE_INTERVAL, (float(message_id), 1e6 / rate_hz)))
            if not ok:
                log.info("the autopilot keeps its own rate of message %d (%s)", message_id, text)

    def _perform(self, action: Action) -> ActionResult:
        self._counts["actions"] += 1
        param, direct, dialect = self._param, self._direct, self._dialect
        if param is None or direct is None or dialect is UNKNOWN:
            return ActionResult(action, False, "no autopilot")
        if action.kind is Kind.PARAMETERS:
            result = _parameters(param, action, lambda: self._todo.empty() and not self._stop.is_set())
            if result.text and result.text != self._fault:
                log.warning("autopilot parameters: %s", result.text)
            self._fault = result.text
            return result
        for command in dialect.commands(action.kind, self._decoder.now.mode, action.height_m):
            ok, text = self._command(direct, command)
            if not ok:
                return ActionResult(action, False, text)
        return ActionResult(action, True)

    def _command(self, direct: MavlinkDirect, command: Command) -> tuple[bool, str]:
        """Send a COMMAND_LONG and wait for its acknowledgement (MAVSDK repeats it)."""
        params = [None if math.isnan(p) else p for p in command.params]  # JSON has no NaN
        fields = {
            "target_system": self._system_id,
            "target_component": _COMPONENT,
            "command": command.number,
            "confirmation": 0,
        }
        fields |= {f"param{i}": (params[i - 1] if i <= len(params) else 0.0) for i in range(1, 8)}
        message = MavlinkMessage("COMMAND_LONG", 0, 0, self._system_id, _COMPONENT, json.dumps(fields))
        try:
            acknowledged = json.loads(direct.send_command(message).fields_json)
        except (MavsdkError, ValueError) as error:
            return False, getattr(getattr(error, "result", None), "name", str(error))
        result = int(acknowledged.get("result", -1))
        return result == _ACCEPTED, f"{_RESULTS.get(result, result)} (command {command.number})"


def _parameters(param: Param, action: Action, idle: Callable[[], bool]) -> ActionResult:
    """Read the parameters, write those that differ where that is asked for, and read these back.

    Gives up between two of them as soon as another action waits or the link ends: a lost reply costs seconds, and a
    landing must not stand in the queue behind it.
    """
    values: dict[str, float] = {}
    faults: list[str] = []
    for name, wanted in action.parameters.items():
        if not idle():
            faults.append("interrupted")
            break
        integer = isinstance(wanted, int)
        read = param.get_param_int if integer else param.get_param_float
        write = param.set_param_int if integer else param.set_param_float
        try:
            values[name] = float(read(name))
            if action.write and not _equal(values[name], wanted):
                write(name, wanted)
                log.info("autopilot parameter %s: %g -> %g", name, values[name], wanted)
                values[name] = float(read(name))
        except MavsdkError as error:
            reason = getattr(getattr(error, "result", None), "name", str(error))
            faults.append(f"{name}: {_CURES.get(reason, reason)}")
            continue
        if not _equal(values[name], wanted):
            faults.append(f"{name}: got {values[name]:g}, expected {wanted:g}")
    return ActionResult(action, not faults, "; ".join(faults), values)


def _equal(got: float, wanted: float) -> bool:
    return math.isclose(got, wanted, rel_tol=1e-4, abs_tol=1e-4)


class _MavsdkLog:
    """Sends MAVSDK's own log lines to Python's: each error once as a warning, however often it is retried."""

    def __init__(self) -> None:
        self.newest_error = ""
        """What went wrong last."""
        self._seen: set[str] | None = None

    def to_warnings(self) -> None:
        """The link is open: from now on an error is a warning; before, it is the reason of a refusal."""
        self._seen = {"Sending message failed"}  # says nothing that the silence of the autopilot does not say

    def __call__(self, level: LogLevel, text: str, _file: str | None, _line: int) -> bool:
        worth = False
        if level is LogLevel.ERROR:
            self.newest_error = text
            worth = self._seen is not None and text not in self._seen
            if self._seen is not None:
                self._seen.add(text)
        log.log(logging.WARNING if worth else logging.DEBUG, "MAVSDK: %s", text)
        return True
