"""The fusion's trackers, each in a process of its own: a slow, frozen or dead one holds no other, nor the fusion.

A tracker is given a picture when it has answered the last one; what it answers counts with that picture's capture time,
however late it comes. Pictures lie in memory that both sides map; through the pipe go only short messages, and at most
one question is open, so a stopped process cannot block the one that asks.
"""

from __future__ import annotations

import ctypes
import logging
import multiprocessing
import signal
import time
from collections.abc import Iterable, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, Literal, NamedTuple

import numpy as np

from common.config import Config
from common.tracking.base import Box, Expectation, Tracker, TrackResult, put
from common.tracking.registry import TRACKERS
from onboard.fusion.camera_motion import tell

log = logging.getLogger(__name__)
_FORKS = multiprocessing.get_context("forkserver")
"""One server imports and compiles once for all; it has no thread, so that a fork of it is whole."""
_END_S = 1.0
"""How long the end of a process is waited for, s."""
_READY_S = 30.0
"""How long one may take to come up, s: the first time trackers are compiled."""
_PROMPT_S = 0.15
"""For how long an open question is waited for at all, s: who is slower holds up no picture."""

Order = Literal["init", "update", "place"]


class Ask(NamedTuple):
    """One question to a tracker; its picture is in the shared memory."""

    order: Order
    """What to do with the picture."""
    t_ns: int
    """Its capture stamp, ns."""
    shape: tuple[int, int, int]
    """Its shape."""
    box: Box | None = None
    """Where to start, or to go on from, px."""
    expected: Expectation | None = None
    """What the camera's motion has done to the picture since the tracker's last one; None where it is not known."""


class Answer(NamedTuple):
    """What a tracker made of it."""

    t_ns: int
    """Capture stamp of the picture, ns."""
    result: TrackResult | None
    """Where the target is; None after a start, or when it failed."""
    error: str = ""
    """Why it failed."""


def serve(name: str, config: Config, seed: Sequence[int], memory: Any, connection: Connection) -> None:
    """Run one tracker until the other side closes; what each process begins with."""
    import cv2

    from common.tracking.registry import make_tracker

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the node, which ends this
    cv2.setNumThreads(1)
    tracker = make_tracker(name, config, np.random.default_rng(list(seed)))
    pixels = np.frombuffer(memory, np.uint8)
    try:
        connection.send(Answer(0, None))
        while True:
            ask: Ask = connection.recv()
            # A tracker may keep the picture; the memory holds the next one soon.
            frame = pixels[: int(np.prod(ask.shape))].reshape(ask.shape).copy()
            connection.send(_answer(tracker, ask, frame))
    except (EOFError, OSError):
        return  # the other side closed, or is no more


def _answer(tracker: Tracker, ask: Ask, frame: np.ndarray) -> Answer:
    """What a tracker makes of a question; one that fails is one that does not see."""
    try:
        if ask.order == "update":
            if ask.expected is not None:
                tell(tracker, ask.expected)
            return Answer(ask.t_ns, tracker.update(frame, ask.t_ns))
        if ask.box is None:
            raise ValueError(f"{ask.order}: got no box, expected x, y, width, height in px")
        if ask.order == "init":
            tracker.init(frame, ask.box, 0.0, ask.t_ns)
        else:
            put(tracker, frame, ask.box, ask.t_ns)
    except Exception as error:  # noqa: BLE001  the other trackers go on
        return Answer(ask.t_ns, None, f"{type(error).__name__}: {error}")
    return Answer(ask.t_ns, None)


class Member:
    """One tracker's process, seen from the fusion.

    Args:
        name: of the registry.
        config: all sections.
        seed: of its randomness.
        size: bytes of the largest picture.
    """

    def __init__(self, name: str, config: Config, seed: Sequence[int], size: int):
        self.name = name
        self.restarts = 0
        """How often its process was begun anew."""
        self.ready = False
        """Whether the process has come up."""
        self.started = False
        """Whether it has a target."""
        self.last_error = ""
        """Why its last answer failed."""
        self._config, self._seed, self._size = config, tuple(seed), size
        self._asked_ns = 0
        self._spawn()

    @property
    def pid(self) -> int:
        """Of its process."""
        return self._process.pid or 0

    @property
    def connection(self) -> Connection:
        """To wait for."""
        return self._connection

    @property
    def busy(self) -> bool:
        """Whether a question is open, the one whether it has come up included."""
        return self._asked_ns > 0

    @property
    def prompt(self) -> bool:
        """Whether an answer can be expected soon."""
        late_s = (time.monotonic_ns() - self._asked_ns) / 1e9
        return self.busy and not self._gone and (late_s < _PROMPT_S or not self.ready)

    def _spawn(self) -> None:
        self._memory = _FORKS.RawArray(ctypes.c_uint8, self._size)
        self._pixels = np.ctypeslib.as_array(self._memory)
        self._connection, theirs = _FORKS.Pipe()
        arguments = (self.name, self._config, self._seed, self._memory, theirs)
        self._process = _FORKS.Process(target=serve, args=arguments, name=f"follow {self.name}", daemon=True)
        self._process.start()
        theirs.close()
        self.ready = self.started = self._gone = False
        self._asked_ns = time.monotonic_ns()

    def ask(self, ask: Ask, frame: np.ndarray) -> bool:
        """Give it a picture; False when it has not answered the last one, or is no more."""
        if self.busy or not self.ready or self._gone:
            return False
        self._pixels[: frame.size] = frame.reshape(-1)
        try:
            self._connection.send(ask)
        except OSError:
            self._gone = True
            return False
        self._asked_ns = time.monotonic_ns()
        if ask.order != "update":
            self.started = True
        return True

    def take(self) -> Answer | None:
        """Its answer, when there is one."""
        try:
            if not self._connection.poll(0):
                return None
            answer: Answer = self._connection.recv()
        except (EOFError, OSError):
            self._gone = True  # `tend` begins it anew
            return None
        self._asked_ns = 0
        if not self.ready:
            self.ready = True
            return None
        self.last_error = answer.error
        if answer.error and answer.result is None:
            log.warning("%s: %s", self.name, answer.error)
        return answer

    def tend(self, frozen_after_s: float) -> str:
        """Begin the process anew when it has died or does not answer; says which, or nothing."""
        overdue_s = (time.monotonic_ns() - self._asked_ns) / 1e9 if self.busy else 0.0
        limit_s = frozen_after_s if self.ready else max(frozen_after_s, _READY_S)
        if not self._process.is_alive():
            why = f"died (exit code {self._process.exitcode})"
        elif overdue_s > limit_s:
            why = f"did not answer for {overdue_s:.1f} s"
        else:
            return ""
        self.close()
        self.restarts += 1
        self._spawn()
        return why

    def close(self) -> None:
        """End the process."""
        self._connection.close()
        if self._process.is_alive():
            self._process.kill()  # a stopped one hears nothing else
        self._process.join(_END_S)


class MemberPool:
    """All trackers of a fusion.

    Args:
        names: of the registry.
        config: all sections.
        seed: of their randomness.
        size: bytes of the largest picture.
    """

    def __init__(self, names: Iterable[str], config: Config, seed: int, size: int):
        self.size = size
        names = list(names)
        _FORKS.set_forkserver_preload(
            [__name__, *config.modules, *(TRACKERS[n].partition(":")[0] for n in names if n in TRACKERS)]
        )
        self.members = {name: Member(name, config, (seed, i), size) for i, name in enumerate(names)}

    @property
    def ready(self) -> bool:
        """Whether all have come up."""
        return all(member.ready for member in self.members.values())

    def await_ready(self, limit_s: float) -> bool:
        """Wait until all have come up; whether they have."""
        end = time.monotonic() + limit_s
        self.collect(0.0)
        while not self.ready and (left := end - time.monotonic()) > 0.0:
            self.collect(min(left, 0.1))
        return self.ready

    def collect(self, limit_s: float) -> list[tuple[str, Answer]]:
        """What has been answered, waiting for so long at most, and for nobody who has been silent for long already."""
        end, answers = time.monotonic() + limit_s, []
        while True:
            for name, member in self.members.items():
                answer = member.take()
                if answer is not None:
                    answers.append((name, answer))
            waited_for = [m.connection for m in self.members.values() if m.prompt]
            left = end - time.monotonic()
            if not waited_for or left <= 0.0 or not wait(waited_for, left):
                return answers

    def close(self) -> None:
        """End all."""
        for member in self.members.values():
            member.close()
