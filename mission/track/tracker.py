"""The tracker: the same person from frame to frame, or "lost"; never somebody else.

Who is who is decided among everybody in view (`crowd`), by place, size and colours; only while nearly all of the weight
is on one of them the target is "tracking". Where it is, to a fraction of a pixel, is measured by two detectors in
upright windows scaled to the body, so that whatever bias they have is the same at all distances: HOG says where the
body is sideways, since it learnt head, shoulders and torso, which hardly swing with arms and legs; NanoDet says how
high and how tall it is. Neither has a memory, so neither drifts. Correlation of head and shoulders bridges the frames
that neither understands; it is not used beyond that, since in front of a background that moves it slides off the body.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mission.detect.hog import WindowedHog
from mission.detect.nanodet import NanoDet
from mission.detect.window import Window, cut_window
from mission.errors import DetectionError
from mission.records import Box, Frame, Image, Vector
from mission.track import noise
from mission.track.appearance import Histogram, colours
from mission.track.crowd import Body, Crowd, Told
from mission.track.detections import BodyDetection, WindowDetectors, innovation_length
from mission.track.initiation import initial_detection
from mission.track.motion import Motion
from mission.track.target import NEAR, Target, beside
from mission.track.template import Template
from mission.track.track import Track, TrackState
from mission.track.walk import Seen, Walk

COASTING_S = 3.5
"""How long a hidden person is waited for: a walker needs that to pass behind a car or the corner of a house."""
_BODY = WindowedHog.BODY_PX
_MIDDLE = np.array(WindowedHog.SIZE) / 2.0
_SURE = (0.9, 0.97)
"""Probability from which on who is followed goes on to be, and from which on somebody is taken for the target again."""
_MISTAKABLE = (0.98, 4)
"""Probability, and looks running, for the second where somebody of the same looks is near: errors of successive looks
have much in common, so that a wrong way may seem sure for a moment."""
_SURE_CUT_OFF = 0.7
"""The first of these where the picture cuts the target off: it is near and large, and second boxes are mostly parts of
itself."""
_LOOK_S = 0.1
"""How often everybody is looked at: looks that follow closely tell the same, and would count as if they did not."""
_RETURNING = 2
"""In how many looks running somebody must surely be the target to be followed after it was out of sight."""
_ASTRAY = 0.3
"""A measured place this far from the box that was told, in body heights, is of something else."""
_GOOD_MATCH = 0.7
"""Smallest correlation that is believed."""
_UNSEEN_S = 0.25
"""How long correlation is believed without a detector agreeing: later it may have slid onto the background."""
_TEMPLATE_S = 0.2
"""Age at which the template is renewed."""
_FRESH_HEIGHT_S = 0.5
"""How long a height is reported after it was last measured."""
_BOTH_S = 0.08
"""Time between frames from which on both detectors look at each."""


class Tracker:
    """Follows one person.

    Args:
        network: the NanoDet network, to share one that is already loaded.
    """

    def __init__(self, network: NanoDet | None = None) -> None:
        self._eyes = WindowDetectors(network or NanoDet())
        self._target: Target | None = None
        self._frames = 0

    def start(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> None:
        """Take whoever is in the box as the target.

        Args:
            frame: the frame in which it was detected.
            box: of the person, from a detector or drawn by hand, roughly head to foot.
            roll_rad: of the camera about its optical axis, positive with the right side down.

        Raises:
            DetectionError: there is no person in the box.
        """
        self._begin(frame, self._whole(frame, box, roll_rad), roll_rad)

    def take_back(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> bool:
        """Follow the target again, after it was lost, if it is who is in a box: the colours tell.

        Args:
            frame: the frame in which the person was detected.
            box: of the person, from a detector.
            roll_rad: as for `start`.

        Raises:
            DetectionError: there is no person in the box, or `start` was never called.
        """
        target = self._target
        if target is None:
            raise DetectionError("The tracker was not started", "Choose a target first.")
        body = self._whole(frame, box, roll_rad)
        if not target.crowd.looks_like_target(_looks(frame.image, body, body.tall(body.height_px), roll_rad)):
            return False
        self._begin(frame, body, roll_rad).crowd.remember(target.crowd)
        return True

    def update(
        self,
        frame: Frame,
        shift_px: tuple[float, float] = (0.0, 0.0),
        roll_rad: float = 0.0,
        passed: tuple[float, float] = (0.0, 0.0),
    ) -> Track:
        """Follow the target into the next frame.

        Args:
            frame: the next frame.
            shift_px: how far the picture moved, around the target, by the camera's own rotation since
                the last frame.
            roll_rad: of the camera about its optical axis, positive with the right side down; without it, size and
                place wander a little with the camera's roll.
            passed: how far the camera's travel moved people since the last frame, in their own heights: who looks half
                as tall is twice as far away, and moves half as far.

        Raises:
            DetectionError: `start` was not called.
        """
        target = self._target
        if target is None:
            raise DetectionError("The tracker was not started", "Choose a target first.")
        if target.state == "lost":
            return self._track(frame, target, 0.0)
        self._frames += 1
        dt_s = target.predict(frame.t_s, shift_px, passed)
        if frame.t_s - target.look_s >= _LOOK_S:
            self._look(frame, target, roll_rad)
        if target.state == "tracking" and not self._measure(frame, target, roll_rad, dt_s):
            # Nobody is where the target should be: everybody has to be looked at.
            if target.look_s < frame.t_s:
                self._look(frame, target, roll_rad)
            if target.state == "tracking" and target.box is None:
                target.state = "coasting"
        if target.state == "coasting":
            return self._coast(frame, target)
        target.seen_s = frame.t_s
        return self._track(frame, target, target.alike)

    def _whole(self, frame: Frame, box: Box, roll_rad: float) -> BodyDetection:
        body = initial_detection(self._eyes, frame.image, box, roll_rad)
        _, bodies = self._eyes.bodies(frame.image, body.centre, body.height_px, roll_rad)  # now at the right scale
        return min(bodies, key=lambda b: float(np.hypot(*np.subtract(b.centre, body.centre))), default=body)

    def _begin(self, frame: Frame, body: BodyDetection, roll: float) -> Target:
        height, centre = body.height_px, body.centre
        window = _upright(frame.image, centre, height, roll)
        hog = self._eyes.centre(window, NEAR)
        if hog is not None:
            window = _upright(frame.image, window.to_frame(hog.x_px, float(_MIDDLE[1])), height, roll)
        size_sigma = noise.HEIGHT_SIGMA if body.whole else noise.CUT_OFF_SIZE_SIGMA
        place = window.to_frame(*_MIDDLE)
        looks = colours(window, _MIDDLE, _BODY)
        seen = Seen(*place, math.log(height) if body.whole else None)
        crowd = Crowd(Body(seen, looks, height), frame.t_s)
        self._target = Target(
            t_s=frame.t_s,
            motion=Motion(place, height, noise.SIDEWAYS_SIGMA, size_sigma),
            crowd=crowd,
            template=Template.cut(window.image, _MIDDLE, _BODY, frame.t_s),
            seen_s=frame.t_s,
            agreed_s=frame.t_s,
            height_s=frame.t_s if body.whole else -np.inf,
            whole_s=frame.t_s,
            look_s=frame.t_s,
            cut_off=not body.whole,
        )
        return self._target

    def _look(self, frame: Frame, target: Target, roll: float) -> None:
        """Look at everybody, and decide whether one of them is surely the target."""
        target.look_s = frame.t_s
        walk = target.crowd.best.people[0].walk
        window, found = self._eyes.everybody(frame.image, (walk.x_px, walk.y_px), walk.height_px, roll)
        bodies = [_body(window, one, walk.height_px, roll) for one in found]
        told = target.crowd.look(bodies, frame.t_s, lambda w: _in_view(window, w))
        target.alike = told.alike
        target.box = None if told.box is None else found[told.box]
        target.near = tuple(one for k, one in enumerate(found) if k != told.box)
        tracking = target.state == "tracking"
        mistakable = not tracking and target.crowd.mistakable(told)
        returning = (_SURE[1], _RETURNING) if not mistakable else _MISTAKABLE
        least = returning[0] if not tracking else _SURE_CUT_OFF if target.cut_off else _SURE[0]
        sure = told.box is not None and told.probability >= least
        target.sure = target.sure + 1 if sure else 0
        if tracking:
            if not sure:
                target.state = "coasting"
                target.motion.vanish()
        elif target.sure >= returning[1]:
            self._resume(frame, target, told, roll)

    def _resume(self, frame: Frame, target: Target, told: Told, roll: float) -> None:
        """The target is in view again."""
        if target.box is not None:
            _restart(target, target.box, told.person.walk.height_px, roll)
            target.state = "tracking"
            target.agreed_s = target.whole_s = frame.t_s

    def _measure(self, frame: Frame, target: Target, roll: float, dt_s: float) -> bool:
        """Where the target is, finely; False where nothing sees it."""
        told = target.box if target.look_s == frame.t_s else None
        if told is not None and innovation_length(told, target.motion.pixel, target.motion.height_px, roll) > (
            _ASTRAY * target.motion.height_px
        ):
            _restart(target, told, target.motion.height_px, roll)
        window = _upright(frame.image, target.motion.pixel, target.motion.height_px, roll)
        looks = [self._see_sideways, self._see_upright]
        if self._frames % 2:
            looks.reverse()
        agreed = False
        for look in looks:
            # Where one detector does not see the target, the other may.
            if not agreed or dt_s >= _BOTH_S:
                agreed = look(frame, target, window, roll) or agreed
        if not agreed and told is not None:
            agreed = self._use(frame, target, told, roll)
        if not agreed and not self._correlate(frame, target, window):
            return False
        body = np.array(window.to_window(*_pair(target.motion.pixel)))
        if not _inside(window, body):
            target.box = None
            return False
        if agreed:
            target.agreed_s = frame.t_s
            if target.template is None or frame.t_s - target.template.t_s >= _TEMPLATE_S:
                target.template = Template.cut(window.image, body, _BODY, frame.t_s)
        return True

    def _see_sideways(self, _frame: Frame, target: Target, window: Window, _roll: float) -> bool:
        """HOG: where the body is sideways."""
        hog = None if target.crowded else self._eyes.centre(window, NEAR)
        if hog is None:
            return False
        x, _ = window.to_frame(hog.x_px, float(_MIDDLE[1]))
        target.motion.see_finely(0, x, noise.SIDEWAYS_SIGMA)
        return True

    def _see_upright(self, frame: Frame, target: Target, _window: Window, roll: float) -> bool:
        """NanoDet: how high and how tall the body is, and who else is near."""
        height, expected = target.motion.height_px, target.motion.pixel
        _, bodies = self._eyes.bodies(frame.image, _pair(expected), height, roll)
        bodies.sort(key=lambda b: innovation_length(b, expected, height, roll))
        body = next((b for b in bodies if target.may_be(b, roll)), None)
        target.crowded = any(beside(b, expected, height) for b in [*bodies, *target.near] if b is not body)
        if body is None:
            return False
        if body.window_cuts:
            body = self._eyes.entire(frame.image, body, roll)
        return self._use(frame, target, body, roll)

    def _use(self, frame: Frame, target: Target, body: BodyDetection, roll: float) -> bool:
        """Take in how high and how tall a body is."""
        height = target.motion.height_px
        stretched = body.whole and target.stretched(body, roll)
        target.cut_off = stretched or not body.whole
        middle = replace(body, feet_visible=False).middle(height, roll) if stretched else body.middle(height, roll)
        if not target.cut_off:
            target.motion.see_height(body.height_px, noise.HEIGHT_SIGMA)
            target.motion.see_finely(1, body.centre[1], noise.UPRIGHT_SIGMA)
            target.height_s = frame.t_s
        elif middle is not None:
            target.motion.see(1, middle[1], noise.CUT_OFF_SIGMA)
        # Arms and legs swing NanoDet's box sideways, so it counts only where HOG is silent.
        if target.crowded or target.motion.sigma_px[0] > noise.BOX_SIDEWAYS_SIGMA * height:
            target.motion.see(0, body.centre[0], noise.BOX_SIDEWAYS_SIGMA)
        return True

    def _correlate(self, frame: Frame, target: Target, window: Window) -> bool:
        """Head and shoulders by correlation with the last frames: a bridge over frames that no detector understands."""
        if target.template is None or frame.t_s - target.agreed_s > _UNSEEN_S:
            return False
        match = target.template.find(window.image, _MIDDLE, _BODY)
        if match is None or match.score < _GOOD_MATCH:
            return False
        for axis, value in enumerate(window.to_frame(match.x_px, match.y_px)):
            target.motion.see(axis, value, noise.MATCH_SIGMA)
        return True

    def _coast(self, frame: Frame, target: Target) -> Track:
        if frame.t_s - target.seen_s > COASTING_S:
            target.state = "lost"
        return self._track(frame, target, 0.0)

    def _track(self, frame: Frame, target: Target, score: float) -> Track:
        state: TrackState = target.state
        if state == "tracking":
            height, (x, y) = target.motion.height_px, _pair(target.motion.pixel)
            filter_px = float(target.motion.sigma_px.max())
        else:
            walk = target.crowd.best.people[0].walk
            height, x, y = walk.height_px, walk.x_px, walk.y_px
            filter_px = height * walk.sigma
        fresh = state == "tracking" and frame.t_s - target.height_s <= _FRESH_HEIGHT_S
        return Track(
            frame_index=frame.index,
            t_s=frame.t_s,
            state=state,
            box=Box(x - 0.2 * height, y - 0.5 * height, 0.4 * height, height),
            pixel=(x, y),
            pixel_sigma_px=noise.pixel_sigma_px(height, filter_px, target.cut_off, target.motion.noise),
            height_px=height if fresh else None,
            size_sigma=noise.size_sigma(height, frame.t_s - target.height_s) if fresh else None,
            score=float(np.clip(score, 0.0, 1.0)),
        )


def _restart(target: Target, body: BodyDetection, height: float, roll: float) -> None:
    """Measure finely from a box on: the target was out of sight, or what was measured has strayed from it."""
    size = body.height_px if body.whole else height
    place = body.middle(size, roll) or body.centre
    size_sigma = noise.HEIGHT_SIGMA if body.whole else noise.CUT_OFF_SIZE_SIGMA
    target.motion = Motion(place, size, noise.BOX_SIDEWAYS_SIGMA, size_sigma).learnt_from(target.motion)
    target.template = None


def _body(window: Window, one: BodyDetection, height: float, roll: float) -> Body:
    """For the association: middle, height and colours."""
    tall = one.tall(height)
    middle = one.middle(tall, roll) or one.centre
    looks = colours(window, np.array(window.to_window(*middle)), tall * window.scale)
    if not one.whole and one.head_visible != one.feet_visible:
        # Where the other end of who is cut off would be is a guess.
        looks[1 if one.head_visible else 0] = 0.0
    return Body(Seen(*middle, math.log(one.height_px) if one.whole else None), looks, tall)


def _in_view(window: Window, walk: Walk) -> bool:
    """Whether the middle of the body is in the window and in the picture."""
    x, y = window.to_window(walk.x_px, walk.y_px)
    rows, columns = window.image.shape[:2]
    margin = 0.2 * walk.height_px * window.scale
    inside = margin < x < columns - margin and margin < y < rows - margin
    return inside and window.shows(x - margin, y) and window.shows(x + margin, y)


def _looks(image: Image, body: BodyDetection, height: float, roll: float) -> Histogram:
    window = _upright(image, body.middle(height, roll) or body.centre, height, roll)
    return colours(window, _MIDDLE, _BODY)


def _upright(image: Image, centre: tuple[float, float] | Vector, height: float, roll: float) -> Window:
    return cut_window(image, _pair(centre), height, _BODY, WindowedHog.SIZE, roll)


def _pair(point: tuple[float, float] | Vector) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _inside(window: Window, place: Vector) -> bool:
    """Whether the torso is inside the picture."""
    return all(window.shows(place[0] + side * 0.13 * _BODY, place[1]) for side in (-1, 1))
