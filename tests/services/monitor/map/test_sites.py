from schemas.world import SiteStatus
from services.monitor.map.sites import FRESH_NS, MAX_SITES, Sites, totals


def status(site: str = "hall", **objects: int) -> SiteStatus:
    return SiteStatus(
        site=site, epoch="e", worker="w", sent_ns=0, last=0, objects=objects, tentative=0, views=0, sightings=0
    )


def test_the_newest_status_of_each_site_counts() -> None:
    sites = Sites()
    for each in (status("b", box=1), status("a", box=2), status("b", box=3)):
        sites.take(each, 7)
    assert [(known.status.site, known.status.objects) for known in sites.every()] == [
        ("a", {"box": 2}),
        ("b", {"box": 3}),
    ]


def test_a_site_that_nobody_looks_after_stays_but_is_not_current() -> None:
    sites = Sites()
    sites.take(status(), 10)
    assert [each.site for each in sites.current(10 + FRESH_NS)] == ["hall"]
    assert list(sites.current(11 + FRESH_NS)) == []
    assert [known.is_current(11 + FRESH_NS) for known in sites.every()] == [False]


def test_of_too_many_sites_the_one_heard_of_longest_ago_is_forgotten() -> None:
    sites = Sites()
    for number in range(MAX_SITES):
        sites.take(status(f"s{number}"), number)
    sites.take(status("s0"), MAX_SITES)
    sites.take(status("new"), MAX_SITES + 1)
    names = {known.status.site for known in sites.every()}
    assert len(names) == MAX_SITES
    assert "s1" not in names
    assert {"s0", "new"} <= names


def test_totals_are_words() -> None:
    assert totals({"pallet": 2, "box": 5, "forklift": 0}) == "5 box, 2 pallet"
    assert totals({}) == "nothing yet"
