"""Devices of others on lewis before our drivers: its own Julabo bath before the generic reader, and the
Lake Shore emulators of ISIS before our Lake Shore driver, where their sources can be had."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

READ = Path(os.environ["BEAMPOSE_EXAMPLES"]) / "read"
# Empty where their sources could not be had.
EMULATORS = os.environ["ISIS_EMULATORS"]
BIN = Path(sys.executable).parent


def free_port():
    with socket.socket() as it:
        it.bind(("127.0.0.1", 0))
        return it.getsockname()[1]


def control(port, *words):
    command = [BIN / "lewis-control", "-r", f"127.0.0.1:{port}", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def started(port, remote, protocol, *device):
    place = f"{protocol}: {{bind_address: 127.0.0.1, port: {port}}}"
    command = [BIN / "lewis", *device, "-r", f"127.0.0.1:{remote}", "-p", place]
    it = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _ in range(200):
        assert it.poll() is None, f"lewis ended with {it.returncode}"
        try:
            socket.create_connection(("127.0.0.1", port), 0.2).close()
            return it
        except OSError:
            time.sleep(0.05)
    raise AssertionError("lewis does not listen")


def read(port, *options, driver="lake-shore"):
    """The last number that a driver reads there, or its error."""
    command = [READ, "sensor", driver, f"tcp:127.0.0.1:{port}", *options]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if ended.returncode:
        return ended.stderr.strip()
    quantity, value = ended.stdout.splitlines()[-1].split()
    assert quantity == "temperature_degc", quantity
    return float(value)


def near(value, expected):
    assert isinstance(value, float) and abs(value - expected) < 1e-9, (value, expected)


def julabo():
    port, remote = free_port(), free_port()
    lewis = started(port, remote, "julabo-version-1", "julabo")
    options = {
        "IN_PV_01": ("external_temperature", -12.5),
        "IN_SP_01": ("temperature_high_limit", 85.25),
    }
    line = ("unit=C", r"terminator=\n", r"identify=VERSION\r")
    try:
        for command, (setting, value) in options.items():
            control(remote, "device", setting, str(value))
            near(read(port, rf"command={command}\r", *line, driver="generic"), value)
        silent = read(port, r"command=IN_PV_99\r", *line, driver="generic")
        assert isinstance(silent, str), silent
    finally:
        lewis.terminate()
        lewis.wait()
    print("lewis' Julabo: two temperatures read as set; what it does not know is an error")


kelvin = ("scale=kelvin", "status=false")
isis = ("-a", EMULATORS, "-k", "lewis_emulators")


def lksh218():
    port, remote = free_port(), free_port()
    lewis = started(port, remote, "stream", *isis, "Lksh218")
    try:
        for channel, temperature in ((1, 295.65), (3, 273.15), (8, 77.36)):
            control(remote, "device", "set_temp", str(channel), str(temperature))
        for channel, temperature in ((1, 295.65), (3, 273.15), (8, 77.36)):
            near(read(port, f"channel={channel}", *kelvin), temperature - 273.15)
        # It knows neither CRDG? nor RDGST?: silence must not become a number.
        silent = read(port, "channel=1")
        assert "no answer" in silent, silent
        silent = read(port, "channel=1", "scale=kelvin")
        assert "no answer" in silent, silent
        control(remote, "device", "connected", "False")
        gone = read(port, "channel=1", *kelvin)
        assert isinstance(gone, str), gone
    finally:
        lewis.terminate()
        lewis.wait()
    print("Lksh218: inputs 1, 3 and 8 read as set; silence and a sensor that is gone are errors")


def lakeshore340():
    port, remote = free_port(), free_port()
    lewis = started(port, remote, "stream", *isis, "lakeshore340")
    try:
        control(remote, "device", "temp_b", "310.25")
        near(read(port, "channel=1", *kelvin), 310.25 - 273.15)
        # It answers words to what it does not know.
        words = read(port, "channel=1")
        assert "expected" in words, words
    finally:
        lewis.terminate()
        lewis.wait()
    print("lakeshore340: an input read as set; words in place of a number are an error")


julabo()
if EMULATORS:
    lksh218()
    lakeshore340()
else:
    print("not tried: the Lake Shore emulators of ISIS, whose sources are in no registry and could not be had")
