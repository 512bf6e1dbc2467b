"""The contract: every message that crosses the bus, and every key it travels under.

Pure data (standard library and msgspec): any process, in any language, that honours these modules is part of the fleet.
"""
