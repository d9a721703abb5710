"""What is logged for Rerun is in the file that its own reader reads."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest

import spindoe

rr = pytest.importorskip("rerun")
SPIN = (40.0, 150.0, -60.0)


@pytest.fixture(scope="module")
def clip(pattern):
    drawn = list(spindoe.synth(pattern, 10, seed=4, fps=350.0, spin_rad_s=SPIN, ball_px=[100, 100]))
    images = [image for image, _ in drawn]
    images[4] = np.full_like(images[4], 90)
    return images, [truth.time_s for _, truth in drawn]


@pytest.fixture(scope="module")
def found(clip, estimator):
    images, times = clip
    return estimator.estimate_sequence(images, times, color="rgb")


def _rows(path, entity, component):
    """All that a file has of an entity's component: (frame, time in seconds, values)."""
    from rerun.chunk import RrdReader

    rows = []
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path != entity:
            continue
        batch = chunk.to_record_batch()
        names = batch.schema.names
        column = next((name for name in names if name.split(":")[-1] == component), None)
        if column is None:
            continue
        for k in range(batch.num_rows):
            frame = batch.column("frame")[k].as_py() if "frame" in names else None
            time = batch.column("time")[k].value * 1e-9 if "time" in names else None
            rows.append((frame, time, batch.column(column)[k].as_py()))
    return sorted(rows, key=lambda row: -1 if row[0] is None else row[0])


@pytest.fixture(scope="module")
def recorded(found, clip, table, tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "clip.rrd"
    spindoe.to_rerun(found, table=table, images=clip[0], color="rgb", path=path)
    return path


def test_images_and_detections_are_in_the_file(recorded, found, clip):
    images, times = clip
    rows = _rows(recorded, "/image", "buffer")
    assert len(rows) == 10 and [row[0] for row in rows] == list(range(10))
    for (_, time, values), image, expected in zip(rows, images, times, strict=True):
        assert time == pytest.approx(expected, abs=1e-9)
        assert np.array_equal(np.array(values[0], np.uint8).reshape(image.shape), image)
    positions = _rows(recorded, "/image/dots", "positions")
    labels = _rows(recorded, "/image/dots", "labels")
    for k, frame in enumerate(found.frames):
        assert np.allclose(np.array(positions[k][2]).reshape(-1, 2), frame.dots[:, :2] + 0.5, atol=1e-4)
        assert labels[k][2] == [str(n) if n >= 0 else "" for n in frame.assignment]
    outlines = dict((row[0], row[2]) for row in _rows(recorded, "/image/outline", "strips"))
    assert set(outlines) == set(range(10)) - {4}
    u, v, radius = found.frames[0].circle
    distances = np.linalg.norm(np.array(outlines[0][0]) - [u + 0.5, v + 0.5], axis=1)
    assert np.allclose(distances, radius, rtol=1e-5)
    assert [row[0] for row in _rows(recorded, "/image/outline", "is_recursive")] == [4]


def test_the_ball_turns_as_it_does(recorded, found, table):
    (_, _, dots), = _rows(recorded, "/world/ball/dots", "positions")
    assert np.allclose(dots, table.pattern.dots, atol=1e-6)
    turns = _rows(recorded, "/world/ball", "quaternion")
    assert [row[0] for row in turns] == [k for k in range(10) if k != 4]
    for frame, _, (xyzw,) in turns:
        assert np.allclose(np.roll(xyzw, 1), found.quaternions_wxyz[frame], atol=1e-6)
    (frame, _, (reason,)), = _rows(recorded, "/rejected", "text")
    assert (frame, reason) == (4, found.frames[4].pose.reason)
    confidences = [row[2][0] for row in _rows(recorded, "/pose/confidence", "scalars")]
    assert np.array_equal(confidences, found.confidences)


def test_the_spin_decays_as_its_motion_does(found, table, tmp_path):
    path = tmp_path / "decay.rrd"
    motion = dataclasses.replace(found.spin, model="decaying", decay_per_s=20.0)
    spindoe.to_rerun(dataclasses.replace(found, spin=motion), table=table, path=path)
    rates = np.array([row[2][0] for row in _rows(path, "/spin/rps", "scalars")])
    # As the orientations turn that the motion predicts.
    step = 1e-5
    before, after = (motion.as_rotation(found.times_s + side * step) for side in (-0.5, 0.5))
    assert np.allclose(rates, (after * before.inv()).magnitude() / step / (2 * np.pi), rtol=1e-5)
    assert rates[0] > 1.5 * rates[-1] and not _rows(path, "/image", "buffer")
    components = [[row[2][0] for row in _rows(path, f"/spin/{axis}", "scalars")] for axis in "xyz"]
    assert np.allclose(np.linalg.norm(components, axis=0), 2 * np.pi * rates)
    (_, _, (arrow,)), *_ = _rows(path, "/world/spin", "vectors")
    assert np.allclose(np.array(arrow) / 3.0, motion.axis, atol=1e-6)


def test_a_tracker_is_logged_as_it_knew_the_spin(clip, estimator, table, tmp_path):
    tracker = estimator.tracker()
    states = [tracker.update(image, time, color="rgb") for image, time in zip(*clip, strict=True)]
    path = tmp_path / "live.rrd"
    spindoe.to_rerun(states, table=table, path=path)
    known = {k: state.spin.rps for k, state in enumerate(states) if state.spin}
    assert known and {row[0]: row[2][0] for row in _rows(path, "/spin/rps", "scalars")} == pytest.approx(known)


def test_without_times_there_are_frames(clip, estimator, table, tmp_path):
    path = tmp_path / "frames.rrd"
    spindoe.to_rerun(estimator.estimate_sequence(clip[0][:2], color="rgb"), table=table, path=path)
    assert [row[:2] for row in _rows(path, "/world/ball", "quaternion")] == [(0, None), (1, None)]


@pytest.mark.parametrize("kept", [None, b"an older one"])
def test_bad_input_leaves_no_file(found, clip, estimator, table, tmp_path, monkeypatch, kept):
    """Nor a part of one, nor a recording that is open; a file that was there stays as it is."""
    path = tmp_path / "a.rrd"
    if kept is not None:
        path.write_bytes(kept)
    images, times = clip
    odd = [*images[:9], images[9][..., 0]]
    tracker = estimator.tracker()
    states = [tracker.update(image, time, color="rgb") for image, time in zip(images[:4], times, strict=False)]
    # A time that only Rerun refuses, when two frames are in the file.
    states[2] = dataclasses.replace(states[2], time_s="never")
    opened, closed = [], []
    save, disconnect = rr.RecordingStream.save, rr.RecordingStream.disconnect
    monkeypatch.setattr(rr.RecordingStream, "save", lambda self, *a: opened.append(self) or save(self, *a))
    monkeypatch.setattr(rr.RecordingStream, "disconnect", lambda self: closed.append(self) or disconnect(self))
    for given, words in [
        ({"images": []}, "images: expected 10, found 0"),
        ({"images": images}, "color"),
        ({"images": odd, "color": "rgb"}, "rgb"),
        ({"found": states}, "time"),
        ({"table": 3}, "table"),
    ]:
        with pytest.raises((ValueError, TypeError), match=words):
            spindoe.to_rerun(**{"found": found, "table": table, "path": path, **given})
        left = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
        assert left == ({} if kept is None else {"a.rrd": kept}), given.keys()
    assert len(opened) == 1 and closed == opened
    with pytest.raises(OSError, match="nowhere"):
        spindoe.to_rerun(found, table=table, path=tmp_path / "nowhere/a.rrd")


def test_bad_input_logs_nothing(found, clip, table, tmp_path):
    """Into a recording of the caller's: images are looked at before the first is logged."""
    path = tmp_path / "own.rrd"
    stream = rr.RecordingStream("test")
    stream.save(str(path))
    with pytest.raises(ValueError, match="rgb"):
        spindoe.to_rerun(
            found, table=table, images=[*clip[0][:9], clip[0][9][..., 0]], color="rgb", recording=stream
        )
    stream.disconnect()
    assert not _rows(path, "/world/ball/dots", "positions") and not _rows(path, "/image", "buffer")


def test_what_does_not_fit_is_refused(found, clip, table, tmp_path, monkeypatch):
    stream = rr.RecordingStream("test")
    with pytest.raises(ValueError, match="images: expected 10, found 2"):
        spindoe.to_rerun(found, table=table, images=clip[0][:2], color="rgb", recording=stream)
    with pytest.raises(ValueError, match="color"):
        spindoe.to_rerun(found, table=table, images=clip[0], recording=stream)
    with pytest.raises(ValueError, match="path: expected it or recording"):
        spindoe.to_rerun(found, table=table, path=tmp_path / "a.rrd", recording=stream)
    with pytest.raises(ValueError, match=r"rerun\.init"):
        spindoe.to_rerun(found, table=table)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ValueError, match=r"^rerun: .*pip install spindoe\[rerun\]$"):
        spindoe.to_rerun(found, table=table)
