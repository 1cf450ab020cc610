"""Starts one of our simulators for a peer, as a program of its own."""

import contextlib
import os
import socket
import subprocess
import tempfile


@contextlib.contextmanager
def simulator(kind, name, way, *options):
    """Yields its address: `(host, port)` where `way` is "tcp", a path where it is "pty"."""
    program = os.environ["BEAMPOSE_SIMULATOR"]
    with tempfile.TemporaryDirectory(prefix="beampose-peer-") as folder:
        place = "tcp:127.0.0.1:0" if way == "tcp" else f"pty:{folder}/port"
        process = subprocess.Popen(
            [program, kind, name, place, *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            address = process.stdout.readline().strip()
            assert address, "the simulator did not start"
            if way == "tcp":
                _, host, port = address.split(":")
                yield host, int(port)
            else:
                yield address
        finally:
            # It serves until its standard input ends.
            process.stdin.close()
            process.wait(timeout=10)


def ask(address, question, end=b"\n"):
    """What the simulator itself answers to a line, beside the peer (TCP only)."""
    with socket.create_connection(address, timeout=5) as line:
        line.sendall(question)
        answer = b""
        while not answer.endswith(end):
            came = line.recv(4096)
            assert came, "the simulator closed the line"
            answer += came
        return answer
