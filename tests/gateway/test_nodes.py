import pytest

from gateway.node_names import is_gateway, is_of, node_name, ros_chunk
from gateway.ros1.names import validate_global


@pytest.mark.parametrize("robot", ["r1", "forklift-7.b", "1"])
def test_a_robots_name_makes_a_legal_node_name(robot: str) -> None:
    name = node_name(robot, "0123456789")
    for node in (f"/{name}", f"/r1/{name}"):
        assert validate_global(node) == node
        assert is_gateway(node)


def test_robots_whose_names_look_alike_to_ros_have_different_nodes() -> None:
    assert node_name("r-1", "0123456789") != node_name("r_1", "9876543210")


@pytest.mark.parametrize("node", ["/camera", "/fleetsight_gateway_r1/camera", "/fleetsight_gateway"])
def test_other_nodes_are_no_gateways(node: str) -> None:
    assert not is_gateway(node)


@pytest.mark.parametrize("robot", ["r1", "forklift-7.b"])
def test_a_robots_gateways_are_known_by_the_names_that_they_get_and_by_no_others(robot: str) -> None:
    name = node_name(robot, "0123456789abcdef")
    assert is_of(f"/{name}", robot)
    assert is_of(f"/ns/{name}", robot)
    assert is_of(f"/{name}_2", robot)
    assert not is_of(f"/{name}_12345678", robot)
    for other in (f"/{name}0", f"/{name}/camera", f"/{name[:-1]}", f"/{name[:-1]}g", f"/x{name}", "/camera"):
        assert not is_of(other, robot)
    assert not is_of(f"/{node_name(f'{robot}_01234567', 'f' * 32)}", robot)
    assert not is_of(f"/{name}", f"{robot}_0")


def test_what_ros_cannot_write_is_an_underscore() -> None:
    assert ros_chunk("forklift-7.b_2") == "forklift_7_b_2"
