from __future__ import annotations

from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.evaluation import cache, scenes
from tests.evaluation.scenes import GROUPS, OTHER_CAMERAS, SWEEP_DEG, render_scene
from tests.evaluation.spectra import angle_deg

SMALL = (64, 48)


def test_groups_have_the_scenes_of_the_figures() -> None:
    report = {group: scenes.scenes(group, "report") for group in GROUPS}

    assert len(report["two"]) == 22
    assert len(report["three"]) == 26
    assert all(scene.angle_deg >= 20 for scene in report["three"])
    assert all(s.angle_deg >= 15 for g in ("broad-two", "broad-three") for s in report[g])
    assert Counter(s.geometry.depth for s in report["bounces"]) == dict.fromkeys(
        (2, 3, 4, 6, None), 3
    )
    assert {s.flash for s in report["two-led"]} == {"led"}
    assert {s.flash for s in report["two"]} == {"xenon"}
    assert {s.geometry.roughness for s in report["roughness"]} == {0.1, 0.2, 0.3, 0.5, 0.7, 1.0}
    for group, count in {"one": 1, "two": 2, "three": 3, "four": 4, "smooth-three": 3}.items():
        assert all(len(s.lamp_spectra) == count for s in report[group])
        assert all(len(s.geometry.lamps) == count + 1 for s in report[group])


def test_every_camera_takes_the_same_rooms() -> None:
    assert not set(OTHER_CAMERAS["report"]) & set(OTHER_CAMERAS["development"])
    for half in ("development", "report"):
        assert len({camera.split()[0] for camera in OTHER_CAMERAS[half]}) == 4  # makers
        for lamps in ("two", "three"):
            rooms = scenes.scenes(lamps, half)[:6]
            for camera in ("Nikon D5100", *OTHER_CAMERAS[half]):
                taken = [s for s in scenes.scenes(f"cameras-{lamps}", half) if s.camera == camera]
                assert [s.geometry for s in taken] == [room.geometry for room in rooms]
                assert [s.lamp_names for s in taken] == [room.lamp_names for room in rooms]
                assert [s.angle_deg for s in taken] == [room.angle_deg for room in rooms]


def test_the_sweep_has_the_angles_it_says() -> None:
    for half in ("development", "report"):
        found = [s.angle_deg for s in scenes.scenes("angle", half)]
        np.testing.assert_allclose(found, SWEEP_DEG * 4, rtol=1e-6)


def test_halves_share_neither_geometry_nor_names() -> None:
    seen: list[set[str]] = []
    for half in ("development", "report"):
        own = [scene for group in GROUPS for scene in scenes.scenes(group, half)]
        rooms = 2 * 6  # of two and three lamps, which groups of cameras hold again
        assert len({scene.name for scene in own}) == len(own) - rooms
        seen.append({repr(scene.geometry.shapes) for scene in own} | {s.name for s in own})
    assert not seen[0] & seen[1]


def test_a_scene_is_the_same_each_time() -> None:
    first, second = scenes.scenes("two", "report")[3], scenes.scenes("two", "report")[3]

    assert repr(first.geometry) == repr(second.geometry)
    np.testing.assert_array_equal(first.lamp_spectra, second.lamp_spectra)
    np.testing.assert_array_equal(first.palette, second.palette)
    rendered = render_scene(first, SMALL)
    for path in cache.folder().glob("*.npz"):
        path.unlink()
    np.testing.assert_array_equal(rendered.lamps, render_scene(second, SMALL).lamps)


def test_frames_are_exposed_and_balanced_as_said() -> None:
    scene = scenes.scenes("three", "development")[0]

    rendered = render_scene(scene, SMALL)

    assert rendered.lamps.shape == (3, 48, 64, 3)
    assert rendered.lamps.dtype == np.float32
    np.testing.assert_allclose(
        rendered.flash_frame, rendered.lamps.sum(axis=0) + rendered.flash, atol=1e-6
    )
    means = rendered.lamps[..., 1].mean(axis=(1, 2))
    np.testing.assert_allclose(
        means / means[0], np.array(scene.strengths) / scene.strengths[0], rtol=1e-5
    )
    assert rendered.flash[..., 1].mean() == pytest.approx(means.sum(), rel=1e-5)
    assert np.percentile(rendered.flash_frame.max(axis=2), 99.9) == pytest.approx(0.9, rel=1e-5)


def test_another_camera_and_flash_need_no_new_rendering() -> None:
    scene = scenes.scenes("one", "report")[0]
    nikon = render_scene(scene, SMALL)
    files = set(cache.folder().iterdir())

    sigma = render_scene(replace(scene, camera="Sigma SD1 Merrill", flash="led"), SMALL)

    assert set(cache.folder().iterdir()) == files
    colours = [picture.flash.mean(axis=(0, 1)) for picture in (nikon, sigma)]
    assert abs(colours[0][0] / colours[0][1] - colours[1][0] / colours[1][1]) > 0.05


def test_a_moved_hand_shifts_the_flash_frame_and_nothing_else() -> None:
    scene = scenes.scenes("two", "development")[0]
    size = (96, 72)
    still, moved = render_scene(scene, size), render_scene(scene, size, motion_px=2.0)

    np.testing.assert_array_equal(still.lamps, moved.lamps)
    np.testing.assert_array_equal(still.flash, moved.flash)
    grey = [np.asarray(np.sqrt(r.flash_frame[..., 1]), np.float64) for r in (still, moved)]
    window = cv2.createHanningWindow(size, cv2.CV_64F)
    (x, y), _response = cv2.phaseCorrelate(grey[0], grey[1], window)
    assert 1.2 < np.hypot(x, y) < 2.8


def test_lamps_behind_shades_widen_the_sweep_beyond_measured_pairs() -> None:
    widest = max(scenes.scenes("angle", "report"), key=lambda scene: scene.angle_deg)
    first, second = widest.lamp_spectra
    assert angle_deg(first, second, widest.camera) == pytest.approx(60)
    assert "shade" in widest.lamp_names[0]
    assert widest.lamp_spectra.min() >= 0


def test_lamps_of_corners_stand_before_both_walls() -> None:
    for half in ("development", "report"):
        for scene in scenes.scenes("bounces", half):
            for wall in scene.geometry.shapes[1:3]:
                turn = np.radians(wall.turn_deg)
                out = np.array([np.sin(turn), 0, np.cos(turn)])
                for lamp in scene.geometry.lamps:
                    assert (np.array(lamp.centre) - wall.centre) @ out > 0.3


def test_a_lamp_behind_a_wall_is_refused() -> None:
    scene = scenes.scenes("one", "report")[1]
    lamp, flash = scene.geometry.lamps
    hidden = replace(lamp, centre=(0.0, 1.0, -9.0))
    geometry = replace(scene.geometry, lamps=(hidden, flash))
    with pytest.raises(ValueError, match="lights nothing"):
        render_scene(replace(scene, geometry=geometry), SMALL)
