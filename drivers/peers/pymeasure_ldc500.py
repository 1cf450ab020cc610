"""pymeasure's LDC500Series against our simulated LDC501, over TCP.

Started by .ci/peers as: pymeasure_ldc500.py SIMULATOR (the built example `simulator`).
"""

import socket
import subprocess
import sys
from contextlib import contextmanager

from pymeasure.errors import Error
from pymeasure.instruments.srs import LDC500Series


@contextmanager
def simulator(kind):
    """Yields host and port of a fresh device."""
    options = ["limit_current=120"] if kind == "laser" else []
    process = subprocess.Popen(
        [sys.argv[1], kind, "srs-ldc500", "tcp:127.0.0.1:0", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        _, host, port = process.stdout.readline().strip().split(":")
        yield host, int(port)
    finally:
        process.stdin.close()
        assert process.wait(10) == 0, "the simulator did not end well"


def client(host, port):
    return LDC500Series(
        f"TCPIP::{host}::{port}::SOCKET",
        visa_library="@py",
        read_termination="\n",
        write_termination="\n",
        timeout=2000,
    )


def raw(host, port, text):
    """What a second client without any library reads."""
    with socket.create_connection((host, port), timeout=2) as line:
        line.sendall(text.encode())
        return line.makefile("r").readline().strip()


def refused(action):
    try:
        action()
    except Error:
        return
    raise AssertionError("expected an error from the registers")


def settings(ldc, raw_value):
    """Writes each through pymeasure; reads it through pymeasure and past it."""
    count = 0
    for channel, name, word, value in [
        ("ld", "current_limit", "SILM", 150.0),
        ("ld", "current_setpoint", "SILD", 60.5),
        ("ld", "voltage_limit", "SVLM", 3.5),
        ("ld", "mode", "SMOD", "CC"),
        ("ld", "current_range", "RNGE", "LOW"),
        ("ld", "modulation_enabled", "MODU", False),
        ("ld", "modulation_bandwidth", "SIBW", "HIGH"),
        ("pd", "units", "PDMW", "mW"),
        ("pd", "bias", "BIAS", 2.5),
        ("pd", "current_limit", "PILM", 900.0),
        ("pd", "power_limit", "PWLM", 12.0),
        ("tec", "mode", "TMOD", "CT"),
        ("tec", "current_limit", "TILM", 1.5),
        ("tec", "voltage_limit", "TVLM", 4.0),
        ("tec", "temperature_setpoint", "TEMP", 24.25),
        ("tec", "temperature_low_limit", "TMIN", 10.0),
        ("tec", "temperature_high_limit", "TMAX", 40.0),
    ]:
        part = getattr(ldc, channel)
        setattr(part, name, value)
        assert getattr(part, name) == value, (name, getattr(part, name))
        found = raw_value(f"{word}?\n")
        expected = {True: "ON", False: "OFF", "mW": "ON"}.get(value, value)
        assert found == expected or float(found) == expected, (name, found)
        count += 1
    return count


def main():
    with simulator("laser") as (host, port):
        ldc = client(host, port)
        assert "LDC501" in ldc.id, ldc.id
        # As somebody left it; a second connection, as our driver opens it, changes nothing of that.
        assert raw(host, port, "\nULOC 1\nTOKN ON\nILOC?\n") == "CLOSED"
        assert ldc.ld.interlock_closed is True
        assert ldc.ld.enabled is False and ldc.ld.current == 0.0
        count = settings(ldc, lambda text: raw(host, port, text))

        ldc.ld.enabled = True
        assert ldc.ld.enabled is True
        assert abs(ldc.ld.current - 60.5) < 1e-3, ldc.ld.current
        assert raw(host, port, "RILD?\n") == "60.500"
        # Set from the other side, read by pymeasure.
        assert raw(host, port, "SILD 33.25;SILD?\n") == "33.250"
        assert ldc.ld.current == 33.25 and ldc.ld.current_setpoint == 33.25
        # The limit drags the set point.
        ldc.ld.current_limit = 20
        assert ldc.ld.current_setpoint == 20.0 and ldc.ld.current == 20.0
        refused(lambda: setattr(ldc.ld, "current_setpoint", 30))
        refused(lambda: setattr(ldc.ld, "current_limit", 400))  # range LOW: 250 mA
        assert ldc.check_errors() == [0, 0]
        ldc.write("NONE 1")
        refused(ldc.check_set_errors)
        ldc.ld.enabled = False
        assert ldc.ld.enabled is False and ldc.ld.current == 0.0
        assert ldc.tec.temperature == 25.0
        ldc.adapter.close()
        print(f"pymeasure LDC500Series, laser: identity, contact, on, off, measured current, "
              f"{count} settings both ways, limits and error registers")

    with simulator("sensor") as (host, port):
        ldc = client(host, port)
        assert ldc.tec.temperature == 21.0 == float(raw(host, port, "TTRD?\n"))
        ldc.adapter.close()
        print("pymeasure LDC500Series, sensor: the diode's temperature")


if __name__ == "__main__":
    main()
