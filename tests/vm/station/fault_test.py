#!/usr/bin/env python3
"""The station on its own computer, and what can go wrong there: fault_test.py LAMPGLOW DEB [FAULT...]

A virtual machine with Debian 12, real systemd and ext4 gets the package, looks at a web camera that shows a simulated night,
and is asked over HTTP from outside. Then each fault is done to it; what docs/station.md states must be what is seen, and
every observation that was shown must be in the database but for the stated bound. Exit 77: something can't be had here.
LAMPGLOW_DEAD_CAMERA_S sets how long the camera is dead (45 s; scripts/soak takes an hour).
"""
import os
import pathlib
import sys
import tempfile
import time

from machine import (MOR_M, SCHEMA_VERSION, Follower, install, integrity, log, milliseconds, prepare, stored_rows, until)

DATA = "/var/lib/lampglow"
DATABASE = f"{DATA}/lampglow.db"


class Faults:
    def __init__(self, machine, camera):
        self.machine, self.camera = machine, camera
        self.follower = Follower(machine)

    # What the outside sees.

    def more_observations(self, count=2, seconds=90):
        wanted = self.follower.count() + count
        until(f"{count} more observations", seconds, lambda: self.follower.count() >= wanted)

    def fault_on_healthz(self, part, seconds=90):
        until(f"fault of the {part} on /healthz", seconds,
              lambda: any(fault.startswith(part) for fault in self.machine.json("/healthz")["faults"]))

    def well(self, seconds=60):
        until("good health", seconds, lambda: self.machine.json("/healthz")["status"] == "ok")

    def event_of(self, kind, since, seconds=60):
        def found():
            events = self.machine.json("/v1/events?limit=100")["events"]
            return [event for event in events if event["kind"] == kind and event["id"] > since]
        return until(f"event {kind}", seconds, found)

    def last_event(self):
        events = self.machine.json("/v1/events?limit=1")["events"]
        return events[0]["id"] if events else 0

    def main_pid(self):
        return int(self.machine.run("systemctl show lampglow -p MainPID --value"))

    def all_stored(self, since=0.0):
        """Everything that was shown after `since` (of this machine's monotonic clock) is stored, and once."""
        shown = {time_text: seen for time_text, seen in self.follower.seen.items() if seen[0] >= since}
        rows, twice = stored_rows(self.machine)
        lost = [time_text for time_text in shown if milliseconds(time_text) not in rows]
        assert not lost, f"shown, but not stored: {lost}"
        assert twice == 0, f"{twice} rows are there twice"
        assert integrity(self.machine) == "ok"
        return len(shown)

    # The faults. The first line of each text is the row of docs/station.md.

    def a_night(self):
        """installed, enabled and started by the package; measures the night, answers from outside; the unit's memory suffices"""
        def measured():  # the emulated machine is too slow for some of its slots; these say so, without a value
            return [shown["visibility"] for _, shown in self.follower.seen.values() if shown["visibility"]["value"] is not None]
        until("4 measurements", 300, lambda: len(measured()) >= 4)
        assert self.machine.run("systemctl is-enabled lampglow") == "enabled"
        until("a current value", 60, lambda: self.machine.json("/v1/current")["properties"]["visibility"]["value"])
        for one in measured():  # bounds that have nothing to do with the night's true visibility would be wrong
            low, high = one["minValue"] or 0, one["maxValue"] or 1e9
            assert low <= MOR_M[1] * 1.2 and high >= MOR_M[0] / 1.2, one
        assert self.machine.ask("/v1/frames/latest.jpg")[1][:2] == b"\xff\xd8"
        self.all_stored()
        status = self.machine.run("systemctl show lampglow -p StatusText --value")
        assert "quay: " in status, status
        peak = int(self.machine.run("cat /sys/fs/cgroup/system.slice/lampglow.service/memory.peak")) >> 20
        log(f"status text \"{status}\"; at most {peak} MiB of the unit's 512")

    def reloaded(self):
        """SIGHUP takes over what it can and names the rest; a file with a mistake changes nothing"""
        m = self.machine
        m.run("cp -a /etc/lampglow/lampglow.toml /tmp/good; sed -i 's/^port = 8080/port = 8081/; s/^interval_s = 4/interval_s = 5/' "
              "/etc/lampglow/lampglow.toml; systemctl reload lampglow")
        until("the key that needs a restart", 30, lambda: "http.port" in m.run("journalctl -u lampglow -o cat | tail -n 40"))
        m.run("echo 'no_such_key = 1' > /etc/lampglow/lampglow.toml; systemctl reload lampglow", good=False)
        until("refusal", 30, lambda: "the old one stays" in m.run("journalctl -u lampglow -o cat | tail -n 40"))
        self.more_observations()
        m.run("cp -a /tmp/good /etc/lampglow/lampglow.toml; systemctl reload lampglow")
        self.more_observations()

    def clock_held(self):
        """a frame says whether NTP holds the clock: the unit's filter lets it ask"""
        def flagged():
            return "clock_unsynchronised" in max(self.follower.seen.items())[1][1]["quality"]
        assert flagged(), "nobody holds the clock of this machine yet"
        # What NTP does, by adjtimex(2): ADJ_STATUS and ADJ_MAXERROR, STA_PLL without STA_UNSYNC.
        self.machine.run("perl -e '$t = pack(\"Lx4 q4 lx4\", 0x14, 0, 0, 1000, 1000, 1) . \"\\0\" x 200; "
                         "exit(syscall(159, $t) < 0 ? 1 : 0)'")
        self.more_observations(1)  # it may have been taken before
        until("a frame of a clock that is held", 60, lambda: not flagged())

    def disk_full(self):
        """fault on /healthz; observations wait in memory and are stored when there is room; the current one is served on"""
        since, begin = self.last_event(), time.monotonic()
        self.machine.run(f"fallocate -l $(df -B1 --output=avail {DATA} | tail -n 1) {DATA}/filler || true; "
                         f"dd if=/dev/zero of={DATA}/filler2 bs=4k 2>/dev/null; sync; true")
        self.fault_on_healthz("database")
        self.more_observations(3)  # still measured and shown
        assert self.machine.ask("/v1/current")[0] == 200
        self.machine.run(f"rm {DATA}/filler {DATA}/filler2")
        self.well()
        self.event_of("disk_full", since)
        self.event_of("database_recovered", since)
        self.more_observations(1)
        log(f"{self.all_stored(begin)} observations of the time around it are all stored")

    def read_only_disk(self):
        """the same"""
        begin = time.monotonic()
        self.machine.run("echo u > /proc/sysrq-trigger; for i in $(seq 60); do touch /var/lib/lampglow/x 2>/dev/null || break; sleep 0.5; "
                         "done; ! touch /var/lib/lampglow/x")
        self.fault_on_healthz("database")
        self.more_observations(3)
        self.machine.run(f"mount -o remount,rw {DATA}; mount -o remount,rw /")
        self.well()
        self.more_observations(1)
        log(f"{self.all_stored(begin)} observations of the time around it are all stored")

    def deleted_database(self):
        """noticed within 5 s; a fresh one is begun, an event says so"""
        self.machine.run(f"rm {DATABASE}")
        gone = time.monotonic()
        until("a fresh database", 30, lambda: self.machine.run(f"ls {DATABASE}", good=False) == DATABASE)
        noticed_s = time.monotonic() - gone
        self.event_of("database_set_aside", 0)
        until("observations since", 90, lambda: sum(seen[0] > gone + 6 for seen in self.follower.seen.values()) >= 2)
        log(f"a fresh one after {noticed_s:.1f} s; {self.all_stored(gone + 6)} observations since are all stored")

    def corrupt_page(self):
        """set aside as lampglow.db.corrupt-TIME, never deleted; a fresh one is begun; an event says so"""
        self.machine.run("systemctl kill -s KILL lampglow; systemctl stop lampglow; "
                         f"sqlite3 {DATABASE} 'PRAGMA wal_checkpoint(TRUNCATE)'; "
                         f"dd if=/dev/urandom of={DATABASE} bs=4096 seek=2 count=6 conv=notrunc 2>/dev/null")
        begin = time.monotonic()
        self.machine.run("systemctl start lampglow", 120)
        until("an answer", 60, lambda: self.machine.ask("/readyz")[0] == 200)
        self.event_of("database_set_aside", 0)
        assert self.machine.run(f"ls {DATABASE}.corrupt-*Z")
        self.more_observations(2)
        self.all_stored(begin)
        self.machine.run(f"rm {DATABASE}.corrupt-*")

    def clock_set_back(self):
        """an event; frames are stored under the new time"""
        since = self.last_event()
        before = set(self.follower.seen)
        self.machine.run("date -s '-1 day'")
        begin = time.monotonic()
        self.event_of("clock_stepped", since, 90)
        until("observation of the new time", 120, lambda: min(self.follower.seen) < min(before))
        self.more_observations(2)
        self.machine.run("date -s '+1 day'")
        self.more_observations(2)
        self.all_stored(begin)

    def out_of_memory(self):
        """the kernel ends it at the unit's limit; systemd starts it again; nothing is lost"""
        m, begin = self.machine, time.monotonic()
        m.run("systemctl set-property --runtime lampglow MemoryMax=24M")
        until("the kernel's end of it", 90, lambda: int(m.run("systemctl show lampglow -p NRestarts --value")) > 0)
        assert "oom-kill" in m.run("journalctl -u lampglow -o cat | tail -n 60")
        m.run("systemctl set-property --runtime lampglow MemoryMax=512M")
        self.more_observations(2, 120)
        log(f"{self.all_stored(begin)} observations of the time around it are all stored; 24 MiB were its limit")

    def stopped_process(self):
        """the watchdog is not fed: systemd ends it after WatchdogSec= (60 s) and starts it again; nothing is lost"""
        begin, pid = time.monotonic(), self.main_pid()
        self.machine.run(f"kill -STOP {pid}")
        until("another process", 150, lambda: self.main_pid() not in (0, pid))
        again_s = time.monotonic() - begin
        assert "watchdog" in self.machine.run("journalctl -u lampglow -o cat | tail -n 60").lower()
        self.more_observations(2, 120)
        self.all_stored(begin)
        log(f"another process after {again_s:.0f} s")

    def dead_camera(self):
        """its own reason in events and metrics, tried again for ever; the service is not restarted"""
        since, pid, seconds = self.last_event(), self.main_pid(), float(os.environ.get("LAMPGLOW_DEAD_CAMERA_S", "45"))
        self.camera.stop()
        self.event_of("source_failed", since, 60)
        self.fault_on_healthz("camera quay", 10)
        until("the metric", 60, lambda: b'lampglow_camera_up{camera="quay"} 0' in self.machine.ask("/metrics")[1])
        until("answer without a value, but with the reason", 60, lambda: self.machine.json("/v1/current")["properties"]["sensor"]["fault"])
        time.sleep(seconds)
        assert self.machine.json("/v1/current")["properties"]["visibility"]["value"] is None
        assert self.main_pid() == pid, "the service was restarted"
        self.camera.start()
        back = time.monotonic()
        self.event_of("source_recovered", since, 90)
        self.well()
        self.more_observations(2)
        log(f"dead for {seconds:.0f} s; back {time.monotonic() - back:.0f} s after the camera")

    def ended(self):
        """SIGTERM: ends in under 5 s with everything stored and the WAL written back"""
        begin = time.monotonic()
        self.machine.run("systemctl stop lampglow")
        took_s = time.monotonic() - begin
        log(f"ended after {took_s:.1f} s")
        assert took_s < 10, took_s  # TimeoutStopSec=10: not killed; the emulated machine is slow
        assert "killed" not in self.machine.run("systemctl show lampglow -p Result --value")
        assert self.machine.run(f"stat -c %s {DATABASE}-wal 2>/dev/null || echo 0") == "0"
        self.all_stored(begin - 30)

    def upgraded_from_version_1(self):
        """The package's upgrade over a database of the first schema: migrated at the start, with all its rows, and gone on with."""
        def asked(sql):
            return self.machine.run(f"sqlite3 -cmd '.timeout 10000' -readonly {DATABASE} '{sql}'")

        def query_of_old_rows(table):  # the file's, of November 2026; with the columns that it has now: migrations add some
            columns = [line.split("|")[1] for line in asked(f"PRAGMA table_info({table})").splitlines()]
            return f"SELECT {', '.join(columns)} FROM {table} WHERE time_ms < 1796000000000 ORDER BY 1, 2, 3"
        self.machine.run(f"systemctl stop lampglow; rm {DATABASE}; sqlite3 {DATABASE} < /seed/v1.sql; chown lampglow: {DATABASE}")
        queries = [query_of_old_rows(table) for table in ("observation", "lamp_fit", "event")]
        before = [asked(query) for query in queries]
        assert asked("PRAGMA user_version") == "1" and all(before)
        self.machine.run("dpkg -i /seed/lampglow.deb", 300)
        until("an answer", 120, lambda: self.machine.ask("/readyz")[0] == 200)
        self.more_observations(2)
        assert asked("PRAGMA user_version") == str(SCHEMA_VERSION)
        assert [asked(query) for query in queries] == before
        assert integrity(self.machine) == "ok"
        log(f"schema 1 became {SCHEMA_VERSION} by the upgrade; {len(before[0].splitlines())} old observations are as they were")

    def upgraded_and_purged(self):
        """an upgrade restarts it, brings an old schema to the present one and keeps everything; purging leaves no file, user or group"""
        self.machine.run("systemctl start lampglow", 120)
        rows, _ = stored_rows(self.machine)
        self.machine.run("dpkg -i /seed/lampglow.deb", 300)
        until("an answer", 120, lambda: self.machine.ask("/readyz")[0] == 200)
        after, twice = stored_rows(self.machine)
        assert set(rows) <= set(after) and twice == 0
        self.upgraded_from_version_1()
        self.follower.close()
        self.machine.run("dpkg --purge lampglow", 300)
        left = self.machine.run("ls -d /etc/lampglow /usr/bin/lampglow /lib/systemd/system/lampglow.service 2>/dev/null; "
                                "ls -A /var/lib/lampglow 2>/dev/null; getent passwd lampglow; getent group lampglow; true")
        assert not left, left


FAULTS = ["a_night", "clock_held", "reloaded", "disk_full", "read_only_disk", "deleted_database", "corrupt_page", "clock_set_back",
          "out_of_memory", "stopped_process", "dead_camera", "ended", "upgraded_and_purged"]


def main():
    lampglow, deb, *chosen = sys.argv[1:]
    failed = 0
    with tempfile.TemporaryDirectory(prefix="lampglow-vm-") as folder:
        work = pathlib.Path(folder)
        machine, camera = prepare(work, lampglow, deb)
        try:
            log(f"commands after {machine.boot():.0f} s")
            install(machine, camera)
            log("installed and ready")
            faults = Faults(machine, camera)
            for name in chosen or FAULTS:
                fault = getattr(faults, name)
                try:
                    fault()
                    log(f"PASSED {name}: {fault.__doc__}")
                except (AssertionError, OSError, KeyError, ValueError) as error:
                    failed += 1
                    log(f"FAILED {name}: {fault.__doc__}\n{error!r}")
                    print(machine.run("journalctl -u lampglow -o short-monotonic | tail -n 40; systemctl status lampglow | head -n 20; "
                                      "df /var/lib/lampglow; ls -la /var/lib/lampglow", good=False), flush=True)
        finally:
            machine.close()
            camera.close()
    log(f"{len(chosen or FAULTS) - failed} of {len(chosen or FAULTS)} passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
