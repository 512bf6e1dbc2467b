"""The subcommands: purpose, settings and entry point of each, imported only when used."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import takewhile
from typing import Any, Final

from pydantic import BaseModel

from services.toolbox.settings import LogLevel

Run = Callable[[BaseModel], Awaitable[int | None]]


@dataclass(frozen=True, slots=True)
class Command:
    """A subcommand. Names are "module:name".

    run: a coroutine function that takes the settings. refusals: the errors it raises for settings that turn out to be
    wrong once used. extra: what must be installed beyond the base. positional: settings that the first arguments are
    for where they are no options. arguments: a function that turns arguments of other kinds into options. log_level:
    least severe events written unless told otherwise. finite: it has an end of its own, instead of running until it is
    told to stop; or the setting that gives it one. lasting: the tasks of a finite one that have none. examples: whole
    command lines, for the help.
    """

    name: str
    summary: str
    settings: str
    run: str
    refusals: tuple[str, ...] = ("bus:BusError",)
    extra: str | None = None
    positional: tuple[str, ...] = ()
    arguments: str | None = None
    log_level: LogLevel = "info"
    finite: bool | str = False
    lasting: tuple[str, ...] = ()
    examples: tuple[str, ...] = ()

    def load_settings(self) -> type[BaseModel]:
        """Import the settings model."""
        found: type[BaseModel] = _load(self.settings)
        return found

    def options_of(self, arguments: Sequence[str]) -> Sequence[str]:
        """Return the options that the arguments stand for."""
        given = list(takewhile(lambda argument: not argument.startswith("-"), arguments[: len(self.positional)]))
        named = [option for name, value in zip(self.positional, given, strict=False) for option in (f"--{name}", value)]
        options = [*named, *arguments[len(given) :]]
        found: Sequence[str] = options if self.arguments is None else _load(self.arguments)(options)
        return found

    def ends(self, settings: BaseModel) -> bool:
        """Return whether the command ends by itself with these settings."""
        if self.lasting and getattr(settings, "task", None) in self.lasting:
            return False
        return self.finite if isinstance(self.finite, bool) else getattr(settings, self.finite) is not None

    def load_run(self) -> Run:
        """Import the coroutine function that runs the process."""
        found: Run = _load(self.run)
        return found

    def load_refusals(self) -> tuple[type[Exception], ...]:
        """Import the error types that reject settings."""
        return tuple(_load(refusal) for refusal in self.refusals)


def _load(reference: str) -> Any:
    module, name = reference.split(":")
    return getattr(import_module(module), name)


COMMANDS: Final = (
    Command(
        "gateway",
        "on each robot: bridge ROS 1 camera topics to Zenoh, and results back, on demand",
        "gateway.settings:GatewaySettings",
        "gateway.process:run",
        refusals=("bus:BusError", "gateway.process:HostError"),
        arguments="gateway.roslaunch_arguments:options_of",
        examples=(
            "fleetsight gateway --robot r1 --connect tcp/central:7447",
            "fleetsight gateway --robot r1 --cameras front=/cam0/picture --topics front/depth=/cam0/range,tf=/tf",
            "fleetsight gateway --robot r1 --connect tcp/central:7447 --max-hz 10,*/depth=5 --uplink-mbit 8",
        ),
    ),
    Command(
        "doctor",
        "on a robot: diagnose why no data flows, and how to mend it",
        "gateway.doctor.settings:DoctorSettings",
        "gateway.doctor.process:run",
        arguments="gateway.roslaunch_arguments:options_of",
        finite=True,
        examples=(
            "fleetsight doctor --robot r1 --connect tcp/central:7447",
            "fleetsight doctor --config /etc/fleetsight/gateway.yaml --json",
            "fleetsight doctor --connect tcp/central:7447",
        ),
    ),
    Command(
        "detector",
        "anywhere: run a YOLO model on the cameras whose results are subscribed to",
        "services.detector.settings:DetectorSettings",
        "services.detector.process:run",
        refusals=("bus:BusError", "services.detector.model:ModelError"),
        extra="detector",
        examples=(
            "fleetsight detector --connect tcp/central:7447",
            "fleetsight detector --model my-seg.pt --robots r1 --device cuda:0",
            "fleetsight detector --opinion --model new.pt --connect tcp/central:7447",
        ),
    ),
    Command(
        "distance",
        "beside a gateway, or anywhere: measure the distance and position of detected objects",
        "services.distance.settings:DistanceSettings",
        "services.distance.process:run",
        extra="distance",
        examples=("fleetsight distance --robots r1 --connect tcp/central:7447",),
    ),
    Command(
        "cloud",
        "beside a gateway, or anywhere: cut detected objects out of point clouds",
        "services.cloud.settings:CloudSettings",
        "services.cloud.process:run",
        extra="cloud",
        examples=("fleetsight cloud --robots r1 --connect tcp/central:7447",),
    ),
    Command(
        "worldmodel",
        "anywhere: keep one inventory of a site, every object once, from what all robots see",
        "services.worldmodel.settings:WorldSettings",
        "services.worldmodel.process:run",
        extra="worldmodel",
        examples=(
            "fleetsight worldmodel --connect tcp/central:7447 --state /var/lib/fleetsight/world",
            "fleetsight worldmodel --sites hall-2=r1+r2,hall-3=r3 --connect tcp/central:7447",
        ),
    ),
    Command(
        "clouds",
        "show the clouds of a camera's objects in 3D, or save them as PLY and PCD",
        "services.toolbox.clouds.settings:CloudsSettings",
        "services.toolbox.clouds.process:run",
        refusals=("bus:BusError", "services.toolbox.clouds.errors:ViewerError"),
        extra="viewer",
        positional=("do", "robot", "camera"),
        log_level="error",
        finite=True,
        examples=("fleetsight clouds view r1 front", "fleetsight clouds save r1 front --folder clouds --count 5"),
    ),
    Command(
        "detect",
        "detect the objects in an image, with a worker of the fleet or a model on this machine",
        "services.toolbox.detect.settings:DetectSettings",
        "services.toolbox.detect.process:run",
        refusals=("bus:BusError", "services.detector.model:ModelError"),
        extra="detector",
        positional=("image",),
        log_level="error",
        finite=True,
        examples=(
            "fleetsight detect photo.jpg --connect tcp/central:7447",
            "fleetsight detect photo.jpg --local --model my-seg.pt --json",
        ),
    ),
    Command(
        "monitor",
        "centrally: show what every robot sees, live",
        "services.monitor.settings:MonitorSettings",
        "services.monitor.process:run",
        refusals=(
            "bus:BusError",
            "services.monitor.history.state:OtherVersionError",
            "services.monitor.map.floor_plan:FloorPlanError",
            "services.monitor.rules.loading:RuleFileError",
            "services.monitor.web.process:WebError",
            "services.monitor.world.zones:ZoneFileError",
        ),
        extra="monitor",
        examples=(
            "fleetsight monitor --listen tls/0.0.0.0:7447 --tls pki/central --access access.json",
            "fleetsight monitor --rules rules.yaml --floor-plan map.yaml --web-host 0.0.0.0",
            "fleetsight monitor --history postgresql://fleetsight@db/fleetsight",
        ),
    ),
    Command(
        "users",
        "manage the users of the monitor's page and API",
        "services.monitor.settings:UsersSettings",
        "services.monitor.web.auth.command:run",
        refusals=("services.monitor.history.state:HistoryError", "services.monitor.web.auth.command:UsersError"),
        extra="monitor",
        positional=("task", "name"),
        log_level="error",
        finite=True,
        examples=(
            "fleetsight users add bob --role viewer",
            "fleetsight users reset bob --role operator",
            "fleetsight users remove bob",
            "fleetsight users list",
            "fleetsight users token bob --days 30",
        ),
    ),
    Command(
        "history",
        "export a monitor's history to CSV or Parquet; back up, restore, maintain its database",
        "services.monitor.history.settings:ExportSettings",
        "services.monitor.history.export:run",
        refusals=("services.monitor.history.state:HistoryError",),
        extra="monitor",
        positional=("task",),
        finite=True,
        examples=(
            "fleetsight history export --to seen.csv --since 2026-11-20T06:00 --robot r1",
            "fleetsight history export --to alerts.parquet --what alerts",
            "fleetsight history backup --to /var/backups/fleetsight.db --history sqlite:////var/lib/fleetsight/history.db",
            "fleetsight history restore --from /var/backups/fleetsight.db --history sqlite:////var/lib/fleetsight/history.db",
            "fleetsight history trust-clock",
            "fleetsight history compact --history sqlite:////var/lib/fleetsight/history.db",
        ),
    ),
    Command(
        "rules",
        "test a rule file against a monitor's history",
        "services.monitor.settings:RulesSettings",
        "services.monitor.rules.command:run",
        refusals=("services.monitor.history.state:HistoryError", "services.monitor.rules.loading:RuleFileError"),
        extra="monitor",
        positional=("task", "file"),
        finite=True,
        examples=("fleetsight rules test rules.yaml --since 2026-11-20T06:00",),
    ),
    Command(
        "pki",
        "make, hand out, list, renew and revoke the certificates by which a fleet's machines know each other",
        "services.access.settings:PkiSettings",
        "services.access.process:run_pki",
        refusals=("services.access.process:AccessError",),
        extra="pki",
        positional=("task", "name"),
        log_level="error",
        finite=True,
        lasting=("serve",),
        examples=(
            "fleetsight pki init",
            "fleetsight pki issue central --hosts 192.168.0.10",
            "fleetsight pki issue r1",
            "fleetsight pki list",
            "fleetsight pki renew",
            "fleetsight pki revoke r17",
            "fleetsight pki serve --folder pki --fleet fleet.yaml",
            "fleetsight pki invite r4 --at central:7448 --days 7",
            "fleetsight pki enrol r4 --renew --at central:7448 --into /etc/fleetsight/tls",
        ),
    ),
    Command(
        "access",
        "print the rules by which routers let each certificate do what it is for, and nothing else",
        "services.access.settings:AccessSettings",
        "services.access.process:run_access",
        refusals=("services.access.process:AccessError",),
        extra="pki",
        positional=("fleet",),
        log_level="error",
        finite=True,
        examples=("fleetsight access fleet.yaml --folder pki --to access.json",),
    ),
    Command(
        "call",
        "call a ROS service of a robot whose gateway lists it",
        "services.toolbox.call.settings:CallSettings",
        "services.toolbox.call.process:run",
        positional=("robot", "service"),
        log_level="error",
        finite=True,
        examples=("fleetsight call r1 /reset --connect tcp/central:7447", "fleetsight call r1 /lights --data true"),
    ),
    Command(
        "simulate",
        "simulate robots: ROS 1 sensors in a rendered warehouse, live or as bags",
        "services.simulator.settings:SimulatorSettings",
        "services.simulator.process:run",
        refusals=("services.simulator.errors:SimulatorError",),
        extra="simulator",
        finite="bag",
        examples=(
            "fleetsight simulate --robots 5 --hz 5",
            "fleetsight simulate --robots 5 --bag '{robot}.bag'",
            "fleetsight simulate --streams color,depth --ros-master http://robot:11311",
        ),
    ),
    Command(
        "collect",
        "save pictures of live cameras for training, with drafts of labels",
        "services.toolbox.collect.settings:CollectSettings",
        "services.toolbox.collect.process:run",
        refusals=("bus:BusError", "services.data_folder:DatasetError"),
        extra="detector",
        positional=("folder",),
        finite=True,
        examples=(
            "fleetsight collect site --every-s 30 --robots 'r*' --connect tcp/central:7447",
            "fleetsight collect site --unsure 0.25..0.4 --appears forklift --most 300",
            "fleetsight collect site --disagree --blur person --seconds 3600",
        ),
    ),
    Command(
        "labels",
        "take the labels of a data-set folder to CVAT, Label Studio and other tools, and back",
        "services.toolbox.labels.settings:LabelsSettings",
        "services.toolbox.labels.process:run",
        refusals=("services.toolbox.labels.objects:LabelsError",),
        extra="detector",
        positional=("task", "source", "target"),
        finite=True,
        examples=(
            "fleetsight labels export site tasks.json --to label-studio",
            "fleetsight labels import project.json site",
            "fleetsight labels check site",
        ),
    ),
    Command(
        "train",
        "train a model such as the shipped one: render, train, evaluate, write weights and card",
        "services.training.settings:TrainingSettings",
        "services.toolbox.train.process:run",
        refusals=("services.training.files:TrainingError",),
        extra="train",
        finite=True,
        examples=(
            "fleetsight train --output my.pt",
            "fleetsight train --images 200 --holdout 20 --polish-epochs 0 --refiner-images 200 --output quick.pt",
        ),
    ),
    Command(
        "demo",
        "run everything on this machine: simulated robots, gateways, detector and monitor",
        "services.toolbox.demo.settings:DemoSettings",
        "services.toolbox.demo.process:run",
        extra="all",
        examples=(
            "fleetsight demo --robots 3",
            "fleetsight demo --seconds 30 --model my-seg.pt",
        ),
    ),
)
