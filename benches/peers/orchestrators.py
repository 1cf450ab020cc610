"""1,000 points of one parameter with QCoDeS and with bluesky: milliseconds a point, as a table's rows.

    python orchestrators.py FOLDER
"""

import contextlib
import json
import pathlib
import sys
import time

POINTS = 1000
folder = pathlib.Path(sys.argv[1])


def row(name, seconds, safe):
    print(f"| {name} | {1e3 * seconds / POINTS:.2f} | {safe} |", flush=True)


def qcodes_points():
    import qcodes
    from qcodes.dataset import Measurement, initialise_or_create_database_at
    from qcodes.dataset import load_or_create_experiment
    from qcodes.parameters import ManualParameter

    initialise_or_create_database_at(str(folder / "qcodes.db"))
    experiment = load_or_create_experiment("overhead", "none")
    position, temperature = ManualParameter("position"), ManualParameter("temperature")
    for period, safe in [(0.0, "each point (flushed at each)"), (5.0, "all but five seconds")]:
        measurement = Measurement(exp=experiment)
        measurement.register_parameter(position)
        measurement.register_parameter(temperature, setpoints=(position,))
        measurement.write_period = max(period, 0.001)
        # It tells on standard output that it begins, where the table goes.
        with contextlib.redirect_stdout(sys.stderr), measurement.run() as saver:
            begin = time.perf_counter()
            for i in range(POINTS):
                saver.add_result((position, float(i)), (temperature, 21.5))
                if period == 0.0:
                    saver.flush_data_to_database()
            seconds = time.perf_counter() - begin
        row(f"QCoDeS {qcodes.__version__}, write period {period:g} s", seconds, safe)


def bluesky_points():
    import bluesky
    from bluesky import RunEngine
    from bluesky.plan_stubs import close_run, open_run, trigger_and_read
    from ophyd.sim import SynSignal

    class Kept:
        """Each document appended to a file and flushed, as the usual serializers do."""

        def __init__(self, path):
            self.file = open(path, "a", encoding="utf-8")

        def __call__(self, name, document):
            self.file.write(json.dumps([name, document], default=str) + "\n")
            self.file.flush()

    signal = SynSignal(func=lambda: 21.5, name="temperature")

    def plan():
        yield from open_run()
        for _ in range(POINTS):
            yield from trigger_and_read([signal])
        yield from close_run()

    engine = RunEngine({})
    engine.subscribe(Kept(folder / "bluesky.jsonl"))
    begin = time.perf_counter()
    engine(plan())
    seconds = time.perf_counter() - begin
    row(f"bluesky {bluesky.__version__}", seconds, "what the system had written out; nothing is synced")


for points in (qcodes_points, bluesky_points):
    try:
        points()
    except ImportError as error:
        print(f"| {points.__name__} | not installed: {error} | |", flush=True)
