"""Says once, at the start, when other ROS nodes cannot reach this machine where they are told to."""

import logging
from typing import Final

from gateway.doctor.finding import Severity
from gateway.doctor.master import check_host
from gateway.doctor.reaching import look_at_host
from gateway.settings import RosSettings

LOOKUP_S: Final = 10.0
"""How long the host's name may take to be looked up."""

log = logging.getLogger(__name__)


async def warn_of_own_host(settings: RosSettings) -> None:
    """Log what the doctor would call a problem of `ros_host`, and what it was given by."""
    look = await look_at_host(settings.ros_host, LOOKUP_S)
    for finding in check_host(look, remote_master=False):
        if finding.severity is Severity.PROBLEM:
            log.warning("%s %s: %s; %s", settings.host_given_by(), finding.subject, finding.what, finding.advice)
