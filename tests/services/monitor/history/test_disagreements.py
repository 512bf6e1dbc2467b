from services.monitor.history.intervals import Disagreement, Disagreements
from services.monitor.history.ledger import Ledger
from services.monitor.inventory.inventory import Inventory, TrustLimits
from services.monitor.inventory.sighting import Debounce
from tests.services.monitor.inventory.seeing import FRONT, S, seen

STALE_S = TrustLimits().stale_ns // S


class Camera:
    """A camera of which two models count boxes, and what was entered in the ledger of it."""

    def __init__(self) -> None:
        self.inventory = Inventory(TrustLimits(Debounce(1, 0, 1, 0)))
        self.inventory.robot_presence("r1", alive=True)
        self.inventory.camera_presence(FRONT, alive=True)
        self.ledger = Ledger()
        self.disagreements = Disagreements(self.inventory, self.ledger)
        self._seq = 0

    def see(self, at_s: int, **counts: int) -> None:
        for model, count in counts.items():
            self._seq += 1
            self.inventory.see(seen(self._seq, {"box": count}, model=model), at_s * S)

    def noted(self, at_s: int) -> list[tuple[int, int, int, int, bool]]:
        """Return (ours, theirs, since, until, open)."""
        for _ in self.disagreements.note(at_s * S):
            pass
        some = [each for each in self.ledger.pending(100) if isinstance(each, Disagreement)]
        self.ledger.written(some)
        assert {(each.name, each.model, each.other_model) for each in some} <= {("box", "m", "n")}
        return [(of.count, of.other_count, of.since_ns // S, of.until_ns // S, of.open) for of in some]


def test_a_disagreement_lasts_until_they_agree() -> None:
    camera = Camera()
    camera.see(1, m=2, n=2)
    camera.see(2, m=2, n=2)
    assert camera.noted(2) == []
    camera.see(3, m=2, n=1)
    assert camera.noted(3) == [(2, 1, 3, 3, True)]
    assert camera.noted(4) == []
    camera.see(4, m=3, n=1)
    assert camera.noted(5) == [(2, 1, 3, 5, False), (3, 1, 5, 5, True)]
    camera.see(6, m=3, n=3)
    assert camera.noted(7) == [(3, 1, 5, 7, False)]
    assert camera.noted(8) == []


def test_it_is_not_known_of_a_camera_that_nobody_speaks_for() -> None:
    camera = Camera()
    camera.see(1, m=2, n=1)
    assert camera.noted(1) == [], "one list may be that which late subscribers get"
    camera.see(2, m=2, n=1)
    assert camera.noted(2) == [(2, 1, 2, 2, True)]
    assert camera.noted(3 + STALE_S) == [(2, 1, 2, 3 + STALE_S, False)]
    camera.see(10, m=2, n=1)
    assert camera.noted(10) == [(2, 1, 10, 10, True)]


def test_who_falls_silent_disagrees_no_more() -> None:
    camera = Camera()
    camera.see(1, m=2, n=1)
    camera.see(2, m=2, n=1)
    camera.noted(2)
    camera.see(9, m=2)
    assert camera.noted(9) == [(2, 1, 2, 9, False)]


def test_it_ends_where_a_new_model_takes_over() -> None:
    camera = Camera()
    for at_s in (1, 2):
        camera.see(at_s, m=2, n=1)
    assert camera.noted(2) == [(2, 1, 2, 2, True)]
    camera.see(3 + STALE_S, n=1)
    camera.inventory.tick((3 + STALE_S) * S)
    assert camera.inventory.disputed() == set()
    assert camera.noted(4 + STALE_S) == [(2, 1, 2, 4 + STALE_S, False)]


def test_of_three_models_it_is_the_one_that_counts_otherwise() -> None:
    camera = Camera()
    for at_s in (1, 2):
        camera.see(at_s, m=2, n=1, o=2)
    assert camera.noted(2) == [(2, 1, 2, 2, True)]
