import pytest

from services.monitor.web.auth.gate import RequestInfo, ServedAt, Verdict, body_limit, judge, local_path
from services.monitor.web.auth.users import Kind, Role, Visitor

OURS = {"host": "monitor:1", "origin": "http://monitor:1"}
VIEWER = Visitor("v", lambda: Role.VIEWER)
GONE = Visitor("g", lambda: None)


def verdict(
    method: str,
    path: str,
    visitor: Visitor | None,
    headers: dict[str, str],
    *,
    own: str = "",
    open_metrics: bool = False,
) -> Verdict:
    asking = RequestInfo(method, path, headers)
    return judge(asking, visitor, by=Kind.SESSION, place=ServedAt(own, open_metrics=open_metrics))


def test_a_socket_is_opened_from_our_own_page_alone() -> None:
    assert verdict("", "/_nicegui_ws/socket.io/", VIEWER, OURS) is Verdict.PASS
    assert verdict("", "/_nicegui_ws/socket.io/", VIEWER, {**OURS, "origin": "http://evil"}) is Verdict.FOREIGN
    assert verdict("", "/api/v1/live", VIEWER, {"host": "monitor:1"}) is Verdict.FOREIGN
    assert verdict("", "/api/v1/live", None, OURS) is Verdict.UNKNOWN
    assert verdict("", "/api/v1/live", GONE, OURS) is Verdict.UNKNOWN
    for method, path in (("", "/api/v1/live"), ("POST", "/api/v1/alerts/a1/resolve")):
        for nobody in (None, GONE):
            assert verdict(method, path, nobody, {"host": "monitor:1"}) is Verdict.UNKNOWN, "its token may be missing"
    assert verdict("POST", "/login", None, {"host": "monitor:1"}) is Verdict.FOREIGN
    token = RequestInfo("", "/api/v1/live", {"host": "monitor:1"})
    assert judge(token, VIEWER, by=Kind.TOKEN, place=ServedAt()) is Verdict.PASS


def test_behind_a_proxy_its_origin_is_ours_and_no_other() -> None:
    behind = {"host": "monitor:1", "origin": "https://fleet.example"}
    assert verdict("POST", "/logout", VIEWER, behind, own="https://fleet.example") is Verdict.PASS
    assert verdict("POST", "/logout", VIEWER, OURS, own="https://fleet.example") is Verdict.FOREIGN


def test_an_origin_without_a_host_is_not_ours() -> None:
    assert verdict("POST", "/login", None, {"origin": "null"}) is Verdict.FOREIGN
    assert verdict("POST", "/login", None, {"host": "", "origin": "http://"}) is Verdict.FOREIGN
    assert verdict("POST", "/login", None, {"host": "monitor:1", "origin": "http://["}) is Verdict.FOREIGN


def test_another_origin_does_not_even_read() -> None:
    assert verdict("GET", "/_nicegui_ws/socket.io/", VIEWER, {**OURS, "origin": "http://monitor:2"}) is Verdict.FOREIGN
    assert verdict("GET", "/_nicegui_ws/socket.io/", VIEWER, OURS) is Verdict.PASS


HOSTS = ServedAt(hosts=frozenset({"localhost", "central", "fleet.lan"}))


@pytest.mark.parametrize(
    "host", ["localhost", "LOCALHOST:8080", "central:8080", "fleet.lan.", "127.0.0.1:8080", "10.0.0.7", "[::1]:8080"]
)
def test_our_names_and_all_addresses_are_ours(host: str) -> None:
    assert judge(RequestInfo("GET", "/login", {"host": host}), None, by=None, place=HOSTS) is Verdict.PASS


@pytest.mark.parametrize(
    "host",
    [
        *("evil.test:8080", "", ":80", "localhost.evil.test", "central.evil.test", "[::1].evil.test"),
        *("127.0.0.1.evil.test:80", "10.0.0.7.evil.test", "evil.test@10.0.0.7", "0x7f000001", "127.1"),
    ],
)
def test_a_foreign_name_that_leads_to_us_reaches_nothing(host: str) -> None:
    for method, path in (("GET", "/"), ("POST", "/login"), ("GET", "/api/v1/robots"), ("", "/api/v1/live")):
        asking = RequestInfo(method, path, {"host": host, "origin": f"http://{host}"})
        for visitor in (None, VIEWER):
            assert judge(asking, visitor, by=Kind.SESSION, place=HOSTS) is Verdict.MISDIRECTED


def test_a_token_that_ended_is_told_as_that_under_any_name_and_opens_no_page() -> None:
    service = {"host": "fleet-monitor.fleet.svc:8080"}
    for path in ("/metrics", "/api/v1/robots"):
        assert judge(RequestInfo("GET", path, service), None, by=Kind.TOKEN, place=HOSTS) is Verdict.UNKNOWN
    for method in ("GET", "POST"):
        assert judge(RequestInfo(method, "/login", service), None, by=Kind.TOKEN, place=HOSTS) is Verdict.MISDIRECTED


def test_beside_a_proxys_our_own_names_and_addresses_log_in_and_no_page_of_others() -> None:
    place = ServedAt("https://fleet.example", hosts=HOSTS.hosts)
    for host in ("localhost:8080", "10.0.0.7:8080", "fleet.lan"):
        asking = RequestInfo("POST", "/login", {"host": host, "origin": f"http://{host}"})
        assert judge(asking, None, by=None, place=place) is Verdict.PASS
        foreign = RequestInfo("POST", "/login", {"host": host, "origin": "http://evil.test"})
        assert judge(foreign, None, by=None, place=place) is Verdict.FOREIGN


def test_programs_and_probes_may_use_any_name_since_no_page_can_read_more_by_it() -> None:
    service = {"host": "fleet-monitor.fleet.svc:8080"}

    def verdict_at(method: str, path: str, *, by: Kind, visitor: Visitor | None, place: ServedAt = HOSTS) -> Verdict:
        return judge(RequestInfo(method, path, service), visitor, by=by, place=place)

    assert verdict_at("GET", "/healthz", by=Kind.SESSION, visitor=None) is Verdict.PASS
    assert verdict_at("GET", "/api/v1/robots", by=Kind.TOKEN, visitor=VIEWER) is Verdict.PASS
    assert verdict_at("GET", "/metrics", by=Kind.TOKEN, visitor=VIEWER) is Verdict.PASS
    assert verdict_at("GET", "/metrics", by=Kind.TOKEN, visitor=None) is Verdict.UNKNOWN
    assert verdict_at("GET", "/metrics", by=Kind.SESSION, visitor=VIEWER) is Verdict.MISDIRECTED
    open_metrics = ServedAt(hosts=HOSTS.hosts, open_metrics=True)
    assert verdict_at("GET", "/metrics", by=Kind.SESSION, visitor=None, place=open_metrics) is Verdict.PASS
    assert verdict_at("GET", "/login", by=Kind.SESSION, visitor=None, place=open_metrics) is Verdict.MISDIRECTED


def test_metrics_are_open_only_where_the_settings_say_so() -> None:
    assert verdict("GET", "/metrics", None, {}) is Verdict.UNKNOWN
    assert verdict("GET", "/metrics", None, {}, open_metrics=True) is Verdict.PASS
    assert verdict("GET", "/metrics/x", None, {}, open_metrics=True) is Verdict.UNKNOWN


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "TRACE", "CONNECT", "ODD", "get"])
def test_a_viewer_changes_nothing_by_whatever_method(method: str) -> None:
    assert verdict(method, "/api/v1/anything/new", VIEWER, OURS) is Verdict.NOT_ALLOWED


@pytest.mark.parametrize(
    "elsewhere",
    [
        "http://evil",
        "//evil",
        "/\\evil",
        "\\\\evil",
        "/a\nb",
        "/\tevil",
        "javascript:x",
        "",
        "x",
        "/" + "x" * 1_000,
        "/ä",
    ],
)
def test_log_in_leads_nowhere_else(elsewhere: str) -> None:
    assert local_path(elsewhere) == "/"


def test_log_in_leads_where_one_wanted_to_go() -> None:
    assert local_path("/alerts/x%20y?z=1") == "/alerts/x%20y?z=1"


def test_only_the_pages_own_script_may_send_much() -> None:
    assert (body_limit("/login"), body_limit("/_nicegui_ws/socket.io/")) == (64 * 1024, 1024 * 1024)
