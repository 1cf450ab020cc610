"""The daemon of yaqd-newport, told by yaqc, drives our SMC100 simulator over a pty."""

import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import tomllib

import yaqc

from simulated import simulator


def until(what, condition, seconds=30.0):
    end = time.monotonic() + seconds
    while True:
        try:
            if condition():
                return
        except (ConnectionError, OSError):
            pass
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.05)


def free_port():
    with socket.socket() as line:
        line.bind(("127.0.0.1", 0))
        return line.getsockname()[1]


with (
    simulator("linear_axis", "newport-smc", "pty") as path,
    tempfile.TemporaryDirectory(prefix="beampose-peer-") as folder,
):
    port = free_port()
    config = pathlib.Path(folder) / "config.toml"
    config.write_text(f'[stage]\nport = {port}\nserial_port = "{path}"\naxis = 1\n')
    program = pathlib.Path(sys.executable).parent / "yaqd-newport-smc100"
    # What it remembers from one run to the next it keeps there too.
    environment = dict(os.environ, HOME=folder, XDG_DATA_HOME=folder, XDG_CONFIG_HOME=folder)
    log = open(pathlib.Path(folder) / "log", "w+")
    daemon = subprocess.Popen(
        [program, "--config", config], env=environment, stdout=log, stderr=log
    )
    try:
        until("the daemon", lambda: yaqc.Client(port))
        stage = yaqc.Client(port)

        def state():
            return tomllib.loads(stage.get_state())

        # It resets the controller, which is deaf for 5 s, and searches the reference.
        until("the reference", lambda: not stage.busy() and state()["status"])
        assert state()["status"].startswith("READY"), state()
        assert state()["hw_limits"] == [0.0, 300.0], state()
        for target in (20.0, 5.0):
            stage.set_position(target)
            until("a move", lambda: state()["status"].startswith("MOVING"))
            until("its end", lambda: not stage.busy())
            assert state()["status"] == "READY from MOVING", state()
            until("where it is", lambda: abs(stage.get_position() - target) < 1e-4)
        # Out of reach: the controller says so, and stays.
        stage.direct_serial_write(b"PA1000")
        time.sleep(1.0)
        log.seek(0)
        said = log.read()
        assert "Displacement out of limits [G]" in said, said
        assert abs(stage.get_position() - 5.0) < 1e-4
        # Off and on.
        stage.direct_serial_write(b"MM0")
        until("off", lambda: state()["status"] == "DISABLE from READY")
        stage.clear_disable()
        until("on", lambda: state()["status"] == "READY from DISABLE")
        assert state()["error_code"] == "0000", state()
        stage.shutdown()
        daemon.wait(timeout=10)
    except BaseException:
        log.seek(0)
        print(log.read()[-3000:], file=sys.stderr)
        raise
    finally:
        if daemon.poll() is None:
            daemon.terminate()
            daemon.wait(timeout=10)
print(
    "yaqd-newport 2025.12.0, pty: resets, homes, reads limits, moves, reads states and positions, "
    "is refused beyond the limits, motor off and on"
)
