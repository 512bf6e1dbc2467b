from services.monitor.health import PULSE_S, Heartbeat

LEASE_S = 2.0
SETTLE_S = 3.0 + LEASE_S


class Ears:
    """What a monitor hears, on a clock that the test sets."""

    def __init__(self) -> None:
        self.heard_s: float | None = 0.0
        self.hearing = Heartbeat(lambda: self.heard_s, LEASE_S)

    def at(self, now_s: float, heard_s: float | None) -> tuple[bool, bool, bool]:
        """Return whether anything turned, whether it is deaf, and whether it has settled."""
        self.heard_s = heard_s
        turned = self.hearing.advance(now_s)
        return turned, self.hearing.deaf, self.hearing.settled


def test_who_hears_the_fleet_from_the_beginning_knows_who_is_there() -> None:
    ears = Ears()
    assert ears.at(1, 0.5) == (False, False, True)
    assert ears.hearing.heard_s == 0.5


def test_after_a_time_without_a_link_everybody_has_the_lease_and_three_seconds_to_appear() -> None:
    ears = Ears()
    assert ears.at(1, None) == (True, True, False)
    assert ears.at(2, None) == (False, True, False)
    assert ears.at(3, 3) == (True, False, False)
    assert ears.at(3 + SETTLE_S - 0.1, 7) == (False, False, False)
    assert ears.at(3 + SETTLE_S, 8) == (True, False, True)


def test_a_link_that_is_lost_again_meanwhile_lets_it_begin_anew() -> None:
    ears = Ears()
    ears.at(1, None)
    ears.at(2, 2)
    assert ears.at(4, None) == (True, True, False)
    ears.at(5, 5)
    assert ears.at(2 + SETTLE_S, 6) == (False, False, False)
    assert ears.at(5 + SETTLE_S, 9) == (True, False, True)


def test_who_was_held_up_was_deaf() -> None:
    ears = Ears()
    late_s = LEASE_S + 2 * PULSE_S
    assert ears.at(10, 10 - late_s) == (False, False, True)
    assert ears.at(10.1, 10 - late_s) == (True, True, False)
    assert ears.at(10.2, 10.2) == (True, False, False)
