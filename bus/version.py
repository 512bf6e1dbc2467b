"""Which fleetsight this is, for what processes say of themselves."""

from importlib.metadata import version
from typing import Final

VERSION: Final = version("fleetsight")
