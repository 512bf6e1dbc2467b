"""Bytes of a real rospy and of real masters; see golden/README.md."""

from __future__ import annotations

from pathlib import Path

GOLDEN = Path(__file__).parent
PUBLISHER_HEADER = (GOLDEN / "publisher-header.bin").read_bytes()
PUBLISHER_REFUSAL = (GOLDEN / "publisher-refusal.bin").read_bytes()
SUBSCRIBER_HEADER = (GOLDEN / "subscriber-header.bin").read_bytes()
SERVICE_HEADER = (GOLDEN / "service-header.bin").read_bytes()
SERVICE_ANSWER = (GOLDEN / "service-answer.bin").read_bytes()
SERVICE_FAILURE = (GOLDEN / "service-failure.bin").read_bytes()
SERVICE_REFUSAL = (GOLDEN / "service-refusal.bin").read_bytes()
IMAGE = (GOLDEN / "image.bin").read_bytes()
REGISTER_PUBLISHER = (GOLDEN / "registerPublisher.xml").read_bytes()
PYTHON2_SUBSCRIBED = (GOLDEN / "python2-registerSubscriber-answer.http").read_bytes()
PYTHON2_STATE = (GOLDEN / "python2-getSystemState-answer.http").read_bytes()
PYTHON2_UNSET = (GOLDEN / "python2-getParam-answer.http").read_bytes()
PYTHON2_UPDATE = (GOLDEN / "python2-publisherUpdate.http").read_bytes()
REGISTER_PUBLISHER_RESPONSE = (GOLDEN / "registerPublisher-response.xml").read_bytes()

IMAGE_MD5 = "060021388200f6f0f447d0fcd9c64743"
TOPIC = "/camera/image_raw"
