from services.monitor.namesakes import KNOWN_NS, Namesakes


def test_a_gateway_that_is_restarted_is_no_namesake() -> None:
    namesakes = Namesakes()
    for at_ns, boot_id in enumerate("aabbcc"):
        namesakes.take("r1", boot_id, at_ns)
        assert not namesakes.has("r1", at_ns)


def test_two_that_are_heard_in_turns_are_and_are_so_no_more_when_one_has_gone() -> None:
    namesakes = Namesakes()
    for at_ns, boot_id in enumerate("abab"):
        namesakes.take("r1", boot_id, at_ns)
    assert namesakes.has("r1", 3)
    assert not namesakes.has("r2", 3)
    namesakes.take("r1", "b", 3 + KNOWN_NS)
    assert namesakes.has("r1", 3 + KNOWN_NS)
    assert not namesakes.has("r1", 4 + KNOWN_NS)
