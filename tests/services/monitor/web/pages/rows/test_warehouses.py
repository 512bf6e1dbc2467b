import time

import msgspec

from schemas.alerts import Severity
from schemas.inventory import SiteTotals, WarehouseReport
from services.monitor.fleet import Fleet
from services.monitor.warehouses.reports import FRESH_NS, MAX_WAREHOUSES, KnownWarehouse, Warehouses
from services.monitor.web.pages.rows.warehouses import (
    address_of_warehouse,
    alert_rows,
    facts_of,
    object_rows,
    open_alerts,
    site_rows,
    sorted_warehouses,
    warehouse_row,
)
from tests.services.monitor.web.pages.rows.test_alerts import ALERT
from tests.services.monitor.world.test_site_objects import thing

NOW = 10**18
HTML = "<b onclick=x>"
REPORT = WarehouseReport(
    warehouse="berlin",
    version="1.2",
    sent_ns=NOW,
    page="https://berlin.example",
    robots=3,
    robots_online=2,
    cameras=6,
    cameras_online=4,
    workers=5,
    in_view={"box": 9},
    sites=[
        SiteTotals(site="hall-2", current=True, objects={"box": 4, "pallet": 2}),
        SiteTotals(site="hall-3", current=True, objects={"box": 1}),
        SiteTotals(site="hall-4", current=False, objects={"box": 100}),
    ],
    alerts={"critical": 1, "info": 2},
    open=[ALERT],
)


def report_of(fleet: Fleet, name: str, **more: object) -> None:
    """Have a warehouse report for an hour."""
    report = msgspec.structs.replace(REPORT, warehouse=name, **more)
    fleet.warehouses.take(report, time.time_ns() + 3600 * 10**9)


def known(name: str = "berlin", received_ns: int = NOW, **more: object) -> KnownWarehouse:
    return KnownWarehouse(msgspec.structs.replace(REPORT, warehouse=name, **more), received_ns)


def test_objects_are_those_of_the_sites_that_are_looked_after_or_what_is_in_view() -> None:
    assert known().objects == {"box": 5, "pallet": 2}
    assert known(sites=[]).objects == {"box": 9}
    assert known(sites=[REPORT.sites[-1]]).objects == {"box": 9}, "of hall-4 nothing is known now"


def test_a_warehouse_that_is_silent_is_a_problem_until_it_reports_again() -> None:
    warehouses = Warehouses()
    assert not warehouses
    warehouses.take(REPORT, NOW)
    assert list(warehouses.problems(NOW + FRESH_NS)) == []
    (problem,) = warehouses.problems(NOW + 60 * 10**9)
    assert problem.startswith("warehouse berlin has not reported for 60 s")
    warehouses.take(REPORT, NOW + 60 * 10**9)
    assert list(warehouses.problems(NOW + 60 * 10**9)) == []


def test_of_too_many_the_longest_silent_is_forgotten() -> None:
    warehouses = Warehouses()
    for number in range(MAX_WAREHOUSES):
        warehouses.take(msgspec.structs.replace(REPORT, warehouse=f"w{number}"), NOW + number)
    warehouses.take(msgspec.structs.replace(REPORT, warehouse="w0"), NOW + MAX_WAREHOUSES)
    warehouses.take(REPORT, NOW + MAX_WAREHOUSES + 1)
    assert len(warehouses.every()) == MAX_WAREHOUSES
    assert warehouses.of("w0") is not None
    assert warehouses.of("w1") is None


def test_a_row_says_how_a_warehouse_is() -> None:
    row = warehouse_row(known(problems=["a", "b"]), NOW)
    assert (row["state"], row["why"], row["robots"], row["cameras"]) == ("online", "", "2 of 3", "4 of 6")
    assert row["objects"] == [["5", "box"], ["2", "pallet"]]
    assert row["alerts"] == [[Severity.CRITICAL, 1], [Severity.INFO, 2]]
    assert row["problems"] == "2 problems"
    gone = warehouse_row(known(), NOW + 60 * 10**9)
    assert (gone["state"], gone["why"], gone["current"]) == ("offline", "last report 1 min ago", False)


def test_those_that_do_not_report_come_first_unless_another_order_is_chosen() -> None:
    every = [
        known("w2"),
        known("w10", alerts={"info": 9}),
        known("w1", NOW - 60 * 10**9, robots_online=9, alerts={}),
    ]

    def order(sort: str, *, descending: bool = False) -> list[str]:
        return [each.name for each in sorted_warehouses(every, sort, NOW, descending=descending)]

    assert order("state") == ["w1", "w2", "w10"]
    assert order("warehouse", descending=True) == ["w10", "w2", "w1"]
    assert order("robots")[-1] == "w1"
    assert order("alerts", descending=True) == ["w10", "w2", "w1"]


def test_the_most_urgent_alerts_of_all_are_shown_with_their_warehouse() -> None:
    critical = msgspec.structs.replace(ALERT, id="2", severity=Severity.CRITICAL, text=HTML, rule=HTML)
    found = open_alerts([known("a"), known("b", open=[critical, ALERT])], 2)
    assert [(name, alert.id) for name, alert in found] == [("b", "2"), ("a", "1")]
    html = alert_rows(found, NOW)
    assert HTML not in html
    assert '<a class="fs-link" href="/warehouses/b">b</a>' in html


def test_facts_link_to_nothing_but_web_addresses() -> None:
    html = facts_of(known(problems=[HTML]), NOW)
    assert 'href="https://berlin.example"' in html
    assert HTML not in html
    assert "2 of 3" in html
    assert "href" not in facts_of(known(page="javascript:alert(1)"), NOW)


def test_sites_and_objects_are_escaped() -> None:
    html = site_rows(REPORT, "hall-2")
    assert 'data-site="hall-2"><div><a class="fs-link" href="?site=hall-2" aria-current=true>hall-2</a>' in html
    assert "4 box, 2 pallet" in html
    assert "100 box, as known last" in html
    assert HTML not in object_rows([msgspec.structs.replace(thing("a", 1.5, 2), name=HTML, id=HTML)], NOW)
    assert address_of_warehouse("a/b") == "/warehouses/a%2Fb"
