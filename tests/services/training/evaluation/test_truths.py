import numpy as np
from pycocotools import mask as coco

from services.simulator.world import Camera, Drive, generate, render
from services.training.evaluation.truths import truths_of
from services.training.viewpoints import CameraView
from tests.services.training.evaluation.pictures import truth


def test_an_object_is_asked_for_from_an_area_and_half_visible_on() -> None:
    seen = truth("box", 0, 0, 20, 1, visibility=0.5)
    assert seen.area == 0.001
    assert seen.asked_for(0.001)
    assert not seen.asked_for(0.00101)
    assert not truth("box", 0, 0, 20, 1, visibility=0.49).asked_for(0.001)


def test_every_object_in_view_is_there_with_its_pixels() -> None:
    scene, camera = generate(702), Camera()
    pose = Drive.plan(scene).pose(0.5)
    rendering = render(scene, pose, camera)
    truths = truths_of(scene, CameraView(pose, camera, rendering))
    instances = sorted(set(np.unique(rendering.instances)) - {0})
    assert [each.name for each in truths] == [scene.class_name(instance) for instance in instances]
    for each, instance in zip(truths, instances, strict=True):
        pixels = coco.decode({"size": each.mask.size, "counts": each.mask.counts})
        assert np.array_equal(pixels, rendering.instances == instance)
        assert each.pixels == pixels.sum()
        assert 0 < each.visibility <= 1
