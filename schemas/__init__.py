"""The contract: every message on the bus, and its key.

Pure data (standard library and msgspec): any process, in any language, that honours these modules is part of the fleet.
"""
