"""fleetsight: what every robot of a warehouse fleet sees, for programs of one's own.

    import asyncio, fleetsight

    async def main():
        async with fleetsight.connect("tcp/127.0.0.1:7447") as fleet:
            async for seen in fleet.class_lists(robot="r*"):
                print(seen.header.robot, seen.header.camera, seen.classes)

    asyncio.run(main())

`fleetsight.connect` and `fleetsight.Fleet` say what there is; docs/client.md is the guide.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from fleetsight import own_packages

own_packages.put_first(own_packages.CLIENT)

if TYPE_CHECKING:
    from fleetsight.api import *  # noqa: F403 - loaded below, when it is used: the command begins without it
else:

    def __getattr__(name):  # noqa: ANN001, ANN202
        if name == "__all__":
            return import_module("fleetsight.api").__all__
        if name.startswith("_") or name not in (api := import_module("fleetsight.api")).__all__:
            raise AttributeError(f"module 'fleetsight' has no attribute {name!r}")
        return getattr(api, name)

    def __dir__():  # noqa: ANN202
        return [*globals(), *import_module("fleetsight.api").__all__]
