"""thorlabs-apt-device drives our APT simulator over a pty."""

import time

from thorlabs_apt_device import KDC101

from simulated import simulator


def until(what, condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.02)


options = ["counts_per_unit=34304", "controller=kdc101"]
with simulator("linear_axis", "thorlabs-apt", "pty", *options) as path:
    device = KDC101(
        serial_port=path, home=False, invert_direction_logic=False, swap_limit_switches=False
    )
    complaints = []
    device.register_error_callback(lambda **what: complaints.append(what))
    status = device.status
    until("a status", lambda: status["channel_enabled"] and status["motor_connected"])
    until("parameters", lambda: device.velparams["max_velocity"] > 0)
    assert device.genmoveparams["msg"] and device.jogparams["msg"] and device.homeparams["msg"]
    device.set_velocity_params(acceleration=1000, max_velocity=500_000)
    device._loop.call_soon_threadsafe(device._write, bytes([0x14, 4, 1, 0, 0x50, 1]))
    until("the speed", lambda: device.velparams["max_velocity"] == 500_000)
    device.home()
    until("the reference", lambda: status["homed"] and not status["homing"])
    device.move_absolute(1_000_000)
    until("a move", lambda: status["moving_forward"])
    until("its end", lambda: not status["moving_forward"] and status["position"] == 1_000_000)
    device.move_relative(-500_000)
    until("a move back", lambda: status["moving_reverse"])
    until("its end", lambda: not status["moving_reverse"] and status["position"] == 500_000)
    device.move_absolute(9_000_000)
    until("a long move", lambda: status["position"] > 1_500_000)
    device.stop()
    until("the stop", lambda: not status["moving_forward"])
    stopped = status["position"]
    assert 1_500_000 < stopped < 8_900_000, stopped
    time.sleep(0.3)
    assert status["position"] == stopped
    # Beyond its travel of 300 mm: nothing is refused, the limit switch ends it.
    device.move_absolute(11_000_000)
    until("the limit switch", lambda: status["forward_limit_switch"])
    until("its end", lambda: not status["moving_forward"])
    assert abs(status["position"] - 300 * 34304) <= 1, status["position"]
    assert not complaints, complaints
    device.close()
    device._thread.join(timeout=5)
print(
    "thorlabs-apt-device 0.3.8, pty: reads status and parameters, sets a speed, homes, moves to "
    "and by, stops, ends at the limit switch"
)
