"""The error of this package's pure parts."""

from services.geometry.errors import GeometryError


class CloudError(GeometryError):
    """Points that cannot be used, or an object that has none; its text says why and fits a result's `unmeasured`."""
