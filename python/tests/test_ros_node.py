"""The ROS 2 node itself, with the messages of Humble and Jazzy as rosbags defines them and a strict stand-in for `rclpy`."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import math
import shutil
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from scipy.spatial.transform import Rotation

import spindoe
from spindoe import _palette

pytest.importorskip("rosbags")

import ros_stand_in as ros
from rosbags.rosbag2 import Reader
from test_ros import record

TABLE = str(ROOT / "designs/dots20/table.npz")
SPIN = np.array([30.0, 100.0, -40.0])
OPTICAL = np.diag([1.0, -1.0, -1.0])
START_S = 1_700_000_000
# Where clips begin.
CLIP_S = 1000
# name: (default, range)
PARAMETERS = {
    "table": ("", None), "intrinsics": ([0.0] * 4, None), "bright_dots": (False, None),
    "rectified": (False, None),
    "ball_radius_m": (0.02, (0.0005, 0.5)), "min_confidence": (spindoe.MIN_CONFIDENCE_IMAGES, (0.0, 1.0)),
    "window": (12, (3, 1000)), "memory_s": (0.25, (0.001, 60.0)), "max_rps": (175.0, (0.1, 1000.0)),
    "image_transport": ("raw", None),
}


# Their messages differ in nothing that the node takes or sends: the first of them where a test is of the node alone.
both = pytest.mark.parametrize("world", ["humble", "jazzy"], indirect=True)


@pytest.fixture
def world(monkeypatch, request):
    """What is around the node of a distribution, and the node's module imported into it."""
    world = ros.install(monkeypatch, getattr(request, "param", "humble"))
    for name in [name for name in sys.modules if name.startswith("spindoe_ros")]:
        monkeypatch.delitem(sys.modules, name)
    world.module = importlib.import_module("spindoe_ros.node")
    # An image takes 2 ms.
    ticks = itertools.count()
    clock = SimpleNamespace(monotonic=lambda: world.steady_s, perf_counter=lambda: 0.002 * next(ticks))
    monkeypatch.setattr(world.module, "time", clock)
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    world.overrides = {"table": TABLE}
    world.is_initialized = True
    world.ros_ns = (START_S + CLIP_S) * 10**9 + 5_000_000
    yield world
    for name in [name for name in sys.modules if name.startswith("spindoe_ros")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def clip(pattern):
    frames = spindoe.synth(
        pattern, 10, seed=6, fps=350.0, spin_rad_s=SPIN, ball_px=[90, 90], camera_distance_radii=[20, 20]
    )
    return list(frames)


def message(world, kind, **fields):
    return world.definitions[f"{kind.split('/')[0]}/msg/{kind.split('/')[1]}"](**fields)


def header(world, time_s, frame_id="camera_optical_frame"):
    ns = START_S * 10**9 + round(time_s * 1e9)
    stamp = message(world, "builtin_interfaces/Time", sec=ns // 10**9, nanosec=ns % 10**9)
    return message(world, "std_msgs/Header", stamp=stamp, frame_id=frame_id)


def images(world, clip, later_s=0.0, **fields):
    """Images as a camera's driver sends them, at the wall clock's times."""
    for image, truth in clip:
        height, width, _ = image.shape
        given = {
            "header": header(world, truth.time_s + later_s), "height": height, "width": width, "encoding": "rgb8", "step": 3 * width,
            "data": np.ascontiguousarray(image).tobytes(), **fields,
        }
        yield message(world, "sensor_msgs/Image", **given)


def numbers(clip):
    intrinsics = clip[0][1].everything["intrinsics"]
    return [float(intrinsics[name]) for name in ("fx", "fy", "cx", "cy")]


def camera_info(world, clip, model="plumb_bob", distortion=(), **fields):
    """As a driver sends it."""
    fx, fy, cx, cy = numbers(clip)
    height, width, _ = clip[0][0].shape
    given = {
        "header": header(world, 0.0), "height": height, "width": width, "distortion_model": model, "d": list(distortion),
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], **fields,
    }
    return message(world, "sensor_msgs/CameraInfo", **given)


def key_values(status):
    return {pair.key: pair.value for pair in status.values}


def report(world):
    """The next of the diagnostics, after a second."""
    world.tick()
    sent = world.publisher("/diagnostics").sent[-1]
    (status,) = sent.status
    return status


@both
def test_the_stand_in_refuses_what_ros_refuses(world):
    """Else nothing below says anything."""
    pose = message(world, "geometry_msgs/PoseWithCovariance")
    image, status = message(world, "sensor_msgs/Image"), message(world, "diagnostic_msgs/DiagnosticStatus")
    for one, field, value in [
        (pose.pose.position, "x", 1), (pose, "covariance", np.zeros(36, np.float32)), (pose, "covariance", np.zeros(35)),
        (pose, "covariance", [0] * 36), (pose, "pose", message(world, "geometry_msgs/Point")), (status, "level", 1),
        (image, "data", np.zeros(3, np.uint8)), (image, "height", np.int64(3)), (image, "height", -1), (image, "height", 2.0),
        (image, "encoding", b"mono8"), (status, "values", [image]), (pose.pose, "header", None),
    ]:
        with pytest.raises((AssertionError, AttributeError)):
            setattr(one, field, value)
    with pytest.raises(TypeError):
        world.definitions["std_msgs/msg/Header"](message(world, "builtin_interfaces/Time"), "camera")
    node = sys.modules["rclpy.node"].Node("n")
    descriptor = message(world, "rcl_interfaces/ParameterDescriptor")
    whole = message(world, "rcl_interfaces/IntegerRange", from_value=1, to_value=9, step=2)
    with pytest.raises(AssertionError, match="length <= 1"):
        descriptor.integer_range = [whole, whole]
    descriptor.integer_range = [whole]
    for name, value in [("use_sim_time", True), ("even", 4), ("large", 11)]:
        with pytest.raises(ros.ParameterException):
            node.declare_parameter(name, value, descriptor)
    for level in ("info", "info", "error"):
        words = pytest.raises(ValueError, match="severity") if level == "error" else contextlib.nullcontext()
        with words:
            getattr(node.get_logger(), level)("said at one place")
    with pytest.raises(AssertionError, match="is an attribute of rclpy's Node"):
        node._timers = []
    publisher = node.create_publisher(world.definitions["sensor_msgs/msg/Image"], "image", 1)
    with pytest.raises(TypeError):
        publisher.publish(status)
    assert not ros.agree(ros.sensor_data(), publisher.qos) and ros.agree(publisher.qos, ros.sensor_data())


@both
def test_it_declares_its_parameters(world):
    node = world.module.SpinNode()
    assert node.get_name() == "spindoe"
    for name, (default, limits) in PARAMETERS.items():
        value, descriptor = node.get_parameter(name).value, node._descriptors[name]
        assert list(value) == default if name == "intrinsics" else value == (TABLE if name == "table" else default)
        assert descriptor.description and descriptor.read_only == (name == "image_transport")
        given = [*descriptor.integer_range, *descriptor.floating_point_range]
        assert [(one.from_value, one.to_value) for one in given] == ([limits] if limits else [])
        assert len(descriptor.integer_range) == (name == "window")
    others = set(node._parameters) - set(PARAMETERS)
    assert all(name == "use_sim_time" or name.startswith("qos_overrides.") for name in others)
    assert not set(vars(world.module.SpinNode)) & set(ros.Node.OWN)


def test_its_topics_and_their_quality(world):
    node = world.module.SpinNode()
    found = {(one.topic, one.kind.kind) for one in node._subscriptions}
    assert found == {("/image", "sensor_msgs/msg/Image"), ("/camera_info", "sensor_msgs/msg/CameraInfo")}
    profiles = [one.qos for one in node._subscriptions]
    # Each has its own, since overrides are written into it.
    assert all(one == ros.sensor_data() for one in profiles) and profiles[0] is not profiles[1]
    found = {(one.topic, one.kind.kind) for one in node._publishers}
    assert found == {
        ("/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
        ("/ball/twist", "geometry_msgs/msg/TwistWithCovarianceStamped"),
        ("/ball/overlay", "sensor_msgs/msg/Image"), ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
    }
    # Displays ask for reliable messages.
    assert all(ros.agree(one.qos, ros.QoSProfile(depth=1)) for one in node._publishers)


def test_cameras_of_any_quality_are_heard(world, clip):
    world.module.SpinNode()
    sent = images(world, clip)
    assert world.send("/image", next(sent), ros.sensor_data()) == 1
    assert world.send("/image", next(sent), ros.QoSProfile(depth=10)) == 1
    world.nodes.clear()
    world.overrides["qos_overrides./image.subscription.reliability"] = "reliable"
    world.overrides["qos_overrides./image.subscription.depth"] = 1
    world.module.SpinNode()
    assert world.subscription("/image").qos.depth == 1 and world.subscription("/camera_info").qos == ros.sensor_data()
    assert world.send("/image", next(sent), ros.sensor_data()) == 0
    assert world.send("/image", next(sent), ros.QoSProfile(depth=10)) == 1


@both
def test_compressed_images_have_a_topic_of_their_own(world, clip):
    """Those of a lossless codec give the answers of the raw ones."""
    cv2 = pytest.importorskip("cv2")
    world.module.SpinNode()
    for one in images(world, clip):
        world.send("/image", one)
    raw = {topic: world.publisher(topic).sent for topic in ("/ball/pose", "/ball/twist")}
    world.nodes.clear()
    world.overrides["image_transport"] = "compressed"
    node = world.module.SpinNode()
    assert {one.topic for one in node._subscriptions} == {"/image/compressed", "/camera_info"}
    for one, (image, _) in zip(images(world, clip), clip, strict=True):
        data = cv2.imencode(".png", image[..., ::-1])[1].tobytes()
        words = "rgb8; png compressed bgr8"
        packed = message(world, "sensor_msgs/CompressedImage", header=one.header, format=words, data=data)
        assert world.send("/image/compressed", packed) == 1
    for topic, expected in raw.items():
        assert expected and repr(world.publisher(topic).sent) == repr(expected)
    world.overrides["image_transport"] = "theora"
    with pytest.raises(ValueError, match="image_transport: expected raw or compressed, found 'theora'"):
        world.module.SpinNode()


@both
def test_an_overlay_while_somebody_subscribes(world, clip):
    world.module.SpinNode()
    publisher = world.publisher("/ball/overlay")
    first, second = images(world, clip[:2])
    world.send("/image", first)
    assert not publisher.sent
    publisher.listeners = 1
    world.send("/image", second)
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


@both
@pytest.mark.parametrize("known_by", ["parameter", "camera_info"])
def test_it_answers_images(world, clip, known_by):
    if known_by == "parameter":
        world.overrides["intrinsics"] = numbers(clip)
    else:
        world.incoming.append(("/camera_info", camera_info(world, clip)))
    sent = list(images(world, clip))
    world.incoming += [("/image", one) for one in sent]
    assert world.module.main() == 0
    assert world.events == ["init", "spin", "shutdown"] and world.nodes[0].is_destroyed
    poses, twists = world.publisher("/ball/pose").sent, world.publisher("/ball/twist").sent
    assert len(poses) >= 8 and len(twists) >= 6
    headers = [one.header for one in sent]
    truths = {(m.header.stamp.sec, m.header.stamp.nanosec): t for m, (_, t) in zip(sent, clip, strict=True)}
    for one in [*poses, *twists]:
        assert one.header in headers and one.header.frame_id == "camera_optical_frame"
    for one in poses:
        truth = truths[one.header.stamp.sec, one.header.stamp.nanosec]
        q, p = one.pose.pose.orientation, one.pose.pose.position
        covariance = one.pose.covariance.reshape(6, 6)
        # The ball's distance is known to some millimeters, its direction much better; center and orientation are correlated.
        assert np.all(np.linalg.eigvalsh(covariance) > 0.0) and 0.0005 < np.sqrt(covariance[2, 2]) < 0.01
        assert covariance[0, 0] < covariance[2, 2] and np.any(covariance[:3, 3:] != 0.0)
        assert np.rad2deg(np.sqrt(np.trace(covariance[3:, 3:]))) < 5.0
        expected = Rotation.from_matrix(OPTICAL) * truth.as_rotation()
        off = Rotation.from_quat([q.x, q.y, q.z, q.w]) * expected.inv()
        assert np.rad2deg(off.magnitude()) < 8.0
        assert p.z > 0.0 and np.hypot(np.hypot(p.x, p.y), p.z) == pytest.approx(0.4, rel=0.1)
    # In the header's frame, which is optical.
    angular = twists[-1].twist.twist.angular
    assert np.linalg.norm(np.array([angular.x, angular.y, angular.z]) - OPTICAL @ SPIN) < 8.0
    covariance = twists[-1].twist.covariance.reshape(6, 6)
    assert np.all(np.linalg.eigvalsh(covariance[3:, 3:]) > 0.0) and covariance[0, 0] >= 1e6
    # The first images have no spin yet, and that is said.
    assert any("at least 3" in line for line in world.said("debug"))
    assert not world.said("warning") and not world.said("error")


def test_without_a_camera_frames_and_positions_say_so(world, clip):
    world.module.SpinNode()
    for one in images(world, clip):
        world.send("/image", one)
    poses, twists = world.publisher("/ball/pose").sent, world.publisher("/ball/twist").sent
    assert len(poses) >= 8 and twists
    for one in [*poses, *twists]:
        assert one.header.frame_id == "camera_optical_frame_view"
    for one in poses:
        p = one.pose.pose.position
        assert np.isnan([p.x, p.y, p.z]).all() and one.pose.covariance[0] >= 1e6
    assert not world.said("warning")
    status = report(world)
    assert status.level == status.WARN and "view frame" in status.message and "no camera_info has come" in status.message
    assert world.said("warning") == [status.message]
    world.send("/camera_info", camera_info(world, clip, k=[0.0] * 9))
    world.send("/image", next(images(world, clip, 1.0)))
    assert "k is 0: calibrate" in report(world).message


@both
def test_what_camera_info_says(world, clip):
    info = camera_info(world, clip, distortion=[-0.2, 0.05, 0.001, -0.002, 0.0])
    fx, fy, cx, cy = numbers(clip)
    core = sys.modules["spindoe_ros.core"]
    size = info.width, info.height
    known = spindoe.Camera([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], [-0.2, 0.05, 0.001, -0.002, 0.0], size=size)
    assert core.camera_of(info) == known
    # A region of interest and binned pixels: those of the whole sensor, moved and divided.
    info.roi.x_offset, info.roi.y_offset, info.binning_x, info.binning_y = 30, 8, 2, 2
    info.roi.width, info.roi.height = 60, 40
    point = [[0.1, -0.05, 1.0]]
    moved = (known.project(point) - [30, 8]) / 2.0
    assert np.allclose(core.camera_of(info).project(point), moved) and core.camera_of(info).size == (30, 20)
    info.roi.width = info.roi.height = 0
    assert core.camera_of(info).size == (size[0] // 2, size[1] // 2)
    info.p = np.array([900.0, 0, 320, 0, 0, 900, 240, 0, 0, 0, 1, 0])
    info.roi.x_offset = info.roi.y_offset = info.binning_x = info.binning_y = 0
    expected = spindoe.Camera([[900, 0, 320], [0, 900, 240], [0, 0, 1]], size=size)
    assert core.camera_of(info, rectified=True) == expected
    fisheye = camera_info(world, clip, "equidistant", [0.01, 0.0, 0.0, 0.0])
    assert core.camera_of(fisheye).kind == "fisheye"
    assert core.camera_of(message(world, "sensor_msgs/CameraInfo")) is None
    world.module.SpinNode()
    world.send("/camera_info", camera_info(world, clip, "ftheta"))
    assert [line for line in world.said("error") if "camera_info: distortion_model" in line and "ftheta" in line]
    world.send("/camera_info", camera_info(world, clip))
    world.send("/camera_info", camera_info(world, clip))
    assert len(world.said("info")) == 1


def test_a_camera_of_another_size(world, clip):
    """Until the camera_info of its images comes, they are refused in one line; then they are answered."""
    world.module.SpinNode()
    fx, fy, cx, cy = numbers(clip)
    height, width, _ = clip[0][0].shape
    twice = {"k": [2 * fx, 0.0, 2 * cx + 0.5, 0.0, 2 * fy, 2 * cy + 0.5, 0.0, 0.0, 1.0], "width": 2 * width, "height": 2 * height}
    world.send("/camera_info", camera_info(world, clip, **twice))
    sent = images(world, clip)
    world.send("/image", next(sent))
    world.send("/image", next(sent))
    (line,) = world.said("error")
    assert line.startswith("/image: image: expected") and f"found {width} x {height}" in line and "binning" in line
    status = report(world)
    assert status.level == status.ERROR and status.message.startswith("2 of 2 images cannot be read: image: expected")
    # The same sensor, binned.
    world.send("/camera_info", camera_info(world, clip, **twice, binning_x=2, binning_y=2))
    for one in sent:
        world.send("/image", one)
    assert len(world.publisher("/ball/pose").sent) >= 6 and len(world.said("error")) == 2


def test_frames_have_the_name_of_the_image_or_else_of_its_camera(world, clip):
    world.module.SpinNode()
    world.send("/camera_info", camera_info(world, clip, header=header(world, 0.0, "left_optical")))
    nameless = [header(world, truth.time_s, "") for _, truth in clip]
    for one, given in zip(images(world, clip[:4]), nameless[:4], strict=True):
        one.header = given
        world.send("/image", one)
    for one in images(world, clip[4:]):
        world.send("/image", one)
    names = [one.header.frame_id for one in world.publisher("/ball/pose").sent]
    assert set(names[:4]) == {"left_optical"} and set(names[4:]) == {"camera_optical_frame"}


def test_parameters_reach_the_core(world, clip):
    world.overrides.update(min_confidence=1.0, window=5)
    world.module.SpinNode()
    for one in images(world, clip[:3]):
        world.send("/image", one)
    assert not world.publisher("/ball/pose").sent


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"table": ""}, "table: expected the path"), ({"table": "none.npz"}, "none.npz: cannot be read"),
        ({"window": 1}, "window out of range"), ({"window": 5.0}, "Wrong parameter type"),
        ({"memory_s": 1}, "Wrong parameter type"),
        ({"image_transport": ""}, "image_transport: expected"), ({"intrinsics": [900.0, 900.0]}, "intrinsics: expected fx, fy"),
        ({"intrinsics": [-1.0, 900.0, 1.0, 1.0]}, "intrinsics: "), ({"ball_radius_m": 40.0}, "ball_radius_m out of range"),
        ({"intrinsics": [900.0, 900.0, 1.0, math.nan]}, "intrinsics: "), ({"memory_s": math.nan}, "memory_s out of range"),
    ],
)
def test_parameters_that_do_not_fit_end_in_one_line(world, given, problem):
    world.overrides.update(given)
    assert world.module.main() == 2
    (line,) = world.said("fatal")
    assert problem in line and "\n" not in line
    assert world.events == ["init", "shutdown"]


def test_a_stop_from_outside_ends_it(world):
    """As launch stops a node: by then rclpy is shut down."""
    def stop():
        world.is_initialized = False

    world.incoming, world.ending = [stop], ros.ExternalShutdownException
    assert world.module.main() == 0
    assert world.nodes[0].is_destroyed and "shutdown" not in world.events


def test_what_the_library_warns_of_is_logged(world):
    world.incoming = [lambda: warnings.warn("the focal length is doubtful", stacklevel=1)]
    world.module.main()
    assert world.said("warning") == ["the focal length is doubtful"]


@both
def test_parameters_change_at_run_time(world, clip):
    node = world.module.SpinNode()
    parameter = sys.modules["rclpy.parameter"].Parameter
    world.send("/camera_info", camera_info(world, clip))
    sent = images(world, clip)
    for _ in range(4):
        world.send("/image", next(sent))
    assert len(world.publisher("/ball/twist").sent) == 3
    for name, value, problem in [
        ("window", 2, "out of range"), ("table", "none.npz", "none.npz: cannot be read"), ("image_transport", "raw", "read-only"),
        ("intrinsics", [900.0], "intrinsics: expected fx"), ("memory_s", 1, "Wrong parameter type"),
    ]:
        result = node.set_parameters_atomically([parameter(name, value=value)])
        assert not result.successful and problem in result.reason
    # What another part of the node refuses is not taken.
    refused = message(world, "rcl_interfaces/SetParametersResult", successful=False, reason="no")
    node._on_set_parameters_callbacks.append(lambda _: refused)
    assert not node.set_parameters_atomically([parameter("min_confidence", value=1.0)]).successful
    node._on_set_parameters_callbacks.pop()
    world.send("/image", next(sent))
    assert len(world.publisher("/ball/pose").sent) == 5 and len(world.publisher("/ball/twist").sent) == 4
    # A new beginning: two images until there is a spin; the camera stays known.
    changes = [parameter("ball_radius_m", value=0.04), parameter("window", value=5)]
    assert node.set_parameters_atomically(changes).successful
    before = world.publisher("/ball/pose").sent[-1].pose.pose.position.z
    for _ in range(2):
        world.send("/image", next(sent))
    assert len(world.publisher("/ball/pose").sent) == 7 and len(world.publisher("/ball/twist").sent) == 5
    last = world.publisher("/ball/pose").sent[-1]
    assert last.header.frame_id == "camera_optical_frame"
    assert last.pose.pose.position.z == pytest.approx(2 * before, rel=0.05)


def test_a_table_that_is_gone_does_not_end_the_node(world, clip, tmp_path):
    """It was there when the parameters were set; another change was tried since, which another part refused."""
    node = world.module.SpinNode()
    parameter = sys.modules["rclpy.parameter"].Parameter
    table = tmp_path / "table.npz"
    shutil.copy(TABLE, table)
    sent = images(world, clip)
    world.send("/image", next(sent))
    refused = message(world, "rcl_interfaces/SetParametersResult", successful=False, reason="no")

    def set_and_try_another():
        assert node.set_parameters_atomically([parameter("table", value=str(table))]).successful
        node._on_set_parameters_callbacks.append(lambda _: refused)
        assert not node.set_parameters_atomically([parameter("window", value=5)]).successful
        node._on_set_parameters_callbacks.pop()

    set_and_try_another()
    table.unlink()
    world.send("/camera_info", camera_info(world, clip))
    for _ in range(3):
        world.send("/image", next(sent))
    # What was goes on, which is said once.
    assert len(world.publisher("/ball/pose").sent) == 4 and len(world.publisher("/ball/twist").sent) >= 1
    (line,) = world.said("error")
    assert "table.npz: cannot be read" in line and TABLE in line
    # Set again when it is back, it is taken.
    shutil.copy(TABLE, table)
    set_and_try_another()
    world.send("/image", next(sent))
    assert node._core.settings.table == str(table) and len(world.said("error")) == 1


def test_an_image_that_cannot_be_read_does_not_end_the_node(world, clip):
    world.module.SpinNode()
    first, second = images(world, clip[:2])
    first.encoding = "32FC1"
    for _ in range(50):
        world.send("/image", first)
    # Said once in a while.
    (line,) = world.said("error")
    assert line.startswith("/image: encoding: expected one of") and "'32FC1'" in line
    world.steady_s += 6.0
    world.send("/image", first)
    assert len(world.said("error")) == 2
    world.send("/image", second)
    assert len(world.publisher("/ball/pose").sent) == 1
    status = report(world)
    assert status.level == status.WARN and status.message.startswith("51 of 52 images cannot be read: encoding")
    assert key_values(status)["unreadable images"] == "51"


def test_stamps_that_stand_or_go_back(world, clip):
    world.module.SpinNode()
    sent = list(images(world, clip))
    for one in sent[:4]:
        world.send("/image", one)
    assert len(world.publisher("/ball/twist").sent) == 3
    # Sent twice: no other answer, and no new beginning.
    world.send("/image", sent[3])
    (line,) = world.said("error")
    assert "header.stamp: expected one after that of the last image, found the same" in line
    world.send("/image", sent[4])
    assert len(world.publisher("/ball/pose").sent) == 5 and len(world.publisher("/ball/twist").sent) == 4
    # A bag that starts again.
    for one in sent[:3]:
        world.send("/image", one)
    (line,) = world.said("warning")
    assert line == "stamps went back by 0.011 s, to a new beginning"
    assert len(world.publisher("/ball/twist").sent) == 6
    # Forward by an hour: what was is forgotten.
    for one in images(world, clip[:2], 3600.0):
        world.send("/image", one)
    assert len(world.publisher("/ball/pose").sent) == 10 and len(world.publisher("/ball/twist").sent) == 7


@both
def test_diagnostics(world, clip):
    world.module.SpinNode()
    world.offered["/image"] = 1
    status = report(world)
    assert (status.level, status.message) == (status.WARN, "no images on /image, which has 1 publishers")
    world.send("/camera_info", camera_info(world, clip))
    for one in images(world, clip):
        world.ros_ns = one.header.stamp.sec * 10**9 + one.header.stamp.nanosec + 7_000_000
        world.send("/image", one)
    status = report(world)
    assert status.level == status.OK and status.name == "spindoe: ball" and status.hardware_id == "camera_optical_frame"
    values = key_values(status)
    posed, spins = (len(world.publisher(topic).sent) for topic in ("/ball/pose", "/ball/twist"))
    assert values == {
        "images": "10", "images with a ball": "10", "answered": str(posed), "answered share": f"{posed / 10:.3f}",
        "spins": str(spins), "spins of two images": "1", "unreadable images": "0", "missed frames": "0",
        "processing ms": "2.0", "latency ms": "7.0",
        "largest latency ms": "7.0", "intrinsics": "known", "reason": values["reason"],
    }
    assert status.message == f"{posed} of 10 images with a ball are answered"
    sent = world.publisher("/diagnostics").sent[-1].header.stamp
    assert (sent.sec * 10**9 + sent.nanosec, world.publisher("/diagnostics").topic) == (world.ros_ns, "/diagnostics")
    # A verdict is logged where it is new.
    assert [level for level, line in world.lines if "images" in line] == ["warning", "info"]
    report(world)
    report(world)
    assert len(world.said("warning")) == 1
    # Each report is of its own second.
    assert key_values(report(world))["images"] == "0"


def test_diagnostics_of_frames_that_are_missed(world, clip):
    world.module.SpinNode()
    world.send("/camera_info", camera_info(world, clip))
    for k, one in enumerate(images(world, clip)):
        if k not in (4, 5, 8):
            world.send("/image", one)
    status = report(world)
    assert status.level == status.WARN and key_values(status)["missed frames"] == "3"
    assert status.message == "frames are missed: at least 3 of 10, with 2 ms for an image"


def test_diagnostics_of_another_clock(world, clip):
    """As of a bag that is played without its clock."""
    world.module.SpinNode()
    world.send("/camera_info", camera_info(world, clip))
    world.ros_ns += 86_400 * 10**9
    for one in images(world, clip[:4]):
        world.send("/image", one)
    status = report(world)
    assert status.level == status.WARN and "86400 s apart" in status.message and "use_sim_time" in status.message


def test_diagnostics_of_a_ball_that_is_not_this_one(world, clip):
    world.overrides["table"] = str(ROOT / "designs/dots40/table.npz")
    world.module.SpinNode()
    world.send("/camera_info", camera_info(world, clip))
    for one in images(world, clip):
        world.send("/image", one)
    status = report(world)
    assert status.level == status.WARN and " of 10 images with a ball are answered: " in status.message
    # Without a ball there is nothing to warn of.
    for k, one in enumerate(images(world, clip, 2.0, data=bytes(clip[0][0].size))):
        world.send("/image", one)
    status = report(world)
    assert status.level == status.OK and status.message.startswith("no ball") and key_values(status)["answered share"] == ""


@pytest.mark.parametrize("bright_dots", [False, True])
@pytest.mark.parametrize("bits", [10, 12])
def test_numbers_of_fewer_bits(world, clip, bits, bright_dots):
    """In 16, as many cameras send them."""
    world.overrides["bright_dots"] = bright_dots
    world.module.SpinNode()
    for image, truth in clip:
        dark = (image.mean(axis=2) / 255 * (2**bits - 1)).astype("<u2")
        if bright_dots:
            dark = (2**bits - 1 - dark).astype("<u2")
        height, width = dark.shape
        one = message(
            world, "sensor_msgs/Image", header=header(world, truth.time_s), height=height, width=width, encoding="mono16",
            step=2 * width, data=dark.tobytes(),
        )
        world.send("/image", one)
    assert len(world.publisher("/ball/pose").sent) >= 8


def test_two_nodes_in_a_process(world, clip):
    parameter = sys.modules["rclpy.parameter"].Parameter
    world.module.SpinNode(namespace="left")
    second = [parameter("ball_radius_m", value=0.04)]
    right = world.module.SpinNode("watch", namespace="right", parameter_overrides=second)
    assert right.get_name() == "watch"
    for side in ("left", "right"):
        world.send(f"/{side}/camera_info", camera_info(world, clip))
    for k, one in enumerate(images(world, clip)):
        world.send("/left/image", one)
        if k < 3:
            world.send("/right/image", one)
    z = {side: [one.pose.pose.position.z for one in world.publisher(f"/{side}/ball/pose").sent] for side in ("left", "right")}
    assert len(z["left"]) >= 8 and len(z["right"]) == 3
    assert np.allclose(np.array(z["right"]) / z["left"][:3], 2.0)
    world.tick()
    statuses = [one.sent[0].status[0] for node in world.nodes for one in node._publishers if one.topic == "/diagnostics"]
    assert [one.name for one in statuses] == ["spindoe: ball", "watch: ball"]


@both
def test_a_bag_and_the_node_say_the_same(world, clip, tmp_path):
    """Messages of a recorded bag, through the node: what it publishes is what the bag's program writes, bit by bit."""
    record(tmp_path / "in", clip)
    bag = importlib.import_module("spindoe_ros.bag")
    core = importlib.import_module("spindoe_ros.core")
    bag.process(tmp_path / "in", tmp_path / "out", core.SpinCore(core.Settings(TABLE)))
    written = {bag.POSE: [], bag.TWIST: []}
    with Reader(tmp_path / "out") as reader:
        for connection, _, raw in reader.messages():
            if connection.topic in written:
                written[connection.topic].append(world.definitions.received(raw, connection.msgtype))
    world.module.SpinNode()
    with Reader(tmp_path / "in") as reader:
        for connection, _, raw in reader.messages():
            if connection.topic in ("/image", "/camera_info"):
                assert world.send(connection.topic, world.definitions.received(raw, connection.msgtype)) == 1
    for topic, expected in written.items():
        assert len(expected) >= 6 and world.publisher(topic).sent == expected
