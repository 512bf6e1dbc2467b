"""Errors of the simulator."""


class SimulatorError(Exception):
    """The request cannot be carried out; the message is one line for the user."""


class MasterError(SimulatorError):
    """A robot's own ROS master cannot be started."""


class FloorPlanError(SimulatorError):
    """A floor plan cannot be written."""


class BagError(SimulatorError):
    """A bag cannot be written."""
