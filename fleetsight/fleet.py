"""A program's place in the fleet: what it can subscribe to, ask and publish."""

from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager

from pydantic import ValidationError

from bus import MAX_REQUEST_BYTES, MAX_TIMEOUT_S
from bus.sharing import SharingSettings
from fleetsight.arguments import check_fields, check_name, names, rate_hz, shown, time_s
from fleetsight.asking import ask_detectors, ask_inventory, ask_world
from fleetsight.errors import NoMonitorError, NoWorkerError, NoWorldModelError, SettingsError, translated
from fleetsight.listening import Listening
from fleetsight.own_model import Find, OwnModel
from fleetsight.own_results import Results, publishing
from fleetsight.patterns import one_camera
from schemas.detections import Detections
from schemas.inventory import InventoryAnswer, InventoryRequest
from schemas.status import WorkerStatus
from schemas.world import WorldAnswer, WorldRequest


class Fleet(Listening):
    """The fleet, as `fleetsight.connect` gives it. To be used on the event loop's thread.

    Where methods take a `robot` and a `camera`, those are names in which `*` stands for any number of characters, such
    as `r*`; one that is not valid raises SettingsError at once. `keep` says what is kept of what the program has not
    taken yet: `fleetsight.LATEST` the newest of each camera, `fleetsight.QUEUE(100)` the newest 100 of all cameras, in
    order. Links that break are made again, and subscriptions with them, without an error: `problem` says so meanwhile.

    >>> async def main():
    ...     async with fleetsight.connect(endpoint) as fleet:
    ...         return fleet.problem
    >>> asyncio.run(main())
    ''
    """

    @property
    def problem(self) -> str:
        """Why nobody can be heard now, in words; empty while there is a link."""
        return self._bus.link_problem

    async def detect(self, image: bytes | bytearray | memoryview, *, timeout_s: float = 10.0) -> Detections:
        """Have one of the fleet's detector workers, any that is not busy, say what is in an image file.

        image: the file's content, JPEG, PNG or another format that Pillow reads, of 16 MiB at most.

        Raises:
            NoWorkerError: no worker is there.
            AnswerTimeoutError: one is, but did not answer within `timeout_s` seconds (60 at most).
            RefusedError: it is no image, or all workers were busy all the time.
            ConnectError: there is no link.
            SettingsError: these are no bytes, or too many, or the time is too long.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         found = await fleet.detect(b"an image file")
        ...         return found.objects[0].name, found.objects[0].score
        >>> asyncio.run(main())
        ('box', 0.75)
        """
        timeout_s, file = time_s("timeout_s", timeout_s, most_s=MAX_TIMEOUT_S), _file(image)
        cure = "start one with `fleetsight detector`"
        what = "an image for a detector worker"
        with translated(what, absent=NoWorkerError, cure=cure, link_problem=lambda: self.problem):
            return await ask_detectors(self._bus, file, timeout_s)

    async def inventory(
        self, *, robot: str = "", camera: str = "", name: str = "", in_view: bool = False, timeout_s: float = 5.0
    ) -> InventoryAnswer:
        """Ask the monitor what was seen where, which makes nobody work. All of it, unless told otherwise.

        robot, camera, name: of one robot, camera or class of objects, in full. in_view: what is in view now alone.

        Raises:
            NoMonitorError: no monitor is there.
            AnswerTimeoutError: no answer within `timeout_s` seconds (60 at most).
            ConnectError: there is no link.
            SettingsError: a name or a time that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         answer = await fleet.inventory(robot="r1", in_view=True)
        ...         return [(each.name, each.count) for each in answer.sightings]
        >>> asyncio.run(main())
        [('box', 2)]
        """
        timeout_s = time_s("timeout_s", timeout_s, most_s=MAX_TIMEOUT_S)
        for what, given in (("robot", robot), ("camera", camera)):
            if given != "":
                check_name(what, given)
        check_fields(InventoryRequest, name=name, in_view=in_view)
        question = InventoryRequest(robot=robot, camera=camera, name=name, in_view=in_view)
        cure = "start one with `fleetsight monitor`"
        with translated("the inventory", absent=NoMonitorError, cure=cure, link_problem=lambda: self.problem):
            return await ask_inventory(self._bus, question, timeout_s)

    async def world(
        self,
        site: str = "main",
        *,
        name: str = "",
        region: Sequence[tuple[float, float]] = (),
        robot: str = "",
        seen_within_s: float | None = None,
        timeout_s: float = 5.0,
    ) -> WorldAnswer:
        """Ask the world model for the objects of a site, each once, whoever saw it. All of them, unless told otherwise.

        name: of one class. region: corners of a polygon in the site's map, x and y in metres, that the objects' centres
        are in, 256 at most. robot: objects that it saw, in full. seen_within_s: seen at most so many seconds ago.

        Raises:
            NoWorldModelError: no world model keeps this site.
            AnswerTimeoutError: no answer within `timeout_s` seconds (60 at most).
            ConnectError: there is no link.
            SettingsError: a name, a region or a time that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet:
        ...         answer = await fleet.world("hall", name="pallet")
        ...         return [(each.id, each.at, each.size) for each in answer.objects]
        >>> asyncio.run(main())
        [('h-1', (2.0, 1.0, 0.5), (1.2, 0.8, 1.0))]
        """
        timeout_s = time_s("timeout_s", timeout_s, most_s=MAX_TIMEOUT_S)
        check_name("site", site)
        if robot != "":
            check_name("robot", robot)
        corners = list(region)
        check_fields(WorldRequest, name=name, region=corners, seen_within_s=seen_within_s)
        question = WorldRequest(name=name, region=corners, robot=robot, seen_within_s=seen_within_s)
        cure = "start one with `fleetsight worldmodel`"
        what = f"the world of site {site}"
        with translated(what, absent=NoWorldModelError, cure=cure, link_problem=lambda: self.problem):
            return await ask_world(self._bus, site, question, timeout_s)

    def results(self, robot: str, camera: str, *, opinion: bool = False) -> AbstractAsyncContextManager[Results]:
        """Publish what a model of one's own found in the images of one camera, for as long as the context lasts.

        For programs that have the images by other means; `serve_model` takes them from the fleet, and shares the
        cameras with the fleet's detectors. opinion: as a second opinion, which nobody counts.

        Raises:
            SettingsError: a name that is not valid.

        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet, fleet.results("r7", "rear") as results:
        ...         return results.wanted
        >>> asyncio.run(main())
        False
        """
        return publishing(self._bus, self._iterations, one_camera(robot, camera), opinion=opinion)

    async def serve_model(
        self,
        find: Find,
        *,
        model: str,
        classes: Sequence[str] = (),
        robots: Sequence[str] = (),
        opinion: bool = False,
        most_hz: float | None = None,
        worker: str | None = None,
    ) -> None:
        """Be a detector worker with a model of one's own, until cancelled.

        It shares the fleet's cameras with other detector workers, takes images only while somebody wants results, and
        publishes what `find` returns for each image as detections and class lists.

        find: called for one image at a time; of those that come meanwhile the newest of each camera waits. It must not
        block the event loop: compute with `await asyncio.to_thread(...)`. Its errors end the service and are raised.
        model: its name, for people. classes: what it can find, for people, 1,000 at most. robots: work for these alone,
        before all workers that are for any. opinion: give a second opinion, which nobody counts. most_hz: images a
        second of each camera that are asked for; all of them unless given. worker: its name; one that nobody has, and
        that begins with the certificate's, unless given.

        Raises:
            SettingsError: a name or a rate that is not valid, or one too long for others to read.
            MessageError: nobody could read what `find` returned.
            ClosedError: the fleet was left before.

        >>> async def find(image):
        ...     return [fleetsight.Detection(name="crate", score=0.9, box=fleetsight.Box(0, 0, 2, 2))]
        >>> async def main():
        ...     async with fleetsight.connect(endpoint) as fleet, asyncio.TaskGroup() as group:
        ...         serving = group.create_task(fleet.serve_model(find, model="crates", opinion=True, worker="mine"))
        ...         async for change in fleet.workers("opinion"):
        ...             print(change.who.worker)
        ...             break
        ...         serving.cancel()
        >>> asyncio.run(main())
        mine
        """
        most_hz, classes = rate_hz("most_hz", most_hz), names("classes", classes)
        check_fields(WorkerStatus, model=model, classes=classes)
        given = {"tls_certificate": self._certificate} if worker is None else {"worker": worker}
        try:
            sharing = SharingSettings.model_validate({"robots": names("robots", robots), **given})
        except ValidationError as error:
            raise SettingsError(error.errors()[0]["msg"].removeprefix("Value error, ")) from error
        await OwnModel(
            self._bus, self._iterations, find, model, sharing, classes=classes, opinion=opinion, most_hz=most_hz
        ).run()


def _file(image: object) -> bytes | bytearray:
    """Return the bytes of an image file.

    Raises:
        SettingsError: these are none, or too many.
    """
    if isinstance(image, memoryview):
        image = image.tobytes()
    if not isinstance(image, bytes | bytearray):
        raise SettingsError(f"image {shown(image)}: these are no bytes; give the content of an image file")
    if len(image) > MAX_REQUEST_BYTES:
        raise SettingsError(f"an image of {len(image)} bytes: at most {MAX_REQUEST_BYTES} are sent; make it smaller")
    return image
