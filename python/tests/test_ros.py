"""The core of the ROS 2 node, driven by a bag that is written and read without ROS."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from scipy.spatial.transform import Rotation

import spindoe

pytest.importorskip("rosbags")
sys.path.insert(0, str(ROOT / "python/examples/ros2_spindoe"))

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from spindoe_ros import bag
from spindoe_ros.core import Settings, SpinCore, image_of

TABLE = str(ROOT / "designs/dots20/table.npz")
SPIN = np.array([30.0, 100.0, -40.0])
OPTICAL = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def recorded(pattern, tmp_path_factory):
    """A bag of one turning ball, as a camera's driver records it, and the truth."""
    path = tmp_path_factory.mktemp("bag") / "in"
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    truths = []
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/image", "sensor_msgs/msg/Image", typestore=store)
        cameras = writer.add_connection("/camera_info", "sensor_msgs/msg/CameraInfo", typestore=store)
        other = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        clip = spindoe.synth(
            pattern, 16, seed=6, fps=350.0, spin_rad_s=SPIN, ball_px=[90, 90],
            camera_distance_radii=[20, 20],
        )
        for image, truth in clip:
            truths.append(truth)
            ns = round(truth.time_s * 1e9)
            stamp = types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
            header = types["std_msgs/msg/Header"](stamp, "camera_optical_frame")
            height, width, _ = image.shape
            fx, fy, cx, cy = (truth.everything["intrinsics"][name] for name in ("fx", "fy", "cx", "cy"))
            k = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], dtype=np.float64)
            whole = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
            info = types["sensor_msgs/msg/CameraInfo"](
                header, height, width, "plumb_bob", np.zeros(5), k, np.eye(3).ravel(), np.zeros(12), 0, 0, whole
            )
            writer.write(cameras, ns, store.serialize_cdr(info, info.__msgtype__))
            # Rows padded as drivers do, and blue first.
            rows = np.zeros((height, 3 * width + 5), np.uint8)
            rows[:, : 3 * width] = image[..., ::-1].reshape(height, -1)
            message = types["sensor_msgs/msg/Image"](
                header, height, width, "bgr8", 0, rows.shape[1], rows.ravel()
            )
            writer.write(topic, ns, store.serialize_cdr(message, message.__msgtype__))
            text = types["std_msgs/msg/String"]("hello")
            writer.write(other, ns, store.serialize_cdr(text, text.__msgtype__))
    return path, truths


def test_a_bag_is_answered(recorded, tmp_path):
    path, truths = recorded
    core = SpinCore(Settings(TABLE))
    answers = bag.process(path, tmp_path / "out", core)
    assert len(answers) == len(truths)

    store = get_typestore(Stores.ROS2_HUMBLE)
    poses, twists, images = {}, {}, 0
    with Reader(tmp_path / "out") as reader:
        assert {c.topic for c in reader.connections} == {"/image", bag.POSE, bag.TWIST}
        for connection, time_ns, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            if connection.topic == bag.POSE:
                poses[time_ns] = message
            elif connection.topic == bag.TWIST:
                twists[time_ns] = message
            else:
                images += 1
    assert images == len(truths) and len(poses) >= 14 and len(twists) >= 12
    for truth in truths:
        pose = poses.get(round(truth.time_s * 1e9))
        if pose is None:
            continue
        assert pose.header.frame_id == "camera_optical_frame"
        q = pose.pose.pose.orientation
        expected = Rotation.from_matrix(OPTICAL) * truth.as_rotation()
        off = Rotation.from_quat([q.x, q.y, q.z, q.w]) * expected.inv()
        assert np.rad2deg(off.magnitude()) < 8.0
        # In front of the camera, at its distance of 20 radii of 20 mm.
        p = pose.pose.pose.position
        assert p.z > 0.0 and np.hypot(np.hypot(p.x, p.y), p.z) == pytest.approx(0.4, rel=0.1)
    last = twists[max(twists)].twist
    angular = last.twist.angular
    found = np.array([angular.x, angular.y, angular.z])
    assert np.linalg.norm(found - OPTICAL @ SPIN) < 5.0
    covariance = np.asarray(last.covariance).reshape(6, 6)
    assert np.all(np.linalg.eigvalsh(covariance[3:, 3:]) > 0) and covariance[0, 0] >= 1e6


def test_the_same_bag_again_is_a_new_beginning(recorded, tmp_path):
    core = SpinCore(Settings(TABLE, frame="camera"))
    # Without the topic nothing is known of the camera.
    first = bag.process(recorded[0], tmp_path / "1", core, camera_info="/none")
    second = bag.process(recorded[0], tmp_path / "2", core, camera_info="/none")
    assert np.array_equal(first[-1].spin.spin_rad_s, second[-1].spin.spin_rad_s)
    assert np.linalg.norm(first[-1].spin.spin_rad_s - SPIN) < 8.0
    assert first[-1].frame_id_of("camera", first[-1].spin) == "camera_view"
    assert first[0].position_m is None and "at least 3" in first[0].reason


def test_bags_and_settings_that_do_not_fit(recorded, tmp_path):
    core = SpinCore(Settings(TABLE))
    with pytest.raises(ValueError, match="topic"):
        bag.process(recorded[0], tmp_path / "3", core, "/chatter")
    with pytest.raises(ValueError, match="frame"):
        SpinCore(Settings(TABLE, frame="map"))
    with pytest.raises(ValueError, match="window"):
        SpinCore(Settings(TABLE, window=1))


@pytest.mark.parametrize(
    ("encoding", "big"),
    [("mono8", 0), ("mono16", 0), ("mono16", 1), ("rgb8", 0), ("bgra8", 0), ("rgba8", 0)],
)
def test_encodings(encoding, big):
    rng = np.random.default_rng(0)
    kind = np.dtype((">" if big else "<") + ("u2" if "16" in encoding else "u1"))
    channels = {"mono8": 1, "mono16": 1, "rgb8": 3, "bgra8": 4, "rgba8": 4}[encoding]
    values = rng.integers(0, 256 ** kind.itemsize, (5, 7, channels)).astype(kind)
    rows = np.zeros((5, 7 * channels * kind.itemsize + 3), np.uint8)
    rows[:, :-3] = values.view(np.uint8).reshape(5, -1)
    message = SimpleNamespace(
        height=5, width=7, encoding=encoding, is_bigendian=big, step=rows.shape[1], data=rows.tobytes()
    )
    image, color = image_of(message)
    expected = values[..., 0] if channels == 1 else values[..., :3]
    assert np.array_equal(image, expected) and image.dtype.isnative
    assert color == {"m": "gray", "r": "rgb", "b": "bgr"}[encoding[0]]
    message.encoding = "yuv422"
    with pytest.raises(ValueError, match="encoding"):
        image_of(message)
    message.encoding, message.data = encoding, b""
    with pytest.raises(ValueError):
        image_of(message)
