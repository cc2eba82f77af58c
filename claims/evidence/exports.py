"""One short session as makers and laboratories write it: each file with whose it is and where its form is from.

A ball of 10 mm about the sensor's origin is pressed twice. The numbers have so few digits that every form holds all of
them, unless its row says otherwise. The forms are those of the makers' manuals and of loggers in use, in own words.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

RATE, ROWS = 100.0, 120  # Hz
RADIUS = 0.01  # m: of the sphere that `palpate rig new` proposes without a mesh
POINTS = np.array([[0.0, 0.6, 0.8], [0.48, 0.6, 0.64]]) * RADIUS
_PUSHES = ((30, 60, np.array([0.3, -2.0, -3.0])), (75, 105, np.array([-1.5, -2.5, -2.0])))


def _session() -> tuple[np.ndarray, np.ndarray]:
    wrench = np.random.default_rng(12).normal(0.0, 1.0, (ROWS, 6)) * ([2e-3] * 3 + [2e-5] * 3)
    for (first, last, force), point in zip(_PUSHES, POINTS, strict=True):
        wrench[first:last] += np.concatenate([force, np.cross(point, force)])
    return np.arange(ROWS) / RATE, np.column_stack([np.round(wrench[:, :3], 4), np.round(wrench[:, 3:], 6)])


TIME, WRENCH = _session()
PRESSED = np.any([(np.arange(ROWS) >= first) & (np.arange(ROWS) < last) for first, last, _ in _PUSHES], axis=0)
PLAIN = ("time", "fx", "fy", "fz", "tx", "ty", "tz")
FT = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
FM = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
Cells = Sequence[Sequence[str]]


@dataclass(frozen=True)
class Export:
    """A file.

    Args:
        name: of the file.
        form: whose it is, and where the form is from.
        data: its bytes.
        options: of `palpate rig new`.
        says: what `rig new` must say of it.
        refused: what `rig new` refuses it with; "" if it makes a rig.
        edit: a line of the rig to change, as (old, new), which `rig new` must have named.
        tolerance: [N, N m] by which wrenches may miss the session's, where the form has fewer digits.
    """

    name: str
    form: str
    data: bytes
    options: tuple[str, ...] = ()
    says: tuple[str, ...] = ()
    refused: str = ""
    edit: tuple[str, str] | None = None
    tolerance: tuple[float, float] = (1e-9, 1e-11)


def _cells(*columns: Sequence[object] | np.ndarray, decimal: str = ".") -> Cells:
    def text(each: object) -> str:
        return (each if isinstance(each, str) else f"{each:.12g}").replace(".", decimal)

    return list(zip(*([text(each) for each in column] for column in columns), strict=True))


def _wrench(force: float = 1.0, torque: float = 1.0, digits: int = 12) -> list[np.ndarray]:
    """Six columns, so many of a unit to a newton and a newton-metre."""
    scales = [force] * 3 + [torque] * 3
    return [np.round(column * scale, digits) for column, scale in zip(WRENCH.T, scales, strict=True)]


def _table(
    names: Sequence[str], cells: Cells, sep: str = ",", before: Sequence[str] = (), end: str = "\n", tail: str = ""
) -> str:
    header = [sep.join(names)] if names else []
    return end.join([*before, *header, *(sep.join(row) + tail for row in cells), ""])


def _time(scale: float = 1.0, start: float = 0.0) -> list[str]:
    return [f"{start + scale * time:.15g}" for time in TIME]


def _clock(text: str = "%H:%M:%S", sep: str = ".") -> list[str]:
    base = np.datetime64("2025-03-04T12:34:56.000")
    stamps = [base + np.timedelta64(round(1e3 * time), "ms") for time in TIME]
    return [each.item().strftime(text) + f"{sep}{each.item().microsecond // 1000:03d}" for each in stamps]


def _bracketed(unit: str, names: Sequence[str] = FT, force: str = "N", torque: str = "Nm") -> list[str]:
    return [f"{name} {unit[0]}{force if k < 3 else torque}{unit[1]}" for k, name in enumerate(names)]


def _ati(force: float = 1e6, torque: float = 1e6, units: str = "Nm", *, cut: bool = False, sep: str = ", ") -> str:
    """As the demo program of the Net F/T writes it: counts, a sequence, and what a count is before the names."""
    scale = {"Nm": 1.0, "Nmm": 1e3}[units]
    before = [
        "Start Time: 3/4/25, 12:34 PM",
        "RDT Sample Rate: 100",
        '"PLEASE NOTE: The sample rate is read when the program starts."',
        "Force Units: N",
        f"Counts per Unit Force: {force:.1f}",
        f"Torque Units: {units}",
        f"Counts per Unit Torque: {torque:.1f}",
    ]
    names = ["Status (hex)", "RDT Sequence", "F/T Sequence", *FT, "Time"]
    sequence = [f"{k + 1}" for k in range(ROWS)]
    status, clock = ["0x00000000"] * ROWS, [f"12:34:{56 + k // 100}" for k in range(ROWS)]
    cells = _cells(
        status, sequence, [f"{70 * (k + 1)}" for k in range(ROWS)], *_wrench(force, scale * torque, 0), clock
    )
    return _table(names, cells, sep, before[:2] if cut else before)


def _franka(*, both: bool) -> str:
    """As libfranka's logToCSV: arrays numbered from 0, the time in ms; wrenches are what the arm does to the world."""
    q = [f"state.q[{k}]" for k in range(7)]
    base = [f"state.O_F_ext_hat_K[{k}]" for k in range(6)]
    own = [f"state.K_F_ext_hat_K[{k}]" for k in range(6)]
    joints = [np.linspace(0, 1, ROWS).round(3)] * 7
    pose = np.eye(4)
    pose[:3, 3] = place = np.array([0.5, 0.1, 0.4])
    names, there = [f"state.O_T_EE[{k}]" for k in range(16)], np.tile(pose.T.ravel(), (ROWS, 1)).T
    about = -np.column_stack([WRENCH[:, :3], WRENCH[:, 3:] + np.cross(place, WRENCH[:, :3])])
    columns = [*joints, *there, *about.T, *(-WRENCH.T if both else [])]
    heads = ["duration", "success rate", *q, *names, *base, *(own if both else [])]
    return _table(heads, _cells(_time(1e3), ["1"] * ROWS, *columns))


def _lvm() -> str:
    """LabVIEW's measurement file: two headers that end in a line of their own."""
    before = [
        "LabVIEW Measurement", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t.", "***End_of_Header***", "",
        "Channels\t6", "Samples\t120\t120", "Delta_X\t0.010000", "***End_of_Header***",
    ]  # fmt: skip
    return _table(["X_Value", *_bracketed("[]"), "Comment"], _cells(_time(), *_wrench(), [""] * ROWS), "\t", before)


def _accelerated(names: Sequence[str], length: float) -> str:
    """An arm at rest whose accelerometer reads so much along z."""
    return _table([*PLAIN, *names], _cells(_time(), *_wrench(), ["0"] * ROWS, ["0.01"] * ROWS, [f"{length}"] * ROWS))


def _mixed() -> str:
    lines = _table(PLAIN, _cells(_time(), *_wrench())).split("\n")
    return "\n".join(line.replace(",", ";") if k in (20, 21) else line for k, line in enumerate(lines))


def _remarked() -> str:
    lines = _table(PLAIN, _cells(_time(), *_wrench())).split("\n")
    lines[40:40] = ["# gripper closed", "// and opened, at last"]
    return "\n".join(lines)


def _german() -> Cells:
    return _cells(_time(), *_wrench(), decimal=",")


_ROWS = _cells(_time(), *_wrench())
_BARE = _cells(*_wrench())
_ZERO = ["0"] * ROWS
_SEQUENCE = [f"{k}" for k in range(ROWS)]
_SAVETXT = [[f"{float(text):.18e}" for text in row] for row in _ROWS]
_ROS = tuple(f"{what}.{axis}" for what in ("force", "torque") for axis in "xyz")
_HEX = ("HS sequence", "FT sequence", "Status", *FT)
_NS = [f"{1_741_091_696_000_000_000 + round(1e9 * time)}" for time in TIME]
_PER_COUNT = 'units = { force = "N", torque = "N m" }'
_NO_UNIT = "states no unit"


def _file(
    name: str, form: str, text: str, options: Sequence[str] = (), says: Sequence[str] = (), *,
    encoding: str = "utf-8", **more: Any,
) -> Export:  # fmt: skip
    return Export(name, form, text.encode(encoding), tuple(options), tuple(says), **more)


READ = (  # what is read: most without a word, others with what they were taken for
    _file("plain.csv", "Palpate's own", _table(PLAIN, _ROWS)),
    _file("excel_de.csv", "Excel, German: semicolons and decimal commas", _table(PLAIN, _german(), ";")),
    _file("excel_de_units.csv", "Excel, German, a byte order mark and units in the names",
        _table(["Zeit [s]", *_bracketed("[]", FM)], _german(), ";", end="\r\n"), encoding="utf-8-sig"),
    _file("unicode_text.txt", "Excel, Unicode text: UTF-16, tabs",
        _table(["Time [s]", *_bracketed("[]")], _german(), "\t", end="\r\n"), encoding="utf-16"),
    _file("latin1.csv", "a German logger in Latin-1, times in microseconds",
        _table(["Zeit [\u00b5s]", *_bracketed("[]", FM)], _cells(_time(1e6), *_wrench()), ";"), encoding="latin-1"),
    _file("savetxt_header.txt", "numpy.savetxt with header=", _table(["# time", *PLAIN[1:]], _SAVETXT, " ")),
    _file("savetxt.txt", "numpy.savetxt without a header",
        _table((), _SAVETXT, " "), says=("without names", "in the order x, y, z, x, y, z")),
    _file("savetxt.csv", "numpy.savetxt, commas, header with #", _table(["# time", *PLAIN[1:]], _ROWS)),
    _file("matlab.txt", "MATLAB, names in a comment of %",
        _table(["% time", *(f"{name}_N" for name in FT[:3]), *(f"{name}_Nm" for name in FT[3:])], _ROWS, "  ")),
    _file("fixed_width.txt", "a Fortran-like logger: columns of spaces, units in the names",
        _table([f"{name:>12}" for name in ("t [s]", *_bracketed("[]"))],
            [[f"{text:>12}" for text in row] for row in _ROWS], " ")),
    _file("pandas.csv", "pandas.to_csv with its index", _table(["", *PLAIN], _cells(_SEQUENCE, _time(), *_wrench()))),
    _file("pandas_dates.csv", "pandas.to_csv with its index of dates, which has no name",
        _table(["", *FT], _cells(_clock("%Y-%m-%d %H:%M:%S"), *_wrench()))),
    _file("bars.txt", "a database's dump: bars", _table(PLAIN, _ROWS, "|"), says=("separated by bars",)),
    _file("remarks.csv", "a logger that writes remarks among the rows", _remarked()),
    _file("trailing.csv", "a logger that ends each row with a comma", _table(PLAIN, _ROWS, tail=",")),
    _file("quoted.csv", "a spreadsheet: decimal commas in quotes between commas",
        _table(PLAIN, [[f'"{text}"' for text in row] for row in _german()]), says=("decimal commas in quotes",)),
    _file("unit_row.csv", "a data logger: units in a row of their own",
        _table(["s", *["N"] * 3, *["Nm"] * 3], _ROWS, before=[",".join(["Time", *FT])]), says=("units in a row",)),
    _file("unit_row_first.csv", "the same with the units above the names",
        _table(["Time", *FT], _cells(_time(1e3), *_wrench(1e-3, 1e3)), before=["ms,kN,kN,kN,Nmm,Nmm,Nmm"])),
    _file("kistler.txt", "Kistler BioWare's text: lines on the file, names, a row of units, tabs",
        _table(["s", *["N"] * 3, *["N m"] * 3], _ROWS, "\t", ["File name:\trun.dat", "Sampling rate (Hz):\t100",
            "\t".join(["abs time (s)", *FM])])),
    _file("labview.lvm", "LabVIEW measurement file, tabs", _lvm()),
    _file("netft.csv", "ATI Net F/T, the Java demo (manual 9610-05-Ethernet Axia, demo CSV file format)",
        _ati(), says=("100 Hz",)),
    _file("netft_mm.csv", "ATI Net F/T configured for N mm", _ati(1e6, 1e3, "Nmm")),
    _file("schunk_ftn.csv", "SCHUNK FTN, which is ATI's Net F/T, between tabs", _ati(sep="\t")),
    _file("netft_python.csv", "a laboratory's logger of a Net F/T: all settings in one line",
        _table(["Time", "TimeStamp", *FT], _cells(_time(), _ZERO, *_wrench(1e6, 1e6, 0)),
            before=[
                "Force Units: N, Torque Units: Nmm, Counts per Unit Force: 1000000.0, Counts per Unit Torque: 1000"])),
    _file("daq_ft.csv", "ATI DAQ F/T .NET demo: no times, raw rate and averaging before the names",
        _table(FT, _BARE, before=["3/4/2025 12:34:56 PM", "Sample Rate: 10000", "Averaging: 100", "Force Units: N",
            "Torque Units: N-m"]), says=("100 Hz",)),
    _file("ati_lbf.csv", "ATI, configured for pounds and inches",
        _table(["Time (s)", *_bracketed("()", FT, "lbf", "lbf-in")], _cells(_time(),
            *_wrench(1 / 4.4482216152605, 1 / (4.4482216152605 * 0.0254))))),
    _file("node.csv", "a laboratory's logger of a Net F/T over HTTP",
        _table(["Current Time (ms)", *_bracketed("()")], _cells(_time(1e3), *_wrench()))),
    _file("bota.csv", "Bota, its serial protocol in a table: status, wrench, time stamp in us, temperature",
        _table(["status", *FM, "timestamp", "temperature"], _cells(_ZERO, *_wrench(), _time(1e6, 5e6),
            ["31.5"] * ROWS)), says=(_NO_UNIT, "taken for us")),
    _file("echo.csv", "rostopic echo -p of a Bota or ATI node",
        _table(["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id",
            *(f"field.wrench.{name}" for name in _ROS)], _cells(_NS, _SEQUENCE, _NS, ["ft"] * ROWS, *_wrench()))),
    _file("bagpy.csv", "bagpy: the time, and its stamp in two columns",
        _table(["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id",
            *(f"wrench.{name}" for name in _ROS)], _cells(_time(1.0, 1_741_091_696), _SEQUENCE, _ZERO, _ZERO,
            ["ft"] * ROWS, *_wrench()))),
    _file("plotjuggler.csv", "PlotJuggler's export",
        _table(["__time", *(f"/ft/wrench/{name.replace('.', '/')}" for name in _ROS)], _ROWS)),
    _file("robotiq.csv", "Robotiq FT 300: 0.01 N and 0.001 N m (manual, data stream)",
        _table(["Timestamp", *_bracketed("()", FM)], _cells(_time(), *_wrench(1, 1, 3))), tolerance=(6e-4, 6e-4)),
    _file("robotous.csv", "Robotous RFT: N and N m, an overload flag",
        _table(["Time[s]", *(f"{name}[N]" for name in FT[:3]), *(f"{name}[Nm]" for name in FT[3:]), "Overload"],
            _cells(_time(), *_wrench(), _ZERO))),
    _file("optoforce.csv", "OptoForce / OnRobot HEX: optoforce_ros, semicolons, units without a space",
        _table(["Time(s)", *(f"{name}(N)" for name in FT[:3]), *(f"{name}(Nm)" for name in FT[3:])], _ROWS, ";")),
    _file("franka.csv", "libfranka's log of an error: both external wrenches, time in ms",
        _franka(both=True), says=("stiffness frame K", "2 wrenches", _NO_UNIT, "taken for ms")),
    _file("franka_base.csv", "libfranka's log with the wrench in the base frame only",
        _franka(both=False), says=("base O", "does to the world"), tolerance=(1e-9, 1e-9)),
    _file("ur_rtde.csv", "UR RTDE record.py: spaces; the wrench along the base's axes",
        _table(["timestamp", *(f"actual_TCP_force_{k}" for k in range(6)), "qx", "qy", "qz", "qw"],
            _cells(_time(1, 900), *_wrench(), _ZERO, _ZERO, _ZERO, ["1"] * ROWS), " "), says=("axes of its base",)),
    _file("milliseconds.csv", "a microcontroller: integer milliseconds, no unit",
        _table(["t", *PLAIN[1:]], _cells(_time(1e3), *_wrench())), says=(_NO_UNIT, "taken for ms", "[time] unit")),
    _file("microseconds.csv", "a microcontroller: integer microseconds, no unit",
        _table(["t", *PLAIN[1:]], _cells(_time(1e6), *_wrench())), says=(_NO_UNIT, "taken for us")),
    _file("unix_ns.csv", "ROS stamps in nanoseconds", _table(["stamp", *PLAIN[1:]], _cells(_NS, *_wrench()))),
    _file("iso.csv", "ISO 8601 stamps",
        _table(["timestamp", *PLAIN[1:]], _cells(_clock("%Y-%m-%dT%H:%M:%S"), *_wrench()))),
    _file("date_de.csv", "dates as Germans write them",
        _table(["Zeitstempel", *FT], _cells(_clock("%d.%m.%Y %H:%M:%S"), *_wrench()), ";")),
    _file("clock.csv", "times of day", _table(["Time", *FT], _cells(_clock(), *_wrench()))),
    _file("rate.csv", "no times, the rate is known", _table(_bracketed("()"), _BARE), ("--rate", "100"), ("100 Hz",)),
    _file("counter.csv", "a sample counter, the rate is known",
        _table(["sample", *FT], _cells(_SEQUENCE, *_wrench())), ("--rate", "100"), ("100 Hz",)),
    _file("interval.csv", "an oscilloscope's preamble: the interval in it",
        _table(FT, _BARE, before=["Instrument,FT-7", "Sample Interval,0.01"]), says=("100 Hz",)),
    _file("two_sensors.csv", "two sensors in one table",
        _table(["time", *(f"ft{k}_{name.lower()}" for k in (1, 2) for name in FT)], _cells(_time(), *_wrench(),
            *_wrench(2.0, 2.0))), says=("2 wrenches", "ft2_fx", "in [force_torque]")),
    _file("hands.csv", "two hands",
        _table(["time", *(f"{hand}.{name}" for hand in ("left", "right") for name in _ROS)], _cells(_time(),
            *_wrench(), *_wrench(2.0, 2.0))), says=("right.force.x",)),
    _file("kilopond.csv", "an older bridge amplifier: kilopond",
        _table(["Time [s]", *_bracketed("[]", FT, "kp", "kgf cm")], _cells(_time(),
            *_wrench(1 / 9.80665, 100 / 9.80665)))),
    _file("milli.csv", "a small sensor: mN and mNm",
        _table(["Time (ms)", *_bracketed("()", FT, "mN", "mNm")], _cells(_time(1e3), *_wrench(1e3, 1e3)))),
    _file("axis_first.csv", "a testing machine: the axis before the word",
        _table(["Time [s]", *(f"{axis} {what}" for what in ("Force [N]", "Torque [Nm]") for axis in "XYZ")], _ROWS)),
    _file("kraft.csv", "a German test bench: words, DIN units",
        _table(["Zeit in s", *(f"Kraft {axis} in N" for axis in "XYZ"), *(f"Moment {axis} in Nm" for axis in "XYZ")],
            _german(), ";")),
    _file("six.csv", "an array of six in one table", _table(["time", *(f"wrench_{k}" for k in range(6))], _ROWS)),
    _file("torque_first.csv", "torques before forces",
        _table(["time", *FM[3:], *FM[:3]], _cells(_time(), *_wrench()[3:], *_wrench()[:3]))),
    _file("imu.csv", "an IMU's accelerations, named as those of a motion",
        _accelerated(("ax", "ay", "az"), 9.8), says=("of an IMU", "gravity is in it", "[acceleration] kind")),
    _file("imu_g.csv", "an IMU in g",
        _accelerated([f"imu_acc_{axis} [g]" for axis in "xyz"], 1.01), says=("of an IMU", "gravity is in it")),
    _file("imu_unnamed_g.csv", "an IMU in g that does not say so",
        _accelerated(("acc_x", "acc_y", "acc_z"), 0.99), says=("of an IMU", "g at the median")),
    _file("motion.csv", "a robot's own accelerations",
        _accelerated([f"linear_acceleration.{axis}" for axis in "xyz"], 0.1), says=("of the motion",)),
    _file("imu_counts.csv", "an accelerometer's counts",
        _accelerated(("ax", "ay", "az"), 16384), says=("not used", "neither gravity nor motion")),
    _file("wrapped.csv", "a counter of 16 bits that runs over",
        _table(["counter", *FT], _cells([f"{(65500 + k) % 65536}" for k in range(ROWS)], *_wrench())),
        ("--rate", "100"), ("100 Hz",)),
)  # fmt: skip

EDITED = (  # what is read after the line is changed that `rig new` names
    _file("millimetres.csv", "a Nano17 whose torques are N mm, which nothing says",
        _table(["time", *FM], _cells(_time(), *_wrench(1, 1e3))), says=("if torques are N mm",),
        edit=(_PER_COUNT, 'units = { force = "N", torque = "N mm" }')),
    _file("robotiq_registers.csv", "Robotiq FT 300 over Modbus: hundredths of N, thousandths of N m (manual)",
        _table(["time", *FM], _cells(_time(), *_wrench(100, 1000, 0))), says=("integers",), tolerance=(6e-3, 6e-4),
        edit=(_PER_COUNT, 'units = { force = "N/100", torque = "N m/1000" }')),
    _file("onrobot_udp.csv", "OnRobot HEX over UDP: 10,000 counts a N, 100,000 a N m, no times (unseen)",
        _table(_HEX, _cells(_SEQUENCE, _SEQUENCE, _ZERO, *_wrench(1e4, 1e5, 0))), ("--rate", "100"), ("integers",),
        edit=(_PER_COUNT, 'units = { force = "N/10000", torque = "N m/100000" }'), tolerance=(1e-4, 1e-5)),
    _file("netft_cut.csv", "ATI Net F/T without the lines that say what a count is",
        _ati(cut=True), says=("integers",),
        edit=(_PER_COUNT, 'units = { force = "N/1000000", torque = "N m/1000000" }')),
)  # fmt: skip

REFUSED = (
    _file("volts.csv", "a bridge amplifier's volts",
        _table(["time", *_bracketed("[]", FT, "V", "V")], _ROWS), refused="unknown unit 'V'"),
    _file("two_units.csv", "a header that contradicts itself",
        _table(["time", "Fx [N]", "Fy [lbf]", "Fz [N]", *FT[3:]], _ROWS), refused="different units"),
    _file("unit_row_other.csv", "a row of units that contradicts the names",
        _table(["s", *["lbf"] * 3, *["Nm"] * 3], _ROWS, before=[",".join(["Time", *_bracketed("[]")])]),
        refused="unknown unit 'N and lbf'"),
    _file("minutes.csv", "times in minutes", _table(["Time [min]", *FT], _ROWS), refused="unknown unit 'min'"),
    _file("thousands.csv", "thousands parted by commas",
        _table(FT, [[f"{1e4 * float(text):,.1f}" for text in row] for row in _BARE], ";"),
        refused="separator between thousands"),
    _file("either.csv", "a comma that may be a decimal point or part thousands",
        _table(PLAIN, [["1,500", "2,250", "3,125", "4,500", "5,250", "6,125", "7,500"]] * ROWS, ";"),
        refused="the comma can be"),
    _file("commas.csv", "decimal commas between commas, without quotes",
        _table(PLAIN, _german()), refused="If decimal points are commas"),
    _file("twice.csv", "one name twice",
        _table([*PLAIN, "fx"], _cells(_time(), *_wrench(), _ZERO)), refused="'fx' occurs 2 times"),
    _file("counted.csv", "a counter whose rate nobody says",
        _table(["sample", *FT], _cells(_SEQUENCE, *_wrench())), refused="--rate HZ"),
    _file("pandas_index.csv", "pandas.to_csv with an index and no times",
        _table(["", *FT], _cells(_SEQUENCE, *_wrench())), refused="'column_1' counts the samples"),
    _file("untimed.csv", "no times", _table(FT, _BARE), refused="--rate HZ"),
    _file("ros2_stamp.csv", "a ROS 2 stamp in two columns, and no other time",
        _table(["header.stamp.sec", "header.stamp.nanosec", *(f"wrench.{name}" for name in _ROS)],
            _cells(["1741091696"] * ROWS, [f"{round(1e9 * time) % 1_000_000_000}" for time in TIME], *_wrench())),
        refused="two columns"),
    _file("us_dates.csv", "dates whose day and month are ambiguous",
        _table(["Time", *FT], _cells(_clock("%m/%d/%Y %H:%M:%S"), *_wrench())), refused="'Time' has no numbers"),
    _file("column.txt", "one column", _table(["fx"], _cells(_wrench()[0])), refused="is not a log of any of"),
    _file("forces.csv", "forces without torques",
        _table(["time", *FT[:3]], _cells(_time(), *_wrench()[:3])), refused="is not a log of any of"),
)  # fmt: skip

NOTED = (  # read, of which rows or fields are lost, which every command says
    _file("mixed.csv", "two rows of another delimiter", _mixed(), says=("do not have 7 fields",)),
)

EXPORTS = {export.name: export for export in (*READ, *EDITED, *REFUSED, *NOTED)}
