"""One worker's share of the cameras. Pure."""

from collections.abc import Iterator

from bus.sharing.camera_assignment import MAX_CAMERAS, CameraAssignment
from schemas.keys import MOST_CAMERAS, CameraKey
from schemas.worker_keys import Serves, WorkerAlive


class OwnCameras:
    """One worker's share of the cameras.

    A camera that falls to another worker stays here until that one says that it has taken it over: a short overlap
    beats a gap. Results of the same frame twice have the same identity.
    """

    def __init__(self, worker: str) -> None:
        self._worker = worker
        self._assignment = CameraAssignment(worker)
        self._cameras: dict[str, dict[CameraKey, None]] = {}
        self._count = 0
        self._served: frozenset[CameraKey] = frozenset()
        self._handing_over = False

    def worker(self, token: WorkerAlive, *, alive: bool) -> bool:
        """Note that a worker came or went; return whether that is new."""
        return self._assignment.worker(token, alive=alive)

    def camera(self, camera: CameraKey, *, alive: bool) -> bool:
        """Note that a camera came or went; return whether that is new.

        Those over MAX_CAMERAS, or over MOST_CAMERAS of a robot, are ignored.
        """
        of_robot = self._cameras.get(camera.robot, {})
        if alive == (camera in of_robot) or (alive and (self._count >= MAX_CAMERAS or len(of_robot) >= MOST_CAMERAS)):
            return False
        if alive:
            self._cameras.setdefault(camera.robot, of_robot)[camera] = None
        else:
            del of_robot[camera]
            if not of_robot:
                del self._cameras[camera.robot]
            self._assignment.forget(camera)
        self._count += 1 if alive else -1
        return True

    def taken(self, token: Serves, *, alive: bool) -> bool:
        """Note that a worker took a camera over or released it; return whether that is new."""
        return self._assignment.taken(token, alive=alive)

    def plan(self, now_s: float, most: int) -> frozenset[CameraKey]:
        """Return the cameras to serve from now on: at most `most`, each robot's first one before any second one.

        now_s: any steady clock; a plan is good until `next_s`, or until there is news.
        """
        served = set[CameraKey]()
        self._handing_over = False
        for camera in self._in_turn():
            winner = self._assignment.owner(camera, now_s)
            if winner is None or len(served) >= most:
                continue
            if winner == self._worker:
                served.add(camera)
            elif camera in self._served and self._assignment.is_idle(camera, winner):
                served.add(camera)
                self._handing_over = True
        self._served = frozenset(served)
        return self._served

    def _in_turn(self) -> Iterator[CameraKey]:
        """Yield the cameras, robot by robot in turn, and of each robot those known longest first."""
        left = [iter(cameras) for cameras in self._cameras.values()]
        while left:
            more = []
            for cameras in left:
                if (camera := next(cameras, None)) is not None:
                    yield camera
                    more.append(cameras)
            left = more

    @property
    def next_s(self) -> float | None:
        """When the plan changes by itself, on the clock given to `plan`; None if never."""
        return self._assignment.next_s

    @property
    def handing_over(self) -> bool:
        """Whether a camera is still served that now belongs to another worker."""
        return self._handing_over
