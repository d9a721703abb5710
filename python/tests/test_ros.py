"""The core of the ROS 2 node, driven by a bag that is written and read without ROS."""

from __future__ import annotations

import errno
import math
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from scipy.spatial.transform import Rotation

import spindoe

pytest.importorskip("rosbags")

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from spindoe_ros import bag
from spindoe_ros.core import Settings, SpinCore
from spindoe_ros.images import LUMA, MOSAICS, demosaic, image_of

TABLE = str(ROOT / "designs/dots20/table.npz")
SPIN = np.array([30.0, 100.0, -40.0])
OPTICAL = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def clip(pattern):
    """One turning ball, and its truth."""
    return list(
        spindoe.synth(
            pattern, 16, seed=6, fps=350.0, spin_rad_s=SPIN, ball_px=[90, 90],
            camera_distance_radii=[20, 20],
        )
    )


def padded(types, header, image):
    """As many drivers send images: rows padded, and blue first."""
    height, width, _ = image.shape
    rows = np.zeros((height, 3 * width + 5), np.uint8)
    rows[:, : 3 * width] = image[..., ::-1].reshape(height, -1)
    return types["sensor_msgs/msg/Image"](header, height, width, "bgr8", 0, rows.shape[1], rows.ravel())


def compressed(codec):
    """Images of a codec, with the format that image_transport writes."""

    def make(types, header, image):
        cv2 = pytest.importorskip("cv2")
        data = cv2.imencode(f".{codec}", image[..., ::-1])[1]
        words = f"rgb8; {codec} compressed bgr8"
        return types["sensor_msgs/msg/CompressedImage"](header, words, data.ravel())

    return make


def mosaic_of(image, colors):
    """What a sensor with this filter sees of an image: one channel a pixel."""
    mosaic = np.empty(image.shape[:2], image.dtype)
    for place, color in enumerate(colors):
        own = np.s_[place // 2 :: 2, place % 2 :: 2]
        mosaic[own] = image[..., "rgb".index(color)][own]
    return mosaic


def bayer(colors):
    def make(types, header, image):
        height, width, _ = image.shape
        data = mosaic_of(image, colors).ravel()
        return types["sensor_msgs/msg/Image"](header, height, width, f"bayer_{colors}8", 0, width, data)

    return make


def record(path, clip, make=padded):
    """A bag of a clip, as a camera's driver records it."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = None
        cameras = writer.add_connection("/camera_info", "sensor_msgs/msg/CameraInfo", typestore=store)
        other = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        for image, truth in clip:
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
            message = make(types, header, image)
            topic = topic or writer.add_connection("/image", message.__msgtype__, typestore=store)
            writer.write(topic, ns, store.serialize_cdr(message, message.__msgtype__))
            text = types["std_msgs/msg/String"]("hello")
            writer.write(other, ns, store.serialize_cdr(text, text.__msgtype__))


@pytest.fixture(scope="module")
def recorded(clip, tmp_path_factory):
    """The bag, and the truth."""
    path = tmp_path_factory.mktemp("bag") / "in"
    record(path, clip)
    return path, [truth for _, truth in clip]


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
    core = SpinCore(Settings(TABLE))
    # Without the topic nothing is known of the camera.
    first = bag.process(recorded[0], tmp_path / "1", core, camera_info="/none")
    second = bag.process(recorded[0], tmp_path / "2", core, camera_info="/none")
    assert np.array_equal(first[-1].spin.spin_rad_s, second[-1].spin.spin_rad_s)
    assert np.linalg.norm(first[-1].spin.spin_rad_s - OPTICAL @ SPIN) < 8.0
    assert first[-1].frame_id_of(first[-1].spin) == "camera_optical_frame_view"
    assert first[0].position_m is None and "at least 3" in first[0].reason


def test_a_compressed_bag_has_the_answers_of_the_raw_one(clip, recorded, tmp_path):
    raw = bag.process(recorded[0], tmp_path / "raw", SpinCore(Settings(TABLE)))
    for codec in ("png", "jpeg"):
        record(tmp_path / codec, clip, compressed(codec))
        found = bag.process(tmp_path / codec, tmp_path / f"{codec}-out", SpinCore(Settings(TABLE)))
        assert np.linalg.norm(found[-1].spin.spin_rad_s - OPTICAL @ SPIN) < 5.0
        same = [np.array_equal(a.frame.dots, b.frame.dots) for a, b in zip(raw, found, strict=True)]
        # Nothing is lost in a PNG; a JPEG is another picture.
        assert all(same) if codec == "png" else not all(same)
        with Reader(tmp_path / f"{codec}-out") as reader:
            kinds = {c.topic: c.msgtype for c in reader.connections}
        assert kinds["/image"] == "sensor_msgs/msg/CompressedImage"


def test_a_bag_of_a_bayer_camera(clip, tmp_path):
    record(tmp_path / "in", clip, bayer("grbg"))
    answers = bag.process(tmp_path / "in", tmp_path / "out", SpinCore(Settings(TABLE)))
    assert sum(bool(answer.pose) for answer in answers) >= 14
    assert np.linalg.norm(answers[-1].spin.spin_rad_s - OPTICAL @ SPIN) < 5.0
    # The colors are those of the camera: in the wrong order they would be others.
    mean = np.mean([answer.image.mean(axis=(0, 1)) for answer in answers], axis=0)
    assert np.allclose(mean, np.mean([image.mean(axis=(0, 1)) for image, _ in clip], axis=0), atol=0.5)


@pytest.mark.parametrize("encoding", sorted(MOSAICS))
def test_mosaics_are_made_color_as_opencv_does(encoding):
    cv2 = pytest.importorskip("cv2")
    kind, colors = MOSAICS[encoding]
    rng = np.random.default_rng(1)
    mosaic = rng.integers(0, np.iinfo(kind).max, (14, 21), dtype=kind, endpoint=True)
    found = demosaic(mosaic, colors)
    expected = cv2.cvtColor(mosaic, getattr(cv2, f"COLOR_Bayer{colors.upper()}2RGB"))
    assert found.dtype == mosaic.dtype and np.array_equal(found[1:-1, 1:-1], expected[1:-1, 1:-1])
    # A surface of one color is that color, to the border.
    even = np.broadcast_to(np.array([200, 90, 30], kind), (6, 9, 3))
    assert np.array_equal(demosaic(mosaic_of(even, colors), colors), even)
    message = SimpleNamespace(
        height=14, width=21, encoding=encoding, is_bigendian=0, step=21 * mosaic.itemsize, data=mosaic.tobytes()
    )
    image, color = image_of(message)
    assert color == "rgb" and np.array_equal(image, found)
    # The mosaic itself as a PNG.
    packed = SimpleNamespace(format=f"{encoding}; png compressed {encoding}", data=cv2.imencode(".png", mosaic)[1])
    image, color = image_of(packed)
    # Rounded to 16 bits instead of 8.
    off = image / (257.0 if kind == "u1" else 1.0) - found
    assert color == "rgb" and np.abs(off).max() <= (0.5 if kind == "u1" else 0.0)
    with pytest.raises(ValueError, match="at least 2 x 2"):
        demosaic(mosaic[:1], colors)


def test_what_is_no_compressed_image():
    cases = [
        ("16UC1; compressedDepth png", b"", "format: expected an image"),
        ("rgb8; jpeg compressed bgr8", b"", "data: image: expected a PNG"),
        ("jpeg", b"\xff\xd8\xff\xe0 and no more", "data: image"),
    ]
    for words, data, problem in cases:
        with pytest.raises(ValueError, match=problem):
            image_of(SimpleNamespace(format=words, data=data))


def test_an_overlay_of_every_image(clip, recorded, tmp_path):
    bag.process(recorded[0], tmp_path / "out", SpinCore(Settings(TABLE)), overlay=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(tmp_path / "out") as reader:
        connections = [c for c in reader.connections if c.topic == bag.OVERLAY]
        drawn = [store.deserialize_cdr(raw, c.msgtype) for c, _, raw in reader.messages(connections=connections)]
    assert len(drawn) == len(clip)
    for message, (image, _) in zip(drawn, clip, strict=True):
        pixels = message.data.reshape(message.height, message.width, 3)
        changed = np.any(pixels != image, axis=2)
        assert message.encoding == "rgb8" and 0.01 < changed.mean() < 0.2


@pytest.mark.parametrize("make", [padded, compressed("png")])
def test_a_dark_ball_with_bright_dots(clip, recorded, tmp_path, make):
    """Its images, as negatives of those of a bright ball, have the answers of these; shown is what the camera saw."""
    negatives = [(255 - image, truth) for image, truth in clip]
    record(tmp_path / "in", negatives, make)
    dark = bag.process(tmp_path / "in", tmp_path / "1", SpinCore(Settings(TABLE, bright_dots=True)))
    bright = bag.process(recorded[0], tmp_path / "2", SpinCore(Settings(TABLE)))
    assert sum(bool(answer.pose) for answer in bright) >= 14
    for one, other, (image, _) in zip(dark, bright, negatives, strict=True):
        assert bool(one.pose) == bool(other.pose) and one.frame.circle == other.frame.circle
        if one.pose:
            assert np.array_equal(one.pose.quaternion_wxyz, other.pose.quaternion_wxyz)
            assert np.array_equal(one.position_m, other.position_m)
        assert 0.01 < np.any(one.overlay() != image, axis=2).mean() < 0.2
    # Without being said, it is no ball of this pattern.
    answers = bag.process(tmp_path / "in", tmp_path / "3", SpinCore(Settings(TABLE)))
    assert not any(answer.pose for answer in answers)


def leaves_nothing(folder, kept=()):
    return {path.name for path in folder.iterdir()} == set(kept)


def test_a_run_that_fails_leaves_nothing_behind(clip, recorded, tmp_path, monkeypatch):
    core = SpinCore(Settings(TABLE))
    with pytest.raises(ValueError, match="topic: expected images on /chatter, found /camera_info"):
        bag.process(recorded[0], tmp_path / "out", core, "/chatter")
    with pytest.raises(FileNotFoundError, match="none"):
        bag.process(tmp_path / "none", tmp_path / "out", core)
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    (damaged / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    with pytest.raises(ValueError, match="damaged: "):
        bag.process(damaged, tmp_path / "out", core)
    shutil.rmtree(damaged)
    assert leaves_nothing(tmp_path)

    def cut_off(types, header, image):
        message = padded(types, header, image)
        message.data = message.data[:100]
        return message

    record(tmp_path / "in", clip, cut_off)
    with pytest.raises(ValueError, match="/image: none of 16 images can be read, the first because of data: expected .* rows"):
        bag.process(tmp_path / "in", tmp_path / "out", core)
    assert leaves_nothing(tmp_path, ["in"])

    def interrupted(message):
        raise KeyboardInterrupt

    monkeypatch.setattr(core, "on_image", interrupted)
    with pytest.raises(KeyboardInterrupt):
        bag.process(recorded[0], tmp_path / "out", core)
    assert leaves_nothing(tmp_path, ["in"])
    (tmp_path / "out").mkdir()
    with pytest.raises(FileExistsError, match="out: expected a new bag"):
        bag.process(recorded[0], tmp_path / "out", core)
    assert leaves_nothing(tmp_path, ["in", "out"]) and leaves_nothing(tmp_path / "out")


def test_the_command(recorded, tmp_path):
    def run(*words):
        return subprocess.run(
            [sys.executable, "-m", "spindoe_ros.bag", *map(str, words)],
            capture_output=True, text=True, check=False, cwd=tmp_path,
        )

    done = run(recorded[0], "out", "--table", TABLE, "--overlay")
    assert done.returncode == 0 and done.stdout == "16 of 16 images answered: out\n", done.stderr
    with Reader(tmp_path / "out") as reader:
        assert {c.topic for c in reader.connections} == {"/image", bag.POSE, bag.TWIST, bag.OVERLAY}
    refused = run(recorded[0], "other", "--table", TABLE, "--topic", "/chatter")
    assert refused.returncode == 2 and refused.stderr.startswith("spindoe_ros.bag: topic: expected images")
    assert refused.stderr.count("\n") == 1
    for words, problem in [
        ((recorded[0], "other", "--table", "none.npz"), "none.npz: cannot be read"),
        ((recorded[0], "none/other", "--table", TABLE), "No such file"), (("none", "other", "--table", TABLE), "none"),
    ]:
        refused = run(*words)
        assert refused.returncode == 2 and problem in refused.stderr and refused.stderr.count("\n") == 1, refused.stderr
    again = run(recorded[0], "out", "--table", TABLE)
    assert again.returncode == 2 and again.stderr == "spindoe_ros.bag: out: expected a new bag, found one that exists\n"
    assert leaves_nothing(tmp_path, ["out"])


def damaged(source, target):
    """Writes the bag with an image that is cut off, one sent twice, one of another size, one whose bytes are no message, and a
    camera_info of a lens that nobody knows; the times of the images left."""
    store, kept, k = get_typestore(Stores.ROS2_HUMBLE), [], 0
    with Reader(source) as reader, Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        to = {c.topic: writer.add_connection(c.topic, c.msgtype, typestore=store) for c in reader.connections}
        for connection, time_ns, raw in reader.messages():
            message, given = store.deserialize_cdr(raw, connection.msgtype), raw
            if connection.topic == "/image":
                k += 1
                if k == 3:
                    message.data = message.data[:100]
                elif k == 6:
                    message.header.stamp = last.header.stamp
                elif k == 9:
                    message.height -= 1
                elif k == 12:
                    given = raw[:90]
                else:
                    kept.append(time_ns)
                last = message
            elif connection.topic == "/camera_info" and k == 1:
                message.distortion_model = "ftheta"
            if given is raw:
                given = store.serialize_cdr(message, connection.msgtype)
            writer.write(to[connection.topic], time_ns, given)
    return kept


def test_what_cannot_be_read_is_left_out_and_said(recorded, tmp_path, capsys):
    kept = damaged(recorded[0], tmp_path / "in")
    assert bag.main([str(tmp_path / "in"), str(tmp_path / "out"), "--table", TABLE]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("12 of 12 images answered")
    lines = said.err.splitlines()
    beginnings = [
        "spindoe_ros.bag: /camera_info: 1 of 16 messages cannot be read, the first because of distortion_model: expected",
        "spindoe_ros.bag: /image: 4 of 16 messages cannot be read, the first because of data: expected",
    ]
    assert [line[: len(words)] for line, words in zip(lines, beginnings, strict=True)] == beginnings
    with Reader(tmp_path / "out") as reader:
        times = {c.topic: [] for c in reader.connections}
        for connection, time_ns, _ in reader.messages():
            times[connection.topic].append(time_ns)
    assert times["/image"] == kept and times[bag.POSE] == kept and len(times[bag.TWIST]) >= 9
    with pytest.warns(UserWarning) as warned:
        answers = bag.process(tmp_path / "in", tmp_path / "again", SpinCore(Settings(TABLE)))
    assert len(answers) == 12 and {one.filename for one in warned} == {__file__}
    assert [f"spindoe_ros.bag: {one.message}" for one in warned] == lines


def test_exit_codes(clip, recorded, tmp_path, capsys, monkeypatch):
    """Of a ball of another pattern no image is answered; of a dark ball all, once that is said."""
    record(tmp_path / "dark", [(255 - image, truth) for image, truth in clip])
    for source, words, code in [
        (recorded[0], ["--table", "dots40"], 3), (tmp_path / "dark", ["--table", TABLE], 3),
        (tmp_path / "dark", ["--table", TABLE, "--bright-dots"], 0),
    ]:
        assert bag.main([str(source), str(tmp_path / "out"), *words]) == code
        said = capsys.readouterr()
        assert said.out.startswith("16 of 16" if code == 0 else "0 of 16") and not said.err
        assert ("others: " in said.out) == (code == 3)
        shutil.rmtree(tmp_path / "out")

    def full(*_args, **_words):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(bag, "process", full)
    assert bag.main([str(recorded[0]), str(tmp_path / "out"), "--table", TABLE]) == 1


def camera_info(focal_px):
    k = [focal_px, 0, 57, 0, focal_px, 57, 0, 0, 1]
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    return SimpleNamespace(k=k, d=[], distortion_model="", roi=roi, binning_x=0, binning_y=0, width=0, height=0)


@pytest.mark.parametrize("table", ["table.npz", "pattern.csv"])
def test_a_table_is_made_once_for_all_cameras(table, monkeypatch):
    made = []
    for name in ("load", "build"):
        method = getattr(spindoe.HashTable, name)
        monkeypatch.setattr(spindoe.HashTable, name, lambda *a, method=method, **k: made.append(method(*a, **k)) or made[-1])
    core = SpinCore(Settings(str(ROOT / "designs/dots20" / table)))
    assert core.on_camera_info(camera_info(900.0)) and core.on_camera_info(camera_info(800.0))
    assert len(made) == 1 and core.tracker.estimator.table is made[0]


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8", "rgba8", "bgra8", "mono16", "bgr16"])
def test_an_overlay_is_of_the_image(encoding):
    """Whatever the order of its channels, its depth and its alpha."""
    channels = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}[encoding.rstrip("0123456789")]
    kind, shift = ("<u2", 8) if "16" in encoding else ("u1", 0)
    values = np.random.default_rng(0).integers(0, 256, (24, 30, channels)).astype(kind) << shift
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id="")
    message = SimpleNamespace(
        height=24, width=30, encoding=encoding, is_bigendian=0, step=values[0].nbytes, data=values.tobytes(), header=header
    )
    answer = SpinCore(Settings(TABLE)).on_image(message)
    eight = (values >> shift).astype(np.uint8)
    rgb = np.repeat(eight, 3, axis=2) if channels == 1 else eight[..., :3]
    assert answer.frame.circle is None
    assert np.array_equal(answer.overlay(), rgb[..., ::-1] if encoding.startswith("bgr") else rgb)


def test_settings_that_do_not_fit():
    for given, problem in [
        ({"window": 1}, "window: expected 3 to 1000"), ({"table": ""}, "table: expected the path"),
        ({"intrinsics": (900.0, 900.0, 57.0)}, "intrinsics: expected fx, fy, cx, cy"),
        ({"intrinsics": (900.0, 900.0, 57.0, 57.0, 0.1)}, "intrinsics: "),
        ({"intrinsics": (900.0, 900.0, 57.0, math.nan)}, "intrinsics: "),
        ({"intrinsics": (900.0, 900.0, 57.0, 57.0, *[math.nan] * 5)}, "intrinsics: "),
        ({"ball_radius_m": 0.0004}, "ball_radius_m: expected 0.0005 to 0.5, found 0.0004"),
        ({"ball_radius_m": 0.6}, "ball_radius_m: expected 0.0005 to 0.5, found 0.6"),
        *[
            ({name: value}, f"{name}: expected .* to .*, found {value}")
            for name in ("ball_radius_m", "min_confidence", "memory_s", "max_rps") for value in (math.nan, math.inf)
        ],
    ]:
        with pytest.raises(ValueError, match=problem):
            SpinCore(Settings(**{"table": TABLE, **given}))


@pytest.mark.parametrize(
    ("encoding", "big"),
    [
        ("mono8", 0), ("mono16", 0), ("mono16", 1), ("rgb8", 0), ("bgra8", 0), ("rgba8", 0), ("rgb16", 1), ("bgr16", 0),
    ],
)
def test_encodings(encoding, big):
    rng = np.random.default_rng(0)
    kind = np.dtype((">" if big else "<") + ("u2" if "16" in encoding else "u1"))
    channels = {"mono8": 1, "mono16": 1, "rgb8": 3, "bgra8": 4, "rgba8": 4}.get(encoding, 3)
    values = rng.integers(0, 256 ** kind.itemsize, (5, 7, channels)).astype(kind)
    rows = np.zeros((5, 7 * channels * kind.itemsize + 3), np.uint8)
    rows[:, :-3] = values.view(np.uint8).reshape(5, -1)
    message = SimpleNamespace(
        height=5, width=7, encoding=encoding, is_bigendian=big, step=rows.shape[1], data=rows.tobytes()
    )
    image, color = image_of(message)
    expected = values[..., 0] if channels == 1 else values
    assert np.array_equal(image, expected) and image.dtype.isnative
    assert color == ("gray" if channels == 1 else encoding.rstrip("0123456789"))
    message.encoding = "32FC1"
    with pytest.raises(ValueError, match="encoding"):
        image_of(message)
    message.encoding, message.data = encoding, b""
    with pytest.raises(ValueError, match="data: expected 5 rows"):
        image_of(message)


@pytest.mark.parametrize("encoding", [*LUMA, "nv21", "nv24"])
def test_of_yuv_the_brightness(encoding):
    """As OpenCV has it, of an image whose colors vary."""
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(1)
    gray = rng.integers(0, 256, (6, 8)).astype(np.uint8)
    if encoding in LUMA:
        packed = rng.integers(0, 256, (6, 8, 2)).astype(np.uint8)
        to_gray = cv2.COLOR_YUV2GRAY_UYVY if encoding in ("yuv422", "uyvy") else cv2.COLOR_YUV2GRAY_YUY2
        gray, step = cv2.cvtColor(packed, to_gray), 16 + 4
        data = np.pad(packed.reshape(6, 16), ((0, 0), (0, 4))).tobytes()
    else:
        colors = rng.integers(0, 256, gray.size // 2 if encoding == "nv21" else 2 * gray.size).astype(np.uint8)
        data, step = gray.tobytes() + colors.tobytes(), 8
        if encoding == "nv21":
            planes = np.frombuffer(data, np.uint8).reshape(9, 8)
            gray = cv2.cvtColor(planes, cv2.COLOR_YUV2GRAY_NV21)
    message = SimpleNamespace(height=6, width=8, encoding=encoding, is_bigendian=0, step=step, data=data)
    image, color = image_of(message)
    assert color == "gray" and np.array_equal(image, gray)
