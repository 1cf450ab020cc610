"""zaber-motion, the maker's own library, drives our Zaber simulator over TCP and over a pty.

`identify` is never called: it asks a data base on the Internet. All in microsteps, therefore."""

import threading
import time

from zaber_motion import BadDataException, CommandFailedException, MovementInterruptedException
from zaber_motion.ascii import Connection

from simulated import ask, simulator


def drive(connection):
    found = connection.detect_devices(identify_devices=False)
    assert [device.device_address for device in found] == [1], found
    device = found[0]
    assert device.generic_command("get system.serial").data == "900001"
    axis = device.get_axis(1)
    axis.home()
    assert not axis.is_busy() and axis.get_position() == 0
    axis.settings.set("maxspeed", 153600)
    assert axis.settings.get("maxspeed") == 153600
    axis.move_absolute(123456)
    assert axis.get_position() == 123456
    axis.move_relative(-23456)
    assert axis.get_position() == 100000
    try:
        axis.move_absolute(10_000_000)
        raise AssertionError("a move beyond its limits was taken")
    except (BadDataException, CommandFailedException) as refused:
        assert "BADDATA" in str(refused) or isinstance(refused, BadDataException), refused
    try:
        device.generic_command("frobnicate")
        raise AssertionError("an unknown command was taken")
    except CommandFailedException as refused:
        assert "BADCOMMAND" in str(refused), refused
    # Its own stop clears the flag, as it expects that.
    axis.move_absolute(2_500_000, wait_until_idle=False)
    time.sleep(0.5)
    assert axis.is_busy()
    axis.stop()
    assert not axis.is_busy() and 100000 < axis.get_position() < 2_000_000
    # Somebody else's stop: the one who waits is told, and the flag stays until it is cleared.
    somebody = threading.Timer(0.3, lambda: axis.generic_command("stop"))
    somebody.start()
    try:
        axis.move_absolute(2_900_000)
        raise AssertionError("a move that was stopped ended as if it had arrived")
    except MovementInterruptedException:
        pass
    somebody.join()
    assert not axis.is_busy() and axis.get_position() < 2_000_000
    axis.warnings.clear_flags()
    assert not axis.warnings.get_flags()
    axis.move_absolute(200000)
    return axis.get_position()


options = ["steps_per_unit=10000"]
with simulator("linear_axis", "zaber", "tcp", *options) as address:
    with Connection.open_tcp(*address) as connection:
        at = drive(connection)
        ours = ask(address, b"/1 1 get pos\n")
        assert ours.split(b":")[0].endswith(b" %d" % at), ours
with simulator("linear_axis", "zaber", "pty", *options) as path:
    with Connection.open_serial_port(path) as connection:
        assert drive(connection) == at
print(
    "zaber-motion 10.3.0, TCP and pty: detects, homes, moves, reads settings, is refused with the "
    "right words, sees a stop by its flag"
)
