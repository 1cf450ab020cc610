"""pymeasure's Lake Shore client reads our simulator."""

import os
import subprocess
import time
from pathlib import Path

from pymeasure.instruments.lakeshore import LakeShore224

SIMULATOR = Path(os.environ["BEAMPOSE_EXAMPLES"]) / "simulator"
# The simulator takes 20 commands in a second, as the instrument does.
PACE = 0.06

simulator = subprocess.Popen(
    [SIMULATOR, "sensor", "lake-shore", "tcp:127.0.0.1:0", "channel=B"],
    stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
)
try:
    _, host, port = simulator.stdout.readline().strip().split(":")
    monitor = LakeShore224(
        f"TCPIP::{host}::{port}::SOCKET", visa_library="@py", write_termination="\r\n"
    )
    time.sleep(PACE)
    assert monitor.id.startswith("LSCI,MODEL336,"), monitor.id
    time.sleep(PACE)
    celsius = monitor.input_B.celsius
    time.sleep(PACE)
    kelvin = monitor.input_B.kelvin
    time.sleep(PACE)
    sensor = monitor.input_B.sensor
    time.sleep(PACE)
    absent = monitor.input_A.celsius
    # What the simulator's world has: 21 degrees.
    assert abs(celsius - 21.0) < 1e-3, celsius
    assert abs(kelvin - 294.15) < 1e-3, kelvin
    assert abs(sensor - 108.085) < 1e-3, sensor
    assert absent == 0.0, absent
    time.sleep(PACE)
    assert int(monitor.ask("RDGST? A")) == 128
    time.sleep(PACE)
    assert int(monitor.ask("RDGST? B")) == 0
finally:
    simulator.stdin.close()
    simulator.wait(10)
print("pymeasure LakeShore224: identity, CRDG?, KRDG?, SRDG? and the status of an open input")
