"""Several balls, and exposures with several flashes: Python and the command give the same."""

from __future__ import annotations

import json

import numpy as np
import PIL.Image
import pytest
from conftest import run

import spindoe


def test_the_spin_of_an_exposure(command, tmp_path):
    folder = tmp_path / "exposures"
    run(command, "synth", "dots20", "--strobe-ms", "0,0.9,2.1", "--frames", 1, "--seed", 4, "-o", folder)
    image = folder / "images/frame-000000.png"
    flags = ("--strobe-ms", "0,0.9,2.1", "--max-spin-rps", 250, "--json")
    theirs = json.loads(run(command, "estimate", "--table", folder / "table.npz", *flags, image))
    theirs = theirs["frames"][0]["strobe"]["hypotheses"]
    balls = spindoe.Balls(spindoe.Estimator(folder / "table.npz"), count=3)
    ours = balls.estimate_strobe(image, [0.0, 0.9e-3, 2.1e-3])
    assert len(ours.balls) == 3 and len(ours.hypotheses) == len(theirs)
    assert ours.hypotheses[0].missed == () and len(ours.hypotheses[0].lit) == 3
    for a, b in zip(ours.hypotheses, theirs, strict=True):
        assert a.flight == b["flight"]
        assert a.probability == pytest.approx(b["probability"], abs=1e-9)
        # The command reads bytes, whose sums are rounded once; numbers are rounded before.
        np.testing.assert_allclose(a.spin_rad_s, b["spin"]["spin_rad_s"], rtol=1e-6)
        # Golf's words by their definitions: a level camera sees the flight from the side.
        along = {"left": [-1.0, 0.0, 0.0], "right": [1.0, 0.0, 0.0]}[a.flight]
        right, up = np.cross(along, [0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0])
        words = [np.linalg.norm(a.spin_rad_s), *(a.spin_rad_s @ axis for axis in (right, -up, along))]
        golf = a.golf
        assert golf is not None
        ours_rpm = [golf.total_rpm, golf.backspin_rpm, golf.sidespin_rpm, golf.rifle_rpm]
        np.testing.assert_allclose(ours_rpm, np.array(words) * 30.0 / np.pi, rtol=1e-9)
        assert golf.tilt_deg == pytest.approx(np.rad2deg(np.arctan2(golf.sidespin_rpm, golf.backspin_rpm)))
    # Three images agree and one order fits; nothing checks two.
    assert ours.hypotheses[0].golf.spin_type == "measured"
    pairs = balls.estimate_strobe(image, [0.0, 0.9e-3])
    assert {h.golf.spin_type for h in pairs.hypotheses if h.golf} == {"estimated"}
    with pytest.raises(ValueError, match="strobe"):
        balls.estimate_strobe(image, [0.0, 0.0])
    with pytest.raises(ValueError, match="strobe"):
        balls.estimate_strobe(image, [0.0, 1.5])
    # Of several tables all images of an exposure have the one that explains them best together.
    two = spindoe.Balls([spindoe.Estimator("dots24"), *balls.estimators], count=3)
    by_two = two.estimate_strobe(image, [0.0, 0.9e-3, 2.1e-3])
    assert len(by_two.balls) == 3
    for ball in by_two.balls:
        assert ball.table_probabilities[1] == pytest.approx(1.0, abs=1e-6)
    alone, of_two = ours.hypotheses[0].spin_rad_s, by_two.hypotheses[0].spin_rad_s
    assert np.linalg.norm(of_two - alone) < 0.02 * np.linalg.norm(alone)
    with pytest.raises(ValueError, match="flight"):
        balls.estimate_strobe(image, [0.0, 1e-3], flight="sideways")  # type: ignore[arg-type]


def test_balls_of_two_tables_keep_their_numbers(command, tmp_path):
    folder = tmp_path / "two"
    run(command, "synth", "dots20", "--also", "dots32", "--ball-px", 70, "--frames", 6, "-o", folder)
    tables = [folder / "table.npz", folder / "table2.npz"]
    balls = spindoe.Balls([spindoe.Estimator(table) for table in tables])
    images = sorted((folder / "images").glob("*.png"))
    frames = balls.estimate_sequence(images, np.arange(6) / 350)
    named: dict[int | None, set[str]] = {}
    for frame in frames:
        for ball in frame:
            if ball.frame.pose:
                named.setdefault(ball.number, set()).add(ball.table.pattern.sha256)
                assert sum(ball.table_probabilities) == pytest.approx(1.0)
    assert len(named) == 2
    assert all(len(tables) == 1 for tables in named.values())
    assert [b.frame.circle for b in balls.estimate(images[0])]
    # In a mirror none keeps its pose, until it is said.
    flipped = [np.ascontiguousarray(np.asarray(PIL.Image.open(image).convert("RGB"))[:, ::-1]) for image in images]
    times = np.arange(6) / 350
    heard: list[int] = []
    mirrored = balls.estimate_sequence(flipped, times, color="rgb", progress=lambda done, _: heard.append(done))
    assert not any(ball.frame.pose for frame in mirrored for ball in frame) and heard == [6]
    read = balls.estimate_sequence(flipped, times, color="rgb", mirrored=True)
    count = lambda found: sum(bool(ball.frame.pose) for frame in found for ball in frame)  # noqa: E731
    assert count(read) == count(frames) > 0
    with pytest.raises(ValueError, match="balls"):
        spindoe.Balls(balls.estimators, count=0)
