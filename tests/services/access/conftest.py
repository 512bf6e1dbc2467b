from collections.abc import Iterator

import pytest

from tests.services.access.links import Fleet, make_pki, member, router
from tests.services.access.rights import MEMBERS


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    folder = tmp_path_factory.mktemp("access") / "pki"
    make_pki(folder)
    with router(folder) as (central, endpoint):
        members = {}
        opened = [member(folder, name, endpoint) for name in MEMBERS]
        try:
            for name, each in zip(MEMBERS, opened, strict=True):
                members[name] = each.__enter__()
            yield Fleet(folder, central, endpoint, members)
        finally:
            for session in members.values():
                session.close()
