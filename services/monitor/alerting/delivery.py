"""Delivers changed alerts: to the robots they are about, to webhooks, and as actions."""

import asyncio
from collections.abc import Callable
from uuid import uuid4

from bus import Bus
from schemas.alerts import Action, Alert
from services.monitor.alerting.robot_delivery import actions_to_robots, alerts_to_robots
from services.monitor.alerting.webhooks import Webhooks
from services.monitor.rules.model import PLACEHOLDERS, RobotAction, RuleBook
from services.monitor.rules.subjects import Effect


class Delivery:
    """Sends alerts where their rules say. robot_ns: see `Alerting`. webhooks: posts to those of the rules."""

    def __init__(self, robot_ns: Callable[[str, int], int]) -> None:
        self.webhooks = Webhooks()
        self._robot_ns = robot_ns
        self._alerts = alerts_to_robots()
        self._actions = actions_to_robots()

    async def run(self, bus: Bus) -> None:
        """Deliver until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._alerts.run(bus))
            group.create_task(self._actions.run(bus))
            group.create_task(self.webhooks.run())

    def send(self, effect: Effect, book: RuleBook) -> None:
        """Send what became of an alert. book: the rules in force, which may be later ones than its own."""
        alert, rule = effect.alert, effect.rule
        if alert.robot:
            self._alerts.send(alert)
        if rule is None:
            return
        told = dict.fromkeys([*rule.webhooks, *(rule.escalate_webhooks if effect.escalated else ())])
        for name in [name for name in told if name in book.webhooks]:
            self.webhooks.post(name, book.webhooks[name], alert)
        if effect.raised and rule.action is not None:
            robot_ns = self._robot_ns(alert.robot, alert.changed_ns)
            self._actions.send(action_of(rule.action, alert, uuid4().hex, robot_ns))


def action_of(asked: RobotAction, alert: Alert, action_id: str, robot_ns: int = 0) -> Action:
    """Return the action to send to a robot because of an alert. robot_ns: see `Action`."""
    payload = asked.payload
    for placeholder, value in zip(PLACEHOLDERS, (alert.robot, alert.camera, alert.name), strict=True):
        payload = payload.replace(placeholder, value)
    return Action(
        id=action_id,
        name=asked.name,
        robot=alert.robot,
        payload=payload,
        rule=alert.rule,
        sent_ns=alert.changed_ns,
        robot_ns=robot_ns,
    )
