"""The images that tests build, and a program that says what is in one."""

from typing import Final

from deploy.release import images
from tests.deploy.support.units import DEPLOY

ALL_EXTRAS: Final = {
    target: extras
    for target, extras in images((DEPLOY / "Containerfile").read_text(encoding="utf-8")).items()
    if extras
}
"""What of fleetsight each target has."""

EXTRAS: Final = {target: extras for target, extras in ALL_EXTRAS.items() if target != "detector"}
"""The same without the detector's for GPUs: its torch alone has more bytes than all of these."""

REVISION: Final = "0123456789abcdef0123456789abcdef01234567"
LARGEST_MB: Final = {"gateway": 350, "detector-cpu": 800}
"""Size of an image at most."""

PEERS: Final = ("postgresql", "prometheus")
"""Debian's own, that compose.yaml has beside ours."""

STARTED: Final = (
    "postgresql",
    "prometheus",
    "monitor",
    "worldmodel",
    "distance",
    "cloud",
    "detector",
    "simulator",
    "gateway",
)
"""Services of compose.yaml, in the order in which they start."""

LOOK: Final = """
import json, os, subprocess
from importlib.metadata import distributions

names = ("pip", "pip3*", "pip-*", "ensurepip", "setuptools", "gcc-[0-9]*", "g++*", "cc1", "make", "git", "curl", "wget")
named = [part for name in names for part in ("-o", "-name", name)][1:]
print(json.dumps({
    "user": os.getuid(),
    "version": subprocess.check_output(["fleetsight", "--version"], text=True),
    "tools": subprocess.check_output(["find", "/usr/bin", "/usr/lib", "/usr/share", "/opt", *named], text=True),
    "packages": {each.name: each.version for each in distributions() if each.name != "fleetsight"},
}))
"""
"""Prints its user, its version, tools to build with, and Python's packages."""
