"""Clips of balls that carry no pattern of ours: faces, ladybirds, footballs, dice, cookies, clocks, moons.

    python clips.py draw --clips 500 --seed 1 -o clips/
    python clips.py judge clips/ --spindoe spindoe --table table.npz [--json answers.json]

Needs numpy and OpenCV. Each clip is a folder of JPEG files: a ball of 60 to 120 pixels, textured, lit, before a plain or uneven
background, that rests, turns slowly or turns fast. `judge` counts the clips that are answered (exit code 0), and single frames at
the default confidence. Nothing here comes from spindoe's own renderer.
"""

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

Array = np.ndarray
Rng = np.random.Generator
WIDTH, HEIGHT = 320, 240
ROWS = 720
# A surface: colors (B, G, R in 0..1) on a grid of longitude and latitude.
LAT = np.linspace(math.pi / 2, -math.pi / 2, ROWS)
LON = np.linspace(-math.pi, math.pi, 2 * ROWS, endpoint=False)
DIRECTIONS = np.stack(
    [
        np.cos(LAT)[:, None] * np.cos(LON),
        np.cos(LAT)[:, None] * np.sin(LON),
        np.repeat(np.sin(LAT)[:, None], 2 * ROWS, 1),
    ],
    -1,
).astype(np.float32)


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def random_unit(rng: Rng) -> Array:
    return unit(rng.normal(size=3))


def color(rng: Rng, low: float, high: float) -> Array:
    """A color whose luma lies between two values."""
    while True:
        c = rng.uniform(0, 1, 3)
        luma = c @ (0.114, 0.587, 0.299)
        if luma > 0.02:
            wanted = rng.uniform(low, high)
            return np.clip(c * (wanted / luma), 0, 1)


def frame_of(center: Array, roll: float = 0.0) -> Array:
    """Rows: right, up and out at a place of the surface."""
    other = np.array([0.0, 0.0, 1.0]) if abs(center[2]) < 0.9 else np.array([1.0, 0, 0])
    right = unit(np.cross(other, center))
    up = np.cross(center, right)
    c, s = math.cos(roll), math.sin(roll)
    return np.stack([c * right + s * up, c * up - s * right, center])


def local(frame: Array) -> tuple[Array, Array, Array]:
    """Angles from a place of the surface, to the right and up, and the distance."""
    p = DIRECTIONS @ frame.T.astype(np.float32)
    angle = np.arccos(np.clip(p[..., 2], -1, 1))
    scale = angle / np.maximum(np.hypot(p[..., 0], p[..., 1]), 1e-6)
    return p[..., 0] * scale, p[..., 1] * scale, angle


def paint(surface: Array, cover: Array, ink: Array) -> None:
    surface += np.clip(cover, 0, 1)[..., None] * (ink - surface)


def soft(inside: Array, edge: float = 0.008) -> Array:
    """1 where the argument (radians into a shape) is positive."""
    return 0.5 + 0.5 * np.tanh(inside / edge)


def spot(surface: Array, center: Array, radius: float, ink: Array, stretch: float = 1, roll: float = 0) -> None:
    x, y, _ = local(frame_of(center, roll))
    paint(surface, soft(radius - np.hypot(x, y / stretch)), ink)


def at(frame: Array, x: float, y: float) -> Array:
    """The place so many radians to the right and up."""
    angle = math.hypot(x, y)
    if angle < 1e-9:
        return frame[2]
    aside = (frame[0] * x + frame[1] * y) / angle
    return frame[2] * math.cos(angle) + aside * math.sin(angle)


def stroke(surface: Array, a: Array, b: Array, half: float, ink: Array) -> None:
    """A great circle's arc."""
    normal = unit(np.cross(a, b))
    off = np.abs(np.arcsin(np.clip(DIRECTIONS @ normal.astype(np.float32), -1, 1)))
    middle = unit(a + b)
    reach = math.acos(float(np.clip(a @ middle, -1, 1)))
    near = np.arccos(np.clip(DIRECTIONS @ middle.astype(np.float32), -1, 1)) < reach + half
    paint(surface, soft(half - off) * near, ink)


def plain(rng: Rng, low: float = 0.6, high: float = 0.95) -> Array:
    return np.ones((ROWS, 2 * ROWS, 3), np.float32) * color(rng, low, high).astype(np.float32)


def noise(rng: Rng, scale: int) -> Array:
    rough = rng.normal(size=(scale, 2 * scale)).astype(np.float32)
    return cv2.resize(rough, (2 * ROWS, ROWS), interpolation=cv2.INTER_CUBIC)


def face(rng: Rng) -> Array:
    s = plain(rng)
    for sign in (1, -1) if rng.random() < 0.3 else (1,):
        f = frame_of(np.array([0.0, sign, 0.0]), rng.normal(0, 0.2))
        dark = color(rng, 0.0, 0.15)
        gap, size = rng.uniform(0.2, 0.4), rng.uniform(0.06, 0.14)
        height = rng.uniform(0.1, 0.3)
        for x in (-gap, gap):
            spot(s, at(f, x, height), size, dark, rng.uniform(1, 1.8))
        if rng.random() < 0.5:
            spot(s, at(f, 0, 0), size * rng.uniform(0.6, 1.1), dark)
        x, y, _ = local(f)
        ring = np.hypot(x, y - 0.1)
        wide, half = rng.uniform(0.35, 0.55), rng.uniform(0.02, 0.05)
        if rng.random() < 0.8:
            paint(s, soft(half - np.abs(ring - wide)) * (y < -0.1) * (np.abs(x) < wide * 0.8), dark)
        else:
            spot(s, at(f, 0, -0.3), size * 1.2, dark, 0.7)
        if rng.random() < 0.3:
            for x in (-0.45, 0.45):
                spot(s, at(f, x, -0.1), 0.08, np.array([0.5, 0.4, 0.95]))
    return s


def ladybird(rng: Rng) -> Array:
    s = plain(rng, 0.3, 0.6) if rng.random() < 0.7 else plain(rng)
    dark = color(rng, 0.0, 0.08)
    f = frame_of(random_unit(rng))
    for _ in range(int(rng.integers(2, 6))):
        x, y = rng.uniform(0.15, 0.9), rng.uniform(-0.9, 0.9)
        size = rng.uniform(0.06, 0.16)
        for side in (-x, x):
            spot(s, at(f, side, y), size, dark)
    spot(s, at(f, 0, 1.4), rng.uniform(0.4, 0.7), dark)
    if rng.random() < 0.6:
        stroke(s, at(f, 0, 1.0), at(f, 0, -1.4), 0.02, dark)
    return s


def vertices() -> Array:
    g = (1 + 5**0.5) / 2
    v = [(0, a, b * g) for a in (-1, 1) for b in (-1, 1)]
    return np.array([unit(np.roll(p, k)) for p in np.array(v, float) for k in range(3)])


def football(rng: Rng) -> Array:
    s = plain(rng, 0.75, 0.95)
    dark = color(rng, 0.0, 0.15)
    size, points = rng.uniform(0.25, 0.38), vertices()
    for v in points:
        f = frame_of(v)
        near = points[np.argsort(-(points @ v))[1]]
        x, y, r = local(f)
        start = math.atan2(near @ f[1], near @ f[0])
        turn = (np.arctan2(y, x) - start + math.pi / 5) % (2 * math.pi / 5) - math.pi / 5
        paint(s, soft(size * 0.81 - r * np.cos(turn)), dark)
    if rng.random() < 0.6:
        for i, a in enumerate(points):
            for b in points[i + 1 :]:
                if a @ b > 0.4:
                    stroke(s, a, b, 0.008, dark)
    return s


def logo(rng: Rng) -> Array:
    s = plain(rng)
    ink = color(rng, 0.0, 0.3)
    for _ in range(int(rng.integers(1, 3))):
        size, span = 256, rng.uniform(0.5, 1.1)
        page = np.zeros((size, size), np.uint8)
        letters = "ABCDEFGHKMNOPRSTWX0123456789***"
        word = "".join(rng.choice(list(letters), int(rng.integers(2, 7))))
        font = int(rng.integers(0, 8))
        (w, h), _ = cv2.getTextSize(word, font, 1, 2)
        scale = 0.85 * size / w
        cv2.putText(page, word, (int(0.07 * size), int(0.5 * (size + h * scale))), font, scale, 255, int(rng.integers(3, 9)), cv2.LINE_AA)
        if rng.random() < 0.4:
            for k in range(3):
                cv2.circle(page, (int(size * (0.3 + 0.2 * k)), int(size * 0.2)), 12, 255, -1, cv2.LINE_AA)
        x, y, r = local(frame_of(random_unit(rng), rng.uniform(0, 6.28)))
        mapped = cv2.remap(page, ((x / span + 0.5) * size).astype(np.float32), ((0.5 - y / span) * size).astype(np.float32), cv2.INTER_LINEAR)
        paint(s, mapped / 255.0 * (r < 1.2), ink)
    return s


def bowling(rng: Rng) -> Array:
    s = plain(rng, 0.1, 0.8)
    if rng.random() < 0.6:
        s *= np.clip(1 + 0.35 * noise(rng, 12)[..., None], 0.4, 1.5)
    f = frame_of(random_unit(rng), rng.uniform(0, 6))
    ink = color(rng, 0.0, 0.06)
    for x, y in ((-0.13, 0.12), (0.13, 0.12), (0.02, -0.25)):
        spot(s, at(f, x + rng.normal(0, 0.02), y), rng.uniform(0.06, 0.11), ink)
    return s


PIPS = {
    1: [(0, 0)],
    2: [(-1, -1), (1, 1)],
    3: [(-1, -1), (0, 0), (1, 1)],
    4: [(-1, -1), (1, 1), (-1, 1), (1, -1)],
    5: [(-1, -1), (1, 1), (-1, 1), (1, -1), (0, 0)],
    6: [(-1, -1), (1, 1), (-1, 1), (1, -1), (-1, 0), (1, 0)],
}


def dice(rng: Rng) -> Array:
    s = plain(rng, 0.7, 0.95) if rng.random() < 0.7 else plain(rng, 0.2, 0.5)
    ink = color(rng, 0.0, 0.1)
    step, size = rng.uniform(0.2, 0.33), rng.uniform(0.06, 0.11)
    axes = np.eye(3)
    for number, center in zip((1, 2, 3, 6, 5, 4), np.concatenate([axes, -axes]), strict=True):
        f = frame_of(center)
        for x, y in PIPS[number]:
            spot(s, at(f, x * step, y * step), size, ink)
    return s


def cookie(rng: Rng) -> Array:
    s = np.ones((ROWS, 2 * ROWS, 3), np.float32) * np.array([0.35, 0.55, 0.75], np.float32) * rng.uniform(0.8, 1.2)
    s *= np.clip(1 + 0.12 * noise(rng, 40)[..., None], 0.5, 1.4)
    for _ in range(int(rng.integers(6, 24))):
        spot(s, random_unit(rng), rng.uniform(0.05, 0.14), color(rng, 0.03, 0.2), rng.uniform(0.6, 1.7), rng.uniform(0, 3))
    return s


def button(rng: Rng) -> Array:
    s = plain(rng, 0.5, 0.95)
    ink = color(rng, 0.0, 0.15)
    for sign in (1, -1):
        f = frame_of(np.array([0.0, sign, 0]), rng.uniform(0, 3))
        gap, size = rng.uniform(0.12, 0.3), rng.uniform(0.05, 0.11)
        holes = [(-1, -1), (1, 1), (-1, 1), (1, -1)] if rng.random() < 0.6 else [(-1, 0), (1, 0)]
        for x, y in holes:
            spot(s, at(f, x * gap, y * gap), size, ink)
        if rng.random() < 0.5:
            _, _, r = local(f)
            paint(s, soft(0.02 - np.abs(r - rng.uniform(0.6, 1.0))), ink)
    return s


def clock(rng: Rng) -> Array:
    s = plain(rng, 0.7, 0.95)
    ink = color(rng, 0.0, 0.15)
    f = frame_of(np.array([0.0, 1, 0]), rng.uniform(0, 1))
    r = rng.uniform(0.55, 0.9)
    round_marks = rng.random() < 0.6
    for k in range(12):
        c, sn = math.cos(k * math.pi / 6), math.sin(k * math.pi / 6)
        if round_marks:
            spot(s, at(f, r * c, r * sn), 0.05 if k % 3 else 0.08, ink)
        else:
            stroke(s, at(f, 0.87 * r * c, 0.87 * r * sn), at(f, r * c, r * sn), 0.025, ink)
    for length in (0.5, 0.8):
        turn = rng.uniform(0, 6.28)
        stroke(s, f[2], at(f, length * r * math.cos(turn), length * r * math.sin(turn)), 0.025, ink)
    spot(s, f[2], 0.05, ink)
    return s


def moon(rng: Rng) -> Array:
    s = np.ones((ROWS, 2 * ROWS, 3), np.float32) * np.float32(rng.uniform(0.5, 0.8))
    s *= np.clip(1 + 0.15 * noise(rng, 16)[..., None], 0.4, 1.5)
    for _ in range(int(rng.integers(8, 30))):
        center, size = random_unit(rng), rng.uniform(0.04, 0.22)
        spot(s, center, size, np.full(3, rng.uniform(0.6, 0.95)))
        spot(s, center, size * 0.8, np.full(3, rng.uniform(0.2, 0.45)))
    return s


def basketball(rng: Rng) -> Array:
    s = np.ones((ROWS, 2 * ROWS, 3), np.float32) * np.array([0.15, 0.45, 0.85], np.float32)
    ink = color(rng, 0.0, 0.1)
    for normal in (np.array([1.0, 0, 0]), np.array([0, 1.0, 0])):
        paint(s, soft(0.02 - np.abs(np.arcsin(DIRECTIONS @ normal.astype(np.float32)))), ink)
    for sign in (1, -1):
        _, _, r = local(frame_of(np.array([0.0, 0, sign])))
        paint(s, soft(0.02 - np.abs(r - 0.8)), ink)
    return s


def eye(rng: Rng) -> Array:
    s = plain(rng, 0.85, 0.97)
    f = frame_of(random_unit(rng))
    spot(s, f[2], rng.uniform(0.3, 0.5), color(rng, 0.2, 0.5))
    spot(s, f[2], rng.uniform(0.12, 0.22), color(rng, 0.0, 0.05))
    spot(s, at(f, 0.1, 0.1), 0.05, np.ones(3))
    return s


def stars(rng: Rng) -> Array:
    s = plain(rng, 0.1, 0.9)
    ink = color(rng, 0.75, 0.95) if s.mean() < 0.5 else color(rng, 0.0, 0.2)
    for _ in range(int(rng.integers(5, 16))):
        x, y, r = local(frame_of(random_unit(rng), rng.uniform(0, 3)))
        arms = int(rng.integers(4, 7))
        size = rng.uniform(0.1, 0.25)
        wave = 0.6 + 0.4 * np.cos(arms * np.arctan2(y, x))
        paint(s, soft(size * wave - r), ink)
    return s


def polka(rng: Rng) -> Array:
    """Equal dots, evenly spread: a toy ball."""
    s = plain(rng, 0.6, 0.95)
    ink = color(rng, 0.0, 0.2)
    count = int(rng.integers(8, 40))
    size = rng.uniform(0.05, 0.14)
    for k in range(count):
        z = 1 - (2 * k + 1) / count
        turn = k * math.pi * (3 - 5**0.5)
        ring = math.sqrt(1 - z * z)
        spot(s, np.array([ring * math.cos(turn), ring * math.sin(turn), z]), size, ink)
    return s


def fruit(rng: Rng) -> Array:
    s = plain(rng, 0.4, 0.8)
    s *= np.clip(1 + 0.15 * noise(rng, 10)[..., None], 0.5, 1.4)
    for _ in range(int(rng.integers(0, 25))):
        spot(s, random_unit(rng), rng.uniform(0.02, 0.07), color(rng, 0.05, 0.3))
    spot(s, np.array([0, 0, 1.0]), rng.uniform(0.08, 0.2), color(rng, 0.05, 0.25), 1.3)
    return s


KINDS: dict[str, Callable[[Rng], Array]] = {
    f.__name__: f
    for f in (
        face, ladybird, football, logo, bowling, dice, cookie, button, clock, moon, basketball, eye, stars, polka, fruit,
    )
}  # fmt: skip


def turn(vector: Array) -> Array:
    return cv2.Rodrigues(vector.astype(float))[0]


def background(rng: Rng) -> Array:
    base = np.ones((HEIGHT, WIDTH, 3), np.float32) * color(rng, 0.03, 0.6).astype(np.float32)
    if rng.random() < 0.6:
        rough = rng.normal(size=(int(rng.integers(3, 24)), int(rng.integers(3, 32)), 3)).astype(np.float32)
        base += rng.uniform(0.02, 0.12) * cv2.resize(rough, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.clip(base, 0, 1)


class Scene:
    """What stays from frame to frame: light, camera, background, and the ball's place but for a drift."""

    def __init__(self, rng: Rng, radius: float) -> None:
        self.radius = radius
        self.gray = bool(rng.random() < 0.4)
        self.light = unit(np.array([rng.normal(0, 0.6), rng.normal(-0.5, 0.6), 1.0]))
        self.ambient, self.gloss = rng.uniform(0.3, 0.8), rng.uniform(0, 0.5) * (rng.random() < 0.6)
        self.exposure, self.sigma, self.grain = rng.uniform(0.6, 1.1), rng.uniform(0.4, 1.3), rng.uniform(0.002, 0.02)
        self.behind = background(rng)
        self.center = np.array([rng.uniform(radius + 5, WIDTH - radius - 5), rng.uniform(radius + 5, HEIGHT - radius - 5)])
        self.drift = rng.normal(0, 0.5, 2) * (rng.random() < 0.5)
        self.quality = int(rng.integers(75, 98))

    def jpeg(self, surface: Array, pose: Array, rng: Rng) -> Array:
        """The next frame: a surface under a rotation from its frame to the view frame."""
        radius, light = self.radius, self.light
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
        self.center = np.clip(self.center + self.drift, radius + 2, [WIDTH - radius - 2, HEIGHT - radius - 2])
        x, y = (u - self.center[0]) / radius, (v - self.center[1]) / radius
        out = np.hypot(x, y)
        z = np.sqrt(np.clip(1 - out**2, 0, 1))
        seen = np.stack([x, -y, z], -1) @ pose.astype(np.float32)
        lat = np.arcsin(np.clip(seen[..., 2], -1, 1))
        lon = np.arctan2(seen[..., 1], seen[..., 0])
        rows = (math.pi / 2 - lat) / math.pi * (ROWS - 1)
        columns = (lon + math.pi) / (2 * math.pi) * 2 * ROWS
        ball = cv2.remap(surface, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        facing = np.clip(x * light[0] + y * light[1] + z * light[2], 0, 1)
        lit = ball * (self.ambient + (1 - self.ambient) * facing)[..., None]
        half = unit(light + np.array([0, 0, 1.0]))
        lit += self.gloss * (np.clip(x * half[0] + y * half[1] + z * half[2], 0, 1) ** 60)[..., None]
        inside = np.clip((1 - out) * radius + 0.5, 0, 1)[..., None]
        image = self.behind + inside * (lit - self.behind)
        image = cv2.GaussianBlur(np.clip(image * self.exposure, 0, 1) ** (1 / 1.1), (0, 0), self.sigma)
        image = np.clip(image + rng.normal(0, self.grain, image.shape), 0, 1)
        image = (255 * image).astype(np.uint8)
        if self.gray:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        ok, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.quality])
        assert ok
        return jpeg


def clip(kind: str, rng: Rng) -> tuple[list[Array], dict[str, object]]:
    """The frames of a clip, and what it is."""
    surface = KINDS[kind](rng).astype(np.float32)
    surface = surface.clip(0, 1)
    frames = int(rng.integers(30, 61))
    radius = rng.uniform(30, 60)
    motion = str(rng.choice(["rest", "slow", "slow", "fast"]))
    degrees = {"rest": 0.0, "slow": rng.uniform(0.5, 8), "fast": rng.uniform(8, 40)}[motion]
    step = random_unit(rng) * math.radians(degrees)
    change = turn(random_unit(rng) * math.radians(degrees) * rng.uniform(0, 0.02))
    pose = turn(random_unit(rng) * rng.uniform(0, math.pi))
    # Its front towards the camera to begin with, mostly: people show what is drawn.
    if rng.random() < 0.6:
        pose = turn(rng.normal(0, 0.4, 3)) @ turn(np.array([math.pi / 2, 0, 0]))
    scene = Scene(rng, radius)
    images = []
    for _ in range(frames):
        images.append(scene.jpeg(surface, pose, rng))
        pose = turn(step) @ pose
        step = change @ step
    said = {"kind": kind, "frames": frames, "radius_px": radius, "motion": motion, "deg_per_frame": degrees, "gray": scene.gray}
    return images, said


def draw(clips: int, seed: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    kinds = list(KINDS)
    for k in range(clips):
        images, said = clip(kinds[k % len(kinds)], np.random.default_rng([seed, k]))
        to = folder / f"{k:04d}"
        to.mkdir(exist_ok=True)
        for i, jpeg in enumerate(images):
            (to / f"{i:03d}.jpg").write_bytes(jpeg.tobytes())
        (folder / f"{k:04d}.json").write_text(json.dumps(said))


def wilson(hits: int, trials: int) -> str:
    if trials == 0:
        return "-"
    z, p = 1.959964, hits / trials
    middle = (p + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * math.sqrt(p * (1 - p) / trials + z * z / (4 * trials**2))
    return f"{100 * p:.2f} % [{100 * max(middle - half, 0):.2f}, {100 * (middle + half):.2f}]"


def judge(clips: list[Path], spindoe: str, table: str, single: bool, to: Path | None) -> None:
    """Each clip by the command; with `single` each frame on its own, too."""
    answers = []
    for said in clips:
        about = json.loads(said.read_text())
        clip_folder = said.with_suffix("")
        base = [spindoe, "estimate", "--table", table, "--json"]
        done = subprocess.run([*base, str(clip_folder), "--fps", "60"], capture_output=True, text=True, check=False)
        answer = {**about, "clip": said.stem, "exit": done.returncode, "answered": 0, "single": None}
        if done.returncode not in (0, 3):
            print(said.stem, done.stderr[-300:], file=sys.stderr)
        if done.stdout.strip():
            frames = json.loads(done.stdout).get("frames", [])
            answer["answered"] = sum(f.get("refusal") is None for f in frames)
        if single:
            found = 0
            for image in sorted(clip_folder.glob("*.jpg"))[::10]:
                alone = subprocess.run([*base, str(image)], capture_output=True, text=True, check=False)
                found += alone.returncode == 0
            answer["single"] = found
            answer["singles"] = len(list(clip_folder.glob("*.jpg"))[::10])
        answers.append(answer)
        if to:
            to.write_text(json.dumps(answers))
    kinds = sorted({a["kind"] for a in answers})
    print("| balls | clips | answered | frames of these answered | single frames answered |\n|---|---|---|---|---|")
    for kind in [*kinds, None]:
        some = [a for a in answers if kind in (None, a["kind"])]
        yes = [a for a in some if a["exit"] == 0]
        share = ", ".join(f"{a['answered']} of {a['frames']}" for a in yes[:6]) or "-"
        alone = wilson(sum(a["single"] for a in some), sum(a["singles"] for a in some)) if single else "-"
        print(f"| {kind or 'all'} | {len(some)} | {wilson(len(yes), len(some))} | {share} | {alone} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    ways = parser.add_subparsers(dest="way", required=True)
    drawing = ways.add_parser("draw")
    drawing.add_argument("--clips", type=int, default=500)
    drawing.add_argument("--seed", type=int, default=1)
    drawing.add_argument("-o", "--output", type=Path, required=True)
    judging = ways.add_parser("judge")
    judging.add_argument("folder", type=Path)
    judging.add_argument("--spindoe", default="spindoe")
    judging.add_argument("--table", required=True)
    judging.add_argument("--single", action="store_true")
    judging.add_argument("--first", type=int, default=0)
    judging.add_argument("--count", type=int, default=10**6)
    judging.add_argument("--json", type=Path)
    args = parser.parse_args()
    if args.way == "draw":
        draw(args.clips, args.seed, args.output)
    else:
        clips = sorted(args.folder.glob("*.json"))[args.first : args.first + args.count]
        judge(clips, args.spindoe, args.table, args.single, args.json)


if __name__ == "__main__":
    main()
