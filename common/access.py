"""Who may do what on the bus: Zenoh access control, made from the tables of streams and commands.

It judges two kinds of neighbours of a router, and nobody else gets anything:
- a process of this machine, on loopback, known by its name and password: it writes its own streams, answers its own
  commands, reads everything; only operators (`console`, `cli`) give commands;
- the other side's router, over the link, known by the name in its certificate (and, for the ground's, a password as
  well): towards the vehicle go commands to it, and requests and whatever else the vehicle reads; from the vehicle come
  its streams and the answers. Raw pictures and the simulator's knowledge cross in neither direction.

A router sees its neighbour, not the process behind it: that a request over the link comes from the pursuit and not
from the recorder is the ground router's to enforce, and the vehicle's to trust.
"""

from __future__ import annotations

from typing import Any, Literal

from common import topics

RouterSide = Literal["onboard", "ground"]

IDENTITIES: dict[RouterSide, tuple[str, ...]] = {
    "onboard": (
        "router-onboard",
        "camera",
        "helm",
        "proximity",
        "people",
        "search",
        "approach",
        "follow",
        "world",
        "sensor",
        "cli",
    ),
    "ground": ("pursuit", "console", "recorder", "stick", "cli"),
}
"""Names under which processes of a machine log in to its router. `cli` is the `outrider` command; `sensor` and `stick`
are for what users bring: a sensor of obstacles, a stick."""
OPERATORS = ("console", "cli")
"""Who may give commands."""
READ_ON_BOARD = ("helm/request/operator", "helm/request/pursuit", "pursuit/track")
"""What the ground may write towards the vehicle: all that the vehicle's nodes read of it."""
LINK_USER = "link"
"""Name under which the ground's router logs in to the vehicle's."""

_LIVELINESS = ("liveliness_query", "declare_liveliness_subscriber")


def certificate_name(side: RouterSide, vehicle: str) -> str:
    """Common name in the certificate of a side's router."""
    return f"{side}.{vehicle}"


def access_control(side: RouterSide, vehicle: str) -> dict[str, Any]:
    """Zenoh's `access_control` section for the router of a side: what no rule allows is dropped.

    Args:
        side: whose router.
        vehicle: the one vehicle whose keys it handles.
    """
    policies: list[dict[str, Any]] = []
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []

    def allow(subject: dict[str, Any], its_rules: list[dict[str, Any]]) -> None:
        subjects.append(subject)
        for number, rule in enumerate(its_rules):
            rule["id"] = f"{subject['id']} {number + 1}"
        rules.extend(its_rules)
        policies.append({"rules": [r["id"] for r in its_rules], "subjects": [subject["id"]]})

    for identity in IDENTITIES[side]:
        allow(
            {"id": identity, "usernames": [identity], "link_protocols": ["tcp"]},
            _rules_of_identity(identity, side, vehicle),
        )
    other: RouterSide = "ground" if side == "onboard" else "onboard"
    link: dict[str, Any] = {"id": "link", "cert_common_names": [certificate_name(other, vehicle)]}
    if side == "onboard":
        link["usernames"] = [LINK_USER]
    allow(link | {"link_protocols": ["tls"]}, _rules_of_link(side, vehicle))
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def written_by(identity: str) -> list[str]:
    """Names of the streams that an identity may write."""
    streams = [t.name for t in topics.TOPICS.values() if identity in t.writers]
    return [*streams, topics.health_topic(identity).name]


def commands_of(nodes: tuple[str, ...]) -> list[str]:
    """Names of the commands that these nodes answer."""
    return [name for name in topics.COMMANDS if name.split("/")[0] in nodes]


def crossing(writers_side: RouterSide) -> list[str]:
    """Names of the streams of a side that the link carries."""
    if writers_side == "ground":
        return list(READ_ON_BOARD)
    own = IDENTITIES["onboard"]
    streams = [
        t.name
        for t in topics.TOPICS.values()
        if t.crosses_link and not t.simulated and t.name not in READ_ON_BOARD and set(t.writers) & set(own)
    ]
    return streams + [topics.health_topic(identity).name for identity in own]


def _rule(flow: str, messages: tuple[str, ...], vehicle: str, names: list[str]) -> dict[str, Any]:
    return {
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": [topics.key(vehicle, name) for name in names],
    }


def _rules_of_identity(identity: str, side: RouterSide, vehicle: str) -> list[dict[str, Any]]:
    """What a process of this machine may do; ingress is from it, egress to it."""
    rules = [
        _rule("ingress", ("put",), vehicle, written_by(identity)),
        _rule("ingress", ("liveliness_token",), vehicle, [f"alive/{identity}/*"]),
        _rule("ingress", ("declare_subscriber",), vehicle, ["**"]),
        _rule("ingress", _LIVELINESS, vehicle, ["alive/**"]),
        # Readers are shown to writers, so that a camera nobody watches does not compress.
        _rule("egress", ("put", "declare_subscriber", "liveliness_token"), vehicle, ["**"]),
    ]
    if answered := commands_of((identity,)):
        rules.append(_rule("ingress", ("declare_queryable", "reply"), vehicle, answered))
        rules.append(_rule("egress", ("query",), vehicle, answered))
    if identity in OPERATORS:
        asked = list(topics.COMMANDS) if side == "ground" else commands_of(IDENTITIES["onboard"])
        rules.append(_rule("ingress", ("query",), vehicle, asked))
        rules.append(_rule("egress", ("declare_queryable", "reply"), vehicle, asked))
    return rules


def _rules_of_link(side: RouterSide, vehicle: str) -> list[dict[str, Any]]:
    """What the other side's router may do; the same list for both routers, seen from either end."""
    upwards, downwards = ("ingress", "egress") if side == "onboard" else ("egress", "ingress")
    commands = commands_of(IDENTITIES["onboard"])
    rules = [
        _rule(upwards, ("put",), vehicle, crossing("ground")),
        _rule(upwards, ("query",), vehicle, commands),
        _rule(downwards, ("put",), vehicle, crossing("onboard")),
        _rule(downwards, ("declare_queryable", "reply"), vehicle, commands),
    ]
    for flow, identities in ((upwards, IDENTITIES["ground"]), (downwards, IDENTITIES["onboard"])):
        rules.append(_rule(flow, ("liveliness_token",), vehicle, [f"alive/{identity}/*" for identity in identities]))
        rules.append(_rule(flow, ("declare_subscriber",), vehicle, ["**"]))
        rules.append(_rule(flow, _LIVELINESS, vehicle, ["alive/**"]))
    return rules
