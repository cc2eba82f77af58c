"""Samples from devices, through the ring, into the record."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "io/live/_cobs.py",
        "tests/io/test_live_serial.py",
        ("the check is not looked at", "_crc(frame, size - _CHECK) == _number(frame, size - _CHECK, 4)", "True"),
        ("a block of 254 bytes is followed by a zero", "code < 255 and at < stop", "at < stop"),
        ("a block may reach beyond the frame", "at + code > stop or size + code > len(out)", "size + code > len(out)"),
        ("a frame that was joined in its middle is called damaged", "state[JOINED]", "1", "decode"),
        ("a counter that wraps went back", "(counter - state[LAST]) % _WRAP", "counter - state[LAST]"),
        ("one sample too many is missing", "state[LOST] += ahead - 1", "state[LOST] += ahead"),
        ("signed numbers are read as unsigned", "code % 2 == 1 and bits >= limit", "False"),
        ("frames of other numbers are not counted", "state[FOREIGN] += 1", "state[FOREIGN] += 0"),
    ),
    *of(
        "io/live/sequence.py",
        "tests/io/test_live_netft.py",
        ("what came twice is given twice", "abs(step) <= _LATE and advance <= 0 and not self._expected", "False"),
        ("what came late stays missing", "rdt in self._absent", "False"),
        ("a step of one is one missing", "step - 1", "step"),
        ("what is missing over a restart is not known", "advance // self._ratio - 1", "0"),
        ("counters step alike", "self._ratio = max(1, round(advance / steps))", "self._ratio = 1"),
        ("the counter does not wrap", "(step + _ROUND // 2) % _ROUND - _ROUND // 2", "step"),
        ("gaps are not counted", "self.gaps += 1", "self.gaps += 0"),
    ),
    *of(
        "io/live/ring.py",
        "tests/io/test_live_ring.py tests/io/test_live_stream.py tests/io/test_live_record.py",
        ("a reader that is lapped goes on where it was", "max(first, self._oldest())", "first"),
        ("slots that were written over meanwhile are given", "first >= self._oldest()", "True"),
        ("what is received may be read as answered", "self[word]", 'self["received"]', "read"),
        ("the end of the ring is not its beginning", "first % len(self.slots)", "min(first, len(self.slots) - 1)"),
        (
            "a sentence takes the place of the first",
            "self._sentences[count % SENTENCES] = (time.time_ns(), text)",
            "self._sentences[0] = (time.time_ns(), text)",
        ),
        (
            "samples behind a gap have the numbers of those in it",
            'slots["number"] - 1',
            'slots["number"][0] - 1 + np.arange(len(slots))',
        ),
        ("a sample that is not answered has a contact", 'slots["rows"] * (slots["ready"] > 0)', 'slots["rows"] * 1'),
        ("a file of another version is read", 'self["version"] != VERSION', "False"),
        ("a file that is cut off is read", "HEAD + count * slot.itemsize > size", "False"),
    ),
    *of(
        "io/live/_stream.py",
        "tests/io/test_live_stream.py tests/io/test_live_record.py",
        ("an old answer stands beside a new sample", "slot[_READY] = slot[_ROWS] = 0", "pass"),
        ("numbers begin at 0", "first + 1 + k", "first + k"),
        ("all rows of a batch are those of its first sample", "row += counts[k]", "row += 0"),
        ("large stamps lose their nanoseconds", "-_EXACT < stamp[k] < _EXACT", "True"),
    ),
    *of(
        "io/live/recover.py",
        "tests/io/test_live_record.py",
        ("a record that is being written is recovered", "time.time_ns() - ring['alive'] < ALIVE", "False"),
        ("torn slots are kept", "slots['number'] != at + 1 + np.arange(len(slots))", "slots['number'] < 0"),
        ("the ring stays", "path.unlink()", "None"),
    ),
    *of(
        "io/live/pair.py",
        "tests/io/test_live_pair.py",
        ("frames do not wait", "time.monotonic() - self._since > WAITS", "True"),
        ("frames wait for good", "time.monotonic() - self._since > WAITS", "False"),
        ("what is missing is said of the next frame", "self._lost[count:]", "self._lost[:-count]"),
        ("that no wrench comes is not said", "now - self._heard > SILENT and not self._quiet", "False"),
    ),
    *of(
        "io/live/poses.py",
        "tests/io/test_live_poses.py",
        ("of two edges the last one's age counts", "np.maximum(age, older)", "older"),
        ("errors of turns are added, not their squares", "turned**2", "turned", "at"),
        (
            "transforms without a stamp are of 1970",
            "np.where(stamps == 0, messages.time[rows.message[which]], stamps)",
            "stamps",
        ),
        ("poses without a stamp are of 1970", "np.where(stamps == 0, messages.time, stamps)", "stamps"),
        ("a fixed edge takes the place of one that moves", "len(sound) and edge not in self._edges", "len(sound)"),
        ("transforms of no length are held", "sound_quaternions(values[:, 3:])", "True"),
    ),
    *of(
        "viewer/scene.py",
        "tests/cli/test_live_page.py",
        ("arrows keep their scale, however hard it is touched", "force * self.newton > self.size", "False"),
    ),
    *of(
        "cli/live_page.py",
        "tests/cli/test_live_page.py",
        (
            "who comes when nothing comes any more is fed no sample",
            "watched and not self._fed and self._last is not None",
            "False",
        ),
    ),
]
