"""pylablib drives our APT simulator over a pty: a DC controller and a stepper."""

import time

from pylablib.devices import Thorlabs
from pylablib.devices.Thorlabs.kinesis import BasicKinesisDevice

from simulated import simulator

# It toggles RTS as it opens a serial port, which a pty does not have (ENOTTY).
BasicKinesisDevice._cycle_rts = staticmethod(lambda port: None)


def drive(path, scale, model, unit, far):
    """`far` in the peer's unit, which is the metre or the degree."""
    with Thorlabs.KinesisMotor(("serial", path), scale=scale) as motor:
        info = motor.get_device_info()
        assert info.model_no == model and info.nchannels == 1, info
        assert motor.get_scale_units() == unit, motor.get_scale_units()
        assert "enabled" in motor.get_status()
        motor.home(force=True)
        motor.wait_for_home(timeout=10)
        assert motor.is_homed() and abs(motor.get_position()) < 1e-6
        motor.move_to(far / 10)
        assert motor.is_moving()
        motor.wait_move(timeout=10)
        assert abs(motor.get_position() - far / 10) < far * 1e-5, motor.get_position()
        motor.move_by(-far / 20)
        motor.wait_move(timeout=10)
        assert abs(motor.get_position() - far / 20) < far * 1e-5, motor.get_position()
        # A speed comes back as it was set.
        wanted = far / 50
        assert abs(motor.setup_velocity(max_velocity=wanted).max_velocity - wanted) < wanted * 1e-3
        # Stopped on the way; the message that says so came in between and was no answer.
        motor.move_to(far)
        time.sleep(0.3)
        motor.stop()
        assert not motor.is_moving() and far / 20 < motor.get_position() < far * 0.9
        for message in (0x0444, 0x0464, 0x0466):
            assert motor.check_background_comm(message)[0] >= 1, hex(message)


rail = ["counts_per_unit=34304", "controller=kdc101"]
with simulator("linear_axis", "thorlabs-apt", "pty", *rail) as path:
    drive(path, "MTS50-Z8", "KDC101", "m", 0.2)
rotation = [f"counts_per_unit={409600 / 3}", "controller=k10cr1"]
with simulator("rotary_axis", "thorlabs-apt", "pty", *rotation) as path:
    drive(path, "K10CR1", "K10CR1", "deg", 160.0)
print(
    "pylablib 1.4.5, pty: KDC101 and K10CR1 identify, home, move by its own scales, keep a speed, "
    "stop; messages that nobody asked for are passed over"
)
