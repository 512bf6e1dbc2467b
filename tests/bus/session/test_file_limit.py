import subprocess
import sys

import pytest

from bus.session.link_use import MOST_FILES

LIMITED = """
import resource
import sys
from bus.session.process_limits import raise_file_limit
soft, hard = map(int, sys.argv[1:])
resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
print(raise_file_limit(), *resource.getrlimit(resource.RLIMIT_NOFILE))
"""


@pytest.mark.parametrize(("soft", "hard", "raised"), [(256, 4_096, 4_096), (4_096, 4_096, 4_096)])
def test_it_is_raised_to_the_hard_limit(soft: int, hard: int, raised: int) -> None:
    command = [sys.executable, "-c", LIMITED, str(soft), str(hard)]
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    assert said.split() == [str(raised), str(raised), str(hard)]
    assert raised <= MOST_FILES
