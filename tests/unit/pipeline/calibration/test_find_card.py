from __future__ import annotations

import numpy as np

from pipeline.calibration.find_card import find_cards
from tests.cluttered import CAMERA, photograph_room
from tests.evaluation.spectra import sensitivities


def test_a_card_is_found_and_the_circle_lies_on_it() -> None:
    height, width = 240, 360
    picture = np.full((height, width, 3), (0.05, 0.2, 0.1))
    from pipeline.spectra.lights import find_light

    grey = sensitivities(CAMERA) @ find_light("xenon")
    picture[60:160, 100:260] = 0.4 * grey / grey.max()
    (card,) = find_cards(picture, sensitivities(CAMERA))
    assert abs(card.x - 180) < 2
    assert abs(card.y - 110) < 2
    assert 30 < card.radius < 50


def test_coloured_things_are_no_cards() -> None:
    picture = np.full((240, 360, 3), (0.05, 0.2, 0.1))
    picture[60:160, 100:260] = (0.6, 0.1, 0.1)
    assert find_cards(picture, sensitivities(CAMERA)) == []


def test_a_card_in_a_full_room_is_among_what_is_found() -> None:
    room = photograph_room("card", 1)
    assert room.corners is not None
    middle = room.corners.mean(axis=0)
    found = find_cards(np.maximum(room.frames[1] - room.frames[0], 0), sensitivities(CAMERA))
    half = np.linalg.norm(room.corners[1] - room.corners[0]) / 2
    assert min(np.hypot(c.x - middle[0], c.y - middle[1]) for c in found) < 0.1 * half
