"""The gphoto2 program, as Debian ships it, with our PTP/IP camera.

Lists, captures, downloads byte for byte, deletes, and asks for the summary. Usage:
gphoto2_cli.py SIMULATOR, the example program of the drivers crate.
"""

import hashlib
import os
import pathlib
import subprocess
import sys
import tempfile


def picture(shot):
    """The simulated shutter's picture of that number."""
    body = bytes(i * (31 + shot) % 251 for i in range(5000))
    return b"\xff\xd8\xff\xe0" + body + b"\xff\xd9"


def sha(data):
    return hashlib.sha256(data).hexdigest()


class Camera:
    def __init__(self, simulator):
        self.process = subprocess.Popen(
            [simulator, "camera", "gphoto2", "-"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.port = self.process.stdout.readline().strip().removeprefix("device:")

    def ask(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()


def main():
    camera = Camera(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        # The program keeps its name for the camera there.
        env = dict(os.environ, HOME=folder, LC_ALL="C")

        def gphoto2(*words):
            command = ["gphoto2", "--port", camera.port, "--camera", "PTP/IP Camera", *words]
            done = subprocess.run(
                command, cwd=folder, env=env, capture_output=True, text=True, timeout=60)
            assert done.returncode == 0, (words, done.stdout, done.stderr)
            return done.stdout

        listing = gphoto2("--list-files")
        assert "DSC_0001.JPG" in listing and "DSC_0002.JPG" not in listing, listing
        gphoto2("--capture-image-and-download", "--filename", "taken.jpg")
        taken = pathlib.Path(folder, "taken.jpg").read_bytes()
        assert sha(taken) == sha(picture(0)), "the downloaded picture is another"
        # It takes what it downloaded off the card, unless told to keep it.
        assert "DSC_0002.JPG" not in gphoto2("--list-files")
        gphoto2("--capture-image-and-download", "--keep", "--filename", "kept.jpg")
        gphoto2("--capture-image")
        gphoto2("--trigger-capture")
        listing = gphoto2("--list-files")
        for number in (3, 4, 5):
            assert f"DSC_000{number}.JPG" in listing, listing
        gphoto2("--get-all-files", "--force-overwrite")
        for number, shot in ((3, 1), (4, 2), (5, 3)):
            data = pathlib.Path(folder, f"DSC_000{number}.JPG").read_bytes()
            assert sha(data) == sha(picture(shot)), f"picture {number} is another"
        summary = gphoto2("--summary")
        for part in ("Simulated camera", "SIM00000", "Battery Level", "BEAMPOSE"):
            assert part in summary, (part, summary)
        assert camera.ask("releases") == "4"
        version = gphoto2("--version").split("\n")[0]
    camera.process.stdin.close()
    assert camera.process.wait(10) == 0
    print(f"{version} over PTP/IP: listed, captured 4, downloaded 4 with equal SHA-256, deleted 1, "
          "summary read")


main()
