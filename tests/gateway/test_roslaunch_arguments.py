import pytest

from gateway.roslaunch_arguments import options_of
from gateway.settings import GatewaySettings
from services.toolbox.settings import load


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("__name:=gw", ["--node-name=gw"]),
        ("__ns:=/r1", ["--namespace=/r1"]),
        ("__master:=http://robot:11311", ["--ros-master=http://robot:11311"]),
        ("__ip:=10.0.0.1", ["--ros-host=10.0.0.1"]),
        ("__hostname:=robot", ["--ros-host=robot"]),
        ("__log:=/tmp/gateway-1.log", []),
        ("__unheard_of:=1", []),
        ("_rate:=5", []),
        ("/camera/image:=/front/image", ["--remap=/camera/image=/front/image"]),
        ("image:=front/image", ["--remap=image=front/image"]),
        ("--robot", ["--robot"]),
        ("r1", ["r1"]),
        ("front=/image", ["front=/image"]),
        ("--cameras=a:=b", ["--cameras=a:=b"]),
    ],
)
def test_what_roslaunch_says_in_our_words(argument: str, options: list[str]) -> None:
    assert options_of([argument]) == options


def test_ros_arguments_among_options() -> None:
    given = ["--robot", "r1", "--cameras", "front=/camera/color/image_raw"]
    given += ["/camera/color/image_raw:=front/image", "tf:=/tf", "__ns:=r1", "__name:=gw", "__log:=x"]
    settings = load(GatewaySettings, options_of(given), prog="fleetsight gateway").settings
    assert list(settings.streams().values()) == ["/r1/front/image"]
    assert settings.remap == {"/camera/color/image_raw": "front/image", "tf": "/tf"}
    assert settings.names().node == "/r1/gw"
