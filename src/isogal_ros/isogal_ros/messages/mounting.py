"""Where sensors are and how their axes lie, by the static transforms of a vehicle's description.

An entry of `drivers` that asks for it (`from_tf`) has its `rotation` and `translation`, as far as
it does not say them itself, from /tf_static. They are looked up once, before anything is used, so
that all of a run has the same; the recorder keeps what was found."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.inertial.rotations import matrix, to_angles
from isogal.scenario import Scenario, validate_scenario
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError, require_unit
from isogal_ros.messages.drivers import Driver, Entrance
from isogal_ros.messages.frames import BASE, FRD_FLU
from isogal_ros.messages.position import FARTHEST
from isogal_ros.messages.prepared import Reader

Pose = Array
"""Homogeneous transform (4, 4) of a child frame's points, m, into its parent: rotation, and the
child's place in the last column. One follows another by `@`."""
TF_STATIC = "/tf_static"
_INERTIAL = topics.IMU, topics.INS_SOLUTION, topics.INS_SOLUTION_FIX
"""What the navigator's place is that of."""
_ON_GROUND = ("gnss/", "position/")
"""Begin the topics whose messages are not in axes of the sensor."""


class Link(NamedTuple):
    """A transform, by the name of its child."""

    parent: str
    pose: Pose


Tree = Mapping[str, Link]
"""Transforms by child frame."""


def pose_of(place: Array, rotation: Array) -> Pose:
    """Return the pose of a place (3,) and a rotation (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    return pose


def read_transforms(data: bytes) -> dict[str, Link]:
    """Return the transforms of a serialised tf2_msgs/TFMessage, whose class is not among ROS 2's
    wheels; raises BadMessageError where it is none. One of them that cannot be used is left out: a
    message has those of the whole vehicle."""
    content, found = Reader(data), dict[str, Link]()
    try:
        (count,) = content.take("I")
        for _ in range(int(count)):
            content.stamp()
            parent, child = content.text(), content.text()
            numbers = np.array(content.take("7d"))
            turn = np.roll(numbers[3:], 1)  # w first
            with suppress(BadMessageError):
                require_unit(turn, "rotation")
                if (np.abs(numbers[:3]) < FARTHEST).all():
                    found[child] = Link(parent, pose_of(numbers[:3], matrix(turn)))
    except BadMessageError:
        raise BadMessageError("no transforms") from None
    return found


def pose_in(tree: Tree, base: str, frame: str) -> Pose | None:
    """Return the pose of a frame in another; None where they are not connected."""
    (root, of_base), (other, pose) = _to_root(tree, base), _to_root(tree, frame)
    return np.linalg.inv(of_base) @ pose if root == other else None


def _to_root(tree: Tree, frame: str) -> tuple[str, Pose]:
    """Return the last of a frame's parents, and the frame's pose in it."""
    pose = np.eye(4)
    for _ in range(len(tree)):  # which ends where transforms go in a circle
        if frame not in tree:
            break
        frame, pose = tree[frame].parent, tree[frame].pose @ pose
    return frame, pose


def placed(entrance: Entrance, look: Callable[[Callable[[Tree], bool]], Tree]) -> Entrance:
    """Return an entrance whose entries say what they have from static transforms.

    Parameters
    ----------
    entrance : Entrance
    look : callable
        Returns the transforms, once what it is called with says that they are enough, or no more
        are to come; not called where no entry asks.

    Raises
    ------
    InputError
        An entry's frame is not connected with that of the vehicle; or an entry has no effect.
    """
    asking = {name: one for name, one in entrance.drivers.items() if one.from_tf}
    if not asking:
        return entrance
    base = entrance.names.outside(BASE)

    def frames(tree: Tree) -> list[Pose | None]:
        return [pose_in(tree, base, one.frame or "") for one in asking.values()]

    tree = look(lambda seen: all(pose is not None for pose in frames(seen)))
    found: dict[str, Driver] = {}
    for (name, one), pose in zip(asking.items(), frames(tree), strict=True):
        if pose is None:
            there = ", ".join(sorted(tree)) or "nothing"
            raise InputError(
                f"drivers.{name}.from_tf: no transform from {base!r} to {one.frame!r} on"
                f" {TF_STATIC}, which has {there}"
            )
        angles = np.degrees(to_angles(pose[:3, :3])).tolist()
        turn = (0.0, 0.0, 0.0) if name.startswith(_ON_GROUND) else tuple(angles)
        update = {
            "from_tf": False,
            "rotation": one.rotation or turn,
            "translation": one.translation or tuple(pose[:3, 3].tolist()),
        }
        found[name] = one.model_copy(update=update)
    return replace(entrance, drivers={**entrance.drivers, **found})


def mounted(scenario: Scenario, drivers: Mapping[str, Driver]) -> Scenario:
    """Return a scenario with the lever arms that entries of `drivers` say, where it has none of
    its own: from the inertial sensors, or the INS, so less the translation of these."""
    of_inertial = (drivers.get(topic.name, Driver()).translation for topic in _INERTIAL)
    origin = np.array(next(filter(None, of_inertial), (0.0, 0.0, 0.0)))
    arms = {
        name: (FRD_FLU * (np.array(one.translation) - origin)).tolist()
        for name, one in drivers.items()
        if one.translation is not None
    }
    document, changed = scenario.model_dump(mode="json"), False
    sections = {
        topics.GNSS_FIX.name: document["gnss"],
        topics.GNSS_VELOCITY.name: document["gnss"],
        topics.VELOCITY.name: document["velocity"],
        topics.GRAVIMETRY.name: document["gravimeter"],
    }
    for entries, kind in (("positions", "position"), ("velocities", "velocity")):
        for aid in document[entries] or ():
            sections |= {one.name: aid for one in topics.aid_topics(kind, aid["name"])}
    for name, arm in arms.items():
        if name in sections and not any(sections[name]["lever_arm"]):
            sections[name]["lever_arm"], changed = arm, True
    return validate_scenario(document) if changed else scenario
