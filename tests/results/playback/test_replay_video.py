"""The film: a picture a control step, played in simulated time."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np

from specs.data.world import FloorZone
from tasks.results.playback.replay_video import frames, with_captions, write_video
from tasks.results.playback.robot_view import PALETTE, depth_shades
from tests.factories.own_worlds import piece, wedge
from tests.factories.playbacks import DECK, SAMPLES, WHEEL, boxed_playback, playback, seen_playback
from tests.factories.worlds import apartment

WORLD = apartment()
ROBOT, PERSON, OTHER = (249, 171, 0), (161, 66, 244), (0, 131, 143)


def test_the_film_has_all_pictures_at_its_rate(tmp_path: Path):
    path = tmp_path / "replay.mp4"
    pictures = list(frames(WORLD, playback()))
    assert write_video(path, pictures, 20) == SAMPLES
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        found = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 20)
    assert len(found) == SAMPLES
    assert found[0].shape == pictures[0].shape
    apart = np.abs(found[7].astype(int) - pictures[7].astype(int))
    assert apart.mean() < 6


def test_the_robot_moves_through_the_pictures():
    pictures = list(frames(WORLD, playback(), stride=10))
    columns = [np.argwhere((each == ROBOT).all(axis=2))[:, 1].mean() for each in pictures]
    assert len(columns) == 3
    assert columns[0] + 20 < columns[1] < columns[2] - 20


def test_a_box_is_in_the_pictures_while_it_stands():
    boxed, plain = ([*frames(WORLD, each)] for each in (boxed_playback(), playback()))
    changed = [not np.array_equal(one, other) for one, other in zip(boxed, plain, strict=True)]
    assert not changed[0]
    assert changed[-1]


def test_people_walk_through_the_pictures():
    first, last = list(frames(WORLD, playback(people=1), stride=20))[:2]
    columns = [np.argwhere((each == PERSON).all(axis=2))[:, 1] for each in (first, last)]
    assert columns[0].mean() + 20 < columns[1].mean()
    assert not (next(frames(WORLD, playback())) == PERSON).all(axis=2).any()


def test_other_robots_drive_through_the_pictures():
    first, last = list(frames(WORLD, playback(robots=1), stride=20))[:2]
    columns = [np.argwhere((each == OTHER).all(axis=2))[:, 1] for each in (first, last)]
    assert columns[0].mean() + 20 < columns[1].mean()
    assert not (next(frames(WORLD, playback())) == OTHER).all(axis=2).any()


def test_the_robot_is_filmed_from_above_as_its_parts():
    shaped = replace(playback(), shape=(WHEEL, DECK))
    first, plain = next(frames(WORLD, shaped)), next(frames(WORLD, playback()))
    blue = (first == (51, 102, 204)).all(axis=2)
    assert blue.sum() > 1000
    assert not (first == ROBOT).all(axis=2).any()
    assert (plain == ROBOT).all(axis=2).any()


def test_sides_are_even_whatever_the_world():
    for extent_m in (2.0, 2.013, 3.217):
        area = WORLD.footprint.model_copy(update={"y_max_m": WORLD.footprint.y_min_m + extent_m})
        picture = next(frames(WORLD.model_copy(update={"footprint": area}), playback()))
        assert all(side % 2 == 0 for side in picture.shape[:2])


def test_a_scan_that_sees_nothing_ends_at_the_edge_of_the_world():
    far = playback()
    far.ranges_m[:] = 50.0
    picture = next(frames(WORLD, far))
    assert (picture[-4:] == 255).all()


def test_what_the_robot_saw_is_filmed_beside_the_plan():
    plain, seen = list(frames(WORLD, playback())), list(frames(WORLD, seen_playback()))
    width = plain[0].shape[1]
    assert all((each[:, :width] == alone).all() for each, alone in zip(seen, plain, strict=True))
    assert all(side % 2 == 0 for side in seen[0].shape[:2])
    beside = [each[:, width:] for each in seen]
    shades = PALETTE[depth_shades(np.array([[4.0, 2.0, 0.1]]), 4.0, 6.0)][0]
    for sample, number in ((0, 0), (7, 0), (8, 1), (15, 1), (16, 2), (20, 2)):
        for pixel in (shades[number], PALETTE[-1], np.full(3, (40, 120, 200)[number])):
            assert (beside[sample] == pixel).all(axis=2).sum() > 1000
        others = [shades[other] for other in range(3) if other != number]
        assert not any((beside[sample] == pixel).all(axis=2).any() for pixel in others)


def test_a_rendered_picture_has_it_beside_itself_too():
    picture = np.full((200, 300, 3), 77, np.uint8)
    (shown,) = with_captions([picture], seen_playback(), [20])
    assert shown.shape[0] == 200
    assert shown.shape[1] > 600
    assert (shown[100:, :300] == 77).all()
    (alone,) = with_captions([picture], playback(), [20])
    assert alone.shape == picture.shape


def test_zones_are_filmed_and_roofs_are_not():
    zone = FloorZone(name="dock", outline_m=((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0)), found=True)
    own = WORLD.model_copy(update={"version": "2", "rooms": (), "furniture": (), "zones": (zone,)})
    film = next(frames(own, playback()))
    assert (film == (95, 104, 112)).all(axis=2).sum() > 100
    roofed = own.model_copy(update={"furniture": (piece("roof", wedge("roof", (0.0, 0.0), low_m=9.0)),)})
    assert (next(frames(roofed, playback())) == film).all()
