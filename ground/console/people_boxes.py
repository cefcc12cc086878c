"""Where in the picture that is shown the people are who were found in an earlier one, or in one of another size."""

from __future__ import annotations

import msgspec
import numpy as np

from common.geometry.camera import Camera
from common.messages import PeopleDetections, PersonDetection, VehicleState
from ground.console.target import pixels_of


def scaled(found: PersonDetection, x: float, y: float) -> PersonDetection:
    """The same person in a picture of another size."""
    left, top, width, height = found.box_px
    joints = tuple((column * x, row * y, confidence) for column, row, confidence in found.joints_px)
    return msgspec.structs.replace(found, box_px=(left * x, top * y, width * x, height * y), joints_px=joints)


def carried(
    found: PeopleDetections, camera: Camera | None, then: VehicleState | None, now: VehicleState | None
) -> list[PersonDetection]:
    """The people where they are in a later picture, by the vehicle's motion between the two: fewer pictures reach the
    ground than are searched on board, so that the one that is shown is seldom the one in which they were found.

    Args:
        found: in px of pictures of the size that they were found in.
        camera: its calibration; None where it is not known: then they stay where they were found, as do those whose
            place is not known.
        then: state of the vehicle when the picture was taken in which they were found.
        now: the same for the picture that is shown.
    """
    if camera is None or then is None or now is None or then is now:
        return list(found.people)
    eye = camera.resized(found.width, found.height)
    return [_carried(person, eye, then, now) for person in found.people]


def _carried(found: PersonDetection, camera: Camera, then: VehicleState, now: VehicleState) -> PersonDetection:
    if found.ned_p_m is None:
        return found
    shift = pixels_of([found.ned_p_m], camera, now)[0] - pixels_of([found.ned_p_m], camera, then)[0]
    if not np.isfinite(shift).all():
        return found
    x, y = (float(value) for value in shift)
    left, top, width, height = found.box_px
    joints = tuple((column + x, row + y, confidence) for column, row, confidence in found.joints_px)
    return msgspec.structs.replace(found, box_px=(left + x, top + y, width, height), joints_px=joints)
