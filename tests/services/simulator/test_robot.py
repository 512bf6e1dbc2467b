import asyncio
import time
from concurrent.futures import ThreadPoolExecutor

from gateway.ros1.image import TYPE_NAME, decode_image
from gateway.ros1.node import Node
from gateway.ros1.rosmaster import RosMaster
from gateway.ros1.subscriber import Message
from services.simulator.film import Film
from services.simulator.robot import FRAME_ID, Robot
from services.simulator.world import Camera


async def test_a_robot_publishes_its_film_while_somebody_subscribes() -> None:
    camera = Camera.with_field_of_view(64, 48, 1.2)
    received: asyncio.Queue[Message] = asyncio.Queue()
    with ThreadPoolExecutor(1) as executor:
        film = await asyncio.to_thread(Film, 1, camera, 4)
        robot = Robot("r1", "/camera/color/image_raw", film, hz=50)
        async with (
            RosMaster() as master,
            Node("/robot", master_uri=master.uri) as theirs,
            Node("/us", master_uri=master.uri) as ours,
        ):
            driving = asyncio.create_task(robot.run(theirs, executor))
            await asyncio.sleep(0.1)
            assert robot.sent == 0
            before_ns = time.time_ns()
            async with (
                asyncio.timeout(10),
                ours.subscribe("/camera/color/image_raw", TYPE_NAME, received.put_nowait),
            ):
                images = [decode_image((await received.get()).data) for _ in range(3)]
            driving.cancel()
            await asyncio.wait([driving])
    assert all((image.height, image.width, image.step, image.encoding) == (48, 64, 192, "rgb8") for image in images)
    assert all(before_ns < image.stamp <= time.time_ns() for image in images)
    assert {image.frame_id for image in images} == {FRAME_ID}
    for image in images:
        assert bytes(image.data) == film.picture(image.seq).tobytes()
    assert robot.sent >= 3
