"""The ROS 2 node itself, driven by a stand-in for `rclpy`: parameters, topics, messages, frames."""

from __future__ import annotations

import importlib
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import ros_stand_in as ros
from conftest import ROOT
from scipy.spatial.transform import Rotation

import spindoe
from spindoe import _palette

PACKAGE = ROOT / "python/examples/ros2_spindoe"
TABLE = str(ROOT / "designs/dots20/table.npz")
SPIN = np.array([30.0, 100.0, -40.0])
OPTICAL = np.diag([1.0, -1.0, -1.0])
PARAMETERS = {
    "table": "", "frame": "optical", "intrinsics": [0.0] * 4, "rectified": False, "ball_radius_m": 0.02,
    "min_confidence": spindoe.MIN_CONFIDENCE_IMAGES, "window": 12, "memory_s": 0.25, "max_rps": 175.0,
    "image_transport": "raw",
}


@pytest.fixture
def rclpy(monkeypatch):
    """The stand-in, and the node's module imported over it."""
    stand_in = ros.install(monkeypatch)
    for name in [name for name in sys.modules if name.startswith("spindoe_ros")]:
        monkeypatch.delitem(sys.modules, name)
    stand_in.module = importlib.import_module("spindoe_ros.node")
    monkeypatch.setattr(ros.Node, "overrides", {"table": TABLE})
    yield stand_in
    for name in [name for name in sys.modules if name.startswith("spindoe_ros")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def clip(pattern):
    frames = spindoe.synth(
        pattern, 10, seed=6, fps=350.0, spin_rad_s=SPIN, ball_px=[90, 90], camera_distance_radii=[20, 20]
    )
    return list(frames)


def messages(clip, frame_id="camera_optical_frame", start_s=1_700_000_000):
    """Images as a camera's driver sends them, at the wall clock's times."""
    for image, truth in clip:
        ns = start_s * 10**9 + round(truth.time_s * 1e9)
        height, width, _ = image.shape
        header = ros.Header(ros.Time(ns // 10**9, ns % 10**9), frame_id)
        data = np.ascontiguousarray(image).reshape(-1)
        yield ros.Image(header, height, width, "rgb8", 0, 3 * width, data)


def test_it_declares_its_parameters(rclpy):
    node = rclpy.module.SpinNode()
    assert node.name == "spindoe"
    found = {name: value for name, (value, _) in node.parameters.items()}
    assert found == {**PARAMETERS, "table": TABLE}
    assert all(described.description and described.read_only for _, described in node.parameters.values())
    readme = (PACKAGE / "README.md").read_text()
    assert all(f"`{name}`" in readme for name in PARAMETERS)


def test_its_topics(rclpy):
    node = rclpy.module.SpinNode()
    kind, _, qos = node.subscriptions["image"]
    assert kind is ros.Image and qos is ros.SENSOR_DATA
    kind, _, qos = node.subscriptions["camera_info"]
    assert len(node.subscriptions) == 2 and kind is ros.CameraInfo and qos is ros.SENSOR_DATA
    found = {topic: publisher.kind for topic, publisher in node.publishers.items()}
    assert found == {
        "ball/pose": ros.PoseWithCovarianceStamped, "ball/twist": ros.TwistWithCovarianceStamped, "ball/overlay": ros.Image,
    }


def test_compressed_images_have_a_topic_of_their_own(rclpy, clip, monkeypatch):
    """Those of a lossless codec give the answers of the raw ones."""
    cv2 = pytest.importorskip("cv2")
    rclpy.incoming = list(messages(clip))
    rclpy.module.main()
    raw = rclpy.node_of
    monkeypatch.setattr(ros.Node, "overrides", {"table": TABLE, "image_transport": "compressed"})
    rclpy.incoming = [
        ros.CompressedImage(message.header, "rgb8; png compressed bgr8", cv2.imencode(".png", image[..., ::-1])[1].tobytes())
        for message, (image, _) in zip(messages(clip), clip, strict=True)
    ]
    rclpy.module.main()
    node = rclpy.node_of
    assert "image" not in node.subscriptions
    kind, _, qos = node.subscriptions["image/compressed"]
    assert kind is ros.CompressedImage and qos is ros.SENSOR_DATA
    for topic in ("ball/pose", "ball/twist"):
        sent, expected = (repr(one.publishers[topic].sent) for one in (node, raw))
        assert sent == expected and raw.publishers[topic].sent
    monkeypatch.setattr(ros.Node, "overrides", {"table": TABLE, "image_transport": "theora"})
    with pytest.raises(ValueError, match="image_transport: expected raw or compressed, found 'theora'"):
        rclpy.module.SpinNode()


def test_an_overlay_while_somebody_subscribes(rclpy, clip):
    node = rclpy.module.SpinNode()
    _, on_image, _ = node.subscriptions["image"]
    publisher = node.publishers["ball/overlay"]
    first, second = messages(clip[:2])
    on_image(first)
    assert not publisher.sent
    publisher.listeners = 1
    on_image(second)
    (sent,) = publisher.sent
    image, truth = clip[1]
    assert sent.header == second.header and sent.encoding == "rgb8" and sent.step == 3 * sent.width
    drawn = np.frombuffer(sent.data, np.uint8).reshape(sent.height, sent.width, 3)
    changed = np.any(drawn != image, axis=2)
    # The outline and the dots are drawn where the truth has them, and nothing else.
    u, v, radius = truth.circle
    rows, columns = np.nonzero(changed)
    off = np.hypot(columns - u, rows - v) - radius
    dots = np.hypot(*(np.stack([columns, rows], 1)[:, None] - truth.dots[truth.visible]).transpose(2, 0, 1))
    is_near = (np.abs(off) < 3.0) | (dots.min(axis=1) < 4.0)
    assert 300 < changed.sum() < 1500 and is_near.mean() > 0.9
    at_dots = np.rint(truth.dots[truth.visible]).astype(int)
    assert np.mean([tuple(drawn[v, u]) == _palette.IDENTIFIED for u, v in at_dots]) > 0.7


def numbers(clip):
    intrinsics = clip[0][1].everything["intrinsics"]
    return [float(intrinsics[name]) for name in ("fx", "fy", "cx", "cy")]


def camera_info(clip, model="plumb_bob", distortion=()):
    """As a driver sends it."""
    fx, fy, cx, cy = numbers(clip)
    k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
    return ros.CameraInfo(distortion_model=model, d=np.array(distortion, dtype=np.float64), k=k)


@pytest.mark.parametrize("known_by", ["parameter", "camera_info"])
def test_it_answers_images(rclpy, clip, monkeypatch, known_by):
    overrides = {"table": TABLE}
    if known_by == "parameter":
        overrides["intrinsics"] = numbers(clip)
    else:
        rclpy.first = camera_info(clip)
    monkeypatch.setattr(ros.Node, "overrides", overrides)
    rclpy.incoming = list(messages(clip))
    rclpy.module.main()
    assert rclpy.events == ["init", "spin", "shutdown"]
    node = rclpy.node_of
    assert node.is_destroyed
    poses, twists = node.publishers["ball/pose"].sent, node.publishers["ball/twist"].sent
    assert len(poses) >= 8 and len(twists) >= 6
    headers = [message.header for message in rclpy.incoming]
    truths = {(m.header.stamp.sec, m.header.stamp.nanosec): t for m, (_, t) in zip(rclpy.incoming, clip, strict=True)}
    for message in [*poses, *twists]:
        assert message.header in headers and message.header.frame_id == "camera_optical_frame"
    for message in poses:
        truth = truths[message.header.stamp.sec, message.header.stamp.nanosec]
        q, p = message.pose.pose.orientation, message.pose.pose.position
        covariance = message.pose.covariance.reshape(6, 6)
        # The ball's distance is known to some millimeters, its direction much better; center and orientation are correlated.
        assert np.all(np.linalg.eigvalsh(covariance) > 0.0) and 0.0003 < np.sqrt(covariance[2, 2]) < 0.01
        assert covariance[0, 0] < covariance[2, 2] and np.any(covariance[:3, 3:] != 0.0)
        assert np.rad2deg(np.sqrt(np.trace(covariance[3:, 3:]))) < 5.0
        expected = Rotation.from_matrix(OPTICAL) * truth.as_rotation()
        off = Rotation.from_quat([q.x, q.y, q.z, q.w]) * expected.inv()
        assert np.rad2deg(off.magnitude()) < 8.0
        assert p.z > 0.0 and np.hypot(np.hypot(p.x, p.y), p.z) == pytest.approx(0.4, rel=0.1)
    angular = twists[-1].twist.twist.angular
    assert np.linalg.norm(np.array([angular.x, angular.y, angular.z]) - OPTICAL @ SPIN) < 8.0
    covariance = twists[-1].twist.covariance.reshape(6, 6)
    assert np.all(np.linalg.eigvalsh(covariance[3:, 3:]) > 0.0) and covariance[0, 0] >= 1e6
    # The first images have no spin yet, and that is said.
    assert any(level == "debug" and "at least 3" in line for level, line in node.logger.lines)
    assert not any(level == "warning" for level, _ in node.logger.lines)


def test_without_a_camera_frames_and_positions_say_so(rclpy, clip):
    rclpy.incoming = list(messages(clip))
    rclpy.module.main()
    node = rclpy.node_of
    poses, twists = node.publishers["ball/pose"].sent, node.publishers["ball/twist"].sent
    assert len(poses) >= 8 and twists
    for message in [*poses, *twists]:
        assert message.header.frame_id == "camera_optical_frame_view"
    for message in poses:
        p = message.pose.pose.position
        assert np.isnan([p.x, p.y, p.z]).all() and message.pose.covariance[0] >= 1e6
    warnings = [line for level, line in node.logger.lines if level == "warning"]
    assert warnings and all("view frame" in line for line in warnings)


def test_what_camera_info_says(rclpy, clip):
    info = camera_info(clip, distortion=[-0.2, 0.05, 0.001, -0.002, 0.0])
    fx, fy, cx, cy = numbers(clip)
    core = sys.modules["spindoe_ros.core"]
    known = spindoe.Camera([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], [-0.2, 0.05, 0.001, -0.002, 0.0])
    assert core.camera_of(info) == known
    # A region of interest and binned pixels: those of the whole sensor, moved and divided.
    info.roi.x_offset, info.roi.y_offset, info.binning_x, info.binning_y = 30, 8, 2, 2
    point = [[0.1, -0.05, 1.0]]
    moved = (known.project(point) - [30, 8]) / 2.0
    assert np.allclose(core.camera_of(info).project(point), moved)
    info.p = np.array([900.0, 0, 320, 0, 0, 900, 240, 0, 0, 0, 1, 0])
    info.roi.x_offset = info.roi.y_offset = info.binning_x = info.binning_y = 0
    assert core.camera_of(info, rectified=True) == spindoe.Camera.pinhole(900, 900, 320, 240)
    fisheye = camera_info(clip, "equidistant", [0.01, 0.0, 0.0, 0.0])
    assert core.camera_of(fisheye).kind == "fisheye"
    assert core.camera_of(ros.CameraInfo()) is None
    node = rclpy.module.SpinNode()
    _, on_info, _ = node.subscriptions["camera_info"]
    on_info(camera_info(clip, "ftheta"))
    assert [line for level, line in node.logger.lines if level == "error" and "ftheta" in line]
    on_info(camera_info(clip))
    on_info(camera_info(clip))
    assert [level for level, _ in node.logger.lines].count("info") == 1


def test_parameters_reach_the_core(rclpy, clip, monkeypatch):
    monkeypatch.setattr(
        ros.Node, "overrides", {"table": TABLE, "frame": "camera", "min_confidence": 1.0, "window": 5}
    )
    node = rclpy.module.SpinNode()
    _, on_image, _ = node.subscriptions["image"]
    for message in messages(clip[:3]):
        on_image(message)
    assert not node.publishers["ball/pose"].sent
    for name, value in [("frame", "map"), ("window", 1), ("table", "none.npz"), ("image_transport", "")]:
        monkeypatch.setattr(ros.Node, "overrides", {"table": TABLE, name: value})
        with pytest.raises((ValueError, OSError)):
            rclpy.module.SpinNode()
    monkeypatch.setattr(ros.Node, "overrides", {"table": TABLE, "window": 5.0})
    with pytest.raises(TypeError, match="window"):
        rclpy.module.SpinNode()


def test_an_image_that_cannot_be_read_does_not_end_the_node(rclpy, clip):
    node = rclpy.module.SpinNode()
    _, on_image, _ = node.subscriptions["image"]
    first, second = messages(clip[:2])
    first.encoding = "yuv422"
    on_image(first)
    assert [line for level, line in node.logger.lines if "encoding" in line]
    on_image(second)
    assert len(node.publishers["ball/pose"].sent) == 1


def test_the_package_is_whole():
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    needed = {element.text for element in package.iter("exec_depend")}
    assert {"rclpy", "sensor_msgs", "geometry_msgs", "rcl_interfaces", "launch_ros"} <= needed
    assert package.findtext("name") == "spindoe_ros"
    # What ROS starts is in the Python package.
    setup = (PACKAGE / "setup.py").read_text()
    assert '"spindoe = spindoe_ros.node:main"' in setup and "packages=[]" in setup
