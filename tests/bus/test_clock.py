import subprocess
import sys

from bus.clocks import clock_id


def test_every_process_of_a_machine_reads_the_same_clock() -> None:
    other = subprocess.run(
        [sys.executable, "-c", "from bus.clocks import clock_id; print(clock_id())"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert clock_id() == other.stdout.strip() != ""
