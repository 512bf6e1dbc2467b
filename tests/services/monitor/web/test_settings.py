from services.monitor.settings import MonitorSettings


def test_the_page_is_for_this_machine_only_unless_told_otherwise() -> None:
    settings = MonitorSettings()
    assert (settings.web, settings.web_host, settings.web_port) == (True, "127.0.0.1", 8080)
    assert (settings.web_open_metrics, settings.web_url) == (False, None)
