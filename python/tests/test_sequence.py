"""A sequence is kept bit by bit, is the command's table, and is shown in notebooks and plots."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import matplotlib
import numpy as np
import pandas
import PIL.Image
import pytest

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from conftest import ROOT, run
from spindoe_ros import bag
from spindoe_ros.core import Settings, SpinCore

import spindoe
import spindoe.compat
from spindoe import _cluster
from spindoe._common import optional
from spindoe._palette import OTHER, on_white

SPIN = (40.0, 150.0, -60.0)
EASY = {"ball_px": [100, 100], "camera_distance_radii": [20, 20]}


@pytest.fixture(scope="module")
def clip(pattern):
    # 94 revolutions per second look alike at this rate.
    drawn = list(spindoe.synth(pattern, 14, seed=4, fps=120.0, spin_rad_s=SPIN, **EASY))
    # A frame without a ball has no outline, no orientation and a reason.
    images = [image for image, _ in drawn]
    images[5] = np.full_like(images[5], 90)
    return images, [truth.time_s for _, truth in drawn]


@pytest.fixture(scope="module")
def found(clip, estimator):
    images, times = clip
    found = estimator.estimate_sequence(images, times, color="rgb")
    assert found.spin and not found.frames[5].pose and found.spin.aliases
    return found


def _same(a, b, where="sequence"):
    """Types, shapes and bits."""
    assert type(a) is type(b), where
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            _same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), where
    elif isinstance(a, (list, tuple)):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            _same(x, y, f"{where}[{k}]")
    else:
        assert a == b, where


def test_what_is_saved_is_loaded_bit_by_bit(found, clip, table, estimator, tmp_path):
    path = tmp_path / "clip.npz"
    images, times = clip
    precessing = dataclasses.replace(
        found.spin, model="precessing", decay_per_s=0.1, body_rate_rad_s=np.array([1.0, 0.1 + 0.2, 3.0]), lack_of_fit=1.7,
        covariance=None, log_likelihood=None,
    )
    times_s = np.linspace(0.0, 0.3, 4)
    curve = spindoe.SpinCurve(
        times_s, np.outer(1.0 + times_s, [1.0, 2.0, 3.0]), np.tile(np.eye(3), (4, 1, 1)), np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)), 0.1 + 0.2
    )
    pushed = dataclasses.replace(found.spin, model="free", curve=curve)
    pinhole = spindoe.Estimator(table, camera=spindoe.Camera.pinhole(1500, 1500, 66, 66))
    for given in [
        found,
        dataclasses.replace(found, spin=precessing),
        dataclasses.replace(found, spin=pushed),
        estimator.estimate_sequence(images[:6], color="rgb"),
        estimator.estimate_sequence([]),
        pinhole.estimate_sequence(images[:3], times[:3], color="rgb"),
    ]:
        given.save(path)
        _same(spindoe.SequenceEstimate.load(path), given)
    assert [child.name for child in tmp_path.iterdir()] == ["clip.npz"]


def test_all_frames_together_judge_the_table_and_the_mirror(clip, estimator, table):
    images, times = clip
    wrong = spindoe.Estimator("dots32")
    chosen = wrong.estimate_sequence(images, times, color="rgb", others=["dots24", table])
    alone = estimator.estimate_sequence(images, times, color="rgb")
    assert chosen.verdict.answer == alone.verdict.answer == "fits"
    assert (chosen.verdict.table, alone.verdict.table) == (2, 0) and len(chosen.verdict.hypotheses) == 6
    np.testing.assert_array_equal(chosen.quaternions_wxyz, alone.quaternions_wxyz)
    assert chosen.spin and np.array_equal(chosen.spin.spin_rad_s, alone.spin.spin_rad_s)
    # Another ball keeps no pose, and so does a mirrored one, until it is said.
    none = wrong.estimate_sequence(images, times, color="rgb")
    assert none.verdict.answer == "none" and not any(frame.pose for frame in none.frames) and not none.spin
    flipped = [np.ascontiguousarray(image[:, ::-1]) for image in images]
    mirrored = estimator.estimate_sequence(flipped, times, color="rgb")
    assert mirrored.verdict.answer == "mirrored" and not any(frame.pose for frame in mirrored.frames)
    read = estimator.estimate_sequence(flipped, times, color="rgb", mirrored=True)
    np.testing.assert_array_equal(read.quaternions_wxyz, alone.quaternions_wxyz)
    unjudged = estimator.estimate_sequence(images, times, color="rgb", judge=False)
    assert unjudged.verdict is None
    np.testing.assert_array_equal(unjudged.quaternions_wxyz, alone.quaternions_wxyz)


def test_a_region_and_a_rolling_shutter(clip, estimator, table, command, tmp_path):
    images, times = clip
    # Beside the ball there is nothing: a region says which part shows it.
    height, width = images[0].shape[:2]
    wide = [np.concatenate([np.full_like(image, 90), image], axis=1) for image in images]
    found = estimator.estimate_sequence(wide, times, color="rgb", roi=(width, 0, width, height))
    alone = estimator.estimate_sequence(images, times, color="rgb")
    posed = [bool(a.pose) and bool(b.pose) for a, b in zip(found.frames, alone.frames, strict=True)]
    assert sum(posed) >= 11
    beside = estimator.estimate_sequence(wide, times, color="rgb", roi=(0, 0, width, height))
    assert not any(frame.pose for frame in beside.frames)
    for roi in [(0, 0, 0, 4), (0, 0, 4), (-1, 0, 4, 4)]:
        with pytest.raises(ValueError, match="roi"):
            estimator.estimate_sequence(images, color="rgb", roi=roi)
    # The rows of a slow clip: the command's times and spin.
    drawn = list(spindoe.synth(table, 8, seed=5, fps=200.0, spin_rad_s=(0.0, 30.0, 9.0), **EASY))
    slow, at = [image for image, _ in drawn], [truth.time_s for _, truth in drawn]
    for k, (image, time_s) in enumerate(zip(slow, at, strict=True)):
        PIL.Image.fromarray(image).save(tmp_path / f"{k}.png")
    (tmp_path / "times.csv").write_text("frame,time_s\n" + "".join(f"{k},{t!r}\n" for k, t in enumerate(at)))
    table.save(tmp_path / "table.npz")
    flags = ["--times", tmp_path / "times.csv", "--readout-ms", 2, "--json"]
    theirs = json.loads(run(command, "estimate", "--table", tmp_path / "table.npz", *flags, *sorted(tmp_path.glob("*.png"))))
    ours = estimator.estimate_sequence(slow, at, color="rgb", readout_s=0.002)
    np.testing.assert_allclose(ours.times_s, [frame["time_s"] for frame in theirs["frames"]], rtol=0, atol=1e-12)
    assert np.abs(ours.times_s - at).min() > 1e-4
    np.testing.assert_allclose(ours.spin.spin_rad_s, theirs["spin"]["spin_rad_s"], rtol=1e-6)
    with pytest.raises(ValueError, match="readout_s"):
        estimator.estimate_sequence(images, times, color="rgb", readout_s=-1.0)


def test_numpy_reads_what_is_saved(found, tmp_path):
    path = tmp_path / "clip.npz"
    found.save(path)
    with np.load(path, allow_pickle=False) as file:
        assert json.loads(file["meta"].tobytes())["sequence_format_version"] == 1
        assert np.array_equal(file["spin_covariance"], found.spin.covariance)
        offsets = file["dot_offsets"]
        assert np.array_equal(file["assignment"][offsets[3] : offsets[4]], found.frames[3].assignment)
        assert np.isnan(file["pose_quaternions_wxyz"][5]).all()


def test_a_trackers_states_are_tabulated_and_saved(clip, estimator, tmp_path):
    images, times = clip
    tracker = estimator.tracker(max_rps=50.0)
    states = [tracker.update(image, time, color="rgb") for image, time in zip(images, times, strict=True)]
    kept = spindoe.SequenceEstimate.of_states(iter(states))
    assert kept.spin is states[-1].spin
    assert all(frame is state.frame for frame, state in zip(kept.frames, states, strict=True))
    table = kept.to_dataframe()
    assert list(table["time_s"]) == times and table.attrs["frame"] == kept.frame
    assert np.isnan(kept.quaternions_wxyz[5]).all() and table["reason"][5]
    for k, state in enumerate(states):
        if state.frame.pose:
            np.testing.assert_array_equal(kept.quaternions_wxyz[k], state.frame.pose.quaternion_wxyz)
            np.testing.assert_array_equal(kept.covariances_rad2[k], state.frame.pose.covariance)
            assert kept.frame == state.frame.pose.frame
    kept.save(tmp_path / "run.npz")
    _same(kept, spindoe.SequenceEstimate.load(tmp_path / "run.npz"))
    assert len(kept.fictrac()) == sum(bool(state.frame.pose) for state in states)
    none = spindoe.SequenceEstimate.of_states([])
    assert len(none.frames) == 0 and not none.spin and len(none.to_dataframe()) == 0


def test_other_files_are_refused_in_one_line(found, table, tmp_path):
    path = tmp_path / "clip.npz"
    load = spindoe.SequenceEstimate.load
    found.save(path)
    with np.load(path) as file:
        arrays = dict(file.items())
    meta = json.loads(arrays["meta"].tobytes())

    def refused(words, **changed):
        np.savez(path, **{name: array for name, array in {**arrays, **changed}.items() if array is not None})
        with pytest.raises(ValueError, match=words) as error:
            load(path)
        assert "\n" not in str(error.value) and str(path) in str(error.value)

    later = json.dumps({**meta, "sequence_format_version": 2}).encode()
    refused("format version 1, found 2", meta=np.frombuffer(later, np.uint8))
    refused("dots: expected", dots=None)
    refused("circles: expected shape", circles=arrays["circles"][1:])
    refused("dot_offsets: expected", dot_offsets=arrays["dot_offsets"][::-1] - arrays["dot_offsets"][-1])
    refused("assignment: expected", assignment=arrays["assignment"].astype(np.float32))
    table.save(path)
    with pytest.raises(ValueError, match="expected a sequence"):
        load(path)
    for content in (b"", b"no archive", arrays["dots"].tobytes()):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="expected a sequence"):
            load(path)
    with pytest.raises(OSError, match="nowhere"):
        load(tmp_path / "nowhere.npz")


def test_a_damaged_file_is_refused_in_one_line(clip, estimator, tmp_path):
    """Any bit and any end: what is loaded is what was saved, or a line names the file."""
    path = tmp_path / "clip.npz"
    found = estimator.estimate_sequence(clip[0][:3], clip[1][:3], color="rgb")
    found.save(path)
    content = path.read_bytes()
    random = np.random.default_rng(1)
    # What stands at the end and at the front decides how all else is read: every byte there, and others at random.
    places = [*range(len(content) - 250, len(content)), *range(100), *random.integers(0, len(content), 200)]
    refused = 0
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        try:
            _same(spindoe.SequenceEstimate.load(path), found)
        except ValueError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
    assert refused > len(places) // 2
    for end in random.integers(0, len(content), 50):
        path.write_bytes(content[:end])
        with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: expected a sequence"):
            spindoe.SequenceEstimate.load(path)


def test_the_data_frame_is_the_commands_table(pattern, estimator, command, tmp_path):
    cv2 = pytest.importorskip("cv2")
    drawn = spindoe.synth(pattern, 10, seed=4, fps=350.0, spin_rad_s=SPIN, **EASY)
    images, times = [], []
    (tmp_path / "clip").mkdir()
    for image, truth in drawn:
        nanoseconds = round(truth.time_s * 1e9) + 10**9
        cv2.imwrite(str(tmp_path / f"clip/{nanoseconds}.png"), image[..., ::-1])
        images.append(image)
        times.append(nanoseconds / 1e9)
    pattern.save(tmp_path / "pattern.csv")
    run(command, "estimate", tmp_path / "clip", "--table", tmp_path / "pattern.csv", "-o", tmp_path / "found.csv")
    theirs = pandas.read_csv(tmp_path / "found.csv")
    ours = estimator.estimate_sequence(images, times, color="rgb").to_dataframe()
    theirs["residual_rad"] = np.deg2rad(theirs.pop("residual_deg"))
    theirs = theirs.drop(columns="frame")
    assert set(theirs) <= set(ours) and (ours["reason"] == "").all() and len(ours) == 10
    for name in theirs:
        if name == "camera_frame":
            assert list(ours[name]) == list(theirs[name])
        else:
            assert np.allclose(ours[name], theirs[name], rtol=1e-9, atol=1e-12), name


def test_a_rejected_frame_has_a_row(found):
    rows = found.to_dataframe()
    assert rows["reason"][5] == found.frames[5].pose.reason and rows["confidence"][5] == 0.0
    assert np.isnan(rows["qw"][5]) and rows["camera_frame"][5] == "" and rows["camera_frame"][4] == "view"
    assert rows["radius_px"][4] == found.frames[4].circle[2]


def test_a_rejected_frame_counts_for_nothing_where_its_numbers_are_read(found):
    assert np.isnan(found.covariances_rad2[5]).all()
    path = found.fictrac()
    assert len(path) == sum(bool(frame.pose) for frame in found.frames) and 6 not in path.to_dataframe().iloc[:, 0].to_list()
    again = spindoe.fit_spin(found.times_s, found.quaternions_wxyz, covariances_rad2=found.covariances_rad2, frame=found.frame)
    assert again and np.isfinite(again.covariance).all()
    broken = found.covariances_rad2.copy()
    broken[2] = np.nan
    for of in (spindoe.fit_spin, spindoe.fictrac):
        with pytest.raises(ValueError, match="covariances_rad2: row 2"):
            of(found.times_s, found.quaternions_wxyz, covariances_rad2=broken)


def test_where_an_extra_is_missing_one_line_says_what_to_install(found, clip, table, tmp_path, monkeypatch):
    frame, spin, times = found.frames[0], found.spin, found.times_s[:4]
    hasher = spindoe.compat.BayGeoHasher()
    hasher.gen_hash_table(table.pattern.dots)
    turns = spin.as_rotation(times)
    regressor = spindoe.compat.SpinRegressor()
    core = SpinCore(Settings(str(ROOT / "designs/dots20/table.npz")))
    for library, extra, call in [
        ("pandas", "pandas", found.to_dataframe),
        ("matplotlib", "plot", found.plot),
        ("matplotlib", "plot", table.pattern.plot),
        ("matplotlib", "plot", lambda: frame.plot(clip[0][0], table=table, color="rgb")),
        ("scipy", "scipy", frame.pose.as_rotation),
        ("scipy", "scipy", spin.as_rotation),
        ("scipy", "scipy", lambda: spin.as_rotation(times)),
        ("scipy", "scipy", lambda: spindoe.compat.BayGeoHasher().gen_hash_table(table.pattern.dots)),
        ("scipy", "scipy", lambda: hasher.verification(0, 1, table.pattern.dots)),
        ("scipy", "scipy", lambda: regressor.regress(times, turns)),
        ("scipy", "scipy", lambda: regressor.quat2rot([1.0, 0.0, 0.0, 0.0])),
        ("scipy", "scipy", lambda: spindoe.compat.SpinDOE.predicted_rots(None, turns, 0.0, times, spin.spin_rad_s)),
        ("trimesh", "mesh", lambda: spindoe.Stencil(table).to_trimesh("a")),
        ("ray", "ray", lambda: list(_cluster.run(print, [()], ray="local"))),
        ("rosbags", "ros", lambda: bag.process(tmp_path / "in", tmp_path / "out", core)),
    ]:
        with monkeypatch.context() as without:
            # All of it, however much is imported.
            for name in [library, *(name for name in sys.modules if name.startswith(f"{library}."))]:
                without.setitem(sys.modules, name, None)
            with pytest.raises(ValueError, match=rf"^{library}: .*pip install spindoe\[{extra}\]$"):
                call()


def test_without_rosbags_the_command_says_what_to_install(tmp_path):
    """Also where the module itself is run: it imports nothing of its extra."""
    script = (
        "import sys; sys.modules['rosbags'] = None; from spindoe_ros import bag\n"
        f"sys.exit(bag.main(['in', {str(tmp_path / 'out')!r}, '--table', 'dots20']))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("spindoe_ros.bag: rosbags: ") and "pip install spindoe[ros]" in done.stderr


@pytest.mark.parametrize(
    "reason", ["ImportError('libGL.so.1: cannot open\\nshared object file')", "ModuleNotFoundError('no arrow', name='arrow')"]
)
def test_an_extra_that_is_there_and_broken_says_why(reason, tmp_path, monkeypatch):
    (tmp_path / "broken_extra.py").write_text(f"raise {reason}")
    monkeypatch.syspath_prepend(tmp_path)
    words = "libGL.so.1: cannot open shared object file" if "libGL" in reason else "no arrow"
    with pytest.raises(ValueError, match=rf"^broken_extra: it is installed and cannot be imported: {words}$"):
        optional("broken_extra", "live")


def test_the_package_needs_none_of_its_extras():
    """Nothing optional is imported before it is used."""
    script = (
        "import sys, spindoe, spindoe.live\n"
        "print([n for n in ('cv2', 'rerun', 'pandas', 'matplotlib', 'scipy', 'ray') if n in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "[]\n"


def test_a_sequence_is_drawn_by_its_orientations(found):
    """The turns are those of the quaternions, and aliases leave the limits alone."""
    ax = found.plot()
    low, high = ax.get_ylim()
    points = ax.containers[0].lines[0].get_xydata()
    posed = [k for k in range(14) if k != 5]
    assert np.allclose(points[:, 0], (found.times_s - found.times_s[0])[posed])
    assert points[:, 1].min() > low and points[:, 1].max() < high
    assert high - low < 1.5 * np.ptp(points[:, 1])
    # From one frame to the next the ball turns by the angle between their quaternions.
    a, b = found.quaternions_wxyz[0], found.quaternions_wxyz[1]
    angle = 2 * np.arccos(min(1.0, abs(a @ b)))
    assert points[1, 1] - points[0, 1] == pytest.approx(angle / (2 * np.pi), rel=0.02)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    fastest = np.linalg.norm(found.spin.aliases[0].spin_rad_s) / (2 * np.pi)
    assert f"or {fastest:.0f} rps" in labels and fastest > 10 * (high - low)
    plt.close("all")
    rejected = dataclasses.replace(found, spin=spindoe.Rejection("too few"))
    with pytest.raises(ValueError, match="too few"):
        rejected.plot()


def _svg(html):
    root = ET.fromstring(html)
    return root, root.find("{http://www.w3.org/2000/svg}svg")


def _all(svg, name):
    return list(svg.iter("{http://www.w3.org/2000/svg}" + name))


def test_a_pattern_is_shown_with_every_dot_in_its_place(pattern, table):
    _, svg = _svg(pattern._repr_html_())
    ellipses = _all(svg, "ellipse")
    numbers = [int(text.text) for text in _all(svg, "text")]
    assert sorted(numbers) == list(range(20))
    for number, ellipse in zip(numbers, ellipses, strict=True):
        x, y, z = pattern.dots[number]
        at = np.array([100.0 if z > 0 else 300.0, 100.0]) + 90.0 * np.array([x if z > 0 else -x, -y])
        assert np.allclose([float(ellipse.get("cx")), float(ellipse.get("cy"))], at, atol=0.01)
        assert float(ellipse.get("rx")) <= float(ellipse.get("ry"))
    root, svg = _svg(table._repr_html_())
    design = table.design
    radius = 90.0 * design.dot_diameter_mm / design.ball_diameter_mm
    assert float(_all(svg, "ellipse")[0].get("ry")) == pytest.approx(radius, rel=0.01)
    assert "HashTable of" in "".join(root.itertext())


def test_frames_and_sequences_are_shown(found):
    frame = found.frames[0]
    _, svg = _svg(frame._repr_html_())
    assert len(_all(svg, "circle")) == 1 + len(frame.dots)
    assert [int(text.text) for text in _all(svg, "text")] == list(frame.assignment[frame.assignment >= 0])
    root, _ = _svg(found.frames[5]._repr_html_())
    assert found.frames[5].pose.reason in "".join(root.itertext())
    root, svg = _svg(found._repr_html_())
    bars = _all(svg, "rect")
    assert len(bars) == 14 and [k for k, bar in enumerate(bars) if bar.get("fill") == on_white(OTHER)] == [5]
    heights = [float(bar.get("height")) for k, bar in enumerate(bars) if k != 5]
    assert np.allclose(heights, [40 * c for k, c in enumerate(found.confidences) if k != 5], atol=0.01)
    assert " rps" in "".join(root.itertext())


def test_an_exposure_settles_the_alias(pattern):
    # 90 revolutions per second look like 30 at 120 frames per second.
    spin = 2.0 * np.pi * 90.0 * np.array([0.6, 0.0, 0.8])
    drawn = list(
        spindoe.synth(pattern, 10, preset="good", seed=2, fps=120.0, spin_rad_s=spin, exposure_s=0.0003)
    )
    images, times = [image for image, _ in drawn], [truth.time_s for _, truth in drawn]
    blurred = spindoe.Estimator(pattern, measures_blur=True)
    settled = blurred.estimate_sequence(images, times, color="rgb", exposure_s=0.0003).spin
    assert abs(settled.rps - 90.0) < 0.5 and not settled.aliases
    open_ = blurred.estimate_sequence(images, times, color="rgb").spin
    assert abs(open_.rps - 30.0) < 0.5 and open_.aliases
    for exposure_s in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="exposure_s: expected a positive number"):
            blurred.estimate_sequence(images, times, color="rgb", exposure_s=exposure_s)
    with pytest.raises(ValueError, match="measures_blur=True"):
        spindoe.Estimator(pattern).estimate_sequence(images, times, color="rgb", exposure_s=0.0003)
