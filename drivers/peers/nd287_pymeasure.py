"""pymeasure's client of the Heidenhain ND 287 reads our simulator; our driver reads the same."""

import os
import subprocess
import tempfile
import time
from pathlib import Path

from pymeasure.instruments.heidenhain import ND287

EXAMPLES = Path(os.environ["BEAMPOSE_EXAMPLES"])
# Where the simulated person pushes the rail, mm.
PLACE = 123.4567

with tempfile.TemporaryDirectory() as folder:
    link = Path(folder) / "port"
    simulator = subprocess.Popen(
        [EXAMPLES / "simulator", "linear_axis", "heidenhain-nd287", f"pty:{link}"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )
    try:
        assert simulator.stdout.readline().strip() == str(link)
        display = ND287(f"ASRL{link}::INSTR", visa_library="@py")
        identity = display.id
        assert identity[0] == "\x02" and "ND-287" in identity and len(identity) == 37, identity
        on_the_way = display.position
        time.sleep(3)
        there = display.position
        assert 0 <= on_the_way < PLACE and abs(there - PLACE) < 1e-9, (on_the_way, there)
        status = display.status
        assert "00000011" in str(status), status
        # Nothing is displayed: pymeasure takes the silence after a NAK for "no error".
        assert display.check_errors() is None
        display.adapter.close()
        time.sleep(0.2)
        command = [EXAMPLES / "read", "linear_axis", "heidenhain-nd287", str(link)]
        ours = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert "ND-287" in ours, ours
        assert abs(float(ours.split()[-1]) - there) < 1e-9, ours
    finally:
        simulator.stdin.close()
        simulator.wait(10)
print(f"pymeasure ND287: identity, status, no error, {on_the_way} then {there} mm; our driver agrees")
