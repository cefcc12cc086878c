"""The words on the picture."""

from __future__ import annotations

from ground.console.overlay import BLUE, GREEN, GREY, ORANGE, RED, Caption
from ground.console.snapshot import APPROACH, PURSUIT_CAMERA, TRACK, Snapshot


def target_caption(view: Snapshot) -> Caption:
    """The word about the target, state and how long ago it was seen; through another camera than the chase's, the
    word about what is approached; about what is followed, where helm obeys that or there is nothing else."""
    if view.following or _nothing_else(view):
        followed = _followed_caption(view)
        if followed is not None:
            return followed
    if view.shown != PURSUIT_CAMERA:
        return _approach_caption(view)
    track = view.track
    if track is None:
        return Caption("NO PURSUIT", GREY)
    if not view.fresh(TRACK):
        return Caption(f"NO TRACK  {view.age_ms(TRACK) / 1000:.1f} s", RED)
    if track.state == "tracking":
        return Caption(f"TRACKING  {view.track_age_ms:.0f} ms", GREEN)
    if track.state == "lost":
        since = f"  {view.tracked_ago_ms / 1000:.1f} s" if view.tracked_ago_ms >= 0 else ""
        return Caption(f"LOST{since}", ORANGE)
    return Caption("NO TARGET", GREY)


def _nothing_else(view: Snapshot) -> bool:
    """Whether there is no target but the follower's for the camera that is shown."""
    if view.shown != PURSUIT_CAMERA:
        return view.approach is None or not view.fresh(APPROACH) or view.approach.state == "idle"
    return view.track is None or view.track.state == "idle"


def _followed_caption(view: Snapshot) -> Caption | None:
    """The word about what is followed; None where the camera that is shown does not show it."""
    track = view.followed_in_picture
    if track is None:
        return None
    if track.state == "tracking":
        return Caption(f"{'FOLLOWING' if view.following else 'TO FOLLOW'}  {view.followed_age_ms:.0f} ms", BLUE)
    since = f"  {view.followed_ago_ms / 1000:.1f} s" if view.followed_ago_ms >= 0 else ""
    return Caption(f"LOST{since}", ORANGE)


def _approach_caption(view: Snapshot) -> Caption:
    target = view.approach if view.fresh(APPROACH) else None
    if target is None or target.state == "idle":
        return Caption("NO SELECTION", GREY)
    word = {"tracking": f"{target.distance_m:.1f} m, TO {target.goal_m:.1f} m", "lost": "LOST"}[target.state]
    return Caption(word, GREEN if target.state == "tracking" else ORANGE)


def hint(view: Snapshot) -> str:
    """What the operator may draw on the picture; empty when there is nothing to say, and over found people."""
    if view.in_picture is not None and view.in_picture.people:
        return ""
    followed = view.followed_in_picture
    if followed is not None and (view.following or _nothing_else(view)):
        return "" if followed.state == "tracking" else "Draw a box around what to follow"
    if view.shown != PURSUIT_CAMERA:
        return "Draw a box to approach it" if _nothing_else(view) else ""
    if view.track is not None and view.fresh(TRACK) and view.track.state != "tracking":
        return "Draw a box around the target"
    return ""
