import msgspec

from schemas.world import MAX_PROBLEMS, RobotOffset, SiteStatus
from services.monitor.formats import MAX_SHOWN
from services.monitor.world.site_status import FRESH_NS, JUMP_NS, LATELY_NS, MAX_SITES, Sites, totals


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


def robot(name: str, doubted: str = "") -> RobotOffset:
    return RobotOffset(robot=name, x=0, y=0, yaw=0, sigma_m=0, doubted=doubted, views=1, last_ns=1)


NO_MAP = "of a robot without a map frame"


def hall(*, epoch: str = "e", **given: object) -> SiteStatus:
    return msgspec.structs.replace(status("hall"), epoch=epoch, **given)


def test_robots_that_are_lost_are_problems_while_they_are() -> None:
    sites = Sites()
    why = "its pose does not fit what was seen before"
    lost = [robot(f"r{number}", why) for number in range(5)]
    sites.take(hall(robots=[robot("x"), *lost], problems=[f"{each.robot}: {why}" for each in lost]), 10)
    (problem,) = sites.problems(10)
    assert problem.startswith(
        "site hall leaves out the sightings of r0, r1, r2 and 2 more: its pose does not fit what was seen before;"
        " correct that in its localisation"
    )
    assert sites.problems(11 + FRESH_NS) == [], "nobody looks after the site"
    sites.take(hall(robots=[robot("r0")]), 20)
    assert sites.problems(20) == []
    off = msgspec.structs.replace(hall(robots=lost, problems=[f"r1: {why}"]), sent_ns=2 + LATELY_NS)
    sites.take(off, 30)
    assert sites.problems(30) == [], "no view of it came for long: it is off"


def test_robots_whose_poses_have_jumped_are_a_problem_when_they_do_not_fit_soon() -> None:
    sites, why = Sites(), "its pose has jumped"

    def at(now_ns: int, *robots: RobotOffset) -> list[str]:
        sites.take(
            hall(robots=list(robots), problems=[f"{each.robot}: {why}" for each in robots if each.doubted]), now_ns
        )
        return sites.problems(now_ns)

    assert at(10, robot("r1", why)) == []
    assert at(9 + JUMP_NS, robot("r1", why), robot("r2", why)) == []
    (problem,) = at(10 + JUMP_NS, robot("r1", why), robot("r2", why))
    assert problem == (
        "site hall leaves out the sightings of r1: its pose has jumped; correct that in its localisation, as with"
        " 2D Pose Estimate in RViz"
    )
    assert at(11 + JUMP_NS, robot("r1")) == []
    assert at(12 + JUMP_NS, robot("r1", why)) == [], "it has jumped again"


def test_wrong_depth_and_other_class_names_have_cures_of_their_own() -> None:
    sites, why, names = Sites(), "its depth does not fit the floor", "another model's class names"
    told = [f"r1: {why}", f"r2: 9 sightings left out: {names}"]
    for count in (8, 9):
        sites.take(hall(robots=[robot("r1", why)], left_out={names: count}, problems=told), count)
    depth, classes = sites.problems(9)
    assert depth == (
        "site hall leaves out the sightings of r1: its depth does not fit the floor; check the depth camera, how it is"
        " mounted, and its transform"
    )
    assert classes == (
        "site hall: robots have other names for the same things, each by its model: let all of a site run one model, or"
        " models with the same class names (r2)"
    )


def test_sightings_that_are_left_out_are_a_problem_while_more_are_and_with_the_cure() -> None:
    sites = Sites()

    def at(now_ns: int, count: int, *, epoch: str = "e") -> list[str]:
        told = f"r1: {count} sightings left out: {NO_MAP}"
        counted = {NO_MAP: count, "farther, higher or larger than objects are": count}
        sites.take(hall(epoch=epoch, left_out=counted, problems=[told]), now_ns)
        return sites.problems(now_ns)

    assert at(1, 7) == [], "nobody knows since when"
    (problem,) = at(2, 8)
    assert problem.startswith(
        "site hall: robots have no frame map, so that what they see has no place: start their loc"
    )
    assert problem.endswith(" (r1)")
    assert at(2 + LATELY_NS, 8) == [problem]
    assert at(3 + LATELY_NS, 8) == []
    assert at(4 + LATELY_NS, 9, epoch="f") == [], "another worker counts from 0"


def test_problems_that_are_not_known_are_told_as_they_are_and_all_are_limited() -> None:
    sites = Sites()
    sites.take(hall(problems=[f"odd\n{number}" for number in range(MAX_PROBLEMS)]), 1)
    problems = sites.problems(1)
    assert problems[0] == "site hall: odd\\n0"
    assert (len(problems), problems[-1]) == (MAX_SHOWN + 1, f"and {MAX_PROBLEMS - MAX_SHOWN} more problems")


def test_totals_are_words() -> None:
    assert totals({"pallet": 2, "box": 5, "forklift": 0}) == "5 box, 2 pallet"
    assert totals({}) == "nothing yet"
