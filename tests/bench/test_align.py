from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import simplejpeg

from tests.bench import align


def test_the_error_is_the_mean_distance_at_the_corners() -> None:
    moved = np.array([[1.0, 0, 3], [0, 1, 4], [0, 0, 1]])
    wider = np.diag([1.1, 1.0, 1.0])

    assert align._corner_error(moved, np.eye(3), 200, 100) == pytest.approx(5)
    # nothing at the left corners, a tenth of the width at the right ones
    assert align._corner_error(wider, np.eye(3), 200, 100) == pytest.approx(10)


def test_pictures_are_moved_by_the_matrix() -> None:
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[10, 20] = 255

    moved = align._warped(picture, np.array([[1.0, 0, 7], [0, 1, -4], [0, 0, 1]]))

    assert moved[..., 0].argmax() == 6 * 60 + 27


def test_a_hand_turns_a_camera() -> None:
    """No point comes nearer to the camera, so that angles between rays stay as they are."""
    found = align._turned(40, -20, 2, 1000, 800)
    focal = 500 / np.tan(np.radians(25))

    def rays(points: Any) -> Any:
        out = np.column_stack([(points - (500, 400)) / focal, np.ones(len(points))])
        return out / np.linalg.norm(out, axis=1, keepdims=True)

    before = np.array([[0.0, 0.0], [1000, 0], [0, 800], [1000, 800], [500, 400]])
    after = cv2.perspectiveTransform(before[None], found)[0]

    assert after[4] - before[4] == pytest.approx([40, -20], abs=1)
    assert rays(after) @ rays(after).T == pytest.approx(rays(before) @ rays(before).T)
    right = after[3] + after[1] - after[0] - after[2]
    assert np.degrees(np.arctan2(-right[1], right[0])) == pytest.approx(2, abs=0.1)


def test_ours_is_timed_without_its_first_run_and_held_against_the_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who finds no motion has the whole of it for an error."""
    path = tmp_path / "a.jpg"
    path.write_bytes(simplejpeg.encode_jpeg(np.full((200, 300, 3), 90, np.uint8), colorspace="RGB"))
    spent = [0.0]
    costs = iter([9.0, 8, 2, 2, 1] * 3)
    monkeypatch.setattr(align, "pair_files", lambda _pair: (path, path))
    monkeypatch.setattr(align, "HUGIN", "no-such-program")
    monkeypatch.setattr(align, "time", SimpleNamespace(process_time=lambda: spent[0]))

    def find(*_pair: object) -> SimpleNamespace:
        spent[0] += next(costs)
        return SimpleNamespace(matrix=np.eye(3))

    monkeypatch.setattr(align, "estimate_alignment", find)

    measured = align.measure("a pair")

    assert measured["cpu_s"] == 2
    whole = [
        align._corner_error(np.eye(3), align._turned(*motion, 300, 200), 300, 200)
        for motion in align._MOTIONS
    ]
    assert measured["error_px"] == pytest.approx(np.median(whole))
    assert measured["hugin_cpu_ratio"] is measured["hugin_error_px"] is None
