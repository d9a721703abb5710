"""Runs the node's core over a recorded bag, without ROS: reads one, writes one with the answers.

    python -m spindoe_ros.bag IN OUT --table table.npz [--topic /image] [--camera-info /camera_info]

The written bag (MCAP) holds the images and the answers, and opens in Foxglove.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from .core import Answer, Settings, SpinCore

POSE = "/ball/pose"
TWIST = "/ball/twist"


def process(
    source: Path, target: Path, core: SpinCore, topic: str = "/image", camera_info: str = "/camera_info"
) -> list[Answer]:
    """Answers every image of the topic, by the camera of the other topic where there is one; the answers, in the bag's order.

    Raises:
        ValueError: Where the bag has no such topic of images.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    answers = []
    with Reader(source) as reader, Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = [c for c in reader.connections if c.topic == topic]
        if not connections or connections[0].msgtype != "sensor_msgs/msg/Image":
            found = ", ".join(f"{c.topic} ({c.msgtype})" for c in reader.connections)
            raise ValueError(f"topic: expected images on {topic}, found {found}")
        images = writer.add_connection(topic, "sensor_msgs/msg/Image", typestore=store)
        poses = writer.add_connection(
            POSE, "geometry_msgs/msg/PoseWithCovarianceStamped", typestore=store
        )
        twists = writer.add_connection(
            TWIST, "geometry_msgs/msg/TwistWithCovarianceStamped", typestore=store
        )
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
                pose = _pose(store.types, message.header, answer)
                writer.write(poses, time_ns, store.serialize_cdr(pose, pose.__msgtype__))
            if answer.spin:
                twist = _twist(store.types, message.header, answer)
                writer.write(twists, time_ns, store.serialize_cdr(twist, twist.__msgtype__))
    return answers


def _header(types: Any, header: Any, frame_id: str) -> Any:
    return types["std_msgs/msg/Header"](header.stamp, frame_id)


def _pose(types: Any, header: Any, answer: Answer) -> Any:
    named = _header(types, header, answer.frame_id_of(header.frame_id, answer.pose))
    point = types["geometry_msgs/msg/Point"](*map(float, answer.position()))
    w, x, y, z = map(float, answer.pose.quaternion_wxyz)
    pose = types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](x, y, z, w))
    known = types["geometry_msgs/msg/PoseWithCovariance"](pose, answer.pose_covariance())
    return types["geometry_msgs/msg/PoseWithCovarianceStamped"](named, known)


def _twist(types: Any, header: Any, answer: Answer) -> Any:
    named = _header(types, header, answer.frame_id_of(header.frame_id, answer.spin))
    vector = types["geometry_msgs/msg/Vector3"]
    linear, angular = vector(0.0, 0.0, 0.0), vector(*map(float, answer.spin.spin_rad_s))
    twist = types["geometry_msgs/msg/Twist"](linear, angular)
    known = types["geometry_msgs/msg/TwistWithCovariance"](twist, answer.twist_covariance())
    return types["geometry_msgs/msg/TwistWithCovarianceStamped"](named, known)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Answer the images of a bag.")
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--table", required=True)
    parser.add_argument("--topic", default="/image")
    parser.add_argument("--camera-info", default="/camera_info")
    arguments = parser.parse_args()
    core = SpinCore(Settings(arguments.table))
    answers = process(arguments.source, arguments.target, core, arguments.topic, arguments.camera_info)
    posed = sum(bool(answer.pose) for answer in answers)
    print(f"{posed} of {len(answers)} images answered")


if __name__ == "__main__":
    main()
