"""Plans which topic becomes which stream."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Final

from gateway.discovery.candidates import (
    READERS,
    SIDES,
    Candidate,
    best,
    name_cameras,
    one_of_each_image,
    rectified_first,
    shows_colors,
    with_sides_joined,
)
from gateway.discovery.published_topics import Topic, calibrations_of, image_of, is_topic
from gateway.discovery.topic_names import Path, read, says_rectified
from gateway.node_names import ros_chunk
from gateway.to_bus.translators import StreamKind, camera_info, kind_of, points, transforms
from gateway.to_bus.translators.raw import STRING
from gateway.to_ros.outputs import is_result
from schemas.image import DEPTH_ENCODINGS
from schemas.keys import TF, TF_STATIC, CameraKey, RobotStreamKey, SensorKey, Stream, StreamKey
from schemas.status import MAX_STREAMS

EVERYTHING: Final = re.compile(".*")
NO_TOPIC: Final = re.compile("")


@dataclass(frozen=True, slots=True)
class DiscoverySettings:
    """A gateway's settings for its streams.

    named: topics that are taken as they are, published or not. discover: take what else is found.
    allow, deny: patterns for the whole names of found topics; `deny` wins.
    rectified: streams with rectified images, whatever their topics' names say.
    """

    robot: str
    named: Mapping[SensorKey, str] = field(default_factory=dict)
    discover: bool = True
    allow: re.Pattern[str] = EVERYTHING
    deny: re.Pattern[str] = NO_TOPIC
    rectified: frozenset[SensorKey] = frozenset()


NOT_A_NAME: Final = "its name is not valid for a stream's topic"
OF_GATEWAYS: Final = "published by gateways"
UNKNOWN_TYPE: Final = "the master does not know its type yet"
TEXT: Final = "a text; --discover --topics text/NAME=TOPIC takes it as well"
NO_SENSOR: Final = "not a sensor's message type; --discover --topics ros/NAME=TOPIC takes it as well, as it is"

TYPES: Final = READERS.keys() | {camera_info.TYPE_NAME, *transforms.TYPE_NAMES}


def why_not(topic: Topic, settings: DiscoverySettings, named: Collection[str]) -> str | None:
    """Return why discovery ignores a topic, or None. named: images that the settings name."""
    if not is_topic(topic.name):
        return NOT_A_NAME
    if topic.only_gateways or is_result(topic.name):
        return OF_GATEWAYS
    if image_of(topic.name) in named:
        return "the same image as a topic that the settings name"
    return _by_pattern(topic, settings) or _by_type(topic)


def _by_pattern(topic: Topic, settings: DiscoverySettings) -> str | None:
    if settings.deny.fullmatch(topic.name):
        return f"denied by --deny {settings.deny.pattern}"
    if not settings.allow.fullmatch(topic.name):
        return f"not allowed by --allow {settings.allow.pattern}"
    return None


def _by_type(topic: Topic) -> str | None:
    if not topic.type:
        return UNKNOWN_TYPE
    if topic.type == STRING:
        return TEXT
    return None if topic.type in TYPES else NO_SENSOR


UNNAMED: Final = (
    "not named like a camera's image or points; --discover --cameras NAME=TOPIC or --discover --topics "
    "NAME/STREAM=TOPIC takes it as well"
)
NO_COLOR: Final = "its pixels are encoded as depth, but its name says infrared"
NOBODYS: Final = "a calibration or transforms that no stream needs"
TOO_MANY: Final = f"over {MAX_STREAMS} streams, which is the most a gateway offers"
MAX_CAMERAS: Final = 1_000
INFOS: Final = {Stream.COLOR: Stream.INFO, Stream.DEPTH: Stream.DEPTH_INFO}


@dataclass(frozen=True, slots=True)
class Source:
    """The topic of a stream. type: empty while unknown."""

    topic: str
    type: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """The streams to offer.

    left_out: why, by topic. names: every camera's that was ever found. first: the camera that came first.
    rectified: see `DiscoverySettings`.
    """

    streams: Mapping[SensorKey, Source] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    names: Mapping[Path, str] = field(default_factory=dict)
    first: str | None = None
    rectified: frozenset[SensorKey] = frozenset()

    @property
    def cameras(self) -> list[CameraKey]:
        """The cameras with colour, which can have results, in order of appearance."""
        return sorted(cameras_of(self.streams), key=lambda key: (key.camera != self.first, key.camera))

    def of_points(self, key: SensorKey) -> bool:
        """Return whether a colour stream is made of its camera's point cloud: both have one topic."""
        if not isinstance(key, StreamKey) or key.stream is not Stream.COLOR:
            return False
        points = self.streams.get(StreamKey(key.camera, Stream.POINTS))
        return points is not None and key in self.streams and points.topic == self.streams[key].topic

    def kind_of(self, key: SensorKey) -> StreamKind:
        """Return the kind of one of the streams."""
        return kind_of(key, of_points=self.of_points(key), of_rectified=self._of_rectified(key))

    def _of_rectified(self, key: SensorKey) -> bool:
        """Return whether a stream is the calibration of a rectified image, by its topic's name or the settings."""
        if not isinstance(key, StreamKey):
            return False
        pictures = [StreamKey(key.camera, of) for of, info in INFOS.items() if info is key.stream]
        return any(
            picture in self.streams and (picture in self.rectified or says_rectified(self.streams[picture].topic))
            for picture in pictures
        )


def cameras_of(keys: Iterable[SensorKey]) -> list[CameraKey]:
    """Return the cameras that have a colour stream."""
    return [key.camera for key in keys if isinstance(key, StreamKey) and key.stream is Stream.COLOR]


NO_PLAN: Final = Plan()


def plan(topics: Iterable[Topic], settings: DiscoverySettings, before: Plan = NO_PLAN) -> Plan:
    """Return the plan for the topics published now, following the previous plan.

    The same topics give the same plan in whatever order they are. Cameras keep the names they have.
    """
    published = {topic.name: topic for topic in sorted(topics)}
    planning = _Planning(settings, published, before)
    if settings.discover:
        planning.discover()
    return planning.result()


class _Planning:
    def __init__(self, settings: DiscoverySettings, published: Mapping[str, Topic], before: Plan) -> None:
        self._settings = settings
        self._published = published
        self._before = before
        self._names = dict(before.names)
        self._left_out: dict[str, str] = {}
        self._streams = {key: Source(topic, self._type(topic)) for key, topic in settings.named.items()}

    def _type(self, topic: str) -> str:
        return self._published[topic].type if topic in self._published else ""

    def discover(self) -> None:
        self._name_what_is_named()
        looked_at = self._sieved()
        self._take_transforms(looked_at)
        candidates = self._named(self._candidates(looked_at))
        infos = {topic.name for topic in looked_at if topic.type == camera_info.TYPE_NAME}
        slots = best(candidates, self._names)
        for (name, stream), choice in slots.items():
            key = StreamKey(CameraKey(self._settings.robot, name), stream)
            depths = slots.get((name, Stream.DEPTH), [])
            rectified = self._wants_rectified(key, choice[0].topic.name, depths, infos)
            self._choose(key, rectified_first(choice) if rectified else choice)
        self._take_colors_of_points()
        self._take_infos(infos)
        self._leave_rest(looked_at)

    def result(self) -> Plan:
        for _, source in islice(self._streams.items(), MAX_STREAMS, None):
            self._left_out[source.topic] = TOO_MANY
        streams = dict(islice(self._streams.items(), MAX_STREAMS))
        first = self._before.first or next((camera.camera for camera in self._cameras(streams)), None)
        return Plan(streams, dict(sorted(self._left_out.items())), self._names, first, self._settings.rectified)

    def _cameras(self, streams: Mapping[SensorKey, Source]) -> list[CameraKey]:
        """Return the cameras with colour: those from the settings in their order, then the others by name."""
        return [*cameras_of(self._settings.named), *sorted(cameras_of(streams))]

    def _sieved(self) -> list[Topic]:
        named = {image_of(topic) for topic in self._settings.named.values()}
        looked_at = []
        for topic in self._published.values():
            if topic.name in self._settings.named.values():
                continue
            if reason := why_not(topic, self._settings, named):
                self._left_out[topic.name] = reason
            else:
                looked_at.append(topic)
        return looked_at

    def _take_transforms(self, topics: Iterable[Topic]) -> None:
        """Take `/tf` and `/tf_static`, or those in the robot's namespace where there is no global one."""
        found = [topic.name for topic in topics if topic.type in transforms.TYPE_NAMES]
        for stream in (TF, TF_STATIC):
            for name in (f"/{stream}", f"/{ros_chunk(self._settings.robot)}/{stream}"):
                if name in found:
                    self._streams.setdefault(
                        RobotStreamKey(self._settings.robot, stream), Source(name, self._type(name))
                    )

    def _candidates(self, topics: Sequence[Topic]) -> list[Candidate]:
        singles, doubles = one_of_each_image(topic for topic in topics if topic.type in READERS)
        self._left_out |= {name: f"the same image as {taken}" for name, taken in doubles.items()}
        found = []
        for topic in singles:
            candidate = READERS[topic.type](topic)
            if candidate is None:
                self._left_out[topic.name] = NO_COLOR if topic.encoding in DEPTH_ENCODINGS else UNNAMED
            else:
                found.append(candidate)
        return with_sides_joined(found, self._names)

    def _named(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates of cameras with a name: at most MAX_CAMERAS in a gateway's life."""
        known = set(self._names)
        new = sorted({candidate.path for candidate in candidates} - known)[: max(0, MAX_CAMERAS - len(known))]
        taken = [key.camera.camera for key in self._settings.named if isinstance(key, StreamKey)]
        self._names |= name_cameras(new, self._settings.robot, self._names_that_tell(candidates), taken)
        for candidate in candidates:
            if candidate.path not in self._names:
                self._left_out[candidate.topic.name] = f"over {MAX_CAMERAS} cameras, which is the most a gateway offers"
        return [candidate for candidate in candidates if candidate.path in self._names]

    def _names_that_tell(self, candidates: Sequence[Candidate]) -> dict[Path, str]:
        """Return the names that the names of further cameras depend on.

        Those of topics whose names say nothing do not count, unless something is found beside these.
        """
        named = [
            (key.camera.camera, topic) for key, topic in self._settings.named.items() if isinstance(key, StreamKey)
        ]
        apart = {camera for camera, _ in named} - {camera for camera, topic in named if read(image_of(topic))}
        found = {candidate.path for candidate in candidates}
        return {path: camera for path, camera in self._names.items() if camera not in apart or path in found}

    def _name_what_is_named(self) -> None:
        """Give cameras the names from the settings, also the whole camera of which one is a side."""
        for path, camera in self._named_paths():
            self._names.setdefault(path, camera)
        wholes: dict[Path, set[str]] = {}
        for path, camera in self._named_paths():
            if path and path[-1] in SIDES:
                wholes.setdefault(path[:-1], set()).add(camera)
        for path, cameras in wholes.items():
            if len(cameras) == 1:
                self._names.setdefault(path, *cameras)

    def _named_paths(self) -> Iterator[tuple[Path, str]]:
        """Return the cameras from the settings by path; the namespace where a topic's name tells none."""
        for key, topic in self._settings.named.items():
            found = read(image_of(topic))
            path = tuple(image_of(topic).strip("/").split("/")[:-1]) if found is None else found.path
            if isinstance(key, StreamKey) and (path or found):
                yield path, key.camera.camera

    def _wants_rectified(self, key: StreamKey, color: str, depths: Sequence[Candidate], infos: Collection[str]) -> bool:
        """Return whether a stream is colour beside rectified depth whose only calibration is colour's.

        One calibration is both pictures' only if both are rectified.
        """
        depth_key = StreamKey(key.camera, Stream.DEPTH)
        depth = self._settings.named.get(depth_key) or next((each.topic.name for each in depths), None)
        has_info = StreamKey(key.camera, Stream.DEPTH_INFO) in self._settings.named
        if key.stream is not Stream.COLOR or depth is None or has_info:
            return False
        own = set(calibrations_of(depth)).intersection(infos).difference(calibrations_of(color))
        return not own and (depth_key in self._settings.rectified or says_rectified(depth))

    def _choose(self, key: StreamKey, choice: Sequence[Candidate]) -> None:
        preferred = choice[0].topic
        taken = self._streams.setdefault(key, Source(preferred.name, preferred.type)).topic
        for candidate in choice:
            if candidate.topic.name != taken:
                self._left_out[candidate.topic.name] = f"{key.name} is {taken}"

    def _take_colors_of_points(self) -> None:
        """Use the image in a point cloud as colour of a camera without other colour, if its name says colour."""
        for key, source in list(self._streams.items()):
            if isinstance(key, StreamKey) and key.stream is Stream.POINTS and self._shows_colors(source.topic):
                self._streams.setdefault(StreamKey(key.camera, Stream.COLOR), source)

    def _shows_colors(self, topic: str) -> bool:
        """Return whether a point cloud is a colour image, by its name, unless its messages say otherwise."""
        heard = self._published[topic].encoding if topic in self._published else ""
        return shows_colors(topic) and heard in ("", points.ENCODING)

    def _take_infos(self, infos: set[str]) -> None:
        used = {source.topic for source in self._streams.values()}
        for key, source in list(self._streams.items()):
            if isinstance(key, StreamKey) and key.stream in INFOS:
                for name in calibrations_of(source.topic):
                    info = StreamKey(key.camera, INFOS[key.stream])
                    if name in infos - used and info not in self._streams:
                        self._streams[info] = Source(name, camera_info.TYPE_NAME)
                        used.add(name)

    def _leave_rest(self, topics: Iterable[Topic]) -> None:
        used = {source.topic for source in self._streams.values()}
        for topic in topics:
            if topic.name not in used:
                self._left_out.setdefault(topic.name, NOBODYS)
