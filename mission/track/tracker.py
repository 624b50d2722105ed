"""The tracker: the same person from frame to frame, or "lost"; never somebody else.

HOG (every other frame) says where the body is sideways: it learnt head, shoulders and torso, so it hardly swings with
arms and legs. NanoDet (the frames between) says how high and how tall the body is, which HOG does poorly. Neither has a
memory, so neither drifts, and both look at upright windows scaled to the body, so that whatever bias they have is the
same at all distances. Correlation of head and shoulders bridges the frames that neither understands; it is not used
beyond that, since in front of a background that moves it slides off the body. Colours decide whether it is still the
same person.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np

from mission.detect.hog import WindowedHog
from mission.detect.nanodet import NanoDet
from mission.detect.window import Window, cut_window
from mission.errors import DetectionError
from mission.records import Box, Frame, Image, Vector
from mission.track import noise
from mission.track.appearance import adapted, colours, likeness
from mission.track.measure import Extent, Eyes, away
from mission.track.meeting import told_apart
from mission.track.motion import Motion
from mission.track.other import may_be_taken_for, seen_again
from mission.track.target import NEAR, Target, beside
from mission.track.template import Template
from mission.track.track import Track, TrackState
from mission.track.whole_body import whole_body

COASTING_S = 2.5
"""How long a hidden person is waited for: a walker needs that to pass behind a car, half covered to half free."""
_BODY = WindowedHog.BODY_PX
_MIDDLE = np.array(WindowedHog.SIZE) / 2.0
_SAME_LOOKS = 0.55
"""Smallest likeness of colours that may be the same person."""
_SAME_LOOKS_ALONE = 0.4
"""The same for who was followed until now with nobody near: a part may be in the shade, or half out of the picture."""
_ALONE_S = 1.5
"""How long nobody else must have been near."""
_SURE_LOOKS = 0.75
"""Likeness from which on the memory of the colours follows the light."""
_GOOD_MATCH = 0.7
"""Smallest correlation that is believed."""
_UNSEEN_S = 0.25
"""How long correlation is believed without a detector agreeing: later it may have slid onto the background."""
_EARLIER_S = 0.25
"""How far back, at least, the motion is taken from when the person disappears: what was seen last was half a person."""
_TEMPLATE_S = 0.2
"""Age at which the template is renewed."""
_FRESH_HEIGHT_S = 0.5
"""How long a height is reported after it was last measured."""


class Tracker:
    """Follows one person.

    Args:
        network: the NanoDet network, to share one that is already loaded.
    """

    def __init__(self, network: NanoDet | None = None) -> None:
        self._eyes = Eyes(network or NanoDet())
        self._target: Target | None = None
        self._lost = True
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
        body = whole_body(self._eyes, frame.image, box, roll_rad)
        _, bodies = self._eyes.bodies(frame.image, body.centre, body.height_px, roll_rad)  # now at the right scale
        body = min(bodies, key=lambda b: float(np.hypot(*np.subtract(b.centre, body.centre))), default=body)
        self._begin(frame, body.centre, body.height_px, not body.whole, roll_rad)

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
        body = whole_body(self._eyes, frame.image, box, roll_rad)
        window = _upright(frame.image, body.centre, body.height_px, roll_rad)
        if likeness(colours(window, _MIDDLE, _BODY), target.looks) < _SAME_LOOKS:
            return False
        self.start(frame, box, roll_rad)
        if self._target is not None:
            self._target.looks = target.looks
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
            frame: newer than the last one.
            shift_px: how far the picture is expected to have moved at the target, by the camera's own rotation since
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
        if self._lost:
            return self._track(frame, target, "lost", 0.0)
        self._frames += 1
        hidden = target.seen_s < target.t_s
        target.foretell(frame.t_s, shift_px, passed)
        if hidden:
            return self._look_for(frame, target, roll_rad)
        return self._follow(frame, target, roll_rad)

    def _begin(self, frame: Frame, centre: tuple[float, float], height: float, cut_off: bool, roll: float) -> None:
        window = _upright(frame.image, centre, height, roll)
        hog = self._eyes.centre(window, NEAR)
        if hog is not None:
            window = _upright(frame.image, window.to_frame(hog.x_px, float(_MIDDLE[1])), height, roll)
        size_sigma = noise.CUT_OFF_SIZE_SIGMA if cut_off else noise.HEIGHT_SIGMA
        motion = Motion(window.to_frame(*_MIDDLE), height, noise.SIDEWAYS_SIGMA, size_sigma)
        self._target = Target(
            t_s=frame.t_s,
            motion=motion,
            earlier=deepcopy(motion),
            next_earlier=deepcopy(motion),
            earlier_s=frame.t_s,
            looks=colours(window, _MIDDLE, _BODY),
            template=Template.cut(window.image, _MIDDLE, _BODY, frame.t_s),
            seen_s=frame.t_s,
            agreed_s=frame.t_s,
            height_s=-np.inf if cut_off else frame.t_s,
            whole_s=frame.t_s,
            cut_off=cut_off,
        )
        self._lost = False

    def _follow(self, frame: Frame, target: Target, roll: float) -> Track:
        if target.other is not None and target.other.meets(target.motion, frame.t_s):
            return self._part(frame, target)
        window = _upright(frame.image, target.motion.pixel, target.motion.height_px, roll)
        looks = [self._see_sideways, self._see_upright]
        if self._frames % 2:
            looks.reverse()
        # Where one detector does not see the target, the other may.
        agreed = any(look(frame, target, window, roll) for look in looks)
        if target.other is not None and target.other.meets(target.motion, frame.t_s):
            return self._part(frame, target)
        if not agreed and not self._correlate(frame, target, window):
            return self._vanish(frame, target, 0.0)
        body = np.array(window.to_window(*_pair(target.motion.pixel)))
        seen = colours(window, body, _BODY)
        alike = likeness(seen, target.looks)
        alone = agreed and frame.t_s - target.company_s > _ALONE_S
        if alike < (_SAME_LOOKS_ALONE if alone else _SAME_LOOKS) or not _inside(window, body):
            return self._vanish(frame, target, alike)
        target.seen_s = frame.t_s
        if frame.t_s - target.earlier_s >= _EARLIER_S:
            target.earlier, target.next_earlier = target.next_earlier, deepcopy(target.motion)
            target.earlier_s = frame.t_s
        if agreed:
            target.agreed_s = frame.t_s
            if alike > _SURE_LOOKS:
                target.looks = adapted(target.looks, seen, 0.02)
            if target.template is None or frame.t_s - target.template.t_s >= _TEMPLATE_S:
                target.template = Template.cut(window.image, body, _BODY, frame.t_s)
        return self._track(frame, target, "tracking", alike)

    def _see_sideways(self, _frame: Frame, target: Target, window: Window, _roll: float) -> bool:
        """HOG: where the body is sideways."""
        hog = None if target.crowded else self._eyes.centre(window, NEAR)
        if hog is None:
            return False
        x, _ = window.to_frame(hog.x_px, float(_MIDDLE[1]))
        target.motion.see(0, x, noise.SIDEWAYS_SIGMA)
        return True

    def _see_upright(self, frame: Frame, target: Target, _window: Window, roll: float) -> bool:
        """NanoDet: how high and how tall the body is, and who else is near."""
        height, expected = target.motion.height_px, target.motion.pixel
        _, bodies = self._eyes.bodies(frame.image, _pair(expected), height, roll)
        bodies.sort(key=lambda b: away(b, expected, height, roll))
        body = next((b for b in bodies if target.may_be(b, roll)), None)
        others = [b for b in bodies if b is not body]
        target.crowded = any(beside(b, expected, height) for b in others)
        target.company_s = frame.t_s if others else target.company_s
        others = [
            b for b in others if may_be_taken_for(b, height) and self._alike(frame, target, b, roll) > _SAME_LOOKS
        ]
        target.other = seen_again(target.other, others, target.motion, frame.t_s, roll, body)
        if body is None:
            return False
        if body.window_cuts:
            body = self._eyes.entire(frame.image, body, roll)
        stretched = body.whole and target.stretched(body, roll)
        target.cut_off = stretched or not body.whole
        middle = replace(body, feet_visible=False).middle(height, roll) if stretched else body.middle(height, roll)
        if not target.cut_off:
            target.motion.see_height(body.height_px, noise.HEIGHT_SIGMA)
            target.motion.see(1, body.centre[1], noise.UPRIGHT_SIGMA)
            target.height_s = frame.t_s
        elif middle is not None:
            target.motion.see(1, middle[1], noise.CUT_OFF_SIGMA)
        # Arms and legs swing NanoDet's box sideways, so it counts only where HOG is silent.
        if target.crowded or target.motion.sigma_px[0] > noise.BOX_SIDEWAYS_SIGMA * height:
            target.motion.see(0, body.centre[0], noise.BOX_SIDEWAYS_SIGMA)
        return True

    def _alike(self, frame: Frame, target: Target, body: Extent, roll: float) -> float:
        """How much somebody looks like the target; where the other end of who is cut off would be is a guess."""
        seen = colours(_around(frame.image, target, body, roll), _MIDDLE, _BODY)
        if not body.whole and body.head_visible != body.feet_visible:
            seen[1 if body.head_visible else 0] = 0.0
        return likeness(seen, target.looks)

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

    def _vanish(self, frame: Frame, target: Target, score: float) -> Track:
        # The last frames showed half a person, or already somebody else.
        target.motion = deepcopy(target.earlier)
        target.motion.vanish()
        return self._coast(frame, target, score)

    def _part(self, frame: Frame, target: Target) -> Track:
        """Somebody of the same looks is about to cover the target: whoever is seen next may be the other one."""
        target.met_s = frame.t_s
        target.motion.vanish()
        if target.other is not None:
            target.other.motion.vanish()
        return self._coast(frame, target, 0.0)

    def _coast(self, frame: Frame, target: Target, score: float) -> Track:
        target.returning = 0
        if frame.t_s - target.known_s > COASTING_S:
            self._lost = True
            return self._track(frame, target, "lost", score)
        return self._track(frame, target, "coasting", score)

    def _look_for(self, frame: Frame, target: Target, roll: float) -> Track:
        """Look for somebody of the target's looks and size near where the target should be by now."""
        hidden_s = frame.t_s - target.known_s
        height = target.motion.height_px
        _, bodies = self._eyes.bodies(frame.image, _pair(target.motion.pixel), height, roll, wide=True)
        if frame.t_s - target.met_s < COASTING_S:
            bodies = self._after_meeting(frame, target, bodies, roll)
        best: tuple[float, Extent, Window, float] | None = None
        for body in bodies:
            if not body.sides_visible or not target.may_be_again(body, roll, hidden_s):
                continue
            window = _around(frame.image, target, body, roll)
            alike = likeness(colours(window, _MIDDLE, _BODY), target.looks)
            hog = self._eyes.centre(window, NEAR)
            # A body half behind something: the two detectors do not agree about its middle.
            if alike < _SAME_LOOKS + 0.05 or hog is None or abs(hog.x_px - _MIDDLE[0]) > 0.12 * _BODY:
                continue
            worth = alike - 0.3 * away(body, target.motion.pixel, height, roll) / height
            if best is None or worth > best[0]:
                best = (worth, body, window, hog.x_px)
        if best is None:
            return self._coast(frame, target, 0.0)
        target.returning += 1
        if target.returning < 3:
            if hidden_s > COASTING_S:
                return self._coast(frame, target, 0.0)
            return self._track(frame, target, "coasting", 0.0)
        _, body, window, x = best
        place = np.array([x, _MIDDLE[1]])
        size = body.height_px if body.whole else height
        target.motion = Motion(
            window.to_frame(*place), size, noise.BOX_SIDEWAYS_SIGMA, noise.HEIGHT_SIGMA if body.whole else 0.1
        )
        target.earlier, target.next_earlier = deepcopy(target.motion), deepcopy(target.motion)
        target.template = Template.cut(window.image, place, _BODY, frame.t_s)
        target.earlier_s = target.seen_s = target.agreed_s = frame.t_s
        target.returning = 0
        if target.other is not None and target.other.belied(target.motion, frame.t_s):
            target.other = None
        target.cut_off = not body.whole
        target.whole_s = frame.t_s
        if not target.cut_off:
            target.height_s = frame.t_s
        return self._track(frame, target, "tracking", likeness(colours(window, place, _BODY), target.looks))

    def _after_meeting(self, frame: Frame, target: Target, bodies: list[Extent], roll: float) -> list[Extent]:
        """The target among people of its looks, or nobody while it could be either."""
        alike = [b for b in bodies if self._alike(frame, target, b, roll) > _SAME_LOOKS]
        found = told_apart(alike, target.motion, target.other, frame.t_s, target.known_s, roll)
        if found is None:
            return []
        if target.other is not None and found.other is not None:
            target.other.see(found.other, frame.t_s, roll, alone=found.apart)
        if not found.apart and target.motion.see_box(found.target, roll):
            target.met_s = target.told_s = frame.t_s
        return [found.target] if found.apart else []

    def _track(self, frame: Frame, target: Target, state: TrackState, score: float) -> Track:
        height = target.motion.height_px
        x, y = _pair(target.motion.pixel)
        fresh = state == "tracking" and frame.t_s - target.height_s <= _FRESH_HEIGHT_S
        return Track(
            frame_index=frame.index,
            t_s=frame.t_s,
            state=state,
            box=Box(x - 0.2 * height, y - 0.5 * height, 0.4 * height, height),
            pixel=(x, y),
            pixel_sigma_px=noise.pixel_sigma_px(height, float(target.motion.sigma_px.max()), target.cut_off),
            height_px=height if fresh else None,
            size_sigma=noise.size_sigma(height, frame.t_s - target.height_s) if fresh else None,
            score=float(np.clip(score, 0.0, 1.0)),
        )


def _upright(image: Image, centre: tuple[float, float] | Vector, height: float, roll: float) -> Window:
    return cut_window(image, _pair(centre), height, _BODY, WindowedHog.SIZE, roll)


def _around(image: Image, target: Target, body: Extent, roll: float) -> Window:
    """The window of somebody who may be the target."""
    height = body.tall(target.motion.height_px)
    # Who fills the picture from top to bottom: their middle is as good as anywhere.
    return _upright(image, body.middle(height, roll) or body.centre, height, roll)


def _pair(point: tuple[float, float] | Vector) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _inside(window: Window, place: Vector) -> bool:
    """Whether the torso is inside the picture."""
    return all(window.shows(place[0] + side * 0.13 * _BODY, place[1]) for side in (-1, 1))
