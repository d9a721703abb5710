"""A ball followed as it is filmed, in a window: outline, dots with numbers, axes, spin, latency.

    python -m spindoe.live --table table.npz 0              # camera 0
    python -m spindoe.live --table table.npz clip.mp4       # or a folder of images

`show` does the same for a camera's index, a file, a folder or a generator of images with times; `follow` only estimates, and
`draw` only draws. All need OpenCV (``pip install spindoe[live]``), the window one that has windows: ``opencv-python``, not
``opencv-python-headless``.

A camera is read in a thread of its own: the newest frame is taken, and those that come while one is worked on are dropped
and counted. A frame is shown after the latency that the picture states, without what camera, driver and screen add. Files
are played at the rate of their times, every frame of them.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import threading
import time
from collections.abc import Generator, Iterable
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _palette
from ._common import Floats, aside_of, optional, rotation_matrix
from ._frame import Camera
from ._image import Color, Image, rgb8
from ._pattern import PathLike, Tabled
from ._vision import Estimator, Tracker, TrackerState

Source = int | PathLike | Iterable[tuple[Image, float]]
"""A camera's index, a video, a folder of images, or images with their times in seconds."""
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".pbm")

# Blue, green, red.
OUTLINE, IDENTIFIED, OTHER, EXPECTED = (
    color[::-1] for color in (_palette.OUTLINE, _palette.IDENTIFIED, _palette.OTHER, _palette.EXPECTED)
)
AXES = ((60, 60, 255), (60, 200, 60), (255, 120, 60))
SPIN, WORDS = (255, 80, 255), (235, 235, 235)
MIN_SIDE = 360
LINE = 18


class Followed(NamedTuple):
    """A frame that was followed."""

    image: Image
    state: TrackerState
    latency_s: float
    """Time from the frame's arrival to its answer, seconds."""
    dropped: int
    """Number of frames that were dropped so far."""


def _opencv() -> Any:
    return optional("cv2", "live")


def _projector(state: TrackerState, camera: Camera) -> tuple[tuple[float, float], Floats]:
    """Where the ball's center is, pixels, and the matrix, shape (2, 3), that takes vectors of the pose's frame, in ball
    radii, to pixels beside it: for what stands out of the ball, without perspective."""
    view = state.frame.view(camera)
    u, v, radius = view.circle
    to_view = rotation_matrix(view._handle.to_camera()).T
    return (u, v), radius * np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]) @ to_view


def draw(
    image: Image,
    state: TrackerState,
    *,
    table: Tabled,
    camera: Camera = Camera(),  # noqa: B008 (immutable)
    color: Color | None = None,
    latency_s: float | None = None,
    dropped: int | None = None,
    scale: int | None = None,
) -> NDArray[np.uint8]:
    """Draws what is known of a frame onto a copy of it: the outline green, identified detections blue with their
    numbers, others red; crosses, yellow, where the orientation expects the pattern's dots; the pattern's axes x, y, z in
    red, green, blue; the spin's axis as an arrow. The numbers are in lines below.

    Args:
        image: The image, as in `Tracker.update`.
        state: What the tracker says of it.
        table: The pattern, or its table.
        camera: The estimator's.
        color: The order of the image's channels, as in `Estimator.estimate`.
        latency_s: Time from the frame's arrival to its answer, seconds.
        dropped: Number of frames that were dropped so far.
        scale: How many times as large the image is drawn; by default so that no side is shorter than 360 pixels.

    Returns:
        Blue, green, red, as OpenCV has it; shape (scale * height + 72, scale * width, 3), uint8.
    """
    cv2 = _opencv()
    rgb = rgb8(image, color)
    height, width = rgb.shape[:2]
    enlarged = max(1, -(-MIN_SIDE // max(1, min(height, width)))) if scale is None else scale
    if enlarged < 1:
        raise ValueError(f"scale: expected 1 or more, found {scale}")
    shown = rgb[..., ::-1].repeat(enlarged, axis=0).repeat(enlarged, axis=1)
    canvas = cv2.copyMakeBorder(shown, 0, 4 * LINE, 0, 0, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    picture = canvas[: enlarged * height]

    def at(u: float, v: float) -> tuple[int, int]:
        # Pixels have their centers at whole numbers, also those of the enlarged image.
        return round(enlarged * (u + 0.5) - 0.5), round(enlarged * (v + 0.5) - 0.5)

    def say(words: str, place: tuple[int, int], paint: tuple[int, int, int], onto: Any) -> None:
        cv2.putText(onto, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, paint, 1, cv2.LINE_AA)

    frame, spin = state.frame, state.spin
    if frame.circle is not None:
        u, v, radius = frame.circle
        cv2.circle(picture, at(u, v), round(enlarged * radius), OUTLINE, 1, cv2.LINE_AA)
    if frame.pose and frame.circle is not None:
        expected, is_facing = frame.expected_dots(table, camera)
        for u, v in expected[is_facing]:
            cv2.drawMarker(picture, at(u, v), EXPECTED, cv2.MARKER_CROSS, 7, 1)
        (u, v), onto_image = _projector(state, camera)
        orientation = rotation_matrix(frame.pose.as_frame("camera").quaternion_wxyz)
        for tip, paint, name in zip(1.25 * (onto_image @ orientation).T, AXES, "xyz", strict=True):
            cv2.line(picture, at(u, v), at(u + tip[0], v + tip[1]), paint, 1, cv2.LINE_AA)
            say(name, at(u + tip[0], v + tip[1]), paint, picture)
        if spin and spin.rps > 0.0:
            tip = 1.25 * onto_image @ spin.as_frame("camera").axis
            ends = at(u - tip[0], v - tip[1]), at(u + tip[0], v + tip[1])
            cv2.arrowedLine(picture, *ends, SPIN, 1, cv2.LINE_AA, tipLength=0.06)
    for (u, v, _), number in zip(frame.dots, frame.assignment, strict=True):
        cv2.circle(picture, at(u, v), 6, IDENTIFIED if number >= 0 else OTHER, 1, cv2.LINE_AA)
        if number >= 0:
            x, y = at(u, v)
            say(str(number), (x + 7, y - 5), IDENTIFIED, picture)

    pose = frame.pose
    lines = [
        f"{state.time_s:.3f} s" + ("" if latency_s is None else f"  latency {1e3 * latency_s:.1f} ms")
        + ("" if dropped is None else f"  {dropped} dropped"),
        f"p = {pose.confidence:.4f}, {frame.matched} of {len(frame.dots)} dots" if pose else pose.reason,
    ]
    if spin:
        std = "" if spin.std_rps is None else f" +- {spin.std_rps:.2f}"
        lines += [f"{spin.rps:.2f}{std} rps", "axis " + " ".join(f"{x:+.3f}" for x in spin.axis) + f" ({spin.frame})"]
    else:
        lines.append(f"no spin: {spin.reason}")
    for k, line in enumerate(lines):
        say(line, (6, enlarged * height + LINE * (k + 1) - 5), WORDS, canvas)
    drawn: NDArray[np.uint8] = canvas
    return drawn


def _camera_frames(index: int) -> Generator[tuple[Image, float]]:
    """A camera's frames, blue, green, red, with the times of their arrival by the clock `time.monotonic`."""
    cv2 = _opencv()
    capture = cv2.VideoCapture(index)
    try:
        if not capture.isOpened():
            raise OSError(f"camera {index}: cannot be opened")
        while True:
            is_there, image = capture.read()
            if not is_there:
                raise OSError(f"camera {index}: gives no more frames")
            yield image, time.monotonic()
    finally:
        capture.release()


def _video_frames(path: Path, fps: float | None) -> Generator[tuple[Image, float]]:
    cv2 = _opencv()
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise OSError(f"{path}: cannot be read as a video")
        count = 0
        while True:
            is_there, image = capture.read()
            if not is_there:
                break
            yield image, capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3 if fps is None else count / fps
            count += 1
        if count == 0:
            raise OSError(f"{path}: has no frames")
    finally:
        capture.release()


def _folder_frames(folder: Path, fps: float | None) -> Generator[tuple[Image, float]]:
    cv2 = _opencv()
    # What `spindoe synth` wrote has a sheet of some frames beside them.
    if (folder / "images").is_dir() and (folder / "index.csv").is_file():
        folder = folder / "images"

    def in_order(path: Path) -> list[Any]:
        return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]

    paths = sorted((path for path in folder.iterdir() if path.suffix.lower() in IMAGES), key=in_order)
    if not paths:
        raise ValueError(f"{folder}: expected images ({', '.join(IMAGES)}), found none")
    for count, path in enumerate(paths):
        if fps is None and not (path.stem.isascii() and path.stem.isdigit()):
            raise ValueError(f"{path}: expected fps, or a name that is a time in nanoseconds")
        image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
        if image is None:
            raise ValueError(f"{path}: cannot be read as an image")
        yield image, int(path.stem) / 1e9 if fps is None else count / fps


def _paced(frames: Iterable[tuple[Image, float]]) -> Generator[tuple[Image, float]]:
    """The frames no sooner than their times, the first at once."""
    begun: float | None = None
    with _closed(frames):
        for image, time_s in frames:
            now = time.monotonic()
            begun = now - time_s if begun is None else begun
            time.sleep(max(0.0, begun + time_s - now))
            yield image, time_s


@contextmanager
def _closed(frames: object) -> Generator[None]:
    """Closes a generator afterwards, and with it its camera or file; of other sources nothing."""
    try:
        yield
    finally:
        close = getattr(frames, "close", None)
        if close is not None:
            close()


def _every(frames: Iterable[tuple[Image, float]]) -> Generator[tuple[Image, float, float, int]]:
    with _closed(frames):
        for image, time_s in frames:
            yield image, time_s, time.monotonic(), 0


def _newest(frames: Iterable[tuple[Image, float]]) -> Generator[tuple[Image, float, float, int]]:
    """The newest frame whenever one is asked for, with the time of its arrival and the number of those dropped so far."""
    changed = threading.Condition()
    waiting: list[tuple[Image, float, float]] = []
    ended: list[BaseException | None] = []
    dropped = 0
    is_wanted = True

    def read() -> None:
        nonlocal dropped
        error: BaseException | None = None
        try:
            with _closed(frames):
                for image, time_s in frames:
                    with changed:
                        if not is_wanted:
                            break
                        dropped += len(waiting)
                        waiting[:] = [(image, time_s, time.monotonic())]
                        changed.notify()
        except BaseException as raised:  # noqa: BLE001 (it is raised where the frames are taken)
            error = raised
        with changed:
            ended.append(error)
            changed.notify()

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        while True:
            with changed:
                changed.wait_for(lambda: waiting or ended)
                if not waiting:
                    break
                (image, time_s, arrived), lost = waiting.pop(), dropped
            yield image, time_s, arrived, lost
    finally:
        with changed:
            is_wanted = False
        # A camera is free again with its next frame.
        reader.join(timeout=1.0)
    if ended[0] is not None:
        raise ended[0]


def follow(
    source: Source, tracker: Tracker, *, color: Color | None = None, fps: float | None = None, drop: bool | None = None
) -> Generator[Followed]:
    """Follows a ball through a source's frames. When it ends, by an error too, the camera or file is free again, and a generator
    of images is closed.

    Args:
        source: A camera's index, whose times are those of arrival; a video; a folder of images, whose names are times in
            nanoseconds, unless `fps` is given; or an iterable of images with their times in seconds, increasing.
        tracker: What follows the ball.
        color: The order of the channels, as in `Tracker.update`; only for an iterable.
        fps: Frames per second of a video or folder: their times, in place of their own.
        drop: Whether frames that come while one is worked on are dropped; by default those of a camera are.

    Yields:
        Each frame that was worked on.

    Raises:
        ValueError: For a source that cannot be read, and arguments that do not belong to it.
        OSError: Where a camera or file gives no frames.
    """
    frames: Iterable[tuple[Image, float]]
    is_camera, is_file = isinstance(source, int), isinstance(source, (str, os.PathLike))
    if fps is not None and not (is_file and fps > 0.0):
        raise ValueError("fps: expected it, above 0, only for a video or a folder")
    if (is_camera or is_file) and color not in (None, "bgr"):
        raise ValueError("color: expected only with images; files and cameras are read as bgr")
    if isinstance(source, int):
        frames = _camera_frames(source)
    elif isinstance(source, (str, os.PathLike)):
        path = Path(source)
        if not path.exists() or path.suffix.lower() in IMAGES:
            found = "an image" if path.exists() else "nothing"
            raise ValueError(f"{path}: expected a video or a folder, found {found}")
        frames = _paced((_folder_frames if path.is_dir() else _video_frames)(path, fps))
    else:
        frames = source
    order = color if not (is_camera or is_file) else "bgr"
    taken = (_newest if (is_camera if drop is None else drop) else _every)(frames)
    with closing(taken):
        for image, time_s, arrived, dropped in taken:
            state = tracker.update(image, time_s, color=order)
            yield Followed(image, state, time.monotonic() - arrived, dropped)


def show(
    source: Source,
    tracker: Tracker,
    *,
    color: Color | None = None,
    fps: float | None = None,
    drop: bool | None = None,
    record: PathLike | None = None,
    window: bool = True,
) -> int:
    """Follows a ball and shows it in a window, until the source ends, the window is closed, or q or Escape is pressed.

    Args:
        source: As in `follow`.
        tracker: As in `follow`.
        color: As in `follow`.
        fps: As in `follow`.
        drop: As in `follow`.
        record: A video, ``.mp4`` or ``.avi``, to write of what is drawn; it plays 30 frames a second. It appears when this
            ends: at the source's end, by the window, by Ctrl-C, or with an `OSError`, as where a camera's cable is pulled. Any
            other error leaves none.
        window: Whether there is a window.

    Returns:
        Number of frames that were worked on.

    Raises:
        ValueError: Where OpenCV is missing or has no windows; and as `follow`.
        OSError: Where there is no screen; and as `follow`.
    """
    estimator = tracker.estimator
    if isinstance(source, (int, str, os.PathLike)):
        order: Color | None = "bgr"
    else:
        order = color
    count = 0
    with ExitStack() as opened:
        recorder = None if record is None else opened.enter_context(_Recorder(record))
        if window:
            _open_window()
            opened.callback(_opencv().destroyAllWindows)
        for followed in opened.enter_context(closing(follow(source, tracker, color=color, fps=fps, drop=drop))):
            drawn = draw(
                followed.image, followed.state, table=estimator.table, camera=estimator.camera, color=order,
                latency_s=followed.latency_s, dropped=followed.dropped,
            )
            count += 1
            if recorder is not None:
                recorder.write(drawn)
            if window and _is_closed_after(drawn):
                break
    return count


TITLE = "spindoe"


def _open_window() -> None:
    cv2 = _opencv()
    missing = "window: expected an OpenCV with windows: pip uninstall opencv-python-headless, then pip install spindoe[live]"
    if re.search(r"GUI:\s*NONE", cv2.getBuildInformation()):
        raise ValueError(missing)
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in screens):
        # Qt, beneath OpenCV's windows, ends the process then.
        raise OSError("window: there is no screen, DISPLAY is not set")
    try:
        cv2.namedWindow(TITLE, cv2.WINDOW_AUTOSIZE)
    except cv2.error as error:
        raise ValueError(missing) from error


def _is_closed_after(drawn: NDArray[np.uint8]) -> bool:
    """Shows a frame; whether the window is closed, or q or Escape was pressed."""
    cv2 = _opencv()
    cv2.imshow(TITLE, drawn)
    key = cv2.waitKey(1)
    return key in (27, ord("q")) or cv2.getWindowProperty(TITLE, cv2.WND_PROP_VISIBLE) < 1


class _Recorder:
    """A video of what is drawn, which is there afterwards whole or not at all."""

    CODECS = {".mp4": "mp4v", ".avi": "MJPG"}

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() not in self.CODECS:
            raise ValueError(f"record: expected a name that ends in .mp4 or .avi, found {self.path}")
        self.shape: tuple[int, ...] = ()
        self.writer: Any = None
        self._aside = ExitStack()

    def __enter__(self) -> _Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if self.writer is not None:
            self.writer.release()
            if kind is None or issubclass(kind, (KeyboardInterrupt, OSError)):
                # Ctrl-C ends a camera's recording, and a cable that is pulled: it has all until then.
                self._aside.close()
        self._aside.__exit__(kind, *error)

    def write(self, drawn: NDArray[np.uint8]) -> None:
        cv2 = _opencv()
        if self.writer is None:
            self.shape = drawn.shape
            codec = cv2.VideoWriter.fourcc(*self.CODECS[self.path.suffix.lower()])
            aside = self._aside.enter_context(aside_of(self.path))
            writer = cv2.VideoWriter(str(aside), codec, 30.0, (drawn.shape[1], drawn.shape[0]))
            if not writer.isOpened():
                raise OSError(f"{self.path}: cannot be written as a video")
            self.writer = writer
        if drawn.shape != self.shape:
            raise ValueError(f"record: expected frames of one size, found {drawn.shape} after {self.shape}")
        self.writer.write(drawn)


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m spindoe.live", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", help="a camera's index, a video, or a folder of images")
    parser.add_argument("--table", required=True, help="the pattern's table, or the pattern")
    parser.add_argument("--intrinsics", help="the camera's calibration: OpenCV's YAML or JSON, or ROS' camera_info")
    parser.add_argument("--fps", type=float, help="frames per second of a video or folder, in place of their own times")
    parser.add_argument(
        "--drop", action=argparse.BooleanOptionalAction, help="drop frames that come too fast [default: those of a camera]"
    )
    parser.add_argument("--record", metavar="VIDEO", help="write what is drawn, .mp4 or .avi")
    parser.add_argument("--no-window", dest="window", action="store_false", help="show nothing")
    arguments = parser.parse_args(words)
    source: Source = int(arguments.source) if arguments.source.isdecimal() else arguments.source
    try:
        camera = Camera() if arguments.intrinsics is None else Camera.read(arguments.intrinsics)
        tracker = Estimator(arguments.table, camera=camera).tracker()
        shown = show(
            source, tracker, fps=arguments.fps, drop=arguments.drop, record=arguments.record, window=arguments.window
        )
    except ValueError as error:
        print(f"spindoe.live: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"spindoe.live: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    print(f"{shown} frames")
    return 0


if __name__ == "__main__":
    sys.exit(main())
