"""What the middleware of every process of the graph is told, however that was started."""

import os
import re
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager, suppress
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.node import Node

OWN_FILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Environment variables that name a file of profiles."""
PROFILES = {
    OWN_FILES[0]: str(Path(__file__).with_name("fastdds.xml")),
    "RMW_FASTRTPS_USE_QOS_FROM_XML": "1",
}
"""Quick acknowledgements, memory that is freed, and no shared memory. The second is for the first
only: with a file that does not say how messages are kept it would mean something else than
usual."""
LEASE = 20.0
"""s of wall time after which Fast DDS takes a process that says nothing for gone, and drops
all that it keeps for it."""

SHARED_MEMORY = Path("/dev/shm")
"""Folder of its files."""
_LOCK = re.compile(rf"{SHARED_MEMORY}/(fastrtps_[0-9a-f]{{16}})_el")
"""File that a process holds for as long as it has shared memory of Fast DDS."""


def delete_shared_memory(name: str, folder: Path = SHARED_MEMORY) -> None:
    """Delete the files of one piece of shared memory of Fast DDS, by its name."""
    for left in (f"sem.{name}_mutex", name, f"{name}_el"):
        (folder / left).unlink(missing_ok=True)


def leave_shared_memory() -> None:
    """Delete this process's files of shared memory, which it has although its data do not go over
    it: at the end of a process that does not take its participant down."""
    for one in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # what lists them is among them, and is gone
            if held := _LOCK.fullmatch(str(one.readlink())):
                delete_shared_memory(held[1])


def set_profiles(environment: MutableMapping[str, str] = os.environ) -> None:
    """Name Isogal's profiles in an environment, unless it names others; before rclpy.init."""
    file = PROFILES[OWN_FILES[0]]
    if all(environment.get(name, file) == file for name in OWN_FILES):
        for name, value in PROFILES.items():
            environment.setdefault(name, value)


@contextmanager
def listening_node(name: str, context: Context) -> Iterator[Node]:
    """Yield a node that only listens, quietly."""
    node = rclpy.create_node(
        name,
        context=context,
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
    )
    try:
        yield node
    finally:
        node.destroy_node()
