"""The page: one panel at the right with alarms, flight state, buttons and details; the picture fills the rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import viser

from common.geometry.rotation import euler_from_quat
from common.messages import Command
from ground.console.alarms import Alarm, alarms
from ground.console.cards import (
    alarms_html,
    approach_html,
    checks_html,
    flight_html,
    headline_html,
    last_html,
    log_html,
    nodes_html,
    target_html,
)
from ground.console.commands import (
    APPROACH,
    APPROACH_SELECTED,
    BUTTONS,
    ENGAGE,
    HOLD,
    MAIN,
    OF_SETTINGS,
    OF_TARGET,
    PUSH_BACK,
    START_CHASE,
    START_FOLLOW,
    TAKE_OFF,
    Action,
    Commander,
)
from ground.console.config import ConsoleConfig
from ground.console.notes import Notes
from ground.console.people_tab import PeopleTab
from ground.console.plot import ErrorHistory, ErrorPlot
from ground.console.ring import hud_html, knows_something
from ground.console.snapshot import APPROACH as APPROACH_TOPIC
from ground.console.snapshot import FOLLOWED, LIMITER, STATE, STATUS, Snapshot
from ground.console.stick import Speeds
from ground.console.stick_page import FRAME
from ground.console.style import ButtonLook, button_rules, style_html

FOR_CHASE, FOR_FOLLOWER = "the chase's target", "what the vehicle follows by itself"
"""What a box on the picture chooses."""
AS_SELECTED: str = "as selected, else nearest ahead"
"""Choice of the list of things to approach."""
_WIDTH_PX = 330
_VIEW_LOOK = ButtonLook(wide=True, height_px=38)
_PERIOD_NS = 250_000_000
_SLOW_PERIOD_NS = 1_000_000_000
_PLAIN = (58, 66, 77)
_HOLD_COLOUR = (201, 108, 0)
_NEXT_COLOUR = (31, 122, 68)
_TAKEN_COLOUR = (176, 96, 0)


def next_actions(view: Snapshot) -> set[str]:
    """Labels of the buttons that lead on from here, to be shown in colour."""
    status = view.status
    if status is None or not view.fresh(STATUS):
        return set()
    if status.state == "yielded":
        return {ENGAGE.label}
    if status.state == "standby" and all(item.ok for item in status.preflight):
        return {TAKE_OFF.label}
    if status.state != "hold":
        return set()
    leads = (START_CHASE, view.track), (START_FOLLOW, view.followed if view.fresh(FOLLOWED) else None)
    return {action.label for action, track in leads if track is not None and track.state == "tracking"}


def hud(view: Snapshot) -> str:
    """The limiter's ring over the picture; empty without fresh words of it, and on the ground."""
    status, state = view.limiter, view.state
    known = status is not None and state is not None and view.fresh(LIMITER) and view.fresh(STATE)
    if not known or status is None or state is None or not state.in_air or not knows_something(status):
        return ""
    return hud_html(status, euler_from_quat(state.ned_q_body)[2])


@dataclass
class Texts:
    """The HTML elements of the panel."""

    headline: viser.GuiHtmlHandle
    alarms: viser.GuiHtmlHandle
    flight: viser.GuiHtmlHandle
    hud: viser.GuiHtmlHandle
    approach: viser.GuiHtmlHandle
    last: viser.GuiHtmlHandle
    target: viser.GuiHtmlHandle
    checks: viser.GuiHtmlHandle
    nodes: viser.GuiHtmlHandle
    log: viser.GuiHtmlHandle
    watchdog: viser.GuiHtmlHandle


class Page:
    """Builds the panel and keeps it up to date.

    Args:
        server: the web server.
        config: heights, nodes, spans.
        commander: runs the commands, and knows the last ones.
        notes: gives orders for browsers.
        cameras: names of the vehicle's cameras.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        config: ConsoleConfig,
        commander: Commander,
        notes: Notes,
        cameras: tuple[str, ...],
    ):
        self._config = config
        self._commander, self._notes = commander, notes
        self._server = server
        self._due_ns = 0
        self._slow_due_ns = 0
        self._beat = 0
        self._has_selected = False
        self._pushes_back = False
        self._buttons: dict[str, viser.GuiButtonHandle] = {}
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False, brand_color=(74, 168, 255))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_WIDTH_PX)
        style = gui.add_html("")
        waiting = [Alarm("warning", "Waiting for the router", "Start the ground side: `outrider ground`.")]
        headline, alarm_text = gui.add_html(headline_html(waiting)), gui.add_html(alarms_html(waiting))
        flight_text = gui.add_html("")
        self._view_slot = gui.add_folder(None)
        self._camera = gui.add_dropdown("Camera", cameras, initial_value=config.camera, visible=len(cameras) > 1)
        self._box_for = gui.add_dropdown("A box chooses", (FOR_CHASE, FOR_FOLLOWER))
        buttons = gui.add_folder(None)
        with buttons:
            self._add_buttons(gui, MAIN)
        gui.add_html(FRAME)
        last_text = gui.add_html(last_html(None, 0))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Target"):
            self._things = gui.add_dropdown("Approach what", (AS_SELECTED,))
            approach_text, target_text = gui.add_html(""), gui.add_html("")
            self._add_buttons(gui, OF_TARGET)
            self._plot = ErrorPlot(gui, config.history_s)
        with tabs.add_tab("People"):
            self.people = PeopleTab(gui, notes)
            """What the operator can do about people."""
        with tabs.add_tab("Checks"):
            checks_text = gui.add_html("")
        with tabs.add_tab("Nodes"):
            nodes_text = gui.add_html("")
        with tabs.add_tab("Log"):
            log_text = gui.add_html("")
        with tabs.add_tab("Set"):
            self._height, self._stick_speed = _sliders(gui, config)
            self._add_buttons(gui, OF_SETTINGS)
        self._texts = Texts(
            headline,
            alarm_text,
            flight_text,
            gui.add_html(""),
            approach_text,
            last_text,
            target_text,
            checks_text,
            nodes_text,
            log_text,
            watchdog=gui.add_html(""),
        )
        looks = {self._buttons[action.label]._impl.uuid: action.look for action in BUTTONS}
        looks |= {button._impl.uuid: action.look for action, button in self.people.buttons.items()}
        style.content = style_html(looks, _WIDTH_PX)

    @property
    def camera(self) -> str:
        """Camera that the operator chose."""
        return self._camera.value

    @property
    def chooses_followed(self) -> bool:
        """Whether a box on the picture is for the vehicle's own follower."""
        return self._box_for.value == FOR_FOLLOWER

    @property
    def stick_speeds(self) -> Speeds:
        """What the stick asks for at full deflection."""
        config = self._config
        return Speeds(float(self._stick_speed.value), config.stick_climb_m_s, config.stick_turn_rad_s)

    def add_view_button(self, client: viser.ClientHandle) -> viser.GuiButtonHandle:
        """A button of one browser's own, to switch between picture and 3-D view."""
        with self._view_slot:
            button = client.gui.add_button("Show 3-D view", icon=viser.Icon.CUBE, color=_PLAIN)
            client.gui.add_html(f"<style>{button_rules(button._impl.uuid, _VIEW_LOOK)}</style>")
        return button

    def update(self, view: Snapshot, history: ErrorHistory, picture_rate_hz: float) -> None:
        """Bring texts and button colours up to date, four times a second; what is long, once."""
        if view.t_ns < self._due_ns:
            return
        self._due_ns = view.t_ns + _PERIOD_NS
        texts, log = self._texts, self._commander.log
        with self._server.atomic():
            found = alarms(view, self._config)
            _put(texts.headline, headline_html(found))
            _put(texts.alarms, alarms_html(found))
            _put(texts.flight, flight_html(view))
            _put(texts.hud, hud(view))
            _put(texts.approach, approach_html(view))
            self._offer_things(view)
            _put(texts.last, last_html(log[0] if log else None, view.t_ns))
            _put(texts.target, target_html(view, *(history.newest or (None, None))))
            self._colour_buttons(next_actions(view))
            self._plot.update(history, view.t_ns)
            if view.t_ns >= self._slow_due_ns:
                self._slow_due_ns = view.t_ns + _SLOW_PERIOD_NS
                self.people.update(view)
                _put(texts.checks, checks_html(view))
                _put(texts.nodes, nodes_html(view, self._config.nodes, picture_rate_hz))
                _put(texts.log, log_html(log, view.t_ns))
                # Replaced every second, this element never gets to the end of its animation; when the console dies,
                # it does, and says so over a picture that would otherwise look alive.
                self._beat += 1
                texts.watchdog.content = (
                    f'<div class="or-gone" data-beat="{self._beat}">NO CONNECTION TO THE CONSOLE'
                    f": what you see is old</div>"
                )

    def _add_buttons(self, gui: viser.GuiApi, actions: Iterable[Action]) -> None:
        self._buttons |= {action.label: self._add_button(gui, action) for action in actions}

    def _add_button(self, gui: viser.GuiApi, action: Action) -> viser.GuiButtonHandle:
        button = gui.add_button(action.label, icon=action.icon, color=_HOLD_COLOUR if action is HOLD else _PLAIN)

        @button.on_click
        def _(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            self._notes.give(event.client, *self._asked(action))

        return button

    def _asked(self, action: Action) -> tuple[Action, Command]:
        """What a press of a button means, with the fields beside it."""
        if action is TAKE_OFF:
            return action, Command(height_m=float(self._height.value))
        if action is APPROACH and self._things.value != AS_SELECTED:
            return action, Command(label=self._things.value)
        if action is APPROACH and self._has_selected:
            return APPROACH_SELECTED, Command()
        if action is PUSH_BACK:
            return action, Command(on=not self._pushes_back)
        return action, Command()

    def _offer_things(self, view: Snapshot) -> None:
        """Names of the things that are seen now; the one that is chosen stays in the list."""
        target = view.approach if view.fresh(APPROACH_TOPIC) else None
        self._has_selected = target is not None and target.state == "tracking"
        if view.limiter is not None:
            self._pushes_back = view.limiter.push_back_m_s > 0.0
            switch, words = self._buttons[PUSH_BACK.label], f"Switch push-back {'off' if self._pushes_back else 'on'}"
            if switch.label != words:
                switch.label = words
        names = {o.label for o in view.obstacles if o.label} | {self._things.value} - {AS_SELECTED}
        options = (AS_SELECTED, *sorted(names))
        if tuple(self._things.options) != options:
            self._things.options = options

    def _colour_buttons(self, leading: set[str]) -> None:
        for label, button in self._buttons.items():
            if label == HOLD.label:
                continue
            colour = _PLAIN if label not in leading else (_TAKEN_COLOUR if label == ENGAGE.label else _NEXT_COLOUR)
            if button.color != colour:
                button.color = colour


def _put(element: viser.GuiHtmlHandle, content: str) -> None:
    if element.content != content:
        element.content = content


def _sliders(gui: viser.GuiApi, config: ConsoleConfig) -> tuple[viser.GuiSliderHandle, viser.GuiSliderHandle]:
    """Height of the take-off, and speed at full deflection of the stick."""
    start, fastest = config.stick_speed_m_s, config.stick_speed_max_m_s
    return (
        gui.add_slider("Take-off, m", min=1.0, max=30.0, step=0.5, initial_value=config.takeoff_height_m),
        gui.add_slider("Stick, m/s", min=0.1, max=fastest, step=0.1, initial_value=start),
    )
