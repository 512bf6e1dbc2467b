"""What keeps robots from being simulated."""


class SimulatorError(Exception):
    """What was asked for cannot be done; the message is one line for the user."""


class MasterError(SimulatorError):
    """A robot's own ROS master cannot be started."""


class FloorPlanError(SimulatorError):
    """A floor plan cannot be written."""


class BagError(SimulatorError):
    """A bag cannot be written."""
