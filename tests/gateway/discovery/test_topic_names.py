import pytest

from gateway.discovery.topic_names import read


@pytest.mark.parametrize(
    ("name", "path", "said", "onto"),
    [
        ("/front/color/image_raw", "front", "color image raw", ""),
        ("/image_raw", "", "image raw", ""),
        ("/camera/aligned_depth_to_color/image_raw", "camera", "aligned depth image raw", "color"),
        ("/rgb_to_depth/image_raw", "", "rgb image raw", "depth"),
        ("/velodyne_points", "velodyne", "points", ""),
        ("/a/front_Depth/image", "a/front", "depth image", ""),
        ("/camera/infra1/image_rect_raw", "camera", "infra1 image rect raw", ""),
        ("/rgb0/image_raw", "rgb0", "image raw", ""),
        ("/a/webcam2", "a/webcam2", "", ""),
        ("/depth_camera/image_raw", "camera", "depth image raw", ""),
        ("/front_depth_camera/image_raw", "front_camera", "depth image raw", ""),
        ("/cam/depth_front/image_raw", "cam/front", "depth image raw", ""),
        ("/depth/front/image_raw", "front", "depth image raw", ""),
        ("/a/depth/front/image_raw", "a/front", "depth image raw", ""),
        ("/a/aligned_depth_to_color_front/image_raw", "a/front", "aligned depth image raw", "color"),
        ("/front/rgb_left_image", "front/left", "image rgb", ""),
        ("/a/depth_cam", "a/cam", "depth", ""),
        ("/in_depth0/image_raw", "in_depth0", "image raw", ""),
    ],
)
def test_a_name_says_the_camera_and_what_is_shown(name: str, path: str, said: str, onto: str) -> None:
    found = read(name)
    assert found is not None
    assert "/".join(found.path) == path
    assert sorted(found.said) == sorted(said.split())
    assert sorted(found.onto) == sorted(onto.split())


@pytest.mark.parametrize("name", ["/front/picture", "/", "", "//", "/tracks/image_raw", "/seg/Mask/image_raw"])
def test_other_names_say_nothing(name: str) -> None:
    assert read(name) is None


def test_words_between_camera_and_leaf_are_counted() -> None:
    counts = [found.before for name in ("image_raw", "rgb/image_raw", "rgb_raw/x/hd/image") if (found := read(name))]
    assert counts == [0, 1, 1]
