"""Where the ball is: by the limb of a sphere that OpenCV projects, on rendered frames, and in what is saved and tabulated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spindoe

RADIUS_M = 0.02
K = np.array([[1400.0, 0.0, 640.5], [0.0, 1380.0, 511.0], [0.0, 0.0, 1.0]])
LENS = np.array([-0.28, 0.08, 0.001, -0.002, 0.03])


def limb(center: np.ndarray, count: int = 72) -> np.ndarray:
    """The circle in which the tangents from the origin touch a sphere; shape (count, 3)."""
    squared = center @ center
    middle = center * (1.0 - RADIUS_M**2 / squared)
    around = RADIUS_M * np.sqrt(1.0 - RADIUS_M**2 / squared)
    _, _, axes = np.linalg.svd(center[None])
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return middle + around * (np.outer(np.cos(angle), axes[1]) + np.outer(np.sin(angle), axes[2]))


def cone(rays: np.ndarray) -> tuple[np.ndarray, float]:
    """Axis and half angle of the cone of rays (n, 3) from the origin: the quadric through them, whose axis is the eigenvector of the
    odd sign."""
    x, y, z = rays.T
    rows = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z], axis=1)
    a, b, c, d, e, f = np.linalg.svd(rows)[2][-1]
    values, axes = np.linalg.eigh(np.array([[a, d, e], [d, b, f], [e, f, c]]))
    if np.count_nonzero(values < 0.0) != 1:
        values = -values
    odd = int(np.argmin(values))
    axis = axes[:, odd] * np.sign(axes[2, odd])
    even = np.delete(values, odd).mean()
    return axis, float(np.arctan(np.sqrt(-values[odd] / even)))


@pytest.mark.parametrize("distortion", [np.zeros(5), LENS])
def test_a_limb_that_opencv_projects_leads_to_the_center(table, distortion):
    cv2 = pytest.importorskip("cv2")
    zero = np.zeros(3)
    # OpenCV 5 has both in one.
    undistorted = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)

    def shown(points: np.ndarray) -> np.ndarray:
        return cv2.projectPoints(points.reshape(-1, 1, 3), zero, zero, K, distortion)[0].reshape(-1, 2)

    estimator = spindoe.Estimator(table, camera=spindoe.Camera(K, distortion), ball_radius_m=RADIUS_M)
    random = np.random.default_rng(65)
    for distance in np.geomspace(0.2, 3.0, 8):
        direction = np.append(random.uniform(-0.4, 0.4, 2), 1.0)
        center = distance * direction / np.linalg.norm(direction)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
        pixels = shown(limb(center)).reshape(-1, 1, 2)
        flat = undistorted(pixels, K, distortion, R=np.eye(3), P=np.eye(3), criteria=criteria).reshape(-1, 2)
        axis, half = cone(np.column_stack([flat, np.ones(len(flat))]))
        assert axis * RADIUS_M / np.sin(half) == pytest.approx(center, abs=1e-6)
        # The outline as the picture shows it: the circle of the same center and area.
        u, v = (shown(limb(center, 5000)) - pixels[0, 0]).T
        twice = u * np.roll(v, -1) - np.roll(u, -1) * v
        area = 0.5 * twice.sum()
        middle = [((x + np.roll(x, -1)) * twice).sum() / (6.0 * area) for x in (u, v)]
        given = (*(pixels[0, 0] + middle), np.sqrt(abs(area) / np.pi))
        found = estimator.estimate(np.full((64, 64), 128, np.uint8), circle=given)
        # No dot is seen, and the outline stands.
        assert not found.pose and found.position_rotation_covariance_m_rad is None
        seen = found.position_m * [1, -1, -1]
        assert seen == pytest.approx(center, abs=1e-4 * distance)
        assert np.all(np.linalg.eigvalsh(found.position_covariance_m2) > 0.0)


@pytest.fixture(scope="module")
def clip(pattern):
    easy = {"ball_px": [100, 100], "camera_distance_radii": [20, 20], "max_off_axis_rad": 0.3}
    return list(spindoe.synth(pattern, 12, seed=65, fps=120.0, spin_rad_s=(40.0, 150.0, -60.0), **easy))


def _center(truth: Any) -> np.ndarray:
    """The center of a rendered ball, m, x right, y up, z towards the camera."""
    everything = truth.everything
    k, at = everything["intrinsics"], everything["ball_center"]
    ray = np.array([(at["u"] - k["cx"]) / k["fx"], (k["cy"] - at["v"]) / k["fy"], -1.0])
    return RADIUS_M * everything["distance"] * ray / np.linalg.norm(ray)


def test_rendered_balls_are_where_they_say(table, clip, tmp_path):
    pandas = pytest.importorskip("pandas")
    images, truths = zip(*clip, strict=True)
    k = truths[0].everything["intrinsics"]
    camera = spindoe.Camera.pinhole(*(k[name] for name in ("fx", "fy", "cx", "cy")))
    found = spindoe.Estimator(table, camera=camera).estimate_sequence(
        images, [truth.time_s for truth in truths], color="rgb"
    )
    posed = [(frame, truth) for frame, truth in zip(found.frames, truths, strict=True) if frame.pose]
    assert len(posed) >= 10
    for frame, truth in posed:
        center = _center(truth)
        off = frame.position_m - center
        along = off @ center / np.linalg.norm(center)
        assert np.linalg.norm(off - along * center / np.linalg.norm(center)) < 5e-4
        assert abs(along) < 0.02 * np.linalg.norm(center)
        joint = frame.joint_covariance()
        assert np.all(np.linalg.eigvalsh(joint) > 0.0)
        assert np.array_equal(joint[:3, :3], frame.position_covariance_m2)
        signs = np.tile([1.0, -1.0, -1.0], 2)
        assert np.array_equal(frame.joint_covariance("optical"), joint * np.outer(signs, signs))
    table_of = found.to_dataframe()
    assert table_of[["x_m", "y_m", "z_m"]].to_numpy() == pytest.approx(found.positions_m, nan_ok=True)
    assert table_of["cov_m2_xz"][0] == found.frames[0].position_covariance_m2[0, 2]
    assert table_of.attrs["frame"] == "camera"
    units = table_of.attrs["units"]
    assert units["x_m"] == "m" and units["cov_m2_xx"] == "m^2" and units["cov_xx"] == "rad^2" and units["time_s"] == "s"
    found.save(tmp_path / "clip.npz")
    again = spindoe.SequenceEstimate.load(tmp_path / "clip.npz")
    pandas.testing.assert_frame_equal(again.to_dataframe(), table_of)
    # A ball twice as large is twice as far.
    large = spindoe.Estimator(table, camera=camera, ball_radius_m=2.0 * RADIUS_M).estimate(images[0], color="rgb")
    alone = spindoe.Estimator(table, camera=camera).estimate(images[0], color="rgb")
    assert large.position_m == pytest.approx(2.0 * alone.position_m)


def test_without_intrinsics_there_is_no_position(table, clip):
    image = clip[0][0]
    for camera in (spindoe.Camera(), spindoe.Camera.at_distance(20.0)):
        found = spindoe.Estimator(table, camera=camera).estimate(image, color="rgb")
        assert found.pose and found.position_m is None and found.position_covariance_m2 is None
        with pytest.raises(ValueError, match="position"):
            found.joint_covariance()
