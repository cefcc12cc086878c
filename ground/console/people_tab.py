"""The page's part about people: the list, and what the operator can order about each."""

from __future__ import annotations

import viser

from common.messages import Command, person_label
from ground.console.commands import (
    APPROACH_PERSON,
    DISMISS,
    MERGE,
    RENAME,
    RESUME_SEARCH,
    SEARCH_AREA,
    STOP_SEARCH,
    Action,
)
from ground.console.notes import Notes
from ground.console.people_cards import (
    called,
    faces_html,
    is_interrupted,
    listed,
    number_of,
    people_html,
    search_html,
)
from ground.console.snapshot import Snapshot

NOBODY: str = "nobody yet"
"""The list's only choice while nobody was found."""
_LONGEST_NAME = 40
_PLAIN = (58, 66, 77)


class OrderRefused(ValueError):
    """An order that names nobody, or nothing to do; the text says why."""


def order(action: Action, who: str, name: str, other: str) -> Command:
    """Argument of an order about a person.

    Args:
        action: one of the orders about people.
        who: choice of the list of people.
        name: the text beside Rename.
        other: choice of the list beside Merge.

    Raises:
        OrderRefused: nobody is chosen, there is no name, or somebody would be merged with themselves.
    """
    number, into = number_of(who), number_of(other)
    if number is None:
        raise OrderRefused("Nobody was found yet; there is nobody to choose.")
    label = person_label(number)
    if action is RENAME:
        name = name.strip()
        if not name or len(name) > _LONGEST_NAME:
            raise OrderRefused(f"Write a name of 1 to {_LONGEST_NAME} letters; got {len(name)}.")
        return Command(label=label, name=name)
    if action is MERGE:
        if into is None or into == number:
            raise OrderRefused(f"Choose beside Merge whom {label} is the same as.")
        return Command(label=label, into=person_label(into))
    return Command(label=label)


class PeopleTab:
    """List and orders.

    Args:
        gui: where they are built.
        notes: gives orders for browsers, and tells them why one is none.
    """

    def __init__(self, gui: viser.GuiApi, notes: Notes):
        self._notes = notes
        self._interrupted = False
        self._search = gui.add_html("")
        self.buttons = {action: self._add_search(gui, action) for action in (SEARCH_AREA, STOP_SEARCH)}
        """Handle of each order's button."""
        self._faces = gui.add_html("")
        self._list = gui.add_html("")
        self._who = gui.add_dropdown("Person", (NOBODY,))
        for action in (APPROACH_PERSON, DISMISS):
            self.buttons[action] = self._add(gui, action)
        self._name = gui.add_text("Name", "")
        self.buttons[RENAME] = self._add(gui, RENAME)
        self._other = gui.add_dropdown("Same as", (NOBODY,))
        self.buttons[MERGE] = self._add(gui, MERGE)

    def update(self, view: Snapshot) -> None:
        """Bring the list and the choices up to date; who was chosen stays chosen under another name."""
        self._interrupted = is_interrupted(view)
        texts = (
            (self._search, search_html(view)),
            (self._list, people_html(view)),
            (self._faces, faces_html(view.faces)),
        )
        for element, content in texts:
            if element.content != content:
                element.content = content
        options = tuple(called(p) for p in listed(view.people.people)) if view.people is not None else ()
        for choice in (self._who, self._other):
            _offer(choice, options or (NOBODY,))

    def choose(self, number: int) -> None:
        """Choose a person, when the list has them."""
        for option in self._who.options:
            if number_of(option) == number:
                self._who.value = option

    def _add_search(self, gui: viser.GuiApi, action: Action) -> viser.GuiButtonHandle:
        button = gui.add_button(action.label, icon=action.icon, color=_PLAIN)

        @button.on_click
        def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                goes_on = action is SEARCH_AREA and self._interrupted
                self._notes.give(event.client, RESUME_SEARCH if goes_on else action, Command())

        return button

    def _add(self, gui: viser.GuiApi, action: Action) -> viser.GuiButtonHandle:
        button = gui.add_button(action.label, icon=action.icon, color=_PLAIN)

        @button.on_click
        def _(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            try:
                argument = order(action, self._who.value, self._name.value, self._other.value)
            except OrderRefused as refusal:
                self._notes.refuse(event.client, action, str(refusal))
                return
            self._notes.give(event.client, action, argument)

        return button


def _offer(choice: viser.GuiDropdownHandle[str], options: tuple[str, ...]) -> None:
    if tuple(choice.options) == options:
        return
    number = number_of(choice.value)
    same = [option for option in options if number is not None and number_of(option) == number]
    choice.options = options
    if same and choice.value != same[0]:
        choice.value = same[0]
