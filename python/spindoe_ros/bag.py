"""Runs the node's core over a recorded bag, without ROS: reads one, writes one with the answers.

    python -m spindoe_ros.bag IN OUT --table table.npz [--topic /image] [--camera-info /camera_info]
        [--bright-dots] [--overlay]

The written bag (MCAP) holds the images and the answers, and opens in Foxglove. It appears whole or not at all.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spindoe._common import optional

from . import messages
from .core import Answer, Settings, SpinCore
from .health import most

POSE = "/ball/pose"
TWIST = "/ball/twist"
OVERLAY = "/ball/overlay"
IMAGES = (messages.IMAGE, "sensor_msgs/msg/CompressedImage")
# What the system says of a path that is no fit argument.
USAGE = (FileExistsError, FileNotFoundError, IsADirectoryError, NotADirectoryError)


class BagMessages:
    """Makes messages of the classes of rosbags.

    Args:
        types: Those of a type store, by name.
    """

    def __init__(self, types: Any) -> None:
        self._types = types

    def make(self, kind: str, **fields: Any) -> Any:
        """A message with all its fields."""
        return self._types[kind](**fields)

    def octet(self, value: int) -> int:
        """A value of type ``byte``."""
        return value

    def octets(self, values: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Values of type ``uint8[]``."""
        return values


def process(
    source: Path,
    target: Path,
    core: SpinCore,
    topic: str = "/image",
    camera_info: str = "/camera_info",
    *,
    overlay: bool = False,
) -> list[Answer]:
    """Answers every image of a topic, by the camera of the other topic where there is one; the answers, in the bag's order.

    As the node does, it goes on after a message that cannot be read, and leaves it out; a warning says how many there were.

    Args:
        source: The bag, a folder.
        target: The bag to write, which must not exist; it appears when all images are answered.
        core: What answers.
        topic: Of ``sensor_msgs/Image`` or ``CompressedImage``.
        camera_info: Of ``sensor_msgs/CameraInfo``.
        overlay: Write the images with what was found drawn onto them, too.

    Raises:
        FileExistsError: Where the target exists.
        ValueError: Where rosbags is missing, the source is no bag, has no such topic of images, or none of them can be read.
    """
    rosbag2 = optional("rosbags.rosbag2", "ros")
    if target.exists():
        raise FileExistsError(f"{target}: expected a new bag, found one that exists")
    aside = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        # A bag's file has the name of its folder.
        answers = _process(rosbag2, source, aside / target.name, core, topic, camera_info, overlay)
        (aside / target.name).rename(target)
    except rosbag2.ReaderError as error:
        raise ValueError(f"{source}: {error}") from error
    finally:
        shutil.rmtree(aside)
    return answers


def _process(
    rosbag2: Any, source: Path, target: Path, core: SpinCore, topic: str, camera_info: str, overlay: bool
) -> list[Answer]:
    types, serde = optional("rosbags.typesys", "ros"), optional("rosbags.serde", "ros")
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    kind = rosbag2.StoragePlugin.MCAP
    filled = BagMessages(store.types)
    answers = []
    counts: Counter[str] = Counter()
    problems: dict[str, list[str]] = {}
    with rosbag2.Reader(source) as reader, rosbag2.Writer(target, version=9, storage_plugin=kind) as writer:
        connections = [c for c in reader.connections if c.topic == topic and c.msgtype in IMAGES]
        if not connections:
            found = ", ".join(f"{c.topic} ({c.msgtype})" for c in reader.connections)
            raise ValueError(f"topic: expected images on {topic}, found {found}")

        def connection_of(name: str, kind: str) -> Any:
            return writer.add_connection(name, kind, typestore=store)

        images = connection_of(topic, connections[0].msgtype)
        poses = connection_of(POSE, messages.POSE)
        twists = connection_of(TWIST, messages.TWIST)
        overlays = connection_of(OVERLAY, messages.IMAGE) if overlay else None

        def write(connection: Any, time_ns: int, message: Any) -> None:
            writer.write(connection, time_ns, store.serialize_cdr(message, message.__msgtype__))

        infos = [
            c for c in reader.connections
            if c.topic == camera_info and c.msgtype == "sensor_msgs/msg/CameraInfo"
        ]
        for connection, time_ns, raw in reader.messages(connections=connections + infos):
            counts[connection.topic] += 1
            try:
                message: Any = store.deserialize_cdr(raw, connection.msgtype)
                if connection.topic == camera_info:
                    core.on_camera_info(message)
                    continue
                answer = core.on_image(message)
            except (ValueError, serde.SerdeError) as error:
                problems.setdefault(connection.topic, []).append(str(error))
                continue
            answers.append(answer)
            writer.write(images, time_ns, raw)
            if answer.pose:
                write(poses, time_ns, messages.pose(filled, answer, answer.pose))
            if answer.spin:
                write(twists, time_ns, messages.twist(filled, answer, answer.spin))
            if overlays is not None:
                write(overlays, time_ns, messages.overlay(filled, answer))
    if not answers and topic in problems:
        raise ValueError(f"{topic}: none of {counts[topic]} images can be read, the first because of {problems[topic][0]}")
    for name, reasons in problems.items():
        words = f"{name}: {len(reasons)} of {counts[name]} messages cannot be read, the first because of {reasons[0]}"
        warnings.warn(words, stacklevel=3)
    return answers


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit code: 2 for bad input, 3 where no image is answered, 1 for what the system refuses."""
    parser = argparse.ArgumentParser(
        prog="python -m spindoe_ros.bag", description="Answers the images of a bag.", allow_abbrev=False
    )
    parser.add_argument("source", type=Path, help="the bag, a folder")
    parser.add_argument("target", type=Path, help="the bag to write")
    parser.add_argument("--table", required=True, help="the pattern's table, or the pattern")
    parser.add_argument("--topic", default="/image", help="of Image or CompressedImage")
    parser.add_argument("--camera-info", default="/camera_info", help="of CameraInfo")
    parser.add_argument("--bright-dots", action="store_true", help="a dark ball with bright dots")
    parser.add_argument("--overlay", action="store_true", help="write the images with what was found, too")
    arguments = parser.parse_args(words)

    def say(problem: object) -> None:
        print(f"spindoe_ros.bag: {problem}", file=sys.stderr)

    try:
        core = SpinCore(Settings(arguments.table, bright_dots=arguments.bright_dots))
        with warnings.catch_warnings():
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = lambda message, *_args, **_words: say(message)
            answers = process(
                arguments.source, arguments.target, core, arguments.topic, arguments.camera_info, overlay=arguments.overlay
            )
    except (ValueError, OSError) as error:
        say(error)
        return 2 if isinstance(error, (ValueError, *USAGE)) else 1
    posed = sum(bool(answer.pose) for answer in answers)
    reason = most(Counter(answer.pose.reason for answer in answers if not answer.pose))
    print(f"{posed} of {len(answers)} images answered: {arguments.target}" + (f" (others: {reason})" if reason else ""))
    return 0 if posed else 3


if __name__ == "__main__":
    sys.exit(main())
