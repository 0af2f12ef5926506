"""Labels of the live map: they hang on vertices, move with the map, and the recording remembers them."""

from __future__ import annotations

import numpy as np
import pytest

from server.labels import MOST, Labels, NoPlace
from slam.pose import compose, transform

PATH = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.4], [2.0, 0.5, 1.0]])


def test_a_label_is_where_it_was_put_and_moves_with_the_nearest_vertex():
    labels = Labels()
    put = labels.add("Door", 1.2, -0.3, PATH)
    (placed,) = labels.placed(PATH)
    assert (placed.id, placed.text) == (put.id, "Door")
    assert (placed.x, placed.y) == pytest.approx((1.2, -0.3))
    bent = PATH.copy()
    bent[1] = compose(np.array([0.3, -0.1, 0.2]), bent[1])
    (moved,) = labels.placed(bent)
    assert (moved.x, moved.y) == pytest.approx(transform(np.array([0.3, -0.1, 0.2]), np.array([1.2, -0.3])))
    bent[0] = bent[2] = 7.0
    assert labels.placed(bent) == (moved,), "other vertices do not matter"


def test_a_label_whose_vertex_is_not_there_is_not_shown():
    labels = Labels()
    labels.add("End", 2.0, 0.6, PATH)
    assert labels.placed(PATH[:2]) == ()
    assert len(labels.placed(PATH)) == 1


def test_without_a_map_there_is_nothing_to_hang_a_label_on():
    with pytest.raises(NoPlace, match="no map yet"):
        Labels().add("Door", 0.0, 0.0, np.zeros((0, 3)))


def test_labels_are_removed_and_their_numbers_not_given_again():
    labels = Labels()
    first = labels.add("a", 0.0, 0.0, PATH)
    labels.remove(first.id)
    assert labels.add("b", 0.0, 0.0, PATH).id != first.id
    with pytest.raises(KeyError):
        labels.remove(first.id)


def test_there_are_not_more_labels_than_can_be_shown():
    labels = Labels()
    for _ in range(MOST):
        labels.add("a", 0.0, 0.0, PATH)
    with pytest.raises(NoPlace, match=str(MOST)):
        labels.add("a", 0.0, 0.0, PATH)


def test_what_was_remembered_makes_the_same_labels_again():
    events: list[dict] = []
    labels = Labels(events.append)
    labels.add("Door", 1.2, -0.3, PATH)
    gone = labels.add("Gone", 0.0, 1.0, PATH)
    labels.add("Bed", 2.2, 0.7, PATH)
    labels.remove(gone.id)
    again = Labels()
    for event in [*events, {"id": "x"}, {}, {"id": 9, "text": 3}]:
        again.recall(event)
    for was, now in zip(labels.placed(PATH), again.placed(PATH), strict=True):
        assert (now.id, now.text) == (was.id, was.text)
        assert (now.x, now.y) == pytest.approx((was.x, was.y), abs=1e-3)
    assert again.add("next", 0.0, 0.0, PATH).id == labels.add("next", 0.0, 0.0, PATH).id
