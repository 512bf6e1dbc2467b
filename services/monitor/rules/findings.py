"""Evaluates the conditions of rules on one change or on the current state of one camera. Pure."""

from collections.abc import Iterator, Mapping
from typing import Final, assert_never

import msgspec

from schemas.keys import CameraKey
from services.monitor.inventory.sighting import Change, ChangeKind
from services.monitor.rules import alert_texts
from services.monitor.rules.model import (
    AnyRule,
    AppearsRule,
    DisagreeRule,
    DisappearsRule,
    NearerRule,
    OverRule,
    SilentRule,
    UnderRule,
    WorldRule,
)

COMING_AND_GOING: Final = (ChangeKind.APPEARED, ChangeKind.VANISHED)


class CameraState(msgspec.Struct, frozen=True, gc=False):
    """The state of one camera. available: it is current; else it is the last known one.

    silent_ns: since when the camera says nothing, epoch; None while that is not sure. complete: missing classes are not
    there; else, as soon after the monitor could hear nothing, they may be still to come.
    counts: by class, of those that were ever in view. settled: enough lists came for what was there from the first one
    to count; else more may be in view. nearest: metres by class, where known. disagreements: by class, what two models
    count.
    """

    key: CameraKey
    available: bool
    silent_ns: int | None = None
    complete: bool = True
    counts: Mapping[str, int] = {}
    settled: bool = True
    nearest: Mapping[str, float] = {}
    disagreements: Mapping[str, tuple[int, int]] = {}


class Finding(msgspec.Struct, frozen=True, gc=False):
    """Whether a rule's condition holds for a class, and the alert's text where it does. object: for this one alone.

    holds: None where it is not known any more. since_ns: since when it holds, epoch; now unless given. until_ns: of one
    that holds no more, until when it was seen to; unknown unless given.
    """

    name: str
    holds: bool | None
    text: str = ""
    since_ns: int | None = None
    until_ns: int | None = None
    object: str = ""


def findings(rule: AnyRule, look: CameraState) -> Iterator[Finding]:
    """Yield a rule's findings for a camera; none for unknown facts.

    That something came or went is found in changes, see `found_in`. That it is over is found here too: of what went,
    or came back, while the camera was unavailable there is no change.
    """
    match rule:
        case AppearsRule() | DisappearsRule():
            in_view = look.counts.get(rule.of, 0) > 0
            known = look.available and (in_view or look.settled)
            if known and in_view is isinstance(rule, DisappearsRule):
                yield Finding(rule.of, holds=False)
        case SilentRule():
            if rule.of_cameras:
                yield _silent(look)
        case OverRule() if look.available:
            count = look.counts.get(rule.of, 0)
            over = count > rule.count
            text = alert_texts.over(rule.of, look.key, count, rule.count) if over else ""
            yield Finding(rule.of, over if over or look.settled else None, text)
        case UnderRule() if look.available:
            count = look.counts.get(rule.of, 0)
            under = count < rule.count
            text = alert_texts.under(rule.of, look.key, count, rule.count) if under else ""
            yield Finding(rule.of, under if look.settled or not under else None, text)
        case NearerRule() if look.available:
            yield _nearer(rule, look)
        case DisagreeRule() if look.available:
            yield from _disagreements(rule, look)
        case OverRule() | UnderRule() | NearerRule() | DisagreeRule() | WorldRule():
            return
        case _:
            assert_never(rule)


def found_in(change: Change, rule: AnyRule) -> Finding | None:
    """Return a rule's finding for a change, with its time; None for rules that are not about what is in view."""
    of = change.sighting
    told = _told_by(change, rule)
    if told is None:
        return None
    holds, text = told
    if holds:
        return Finding(of.name, holds=True, text=text, since_ns=of.since_ns)
    # what vanished was seen in its last list; any other count lasts until the list that moved it
    seen_last = change.kind is ChangeKind.VANISHED and not isinstance(rule, UnderRule)
    return Finding(of.name, holds=False, until_ns=of.last_ns if seen_last else of.since_ns - 1)


def _told_by(change: Change, rule: AnyRule) -> tuple[bool, str] | None:
    """Return whether a rule's condition holds after a change, and the alert's text; None if that is not told."""
    of, kind = change.sighting, change.kind
    match rule:
        case AppearsRule() | DisappearsRule() | OverRule() | UnderRule() if rule.of != of.name:
            return None
        case AppearsRule() if kind in COMING_AND_GOING and not change.first_look:
            return kind is ChangeKind.APPEARED, alert_texts.appeared(of.name, of.key)
        case DisappearsRule() if kind in COMING_AND_GOING:
            return kind is ChangeKind.VANISHED, alert_texts.disappeared(of.name, of.key)
        case OverRule() if kind is not ChangeKind.LOST:
            return of.count > rule.count, alert_texts.over(of.name, of.key, of.count, rule.count)
        case UnderRule() if kind is not ChangeKind.LOST and not change.first_look:
            return of.count < rule.count, alert_texts.under(of.name, of.key, of.count, rule.count)
        case _:
            return None


def _silent(look: CameraState) -> Finding:
    if look.available:
        return Finding("", holds=False)
    if look.silent_ns is None:
        return Finding("", holds=None)
    return Finding("", holds=True, text=alert_texts.silent(look.key), since_ns=look.silent_ns)


def _nearer(rule: NearerRule, look: CameraState) -> Finding:
    """Return whether the object is near; objects out of view, or at an unknown distance, are not."""
    nearest = look.nearest.get(rule.of)
    to_come = not look.complete if look.counts.get(rule.of, 0) else not look.settled
    if nearest is None and to_come:
        return Finding(rule.of, holds=None)
    if nearest is None or nearest >= rule.than_m:
        return Finding(rule.of, holds=False)
    text = alert_texts.nearer(rule.of, look.key, nearest, rule.than_m)
    return Finding(rule.of, holds=True, text=text)


def _disagreements(rule: DisagreeRule, look: CameraState) -> Iterator[Finding]:
    for name in [rule.of] if rule.of else look.counts:
        counts = look.disagreements.get(name)
        if counts is None:
            yield Finding(name, holds=False if look.complete and look.settled else None)
        else:
            text = alert_texts.disagree(name, look.key, counts)
            yield Finding(name, holds=True, text=text)
