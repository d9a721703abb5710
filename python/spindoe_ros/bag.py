"""Runs the node's core over a recorded bag, without ROS: reads one, writes one with the answers.

    python -m spindoe_ros.bag IN OUT --table table.npz [--topic /image] [--camera-info /camera_info] [--overlay]

The written bag (MCAP) holds the images and the answers, and opens in Foxglove. It appears whole or not at all.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import spindoe
from spindoe._common import optional

from .core import Answer, Settings, SpinCore

POSE = "/ball/pose"
TWIST = "/ball/twist"
OVERLAY = "/ball/overlay"
IMAGE = "sensor_msgs/msg/Image"
IMAGES = (IMAGE, "sensor_msgs/msg/CompressedImage")


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

    Args:
        source: The bag, a folder.
        target: The bag to write, which must not exist; it appears when all images are answered.
        core: What answers.
        topic: Of ``sensor_msgs/Image`` or ``CompressedImage``.
        camera_info: Of ``sensor_msgs/CameraInfo``.
        overlay: Write the images with what was found drawn onto them, too.

    Raises:
        FileExistsError: Where the target exists.
        ValueError: Where rosbags is missing, the source is no bag, has no such topic of images, or an image cannot be read.
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
    types = optional("rosbags.typesys", "ros")
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    kind = rosbag2.StoragePlugin.MCAP
    answers = []
    with rosbag2.Reader(source) as reader, rosbag2.Writer(target, version=9, storage_plugin=kind) as writer:
        connections = [c for c in reader.connections if c.topic == topic and c.msgtype in IMAGES]
        if not connections:
            found = ", ".join(f"{c.topic} ({c.msgtype})" for c in reader.connections)
            raise ValueError(f"topic: expected images on {topic}, found {found}")

        def connection_of(name: str, kind: str) -> Any:
            return writer.add_connection(name, kind, typestore=store)

        images = connection_of(topic, connections[0].msgtype)
        poses = connection_of(POSE, "geometry_msgs/msg/PoseWithCovarianceStamped")
        twists = connection_of(TWIST, "geometry_msgs/msg/TwistWithCovarianceStamped")
        overlays = connection_of(OVERLAY, IMAGE) if overlay else None

        def write(connection: Any, time_ns: int, message: Any) -> None:
            writer.write(connection, time_ns, store.serialize_cdr(message, message.__msgtype__))

        infos = [
            c for c in reader.connections
            if c.topic == camera_info and c.msgtype == "sensor_msgs/msg/CameraInfo"
        ]
        for connection, time_ns, raw in reader.messages(connections=connections + infos):
            message: Any = store.deserialize_cdr(raw, connection.msgtype)
            if connection.topic == camera_info:
                core.on_camera_info(message)
                continue
            answer = core.on_image(message)
            answers.append(answer)
            writer.write(images, time_ns, raw)
            if answer.pose:
                write(poses, time_ns, _pose(store.types, message.header, answer, answer.pose))
            if answer.spin:
                write(twists, time_ns, _twist(store.types, message.header, answer, answer.spin))
            if overlays is not None:
                write(overlays, time_ns, _overlay(store.types, message.header, answer))
    return answers


def _header(types: Any, header: Any, frame_id: str) -> Any:
    return types["std_msgs/msg/Header"](header.stamp, frame_id)


def _pose(types: Any, header: Any, answer: Answer, found: spindoe.Pose) -> Any:
    named = _header(types, header, answer.frame_id_of(header.frame_id, found))
    point = types["geometry_msgs/msg/Point"](*map(float, answer.position()))
    w, x, y, z = map(float, found.quaternion_wxyz)
    pose = types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](x, y, z, w))
    known = types["geometry_msgs/msg/PoseWithCovariance"](pose, answer.pose_covariance())
    return types["geometry_msgs/msg/PoseWithCovarianceStamped"](named, known)


def _twist(types: Any, header: Any, answer: Answer, found: spindoe.Spin) -> Any:
    named = _header(types, header, answer.frame_id_of(header.frame_id, found))
    vector = types["geometry_msgs/msg/Vector3"]
    linear, angular = vector(0.0, 0.0, 0.0), vector(*map(float, found.spin_rad_s))
    twist = types["geometry_msgs/msg/Twist"](linear, angular)
    known = types["geometry_msgs/msg/TwistWithCovariance"](twist, answer.twist_covariance())
    return types["geometry_msgs/msg/TwistWithCovarianceStamped"](named, known)


def _overlay(types: Any, header: Any, answer: Answer) -> Any:
    drawn = answer.overlay()
    height, width, _ = drawn.shape
    return types[IMAGE](header, height, width, "rgb8", 0, 3 * width, drawn.ravel())


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit code: 2 for bad input, 1 for what the system refuses."""
    parser = argparse.ArgumentParser(
        prog="python -m spindoe_ros.bag", description="Answers the images of a bag.", allow_abbrev=False
    )
    parser.add_argument("source", type=Path, help="the bag, a folder")
    parser.add_argument("target", type=Path, help="the bag to write")
    parser.add_argument("--table", required=True, help="the pattern's table, or the pattern")
    parser.add_argument("--topic", default="/image", help="of Image or CompressedImage")
    parser.add_argument("--camera-info", default="/camera_info", help="of CameraInfo")
    parser.add_argument("--overlay", action="store_true", help="write the images with what was found, too")
    arguments = parser.parse_args(words)
    try:
        answers = process(
            arguments.source, arguments.target, SpinCore(Settings(arguments.table)), arguments.topic,
            arguments.camera_info, overlay=arguments.overlay,
        )
    except (ValueError, OSError) as error:
        print(f"spindoe_ros.bag: {error}", file=sys.stderr)
        return 2 if isinstance(error, ValueError) else 1
    posed = sum(bool(answer.pose) for answer in answers)
    print(f"{posed} of {len(answers)} images answered: {arguments.target}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
