"""The log of stops: the newest are kept, boards and links are noticed, standing still without a driver is no stop."""

from server.stops import KEPT, StopLog


def told(log: StopLog) -> list[tuple[float, str, str]]:
    """Newest first."""
    return [(entry.t, entry.reason, entry.by) for entry in log.newest()]


def test_only_the_newest_are_kept_newest_first():
    log = StopLog()
    for t in range(KEPT + 5):
        log.note(float(t), "pressed Stop", "anna")
    assert [t for t, _, _ in told(log)] == [float(t) for t in reversed(range(5, KEPT + 5))]


def test_a_stop_said_twice_in_a_moment_is_one_and_later_another():
    log = StopLog()
    for t, by in ((1.0, "anna"), (1.2, "anna"), (1.3, "ben"), (4.0, "ben")):
        log.note(t, "pressed Stop", by)
    assert told(log) == [(4.0, "pressed Stop", "ben"), (1.3, "pressed Stop", "ben"), (1.0, "pressed Stop", "anna")]


def test_a_boards_stop_is_told_once_each_time_it_happens():
    log = StopLog()
    reasons = [None, "boot", "none", "fell", "fell", "none", "fell", "link", "command", "stall"]
    for t, reason in enumerate(reasons):
        log.watch(float(t), reason, is_connected=True)
    board = "drive board"
    assert told(log) == [(9.0, "stall", board), (6.0, "fell", board), (3.0, "fell", board)]


def test_a_lost_link_is_told_and_one_that_is_not_yet_there_is_not():
    log = StopLog()
    for t, is_connected in enumerate([False, False, True, True, False, False, True]):
        log.watch(float(t), None, is_connected)
    assert told(log) == [(4.0, "connection lost", "link")]


def test_what_the_robots_bytes_do_not_tell_is_remembered_and_recalled():
    remembered: list[dict] = []
    log, again = StopLog(remembered.append), StopLog()
    log.note(1.0, "pressed Stop", "anna")
    log.watch(2.0, "fell", is_connected=True)
    for entry in remembered:
        again.recall(entry)
    assert told(again) == [(1.0, "pressed Stop", "anna")]
