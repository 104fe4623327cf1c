"""A virtual machine with Debian 12, systemd and ext4 that is a station's computer, and the camera that it looks at.

The machine sees the network through qemu's user-mode stack: its port 8080 is a port of this machine's loopback, and the
host's loopback is its 10.0.2.2. Commands go in through its second serial port; the power can be cut.
"""
import datetime
import http.client
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
# The simulated night's own day and hour, in a year after that of Debian's systemd, which sets an earlier clock forward.
NIGHT_BEGINS = datetime.datetime(2027, 1, 15, 18, 0, tzinfo=datetime.timezone.utc)
# Of the simulated night, by two lamps without nuisances: what estimates fast, since emulated arithmetic is slow.
MOR_M = (400, 3000)
VERSIONS = HERE.parents[1] / "storage/versions"  # a database of each schema version, as SQL
SCHEMA_VERSION = len(list(VERSIONS.glob("v*.sql")))


def log(text):
    print(f"{time.monotonic() - log.begin:7.1f} s  {text}", flush=True)


log.begin = time.monotonic()
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that what was started is ended, too


def skip(why):
    print(f"SKIPPED: {why}")
    sys.exit(77)


def output_of(*command):
    done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, text=True)
    if done.returncode == 77:
        sys.exit(77)
    if done.returncode != 0:
        raise SystemExit(f"{command[0]} failed with {done.returncode}")
    return done.stdout.strip()


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(what, seconds, condition):
    """The first true value of `condition`; what is not ready yet (an exception of the network included) is asked again."""
    deadline = time.monotonic() + seconds
    while True:
        try:
            value = condition()
            if value:
                return value
        except (OSError, http.client.HTTPException, ValueError, KeyError):
            pass
        if time.monotonic() > deadline:
            raise AssertionError(f"in {seconds} s: no {what}")
        time.sleep(0.25)


class Camera:
    """A web camera: lighttpd with a picture that changes every `period_s`, from a simulated night."""

    def __init__(self, folder, night, period_s=0.5):
        self.folder, self.port = folder, free_port()
        (folder / "www").mkdir(parents=True)
        pictures = sorted((night / "images").iterdir())[2:]  # without the clear references
        self.pictures = [picture.read_bytes() for picture in pictures]
        self.period_s, self.ended, self.server = period_s, threading.Event(), None
        (folder / "lighttpd.conf").write_text(
            f'server.document-root = "{folder}/www"\nserver.bind = "127.0.0.1"\nserver.port = {self.port}\n'
            'server.stat-cache-engine = "disable"\nmimetype.assign = (".jpg" => "image/jpeg")\n')
        self.thread = threading.Thread(target=self.change, daemon=True)
        self.thread.start()
        self.start()

    def change(self):
        number = 0
        while not self.ended.wait(self.period_s):
            number += 1
            new = self.folder / "www/new"
            new.write_bytes(self.pictures[number % len(self.pictures)])
            os.replace(new, self.folder / "www/now.jpg")

    def start(self):
        self.server = subprocess.Popen(["lighttpd", "-D", "-f", str(self.folder / "lighttpd.conf")],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def stop(self):
        self.server.terminate()
        self.server.wait()

    def close(self):
        self.ended.set()
        self.stop()


def accelerator():
    """KVM if it really runs: where its device is there but hangs, the kernel's first line does not come."""
    if os.environ.get("LAMPGLOW_VM_ACCEL"):
        return os.environ["LAMPGLOW_VM_ACCEL"]
    if not os.access("/dev/kvm", os.W_OK):
        return "tcg"
    kernel = pathlib.Path(output_of(HERE.parent / "kernel"))
    probe = subprocess.Popen(
        ["qemu-system-x86_64", "-accel", "kvm", "-nodefaults", "-nographic", "-serial", "stdio", "-no-reboot", "-m", "256",
         "-kernel", next(kernel.glob("boot/vmlinuz-*")), "-append", "console=ttyS0 panic=-1 no_timer_check"],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        said, _ = probe.communicate(timeout=8)
    except subprocess.TimeoutExpired:
        probe.kill()
        said, _ = probe.communicate()
    return "kvm" if b"Linux version" in said else "tcg"


class Machine:
    def __init__(self, work, image, seed, accel):
        self.work, self.accel, self.process, self.agent, self.number = work, accel, None, None, 0
        self.port, self.powered_s = free_port(), time.monotonic()
        self.kernel = pathlib.Path(output_of(HERE.parent / "kernel"))
        modules = ["virtio_pci", "virtio_blk", "virtio_net", "crc32c_generic", "ext4"]
        output_of(HERE.parent / "initrd", self.kernel, HERE / "init", work / "initrd", *modules)
        subprocess.run(["cp", "--sparse=always", image, work / "root.ext4"], check=True)
        for name, size, folder in [("data", "192M", None), ("seed", "64M", seed)]:
            subprocess.run(["mkfs.ext4", "-q", "-F", "-m", "0", *(["-d", folder] if folder else []), work / f"{name}.ext4", size],
                           check=True)

    def boot(self):
        """Switches the power on; returns the seconds until systemd took commands."""
        begin = time.monotonic()
        rtc = NIGHT_BEGINS + datetime.timedelta(seconds=begin - self.powered_s)  # a clock with a battery
        drives = []
        for name in ("root", "data", "seed"):
            drives += ["-drive", f"file={self.work / name}.ext4,format=raw,if=virtio,cache=writeback"]
        console = open(self.work / "console.log", "ab")
        self.process = subprocess.Popen(
            ["qemu-system-x86_64", "-accel", self.accel, "-cpu", "max", "-smp", "1", "-m", "1024", "-nodefaults", "-nographic",
             "-no-reboot", "-serial", "stdio", "-serial", f"unix:{self.work}/agent,server=on,wait=off",
             "-rtc", f"base={rtc:%Y-%m-%dT%H:%M:%S}", *drives,
             "-netdev", f"user,id=n0,restrict=off,hostfwd=tcp:127.0.0.1:{self.port}-10.0.2.15:8080",
             "-device", "virtio-net-pci,netdev=n0,romfile=",
             "-kernel", next(self.kernel.glob("boot/vmlinuz-*")), "-initrd", self.work / "initrd",
             "-append", "console=ttyS0 quiet panic=-1 no_timer_check mitigations=off"],
            stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT)
        until("machine that takes commands", 300, self.connect)
        return time.monotonic() - begin

    def console(self):
        return (self.work / "console.log").read_text(errors="replace")

    def connect(self):
        if self.process.poll() is not None:
            raise SystemExit("qemu ended:\n" + self.console()[-2000:])
        if not self.agent:
            self.agent = socket.socket(socket.AF_UNIX)
            try:
                self.agent.connect(str(self.work / "agent"))
            except OSError:
                self.agent = None
                raise
            self.agent.settimeout(2)
        return self.command("echo here", 2)[1] == "here"

    def command(self, command, timeout_s):
        """(exit code, output)"""
        self.number += 1
        self.agent.sendall(f"{self.number} {command}\n".encode())
        deadline = time.monotonic() + timeout_s
        heard, end = b"", re.compile(rb"\nEXIT %d (\d+)\n$" % self.number)
        while not (found := end.search(heard)):
            if time.monotonic() > deadline:
                raise TimeoutError(f"the machine does not answer to: {command}")
            try:
                heard += self.agent.recv(65536)
            except TimeoutError:
                pass
        text = re.sub(rb"(?s).*\nEXIT \d+ \d+\n", b"", heard[:found.start()])  # of commands given up
        return int(found[1]), text.decode(errors="replace").strip()

    def run(self, command, timeout_s=120, good=True):
        """Runs a command within the machine; what it printed. `good`: it must succeed."""
        code, text = self.command(command, timeout_s)
        if good and code != 0:
            raise AssertionError(f"{command}: exit code {code}\n{text}")
        return text

    def ask(self, path, timeout_s=10):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout_s)
        try:
            connection.request("GET", path)
            response = connection.getresponse()
            return response.status, response.read()
        finally:
            connection.close()

    def json(self, path):
        status, body = self.ask(path)
        if status != 200:
            raise ValueError(f"{path}: {status} {body[:200]}")
        return json.loads(body)

    def cut_power(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        if self.agent:
            self.agent.close()
        self.agent = None

    def close(self):
        if self.process and self.process.poll() is None:
            self.cut_power()


class Follower:
    """Reads the event stream as a browser does, with resume; keeps when each observation was first seen, and what it said."""

    def __init__(self, machine):
        self.machine, self.seen, self.events, self.last_id = machine, {}, [], ""
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.follow, daemon=True)
        self.thread.start()

    def follow(self):
        while not self.ended.is_set():
            try:
                self.read_stream()
            except (OSError, http.client.HTTPException, ValueError):
                pass
            self.ended.wait(0.5)

    def read_stream(self):
        connection = http.client.HTTPConnection("127.0.0.1", self.machine.port, timeout=20)
        connection.request("GET", "/v1/stream", headers={"Last-Event-ID": self.last_id} if self.last_id else {})
        response = connection.getresponse()
        kind = ""
        while not self.ended.is_set():
            line = response.readline()
            if not line:
                break
            key, _, value = line.decode().strip().partition(": ")
            if key == "id":
                self.last_id = value
            elif key == "event":
                kind = value
            elif key == "data" and kind == "observation":
                properties = json.loads(value)["properties"]
                self.seen.setdefault(properties["timestamp"], (time.monotonic(), properties))
            elif key == "data":
                self.events.append(json.loads(value))

    def count(self):
        return len(self.seen)

    def close(self):
        self.ended.set()


def stored_rows(machine):
    """What the database holds, asked with Debian's own sqlite3: {time: extinction}, and how many keys are there twice."""
    database = "/var/lib/lampglow/lampglow.db"
    text = machine.run(f"sqlite3 -cmd '.timeout 10000' -readonly {database} 'SELECT time_ms, extinction_per_m FROM observation'")
    rows = [line.split("|") for line in text.splitlines()]
    twice = 0
    for table, key in [("observation", "camera_id, time_ms"), ("frame", "camera_id, time_ms"),
                       ("lamp_fit", "lamp_id, time_ms"), ("mean", "camera_id, period_s, end_ms")]:
        twice += int(machine.run(f"sqlite3 -cmd '.timeout 10000' -readonly {database} 'SELECT count(*) FROM (SELECT 1 FROM {table} "
                                 f"GROUP BY {key} HAVING count(*) > 1)'"))
    return {int(time_ms): value for time_ms, value in rows}, twice + len(rows) - len({row[0] for row in rows})


def integrity(machine):
    return machine.run("sqlite3 -cmd '.timeout 10000' -readonly /var/lib/lampglow/lampglow.db 'PRAGMA integrity_check'", 300)


def milliseconds(timestamp):
    return round(datetime.datetime.fromisoformat(timestamp.replace("Z", "+00:00")).timestamp() * 1000)


def configuration(camera_port, checkpoint_minutes=0.25):
    return f"""name = "quay"
site_file = "/seed/night/site.toml"
reference_archive = "/seed/night"
[source]
url = "http://10.0.2.2:{camera_port}/now.jpg"
[schedule]
interval_s = 4
when = "both"
[http]
address = "0.0.0.0"
port = 8080
max_connections_per_address = 1000
[station]
stale_after_s = 15
[keep]
checkpoint_minutes = {checkpoint_minutes}
"""


def prepare(work, lampglow, deb):
    """The simulated night, the seed disk with it and the package, the image, the camera and the machine, switched off."""
    for tool in ("qemu-system-x86_64", "mkfs.ext4", "lighttpd", "mmdebstrap"):
        if not shutil.which(tool):
            skip(f"{tool} is not installed")
    night = work / "seed/night"
    night.parent.mkdir(parents=True)
    output_of(lampglow, "simulate", night, "--style", "webcam", "--seed", "3", "--frames", "6", "--lamps", "2",
              "--mor-min", str(MOR_M[0]), "--mor-max", str(MOR_M[1]), "--without", "all", "--photons", "50000")
    shutil.copy(deb, work / "seed/lampglow.deb")
    shutil.copy(HERE / "agent", work / "seed/agent")
    shutil.copy(VERSIONS / "v1.sql", work / "seed/v1.sql")
    image = output_of(HERE / "build_image", deb, pathlib.Path(deb).parent / "vm")
    camera = Camera(work / "camera", night)
    accel = accelerator()
    machine = Machine(work, image, work / "seed", accel)
    log(f"accelerator {accel}, image {os.path.getsize(image) >> 20} MiB")
    return machine, camera


def install(machine, camera, **settings):
    """The package into the running system, the configuration, and the station up as seen from outside."""
    machine.run("dpkg -i /seed/lampglow.deb", 300)
    text = configuration(camera.port, **settings).replace("\n", "\\n").replace('"', '\\"')
    machine.run(f'printf "{text}" > /etc/lampglow/lampglow.toml')
    machine.run("lampglow check-config /etc/lampglow/lampglow.toml")
    machine.run("systemctl restart lampglow", 120)
    until("station that is ready", 120, lambda: machine.ask("/readyz")[0] == 200)
